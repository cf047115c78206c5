// SPDX-License-Identifier: BSD-3-Clause
// Models that grow frame by frame, against the ground truth.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "geometry/so3.h"
#include "mapper/mapper_recipe.h"
#include "mapper/true_model.h"
#include "mgsfm/base/error.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"
#include "support/model_comparison.h"
#include "support/permuted_ids.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

SimulationOptions Drive(RigPreset rig, PathPreset path = PathPreset::kCurve) {
  SimulationOptions options;
  options.rig = rig;
  options.path = path;
  options.num_frames = 20;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = 0.3;
  options.mismatch_ratio = 0.1;
  return options;
}

MapperResult Map(const Scene& scene, const ViewGraph& view_graph,
                 int num_threads = 2) {
  return RunIncrementalMapper({scene, view_graph}, MapperOptions(),
                              Threads(num_threads));
}

class IncrementalMapperTest : public testing::TestWithParam<RigPreset> {};

TEST_P(IncrementalMapperTest, RecoversAnUnknownRig) {
  const Simulation simulation = Simulate(Drive(GetParam()));
  ExpectTrueModel(simulation, Map(simulation.scene, simulation.view_graph));
}

TEST_P(IncrementalMapperTest, KnownPosesGiveTheSameModel) {
  const Simulation simulation = Simulate(Drive(GetParam()));
  const auto& truth = simulation.ground_truth.sensor_from_rig;
  Scene partly = simulation.scene, known = simulation.scene;
  partly.sensors.back().sensor_from_rig = truth.back();
  for (size_t i = 0; i < truth.size(); ++i) {
    known.sensors[i].sensor_from_rig = truth[i];
  }
  for (const Scene& scene : {partly, known}) {
    const MapperResult result = Map(scene, simulation.view_graph);
    ExpectTrueModel(simulation, result);
    if (truth.size() == 1) continue;
    // The unit of length is that of the known poses.
    EXPECT_TRUE(result.models[0].translation.is_metric);
    EXPECT_NEAR(CompareModels(scene, result.models[0].reconstruction,
                              simulation.ground_truth)
                    .scale,
                1.0, 0.02);
  }
}

// Lorries accompany half of the drive and fill images: without the rules, a
// model takes their motion for that of the rig.
TEST(IncrementalMapper, GrowsOnTheStaticScene) {
  SimulationOptions options = StandardSimulation(RigPreset::kStereo);
  options.path = PathPreset::kCurve;
  options.num_frames = 60;
  options.frame_spacing_m = 2.5;
  options.convoy_ratio = 0.5;
  options.random_seed = 1;
  const Simulation simulation = Simulate(options);
  const MapperResult result = Map(simulation.scene, simulation.view_graph);
  EXPECT_TRUE(std::any_of(
      result.rejected_pairs.begin(), result.rejected_pairs.end(),
      [](const RejectionCount& count) {
        return count.reason == RejectionReason::kDiscontinuousMotion &&
               count.num_pairs > 0;
      }));
  ASSERT_FALSE(result.models.empty());
  for (const MapperModel& model : result.models) {
    EXPECT_LT(CompareModels(simulation.scene, model.reconstruction,
                            simulation.ground_truth)
                  .max_position,
              0.25);
  }
}

INSTANTIATE_TEST_SUITE_P(Rigs, IncrementalMapperTest,
                         testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                         RigPreset::kKitti360,
                                         RigPreset::kCube6));

