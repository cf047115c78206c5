// SPDX-License-Identifier: BSD-3-Clause
#include "matching/descriptor_matching.h"

#include <algorithm>
#include <cmath>

#include "matching/nearest_two.h"

namespace mgsfm {
namespace {

// Descriptors have a norm of 512 up to the rounding of their elements.
constexpr double kSquaredNorm = 512.0 * 512.0;

// Tests whether a descriptor accepts its nearest neighbor.
class Acceptance {
 public:
  explicit Acceptance(const DescriptorMatchingOptions& options)
      : max_ratio_(options.max_ratio), max_distance_(options.max_distance) {}

  bool operator()(double best_dot, double second_dot) const {
    const double distance = Angle(best_dot);
    return distance <= max_distance_ &&
           distance < max_ratio_ * Angle(second_dot);
  }

 private:
  static double Angle(double dot) {
    return std::acos(std::clamp(dot / kSquaredNorm, 0.0, 1.0));
  }
  const double max_ratio_;
  const double max_distance_;
};

}  // namespace

std::vector<Match> MatchDescriptors(DescriptorView descriptors1,
                                    DescriptorView descriptors2,
                                    const DescriptorMatchingOptions& options,
                                    InstructionSet set,
                                    const TileSelection* tiles) {
  const auto max_size = static_cast<size_t>(options.max_num_matches);
  descriptors1.size = std::min(descriptors1.size, max_size);
  descriptors2.size = std::min(descriptors2.size, max_size);
  const Accepted accepted =
      FindAccepted(descriptors1, descriptors2, set, Acceptance(options), tiles);
  std::vector<Match> matches;
  for (size_t i = 0; i < accepted.of_1.size(); ++i) {
    const int32_t j = accepted.of_1[i];
    if (j == TwoNearest::kNone) continue;
    if (options.cross_check && accepted.of_2[j] != static_cast<int32_t>(i)) {
      continue;
    }
    matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(j)});
  }
  return matches;
}

}  // namespace mgsfm
