// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "matching/descriptor_products.h"
#include "mgsfm/matching/matching_options.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

class TileSelection;

// SIFT descriptors of an image in COLMAP's format: rows of 128 bytes whose
// Euclidean norm is about 512. Does not own the data.
struct DescriptorView {
  static constexpr size_t kDim = 128;
  const uint8_t* data = nullptr;
  size_t size = 0;  // number of rows

  const uint8_t* Row(size_t i) const { return data + i * kDim; }
};

// Matches two images by exact nearest neighbors, sorted by the first keypoint.
// The distance of two descriptors is the angle arccos(dot / 512^2). Descriptor
// i accepts its nearest neighbor j if
//   d(i, j) <= max_distance  and  d(i, j) < max_ratio d(i, second nearest);
// with cross_check, j must also accept i. Ties go to the smaller index.
//
// With `tiles`, only neighbors in selected tiles are compared.
//
// Cost: 128 |1| |2| multiplications; one pass serves both directions.
// The matches are the same for all instruction sets of the processor.
[[nodiscard]] std::vector<Match> MatchDescriptors(
    DescriptorView descriptors1, DescriptorView descriptors2,
    const DescriptorMatchingOptions& options,
    InstructionSet set = FastestInstructionSet(),
    const TileSelection* tiles = nullptr);

}  // namespace mgsfm