// Distributes the sensors of a rig over several rigs with frames of their own
// and unknown poses; the first sensor of each is its reference.
void Regroup(const std::vector<int>& rig_of_sensor, Simulation* simulation) {
  Scene& scene = simulation->scene;
  Reconstruction& truth = simulation->ground_truth;
  const Scene old_scene = scene;
  const Reconstruction old_truth = truth;
  scene.rigs.assign(
      1 + *std::max_element(rig_of_sensor.begin(), rig_of_sensor.end()),
      Rig{RigId(1), 0, {}});
  for (size_t i = scene.sensors.size(); i-- > 0;) {
    Sensor& sensor = scene.sensors[i];
    sensor.rig_idx = rig_of_sensor[i];
    sensor.sensor_from_rig.reset();
    Rig& rig = scene.rigs[sensor.rig_idx];
    rig.id = RigId(static_cast<uint32_t>(sensor.rig_idx + 1));
    rig.ref_sensor_idx = static_cast<int>(i);
    rig.sensor_idxs.insert(rig.sensor_idxs.begin(), static_cast<int>(i));
  }
  scene.frames.clear();
  truth.rig_from_world.clear();
  for (size_t r = 0; r < scene.rigs.size(); ++r) {
    const int ref_idx = scene.rigs[r].ref_sensor_idx;
    scene.sensors[ref_idx].sensor_from_rig = Rigid3();
    for (const int s : scene.rigs[r].sensor_idxs) {
      truth.sensor_from_rig[s] = *old_truth.sensor_from_rig[s] *
                                 old_truth.sensor_from_rig[ref_idx]->Inverse();
    }
    for (size_t f = 0; f < old_scene.frames.size(); ++f) {
      Frame frame{FrameId(static_cast<uint32_t>(scene.frames.size() + 1)),
                  old_scene.frames[f].name,
                  static_cast<int>(r),
                  {}};
      for (const int i : old_scene.frames[f].image_idxs) {
        if (rig_of_sensor[scene.images[i].sensor_idx] != frame.rig_idx) {
          continue;
        }
        scene.images[i].frame_idx = static_cast<int>(scene.frames.size());
        frame.image_idxs.push_back(i);
      }
      scene.frames.push_back(frame);
      truth.rig_from_world.push_back(*old_truth.sensor_from_rig[ref_idx] *
                                     *old_truth.rig_from_world[f]);
    }
  }
  CheckConsistent(scene);
}

TEST(IncrementalMapper, MapsThreeRigsAndTwoSingleCameras) {
  SimulationInput input;
  input.rig = MakeRig(RigPreset::kStereo);
  for (int k = 2; k < 8; ++k) {
    SimulatedCamera camera = input.rig[k % 2];
    camera.image_prefix = "cam" + std::to_string(k) + "/";
    camera.sensor_from_rig =
        Rigid3{ExpSO3({0.01 * k, -0.02 * k, 0.0}), {0.05 * k, 0.1, 0.02 * k}} *
        camera.sensor_from_rig;
    input.rig.push_back(camera);
  }
  SimulationOptions options = Drive(RigPreset::kStereo);
  options.num_frames = 10;
  Simulation simulation = Simulate(options, input);
  Regroup({0, 0, 1, 1, 2, 2, 3, 4}, &simulation);
  ExpectTrueModel(simulation, Map(simulation.scene, simulation.view_graph));
}

// The cameras of a frame determine a model without motion.
TEST(IncrementalMapper, MapsAStandingRig) {
  const Simulation simulation =
      Simulate(Drive(RigPreset::kStereo, PathPreset::kStanding));
  for (const bool is_known : {false, true}) {
    Scene scene = simulation.scene;
    for (size_t i = 0; is_known && i < scene.sensors.size(); ++i) {
      scene.sensors[i].sensor_from_rig =
          simulation.ground_truth.sensor_from_rig[i];
    }
    const MapperResult result = Map(scene, simulation.view_graph);
    ASSERT_EQ(result.models.size(), 1u);
    const Reconstruction& model = result.models[0].reconstruction;
    EXPECT_EQ(model.NumRegisteredImages(scene),
              static_cast<int>(scene.images.size()));
    const double baseline = model.sensor_from_rig[1]->translation.norm();
    for (const auto& pose : model.rig_from_world) {
      EXPECT_LT((pose->Center() - model.rig_from_world[0]->Center()).norm(),
                0.1 * baseline);
    }
  }
}

