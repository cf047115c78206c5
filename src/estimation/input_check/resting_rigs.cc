// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/resting_rigs.h"

#include <algorithm>
#include <map>
#include <string>

#include "base/format.h"

namespace mgsfm {
namespace {

// Collapsed models have at least 0.98, other models at most 0.08
// (docs/results/input_check.md). A rig that stands for most of a recording and
// then moves is no finding.
constexpr double kMinShareAtRest = 0.9;

// Counts all observations but the first of each point.
struct RestCount {
  size_t num_observations = 0;
  size_t num_at_rest = 0;

  double Share() const {
    return num_observations == 0 ? 0.0
                                 : static_cast<double>(num_at_rest) /
                                       static_cast<double>(num_observations);
  }
};

RestCount CountAtRest(const Scene& scene, const Reconstruction& model,
                      double max_distance_px) {
  RestCount count;
  for (const Point3D& point : model.points) {
    std::map<int, Eigen::Vector2f> first_of_sensor;
    for (const Observation& observation : point.track) {
      const Image& image = scene.images[observation.image_idx];
      const Eigen::Vector2f& keypoint =
          image.keypoints_px[observation.keypoint_idx];
      const auto [first, is_first] =
          first_of_sensor.emplace(image.sensor_idx, keypoint);
      if (is_first) continue;
      count.num_at_rest +=
          static_cast<double>((keypoint - first->second).norm()) <=
          max_distance_px;
    }
    count.num_observations += std::max<size_t>(point.track.size(), 1) - 1;
  }
  return count;
}

}  // namespace

std::vector<Finding> FindRestingRig(const Scene& scene, size_t model_idx,
                                    const Reconstruction& model,
                                    double max_error_px) {
  const RestCount count = CountAtRest(scene, model, 2.0 * max_error_px);
  if (count.Share() < kMinShareAtRest) return {};
  const std::string share = Formatted("%.0f %%", 100.0 * count.Share());
  return {{Cause::kRestingRig,
           {},
           {},
           {{"share_at_rest", count.Share()},
            {"num_observations", static_cast<double>(count.num_observations)}},
           "the rig stands still in model " + std::to_string(model_idx) + ": " +
               share +
               " of its observations lie where another image of the "
               "same camera shows the point",
           "if the rig moved, these points move along with it: mask them "
           "(camera_mask_path), and take images at shorter intervals"}};
}

}  // namespace mgsfm
