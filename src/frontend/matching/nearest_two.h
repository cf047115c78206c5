// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <vector>

#include "matching/descriptor_matching.h"
#include "matching/descriptor_products.h"
#include "mgsfm/base/mask.h"

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

struct TwoNearestOfPair {
  std::vector<TwoNearest> of_1;
  std::vector<TwoNearest> of_2;
};

// The tiles whose products a search computes: kTileRows descriptors of image 1
// and kTileColumns of image 2.
class TileSelection {
 public:
  TileSelection(size_t num_descriptors1, size_t num_descriptors2)
      : num_columns_((num_descriptors2 + kTileColumns - 1) / kTileColumns),
        is_selected_((num_descriptors1 + kTileRows - 1) / kTileRows *
                     num_columns_) {}

  // Selects the tiles of `row` that contain descriptors begin to end - 1.
  void Select(size_t row, size_t begin, size_t end) {
    if (begin >= end) return;
    const size_t first = row * num_columns_;
    is_selected_.Fill(first + begin / kTileColumns,
                      first + (end - 1) / kTileColumns + 1, true);
  }
  bool IsSelected(size_t row, size_t column) const {
    return is_selected_[row * num_columns_ + column];
  }

 private:
  size_t num_columns_;
  Mask is_selected_;
};

// The exact two nearest neighbors of all descriptors of both images, by all dot
// products: 128 |1| |2| multiplications. Products are computed in tiles that
// stay in registers and cache and serve both directions. With `tiles`, only
// selected tiles are searched.
// The result is the same for all instruction sets.
TwoNearestOfPair FindTwoNearest(DescriptorView descriptors1,
                                DescriptorView descriptors2, InstructionSet set,
                                const TileSelection* tiles = nullptr);

// Whether a descriptor with these largest dot products accepts its nearest
// neighbor. Must not become true as second_dot increases.
using AcceptanceTest = std::function<bool(int32_t best_dot, double second_dot)>;

// The descriptors of the other image that descriptors accept, or kNone.
struct Accepted {
  std::vector<int32_t> of_1;
  // kNone is also possible if no descriptor of image 1 accepts one.
  std::vector<int32_t> of_2;
};

// The result is the same for all instruction sets. With AVX2, and norms of
// SIFT, with which 16-bit sums cannot overflow, most decisions use dot products
// of descriptors a of image 1 with descriptors b of image 2 rounded to
// multiples of about 4. This takes a third of the time of exact products. Write
// b = s c + h with c the rounded descriptor and s = b.c / c.c, so that h is
// orthogonal to c. With m = s |c| and y = s a.c, only the component of a
// orthogonal to c contributes to a.h:
//   | a.b - y | = | a.h | <= |h| sqrt(|a|^2 - (y / m)^2).
// These bounds are strict. Decisions that they leave open use exact products.
// With `tiles`, only selected tiles are searched.
Accepted FindAccepted(DescriptorView descriptors1, DescriptorView descriptors2,
                      InstructionSet set, const AcceptanceTest& accepts,
                      const TileSelection* tiles = nullptr);

}  // namespace mgsfm
