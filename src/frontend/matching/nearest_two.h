// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "matching/descriptor_matching.h"
#include "matching/descriptor_products.h"

namespace mgsfm {

// The nearest neighbor of a descriptor in another image, i.e. the descriptor
// with the largest dot product (ties go to the first), and the second largest
// dot product. Dense ints, because the kernel fills one per descriptor: dot
// products are non-negative, so kNone compares below all of them.
struct TwoNearest {
  static constexpr int32_t kNone = -1;
  int32_t best_idx = kNone;
  int32_t best_dot = kNone;
  int32_t second_dot = kNone;
};

// Exact two nearest neighbors of all descriptors of both images: all dot
// products in integer arithmetic, 128 |1| |2| multiplications. They are
// computed in tiles that stay in registers and cache and serve both directions.
// Uses AVX2 where available, with the same result.
void FindTwoNearest(DescriptorView descriptors1, DescriptorView descriptors2,
                    std::vector<TwoNearest>* nearest_of_1,
                    std::vector<TwoNearest>* nearest_of_2);

// The same for descriptors packed in the layout of `functions`. Overwrites the
// outputs.
template <class Row, class Column>
void FindTwoNearestOfPacked(const TileFunctions<Row, Column>& functions,
                            const std::vector<Row>& rows, size_t num_rows,
                            const std::vector<Column>& columns,
                            size_t num_columns,
                            std::vector<TwoNearest>* nearest_of_rows,
                            std::vector<TwoNearest>* nearest_of_columns);

// Contiguous rows, padded with zeros to whole tiles.
template <class Row>
std::vector<Row> PackRows(DescriptorView descriptors) {
  const size_t num_tiles = (descriptors.size + kTileRows - 1) / kTileRows;
  std::vector<Row> rows(num_tiles * kTileRows * kNumDims, 0);
  std::copy_n(descriptors.data, descriptors.size * kNumDims, rows.begin());
  return rows;
}

// Columns in blocks, padded in the same way; value(i, k) is dimension k of
// descriptor i. The factors are left zero.
template <class Functions, class Column, class Value>
std::vector<Column> PackColumns(size_t size, const Value& value) {
  constexpr size_t kGroupSize = Functions::kGroupSize;
  const size_t num_blocks = (size + kTileColumns - 1) / kTileColumns;
  std::vector<Column> blocks(num_blocks * Functions::kBlockSize, 0);
  for (size_t i = 0; i < size; ++i) {
    Column* block = blocks.data() + i / kTileColumns * Functions::kBlockSize;
    const size_t column = i % kTileColumns;
    for (size_t group = 0; group < kNumDims / kGroupSize; ++group) {
      for (size_t k = 0; k < kGroupSize; ++k) {
        block[(group * kTileColumns + column) * kGroupSize + k] =
            value(i, group * kGroupSize + k);
      }
    }
  }
  return blocks;
}

// The decision of a descriptor about its nearest neighbor in the other image,
// if approximate dot products determine it.
struct RoughDecision {
  enum class State {
    kRejects,  // accepts no descriptor
    kAccepts,  // accepts best_idx
    kUnsure,   // needs exact dot products
  };
  State state = State::kUnsure;
  std::optional<int32_t> best_idx;  // the nearest neighbor, if it is certain
};

struct RoughDecisions {
  std::vector<RoughDecision> of_1;
  std::vector<RoughDecision> of_2;
};

// Whether a descriptor with these largest dot products accepts its nearest
// neighbor. Must not become true as second_dot increases.
using AcceptanceTest = std::function<bool(int32_t best_dot, double second_dot)>;

// Decides most descriptors by dot products of descriptors a of image 1 with
// descriptors b of image 2 rounded to multiples of about 4. This takes half the
// time of exact products. Write b = s c + h with c the rounded descriptor and s
// = b.c / c.c, so that h is orthogonal to c. With m = s |c| and y = s a.c, only
// the component of a orthogonal to c contributes to a.h:
//   | a.b - y | = | a.h | <= |h| sqrt(|a|^2 - (y / m)^2).
// These bounds are strict, so decisions equal those with exact dot products.
//
// Returns nullopt if the processor lacks AVX2 or if the norms exceed those of
// SIFT, so that 16-bit sums could overflow.
std::optional<RoughDecisions> DecideRoughly(DescriptorView descriptors1,
                                            DescriptorView descriptors2,
                                            const AcceptanceTest& accepts);

}  // namespace mgsfm
