// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <vector>

#include "base/random.h"
#include "bundle_adjustment/problem_builder.h"
#include "estimation/rig_solver/rig_fixtures.h"
#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {

inline SimulationOptions SmallScene(RigPreset rig, PathPreset path) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  // On a loop of ten frames, one camera observes few points twice.
  options.num_frames = rig == RigPreset::kMono ? 24 : 10;
  options.num_points_per_frame = 80;
  options.max_num_features_per_image = 150;
  return options;
}

inline Eigen::Vector2d ProjectPoint(const BundleProblem& problem,
                                    const BundleState& state, int image_idx,
                                    const Eigen::Vector3d& point) {
  const int camera = problem.images[image_idx].camera;
  return ProjectToPixel(problem.cameras[camera].model,
                        state.cameras[camera].data(),
                        PointInCamera(problem, state, image_idx, point))
      .value();
}

// The problem of the ground truth without noise, but for the rounding of pixels
// to single precision.
inline BuiltProblem ExactProblem(const Simulation& simulation,
                                 const BundleAdjustmentOptions& options) {
  BuiltProblem built = BuildProblem(simulation.scene, simulation.ground_truth,
                                    options, RefinedParts::kAll);
  BundleProblem& problem = built.problem;
  for (size_t p = 0; p < problem.num_points(); ++p) {
    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      auto& observation = problem.observations[o];
      observation.pixel = ProjectPoint(problem, built.state, observation.image,
                                       built.state.points[p])
                              .cast<float>();
    }
  }
  return built;
}

// The largest cost of the ground truth that the rounding of pixels below 2048
// causes.
inline double RoundingCost(const BundleProblem& problem) {
  constexpr double kMaxRounding = 0x1p-14;
  return static_cast<double>(problem.observations.size()) * kMaxRounding *
         kMaxRounding;
}

// The tracks of the points as groups, `num_joined` points in each.
inline ObservationGroups GroupTracks(const Reconstruction& reconstruction,
                                     size_t num_joined = 1) {
  ObservationGroups groups;
  for (size_t i = 0; i < reconstruction.points.size(); ++i) {
    const auto& track = reconstruction.points[i].track;
    groups.observations.insert(groups.observations.end(), track.begin(),
                               track.end());
    if ((i + 1) % num_joined != 0) continue;
    std::sort(groups.observations.begin() + groups.offsets.back(),
              groups.observations.end());
    groups.FinishGroup();
  }
  groups.observations.resize(groups.offsets.back());
  return groups;
}

// Draws new noise for the keypoints of the same points.
inline void DrawNoise(double sigma_px, Random* random, Simulation* simulation) {
  for (const Point3D& point : simulation->ground_truth.points) {
    for (const Observation& o : point.track) {
      Image& image = simulation->scene.images[o.image_idx];
      const Camera& camera = simulation->scene.cameras[image.camera_idx];
      const Eigen::Vector2d pixel =
          *ProjectToPixel(camera.model, camera.params.data(),
                          *simulation->ground_truth.CamFromWorld(
                              simulation->scene, o.image_idx) *
                              point.point_in_world) +
          sigma_px * Eigen::Vector2d(random->Normal(), random->Normal());
      image.keypoints_px[o.keypoint_idx] = pixel.cast<float>();
    }
  }
}

// Perturb() for a reconstruction, without intrinsics.
inline Reconstruction Perturbed(const Scene& scene,
                                const Reconstruction& reconstruction,
                                double size, uint64_t seed) {
  Random random(seed);
  Reconstruction result = reconstruction;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    if (scene.sensors[i].sensor_from_rig || !result.sensor_from_rig[i]) {
      continue;
    }
    Rigid3& pose = *result.sensor_from_rig[i];
    pose.rotation = ExpSO3(RandomVector(0.1 * size, &random)) * pose.rotation;
    pose.translation += RandomVector(size, &random);
  }
  for (auto& pose : result.rig_from_world) {
    if (!pose) continue;
    pose = Rigid3::FromRotationAndCenter(
        ExpSO3(RandomVector(0.1 * size, &random)) * pose->rotation,
        pose->Center() + RandomVector(size, &random));
  }
  for (Point3D& point : result.points) {
    point.point_in_world += RandomVector(size, &random);
  }
  return result;
}

}  // namespace mgsfm
