// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// SIFT descriptors of an image as COLMAP stores them: rows of 128 bytes whose
// Euclidean norm is about 512.
struct DescriptorView {
  static constexpr size_t kDim = 128;
  const uint8_t* data = nullptr;
  size_t size = 0;  // rows

  const uint8_t* Row(size_t i) const { return data + i * kDim; }
};

struct DescriptorMatchingOptions {
  double max_ratio = 0.8;
  double max_distance = 0.7;
  bool cross_check = true;
  int max_num_matches = 32768;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("max_ratio", self.max_ratio, GreaterThan(0.0), "",
          "Largest ratio of the distances to the nearest and to the second "
          "nearest descriptor.");
    visit("max_distance", self.max_distance, GreaterThan(0.0), "rad",
          "Largest distance of matched descriptors.");
    visit("cross_check", self.cross_check, AnyValue(), "",
          "Matches must be nearest to each other.");
    visit("max_num_matches", self.max_num_matches, AtLeast(1), "features",
          "At most so many features of an image, its first, are matched.");
  }
};

// The two nearest of another image: those with the largest dot products, the
// first of equal ones. -1 where there is none.
struct TwoNearest {
  int32_t best_idx = -1;
  int32_t best_dot = -1;
  int32_t second_dot = -1;
};

// Of every descriptor of either image, exactly: all dot products, in integers,
// 128 |1| |2| multiplications. They are made in tiles that stay in registers
// and cache and serve both directions at once; with AVX2 where the processor
// has it, with the same result.
void FindTwoNearest(DescriptorView descriptors1, DescriptorView descriptors2,
                    std::vector<TwoNearest>* nearest_of_1,
                    std::vector<TwoNearest>* nearest_of_2);

// Matches sorted by the first keypoint. The distance of two descriptors is
// their angle, arccos(dot / 512^2). A descriptor i accepts its nearest j if
//   d(i, j) <= max_distance  and  d(i, j) < max_ratio d(i, second nearest);
// with cross check, j must accept i as well.
std::vector<Match> MatchDescriptors(DescriptorView descriptors1,
                                    DescriptorView descriptors2,
                                    const DescriptorMatchingOptions& options);

}  // namespace mgsfm
