// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// SIFT descriptors of an image in COLMAP's format: rows of 128 bytes whose
// Euclidean norm is about 512. Does not own the data.
struct DescriptorView {
  static constexpr size_t kDim = 128;
  const uint8_t* data = nullptr;
  size_t size = 0;  // number of rows

  const uint8_t* Row(size_t i) const { return data + i * kDim; }
};

// Names and defaults are COLMAP's.
struct DescriptorMatchingOptions {
  Option<double> max_ratio{
      "max_ratio", 0.8, GreaterThan(0.0),
      "Maximum distance ratio between the best and the second best match. "
      "Decrease it if structures repeat."};
  Option<double> max_distance{
      "max_distance", 0.7, GreaterThan(0.0), "rad",
      "Maximum distance to the best match, as the angle between the "
      "descriptors."};
  Option<bool> cross_check{
      "cross_check", true,
      "Keep a match only if each descriptor is the best match of the other."};
  Option<int> max_num_matches{
      "max_num_matches", 32768, AtLeast(1), "features",
      "Maximum number of features matched per image; those after it in the "
      "database are ignored."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(max_ratio, max_distance, cross_check, max_num_matches);
  }
};

// Matches two images by exact nearest neighbours, sorted by the first keypoint.
// The distance of two descriptors is the angle arccos(dot / 512^2). Descriptor
// i accepts its nearest neighbour j if
//   d(i, j) <= max_distance  and  d(i, j) < max_ratio d(i, second nearest);
// with cross_check, j must accept i as well. Ties go to the smaller index.
//
// Cost: 128 |1| |2| integer multiplications; one pass serves both directions.
[[nodiscard]] std::vector<Match> MatchDescriptors(
    DescriptorView descriptors1, DescriptorView descriptors2,
    const DescriptorMatchingOptions& options);

}  // namespace mgsfm
