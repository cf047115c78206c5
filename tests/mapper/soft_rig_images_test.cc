// SPDX-License-Identifier: BSD-3-Clause
// Cameras that do not trigger simultaneously, from matches to the model on
// disk.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/mapper/report.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/model_scene.h"
#include "mgsfm/simulator/simulation.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using Json = nlohmann::json;

SimulationOptions DriveOptions() {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.num_frames = 20;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = 0.4;
  return options;
}

MapperResult Map(const Simulation& simulation, SoftRig method) {
  Context context;
  context.num_threads = 2;
  MapperOptions options;
  options.soft_rig.method = method;
  return RunMapper({simulation.scene, simulation.view_graph}, options, context);
}

// The root mean square error of the distances between consecutive images, which
// need no alignment except for their mean.
double RelativeError(const Simulation& simulation,
                     const std::vector<std::optional<Rigid3>>& poses) {
  std::vector<double> lengths, true_lengths;
  double sum = 0.0, true_sum = 0.0;
  for (size_t i = 1; i < poses.size(); ++i) {
    lengths.push_back((poses[i]->Center() - poses[i - 1]->Center()).norm());
    true_lengths.push_back((simulation.cam_from_world[i].Center() -
                            simulation.cam_from_world[i - 1].Center())
                               .norm());
    sum += lengths.back();
    true_sum += true_lengths.back();
  }
  double squares = 0.0;
  for (size_t i = 0; i < lengths.size(); ++i) {
    const double error = lengths[i] * true_sum / sum - true_lengths[i];
    squares += error * error;
  }
  return std::sqrt(squares / static_cast<double>(lengths.size()));
}

std::vector<std::optional<Rigid3>> PosesInRig(const Scene& scene,
                                              const Reconstruction& model) {
  std::vector<std::optional<Rigid3>> poses;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    poses.push_back(model.CamFromWorld(scene, static_cast<int>(i)));
  }
  return poses;
}

TEST(SoftRigImagesTest, JitterIsRemovedFromMatchesToModel) {
  SimulationOptions options = DriveOptions();
  options.trigger_jitter_ms = 20.0;
  const Simulation simulation = Simulate(options);
  const Scene& scene = simulation.scene;
  const MapperResult rigid = Map(simulation, SoftRig::kNone);
  const MapperResult soft = Map(simulation, SoftRig::kSoft);
  ASSERT_EQ(rigid.models.size(), 1u);
  ASSERT_EQ(soft.models.size(), 1u);
  EXPECT_FALSE(rigid.models[0].soft_rig_images.has_value());
  const MapperModel& model = soft.models[0];
  ASSERT_TRUE(model.soft_rig_images &&
              model.soft_rig_images->summary.is_usable);
  EXPECT_LT(
      RelativeError(simulation, model.soft_rig_images->cam_from_world),
      0.25 * RelativeError(simulation,
                           PosesInRig(scene, rigid.models[0].reconstruction)));

  RunDescription run;
  run.options_json = "{}";
  const Json report =
      Json::parse(MapperReportToJson(scene, simulation.view_graph, soft, run));
  const Json& summary = report["models"][0]["soft_rig"];
  ASSERT_EQ(summary["sensors"].size(), 2u);
  EXPECT_GT(summary["sensors"][0]["rms_position"], 0.01);
  EXPECT_FALSE(summary["sensors"][0]["is_rigid"]);
  EXPECT_TRUE(summary["sensors"][1]["time_offset_s"].is_null());
}

TEST(SoftRigImagesTest, TimesCannotBeEstimatedWithoutTimes) {
  Simulation simulation = Simulate(DriveOptions());
  simulation.scene.images[3].timestamp_s.reset();
  for (const SoftRig method :
       {SoftRig::kTimeOffset, SoftRig::kReadout, SoftRig::kBoth}) {
    EXPECT_THROW(Map(simulation, method), Error);
  }
}

TEST(SoftRigImagesTest, ModelOnDiskHasThePosesOfTheImages) {
  SimulationOptions options = DriveOptions();
  options.trigger_jitter_ms = 20.0;
  options.num_frames = 10;
  const Simulation simulation = Simulate(options);
  const Scene& scene = simulation.scene;
  const MapperResult result = Map(simulation, SoftRig::kSoft);
  ASSERT_EQ(result.models.size(), 1u);
  const auto& poses = result.models[0].soft_rig_images->cam_from_world;
  const TempDir dir;
  WriteModel(dir.path(), SeparateImages(scene),
             SeparateImages(result.models[0].reconstruction, poses),
             ModelFormat::kBinary);
  const auto expect_pose = [&](size_t i, const Rigid3& pose) {
    EXPECT_LT(AngleBetween(pose.rotation, poses[i]->rotation), 1e-9);
    EXPECT_LT((pose.Center() - poses[i]->Center()).norm(), 1e-9);
  };
  const PoseModel written = ReadModelPoses(dir.path());
  // By default, rigs would be inferred from names again.
  SceneLoadingOptions loading;
  loading.rig_name_rule = "none";
  const ModelScene read = LoadModelScene(dir.path(), loading, {});
  ASSERT_EQ(written.images.size(), scene.images.size());
  ASSERT_EQ(read.scene.images.size(), scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    EXPECT_EQ(written.images[i].name, scene.images[i].name);
    EXPECT_EQ(read.scene.images[i].name, scene.images[i].name);
    expect_pose(i, written.images[i].cam_from_world);
    expect_pose(
        i, *read.reconstruction.CamFromWorld(read.scene, static_cast<int>(i)));
  }
}

}  // namespace
}  // namespace mgsfm