// One camera that only turns has no translation to start with.
TEST(IncrementalMapper, NamesFramesOfAPureRotation) {
  SimulationInput input;
  for (int i = 0; i < 10; ++i) {
    input.rig_from_world_path.push_back({ExpSO3({0.0, 0.05 * i, 0.0}), {}});
    input.rig_from_world_path.back().translation.setZero();
  }
  SimulationOptions options = Drive(RigPreset::kMono);
  options.num_frames = 10;
  const Simulation simulation = Simulate(options, input);
  const MapperResult result = Map(simulation.scene, simulation.view_graph);
  EXPECT_TRUE(result.models.empty());
  ASSERT_EQ(result.unregistered_frames.size(), simulation.scene.frames.size());
  for (const UnregisteredFrame& frame : result.unregistered_frames) {
    EXPECT_FALSE(frame.reason.empty());
  }
}

// Frames without matches to the others are a model of their own.
TEST(IncrementalMapper, MapsSeparatePartsSeparately) {
  Simulation simulation = Simulate(Drive(RigPreset::kStereo));
  const auto is_second = [&](int image_idx) {
    return simulation.scene.images[image_idx].frame_idx >= 8;
  };
  auto& pairs = simulation.view_graph.pairs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                             [&](const ImagePair& pair) {
                               return is_second(pair.image_idx1) !=
                                      is_second(pair.image_idx2);
                             }),
              pairs.end());
  const MapperResult result = Map(simulation.scene, simulation.view_graph);
  ASSERT_EQ(result.models.size(), 2u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  for (const MapperModel& model : result.models) {
    const ModelDifference difference = CompareModels(
        simulation.scene, model.reconstruction, simulation.ground_truth);
    EXPECT_LT(difference.max_rotation_deg, 0.2);
    EXPECT_LT(difference.max_position, 0.1);
  }
}

TEST(IncrementalMapper, ThreadsAndIdsDoNotChangeTheResult) {
  const Simulation simulation = Simulate(Drive(RigPreset::kStereo));
  DatabaseContents contents =
      MakeDatabaseContents(simulation.scene, simulation.view_graph);
  contents.rigs.clear();
  contents.frames.clear();
  std::vector<Reconstruction> models;
  for (const DatabaseContents& input : {contents, WithPermutedIds(contents)}) {
    const LoadedScene loaded =
        LoadScene(input, SceneLoadingOptions(), Threads(1));
    MapperResult result = Map(loaded.scene, loaded.view_graph,
                              static_cast<int>(1 + 2 * models.size()));
    ASSERT_EQ(result.models.size(), 1u);
    models.push_back(std::move(result.models[0].reconstruction));
  }
  EXPECT_LT(MaxPoseDifference(models[0], models[1]), 1e-9);
}

TEST(IncrementalMapper, StopsWhereverItIsAsked) {
  const Simulation simulation = Simulate(Drive(RigPreset::kStereo));
  int num_asked = 0, stop_at = 0;
  Context context = Threads(1);
  bool is_growing = false;
  context.progress = [&](const Progress& progress) {
    is_growing = progress.stage == "incremental mapping";
  };
  context.is_canceled = [&] { return is_growing && ++num_asked == stop_at; };
  const auto map = [&] {
    num_asked = 0;
    is_growing = false;
    return RunIncrementalMapper({simulation.scene, simulation.view_graph},
                                MapperOptions(), context);
  };
  ASSERT_EQ(map().models.size(), 1u);
  const int num_times = num_asked;
  EXPECT_GE(num_times, 15);  // frames beyond the first two
  for (stop_at = 1; stop_at <= num_times; stop_at += num_times / 7) {
    EXPECT_THROW(map(), Interrupted) << stop_at;
  }
}

}  // namespace
}  // namespace mgsfm
