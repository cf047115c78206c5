// SPDX-License-Identifier: BSD-3-Clause
#include "soft_rig/shared_calibration.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "geometry/so3.h"
#include "mapper/run_summary.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/model_comparison.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

constexpr int kFirstOfSecond = 18;  // of 30 frames

SimulationOptions DriveOptions(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.path = PathPreset::kLoop;
  options.num_frames = 30;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = 0.5;
  options.mismatch_ratio = 0.05;
  return options;
}

bool IsInSecond(const Scene& scene, int image_idx) {
  return scene.images[image_idx].frame_idx >= kFirstOfSecond;
}

// Removes the pairs between two parts of a drive.
Simulation WithoutLink(Simulation simulation) {
  std::vector<ImagePair> kept;
  for (ImagePair& pair : simulation.view_graph.pairs) {
    if (IsInSecond(simulation.scene, pair.image_idx1) ==
        IsInSecond(simulation.scene, pair.image_idx2)) {
      kept.push_back(std::move(pair));
    }
  }
  simulation.view_graph.pairs = std::move(kept);
  return simulation;
}

MapperResult Map(const Simulation& simulation) {
  MapperOptions options;
  options.compute_covariances = true;
  return RunMapper({simulation.scene, simulation.view_graph}, options,
                   Threads(2));
}

int CountRigFindings(const MapperResult& result) {
  int count = 0;
  for (const Finding& finding : result.findings) {
    count += finding.cause == Cause::kRigDiffers;
  }
  return count;
}

class PartedDrive : public testing::TestWithParam<RigPreset> {};

TEST_P(PartedDrive, HasOneRigAndOneUnit) {
  const Simulation simulation = WithoutLink(Simulate(DriveOptions(GetParam())));
  const MapperResult result = Map(simulation);
  ASSERT_EQ(result.models.size(), 2u);
  EXPECT_EQ(CountRigFindings(result), 0);
  std::vector<double> scales;
  for (const MapperModel& model : result.models) {
    EXPECT_TRUE(model.has_shared_unit);
    EXPECT_TRUE(model.rig_differences.empty());
    const ModelDifference difference = CompareModels(
        simulation.scene, model.reconstruction, simulation.ground_truth);
    EXPECT_LT(difference.max_position, 0.1);
    scales.push_back(difference.scale);
  }
  EXPECT_NEAR(scales[1] / scales[0], 1.0, 0.01);
  EXPECT_NE(SummarizeRun(simulation.scene, result)
                .models[1]
                .unit_of_length.find("model 0"),
            std::string::npos);
  for (size_t s = 1; s < simulation.scene.sensors.size(); ++s) {
    const Rigid3& first = *result.models[0].reconstruction.sensor_from_rig[s];
    const Rigid3& second = *result.models[1].reconstruction.sensor_from_rig[s];
    // Four standard deviations in each of three coordinates.
    const PoseMatrix& C = *result.models[0].covariances->sensors[s];
    EXPECT_LT(AngleBetween(first.rotation, second.rotation),
              4.0 * std::sqrt(C.topLeftCorner<3, 3>().trace()));
    EXPECT_LT((first.translation - second.translation).norm(),
              4.0 * std::sqrt(C.bottomRightCorner<3, 3>().trace()));
  }
}

INSTANTIATE_TEST_SUITE_P(Rigs, PartedDrive,
                         testing::Values(RigPreset::kStereo,
                                         RigPreset::kKitti360));

// Moves the keypoints of the second camera in the second part of a drive to
// where a rig that has changed would see their points.
void ChangeRig(const Rigid3& new_from_old, Simulation* simulation) {
  const Reconstruction& truth = simulation->ground_truth;
  for (const Point3D& point : truth.points) {
    for (const Observation& o : point.track) {
      Image& image = simulation->scene.images[o.image_idx];
      if (image.sensor_idx != 1 ||
          !IsInSecond(simulation->scene, o.image_idx)) {
        continue;
      }
      const Camera& camera = truth.cameras[image.camera_idx];
      const Eigen::Vector3d before =
          *truth.CamFromWorld(simulation->scene, o.image_idx) *
          point.point_in_world;
      const auto pixel =
          ProjectToPixel(camera.model, camera.params.data(), before);
      const auto moved = ProjectToPixel(camera.model, camera.params.data(),
                                        new_from_old * before);
      if (!pixel || !moved) continue;
      image.keypoints_px[o.keypoint_idx] += (*moved - *pixel).cast<float>();
    }
  }
}

// Turned by one degree and moved by 3 cm across the baseline, whose length the
// images do not tell.
TEST(SharedCalibration, NamesAChangedRig) {
  Simulation changed = Simulate(DriveOptions(RigPreset::kStereo));
  const double angle_deg = 1.0, shift = 0.03;
  const Eigen::Vector3d across =
      changed.ground_truth.sensor_from_rig[1]->translation.unitOrthogonal();
  ChangeRig(
      {ExpSO3(Eigen::Vector3d(0.0, DegToRad(angle_deg), 0.0)), shift * across},
      &changed);
  const MapperResult result = Map(WithoutLink(changed));
  ASSERT_EQ(result.models.size(), 2u);
  ASSERT_EQ(CountRigFindings(result), 1);
  EXPECT_TRUE(result.models[0].rig_differences.empty());
  EXPECT_FALSE(result.models[1].has_shared_unit);
  const RigDifference& difference = result.models[1].rig_differences.at(0);
  EXPECT_EQ(difference.sensor_idx, 1);
  EXPECT_NEAR(difference.rotation_deg, angle_deg,
              4.0 * difference.sigma_rotation_deg);
  EXPECT_LT(difference.sigma_rotation_deg, 0.1 * angle_deg);
  // The model keeps the rig that its images show.
  const Rigid3& first = *result.models[0].reconstruction.sensor_from_rig[1];
  const Rigid3& second = *result.models[1].reconstruction.sensor_from_rig[1];
  EXPECT_NEAR(RadToDeg(AngleBetween(first.rotation, second.rotation)),
              angle_deg, 0.1 * angle_deg);
}

}  // namespace
}  // namespace mgsfm
