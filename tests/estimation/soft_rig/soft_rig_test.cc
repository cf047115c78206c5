// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/soft_rig/soft_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "estimation/soft_rig/winding_drive.h"
#include "mgsfm/evaluation/evaluation.h"
#include "soft_rig/deviations.h"

namespace mgsfm {
namespace {

struct SoftRigDrive {
  Simulation simulation;
  Reconstruction rigid;
  SoftRigResult soft;
};

SoftRigDrive EstimateSoftRigOfImages(const SimulationOptions& simulated,
                                     const std::vector<Rigid3>& path,
                                     int num_threads = 2) {
  SoftRigDrive drive{Simulate(simulated, path), {}, {}};
  const Scene& scene = drive.simulation.scene;
  const CandidateSource candidates =
      FixedCandidates(GroupTracks(drive.simulation.ground_truth));
  const BundleAdjustmentOptions bundle_options;
  drive.rigid = RefineReconstruction(
                    scene, candidates,
                    Perturbed(scene, drive.simulation.ground_truth, 0.01, 3),
                    bundle_options, Threads(num_threads))
                    .estimate;
  SoftRigOptions options;
  options.method = SoftRig::kSoft;
  drive.soft =
      EstimateSoftRig({scene, SeparateImages(scene), candidates, drive.rigid},
                      options, bundle_options, Threads(num_threads));
  return drive;
}

Evaluation Compare(const Simulation& simulation,
                   const std::vector<std::optional<Rigid3>>& cam_from_world) {
  std::vector<ImagePoses> images;
  for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
    images.push_back({simulation.scene.images[i].name, true, cam_from_world[i],
                      simulation.cam_from_world[i]});
  }
  return Evaluate(images, true, {}, {});
}

Evaluation CompareRigid(const SoftRigDrive& drive) {
  std::vector<std::optional<Rigid3>> poses;
  for (size_t i = 0; i < drive.simulation.scene.images.size(); ++i) {
    poses.push_back(
        drive.rigid.CamFromWorld(drive.simulation.scene, static_cast<int>(i)));
  }
  return Compare(drive.simulation, poses);
}

// The true standard deviation of each coordinate. Two images of a frame differ
// by the deviations of both, hence the factor of two in the variance.
DeviationSigma TrueSigma(const Simulation& simulation) {
  double rotation = 0.0, position = 0.0;
  int count = 0;
  for (const Frame& frame : simulation.scene.frames) {
    if (frame.image_idxs.size() < 2) continue;
    const auto relative = [&](int k) {
      const int i = frame.image_idxs[k];
      const Rigid3 rig_pose =
          simulation.ground_truth
              .sensor_from_rig[simulation.scene.images[i].sensor_idx]
              ->Inverse() *
          simulation.cam_from_world[i];
      return rig_pose;
    };
    const Rigid3 a = relative(0), b = relative(1);
    const double angle = AngleBetween(a.rotation, b.rotation);
    rotation += angle * angle;
    position += (a.Center() - b.Center()).squaredNorm();
    ++count;
  }
  return {std::sqrt(rotation / (6.0 * count)),
          std::sqrt(position / (6.0 * count))};
}

TEST(SoftRigTest, JitterIsRemovedAndItsSigmaEstimated) {
  for (const double jitter_ms : {20.0, 50.0}) {
    SimulationOptions options = DriveOptions(RigPreset::kStereo);
    options.trigger_jitter_ms = jitter_ms;
    const SoftRigDrive drive =
        EstimateSoftRigOfImages(options, WindingPath(40));
    const SoftRigSummary& summary = drive.soft.images.summary;
    ASSERT_TRUE(summary.is_usable) << summary.message;
    EXPECT_TRUE(summary.has_converged);
    const Evaluation before = CompareRigid(drive);
    const Evaluation after =
        Compare(drive.simulation, drive.soft.images.cam_from_world);
    EXPECT_LT(after.position_m->mean, 0.2 * before.position_m->mean);
    EXPECT_LT(after.rotation_deg->mean, 0.3 * before.rotation_deg->mean);
    const DeviationSigma truth = TrueSigma(drive.simulation);
    const double scale = after.world_from_model->scale;
    ASSERT_EQ(summary.sensors.size(), 2u);
    for (const SoftRigSensor& sensor : summary.sensors) {
      EXPECT_EQ(sensor.num_images, 40);
      EXPECT_FALSE(sensor.is_rigid);
      EXPECT_NEAR(sensor.sigma_rotation_rad / truth.rotation_rad, 1.0, 0.3);
      EXPECT_NEAR(scale * sensor.sigma_position / truth.position, 1.0, 0.3);
      EXPECT_GT(sensor.max_position, sensor.rms_position);
      EXPECT_LT(sensor.mean_error_after_px, 0.7 * sensor.mean_error_before_px);
      EXPECT_GE(sensor.num_observations_after, sensor.num_observations_before);
      EXPECT_FALSE(sensor.time_offset_s.has_value());
    }
  }
}

TEST(SoftRigTest, RigidRigsStayRigid) {
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    const SoftRigDrive drive =
        EstimateSoftRigOfImages(DriveOptions(rig), WindingPath(20));
    const SoftRigSummary& summary = drive.soft.images.summary;
    ASSERT_TRUE(summary.is_usable) << summary.message;
    const Evaluation before = CompareRigid(drive);
    const Evaluation after =
        Compare(drive.simulation, drive.soft.images.cam_from_world);
    EXPECT_LT(after.position_m->mean, 1.3 * before.position_m->mean + 1e-4);
    EXPECT_LT(after.rotation_deg->mean, 1.3 * before.rotation_deg->mean + 1e-4);
    for (const SoftRigSensor& sensor : summary.sensors) {
      EXPECT_LT(RadToDeg(sensor.rms_rotation_rad), 0.005);
      EXPECT_LT(sensor.rms_position, 0.005);
    }
  }
}

