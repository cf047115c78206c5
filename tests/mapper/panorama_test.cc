// SPDX-License-Identifier: BSD-3-Clause
// Cameras with a common center and fields of view of half the sphere and more.
#include <gtest/gtest.h>

#include "geometry/so3.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/model_comparison.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

Rigid3 Turned(double yaw_deg) {
  return {ExpSO3({0.0, DegToRad(yaw_deg), 0.0}), Vector3d::Zero()};
}

// Field of view of 229 degrees.
SimulatedCamera WideFisheye(const std::string& prefix, double yaw_deg) {
  return {prefix,
          CameraModelId::kOpenCVFisheye,
          1000,
          1000,
          {250.0, 250.0, 500.0, 500.0, 0.0, 0.0, 0.0, 0.0},
          Turned(yaw_deg)};
}

SimulatedCamera Sphere(const std::string& prefix, double yaw_deg) {
  return {prefix,
          CameraModelId::kEquirectangular,
          1600,
          800,
          {1600.0, 800.0},
          Turned(yaw_deg)};
}

void ExpectRecovered(const std::vector<SimulatedCamera>& rig, bool is_known) {
  SimulationOptions options;
  options.path = PathPreset::kCurve;
  options.num_frames = 15;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = 0.5;
  options.mismatch_ratio = 0.05;
  options.extrinsics_are_known = is_known;
  SimulationInput input;
  input.rig = rig;
  const Simulation simulation = Simulate(options, input);
  // Some features are more than 90 degrees off the optical axis.
  bool sees_behind = false;
  for (const Point3D& point : simulation.ground_truth.points) {
    for (const Observation& o : point.track) {
      const Rigid3& pose = simulation.cam_from_world[o.image_idx];
      sees_behind |= (pose * point.point_in_world).z() < 0.0;
    }
  }
  EXPECT_TRUE(sees_behind);
  const MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph}, {}, {});
  ASSERT_EQ(result.models.size(), 1u);
  const Reconstruction& model = result.models[0].reconstruction;
  const ModelDifference difference =
      CompareModels(simulation.scene, model, simulation.ground_truth);
  EXPECT_EQ(difference.num_images,
            static_cast<int>(simulation.scene.images.size()));
  EXPECT_LT(difference.max_rotation_deg, 0.2);
  EXPECT_LT(difference.max_position, 0.1);
  for (size_t k = 1; k < rig.size(); ++k) {
    EXPECT_LT(model.sensor_from_rig[k]->translation.norm() * difference.scale,
              is_known ? 1e-12 : 0.05);
  }
}

TEST(Panorama, WideFisheyesBackToBack) {
  for (const bool is_known : {false, true}) {
    ExpectRecovered({WideFisheye("cam0/", 0.0), WideFisheye("cam1/", 180.0)},
                    is_known);
  }
}

TEST(Panorama, EquirectangularBesideFisheye) {
  for (const bool is_known : {false, true}) {
    ExpectRecovered({Sphere("cam0/", 0.0), WideFisheye("cam1/", 90.0)},
                    is_known);
  }
}

TEST(Panorama, OneEquirectangularCamera) {
  ExpectRecovered({Sphere("cam0/", 0.0)}, false);
}

}  // namespace
}  // namespace mgsfm
