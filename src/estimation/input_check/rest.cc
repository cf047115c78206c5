// SPDX-License-Identifier: BSD-3-Clause
#include "input_check/rest.h"

#include <algorithm>
#include <cstddef>
#include <map>

namespace mgsfm {

double ShareAtRest(const Scene& scene, const Reconstruction& model,
                   double max_error_px) {
  size_t num_observations = 0, num_at_rest = 0;
  for (const Point3D& point : model.points) {
    std::map<int, Eigen::Vector2f> first_of_sensor;
    for (const Observation& observation : point.track) {
      const Image& image = scene.images[observation.image_idx];
      const Eigen::Vector2f& keypoint =
          image.keypoints_px[observation.keypoint_idx];
      const auto [first, is_first] =
          first_of_sensor.emplace(image.sensor_idx, keypoint);
      if (is_first) continue;
      num_at_rest += static_cast<double>((keypoint - first->second).norm()) <=
                     2.0 * max_error_px;
    }
    num_observations += std::max<size_t>(point.track.size(), 1) - 1;
  }
  return num_observations == 0 ? 0.0
                               : static_cast<double>(num_at_rest) /
                                     static_cast<double>(num_observations);
}

}  // namespace mgsfm