TEST(SoftRigTest, ImagesWithFewObservationsStayAtTheRig) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_jitter_ms = 20.0;
  Simulation simulation = Simulate(options, WindingPath(30));
  // Two observations do not determine the pose of an image.
  const int poor_image_idx = simulation.scene.frames[12].image_idxs[1];
  int num_left = 2;
  for (Point3D& point : simulation.ground_truth.points) {
    point.track.erase(std::remove_if(point.track.begin(), point.track.end(),
                                     [&](const Observation& o) {
                                       return o.image_idx == poor_image_idx &&
                                              num_left-- <= 0;
                                     }),
                      point.track.end());
  }
  const Scene& scene = simulation.scene;
  const CandidateSource candidates =
      FixedCandidates(GroupTracks(simulation.ground_truth));
  const BundleAdjustmentOptions bundle_options;
  const Reconstruction rigid =
      RefineReconstruction(scene, candidates, simulation.ground_truth,
                           bundle_options, Threads(2))
          .estimate;
  SoftRigOptions soft_options;
  soft_options.method = SoftRig::kSoft;
  const SoftRigResult result =
      EstimateSoftRig({scene, SeparateImages(scene), candidates, rigid},
                      soft_options, bundle_options, Threads(2));
  ASSERT_TRUE(result.images.summary.is_usable);
  const Rigid3 in_rig = *result.estimate.CamFromWorld(scene, poor_image_idx);
  const Rigid3& pose = *result.images.cam_from_world[poor_image_idx];
  const SoftRigSensor& sensor = result.images.summary.sensors[1];
  EXPECT_LT((in_rig.Center() - pose.Center()).norm(),
            2.0 * sensor.sigma_position);
  EXPECT_LT(AngleBetween(in_rig.rotation, pose.rotation),
            2.0 * sensor.sigma_rotation_rad);
}

TEST(SoftRigTest, ThreadsDoNotChangeAnything) {
  SimulationOptions options = DriveOptions(RigPreset::kStereo);
  options.trigger_jitter_ms = 20.0;
  const SoftRigDrive one = EstimateSoftRigOfImages(options, WindingPath(15), 1);
  const SoftRigDrive three =
      EstimateSoftRigOfImages(options, WindingPath(15), 3);
  for (size_t i = 0; i < one.soft.images.cam_from_world.size(); ++i) {
    const Rigid3& a = *one.soft.images.cam_from_world[i];
    const Rigid3& b = *three.soft.images.cam_from_world[i];
    EXPECT_EQ(a.translation, b.translation);
    EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  }
}

TEST(SoftRigTest, SingleCamerasStayUnchanged) {
  const SoftRigDrive drive =
      EstimateSoftRigOfImages(DriveOptions(RigPreset::kMono), WindingPath(10));
  const SoftRigSummary& summary = drive.soft.images.summary;
  EXPECT_FALSE(summary.is_usable);
  EXPECT_NE(summary.message, "");
  EXPECT_TRUE(summary.sensors.empty());
  for (size_t i = 0; i < drive.simulation.scene.images.size(); ++i) {
    EXPECT_EQ(
        drive.soft.images.cam_from_world[i]->translation,
        drive.rigid.CamFromWorld(drive.simulation.scene, static_cast<int>(i))
            ->translation);
  }
}

}  // namespace
}  // namespace mgsfm
