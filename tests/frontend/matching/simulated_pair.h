// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <vector>

#include "base/random.h"
#include "matching/two_view_verification.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {

inline Camera MakeCamera(CameraModelId model, int width, int height,
                         std::vector<double> params, bool has_prior = true) {
  return {CameraId(1), model, width, height, std::move(params), has_prior};
}

inline std::vector<std::optional<Eigen::Vector3d>> RaysOf(
    const Camera& camera, const std::vector<Eigen::Vector2f>& keypoints) {
  std::vector<std::optional<Eigen::Vector3d>> rays;
  for (const Eigen::Vector2f& keypoint : keypoints) {
    rays.push_back(RayFromPixel(camera.model, camera.params.data(),
                                keypoint.cast<double>()));
  }
  return rays;
}

// One image of a pair.
struct SimulatedView {
  Camera camera = MakeCamera(CameraModelId::kSimplePinhole, 1, 1, {1, 0, 0});
  std::vector<Eigen::Vector2f> keypoints;
  std::vector<std::optional<Eigen::Vector3d>> rays;

  VerificationView View() const { return {&camera, &keypoints, &rays}; }
};

struct SimulatedPair {
  SimulatedView view1, view2;
  std::vector<Match> matches;  // the first `num_true` are correct
  size_t num_true = 0;
};

inline bool IsInImage(const Camera& camera, const Eigen::Vector2d& pixel) {
  return pixel.x() >= 0.0 && pixel.y() >= 0.0 && pixel.x() <= camera.width_px &&
         pixel.y() <= camera.height_px;
}

struct PairSimulationOptions {
  size_t num_true = 150;
  size_t num_false = 50;
  double noise_px = 0.5;
};

// Matches of points from `draw_point` (in camera 1) that both cameras see, and
// false matches anywhere in the images.
inline SimulatedPair SimulatePair(
    const Camera& camera, const Rigid3& cam2_from_cam1,
    const PairSimulationOptions& options, Random* random,
    const std::function<Eigen::Vector3d(Random*)>& draw_point) {
  SimulatedPair pair;
  pair.view1.camera = pair.view2.camera = camera;
  const auto add = [&](const Eigen::Vector2d& pixel1,
                       const Eigen::Vector2d& pixel2) {
    const auto idx = static_cast<uint32_t>(pair.view1.keypoints.size());
    pair.view1.keypoints.emplace_back(pixel1.cast<float>());
    pair.view2.keypoints.emplace_back(pixel2.cast<float>());
    pair.matches.push_back({idx, idx});
  };
  const auto noise = [&]() -> Eigen::Vector2d {
    return options.noise_px *
           Eigen::Vector2d(random->Normal(), random->Normal());
  };
  while (pair.matches.size() < options.num_true) {
    const Eigen::Vector3d point = draw_point(random);
    const auto pixel1 =
        ProjectToPixel(camera.model, camera.params.data(), point);
    const auto pixel2 = ProjectToPixel(camera.model, camera.params.data(),
                                       cam2_from_cam1 * point);
    if (!pixel1 || !pixel2 || !IsInImage(camera, *pixel1) ||
        !IsInImage(camera, *pixel2)) {
      continue;
    }
    add(*pixel1 + noise(), *pixel2 + noise());
  }
  pair.num_true = options.num_true;
  const auto anywhere = [&]() -> Eigen::Vector2d {
    return {random->Uniform(0.0, camera.width_px),
            random->Uniform(0.0, camera.height_px)};
  };
  for (size_t i = 0; i < options.num_false; ++i) add(anywhere(), anywhere());
  pair.view1.rays = RaysOf(camera, pair.view1.keypoints);
  pair.view2.rays = RaysOf(camera, pair.view2.keypoints);
  return pair;
}

inline Eigen::Vector3d DrawInBox(Random* random) {
  return {random->Uniform(-8.0, 8.0), random->Uniform(-6.0, 6.0),
          random->Uniform(5.0, 20.0)};
}

inline Eigen::Vector3d DrawOnPlane(Random* random) {
  const double x = random->Uniform(-6.0, 6.0), y = random->Uniform(-5.0, 5.0);
  return {x, y, 10.0 + 0.4 * x - 0.3 * y};
}

// Points in all directions, including behind the camera.
inline Eigen::Vector3d DrawAround(Random* random) {
  Eigen::Vector3d direction(random->Normal(), random->Normal(),
                            random->Normal());
  return random->Uniform(4.0, 15.0) * direction.normalized();
}

}  // namespace mgsfm
