// SPDX-License-Identifier: BSD-3-Clause
// The mapper's methods for comparison.
#include <gtest/gtest.h>

#include <tuple>

#include "baselines/mapper_baselines.h"
#include "mgsfm/base/error.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/model_comparison.h"

namespace mgsfm {
namespace {

Simulation EasyDrive(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.path = PathPreset::kCurve;
  options.num_frames = 15;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = 0.3;
  return Simulate(options);
}

Scene SceneFor(const Simulation& simulation, MapperMethod method) {
  return method == MapperMethod::kSingle ? SeparateImages(simulation.scene)
                                         : simulation.scene;
}

MapperResult Map(const Simulation& simulation, MapperMethod method,
                 int num_threads = 2) {
  Context context;
  context.num_threads = num_threads;
  BaselineOptions baseline;
  baseline.method = method;
  return RunBaseline(baseline,
                     {SceneFor(simulation, method), simulation.view_graph},
                     MapperOptions(), context);
}

// The ground truth, with the indices of a scene with the same images.
Reconstruction TruthOf(const Simulation& simulation, const Scene& scene) {
  Reconstruction truth = simulation.ground_truth;
  if (scene.frames.size() == simulation.scene.frames.size()) return truth;
  truth.sensor_from_rig.assign(scene.sensors.size(), Rigid3());
  truth.rig_from_world.clear();
  for (size_t i = 0; i < scene.images.size(); ++i) {
    truth.rig_from_world.push_back(simulation.ground_truth.CamFromWorld(
        simulation.scene, static_cast<int>(i)));
  }
  return truth;
}

class MethodsTest
    : public testing::TestWithParam<std::tuple<MapperMethod, RigPreset>> {};

TEST_P(MethodsTest, RecoversAnEasyDrive) {
  const MapperMethod method = std::get<0>(GetParam());
  const Simulation simulation = EasyDrive(std::get<1>(GetParam()));
  const Scene scene = SceneFor(simulation, method);
  const MapperResult result = Map(simulation, method);
  ASSERT_EQ(result.models.size(), 1u);
  const ModelDifference difference = CompareModels(
      scene, result.models[0].reconstruction, TruthOf(simulation, scene));
  EXPECT_EQ(difference.num_images, static_cast<int>(scene.images.size()));
  EXPECT_LT(difference.max_rotation_deg, 0.2);
  EXPECT_LT(difference.max_position, 0.1);
}

INSTANTIATE_TEST_SUITE_P(
    All, MethodsTest,
    testing::Combine(
        testing::Values(MapperMethod::kMgsfm, MapperMethod::kDmraMgp,
                        MapperMethod::kMma, MapperMethod::kIncremental,
                        MapperMethod::kSingle),
        testing::Values(RigPreset::kStereo, RigPreset::kKitti360)));

TEST(SeparateImagesTest, EveryImageIsAFrame) {
  const Simulation simulation = EasyDrive(RigPreset::kKitti360);
  const Scene scene = SeparateImages(simulation.scene);
  CheckConsistent(scene);
  ASSERT_EQ(scene.frames.size(), scene.images.size());
  EXPECT_EQ(scene.rigs.size(), scene.sensors.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    EXPECT_EQ(scene.images[i].name, simulation.scene.images[i].name);
    EXPECT_EQ(scene.frames[i].image_idxs.size(), 1u);
  }
}

TEST(ResolveBaselineTest, MethodReplacesAuto) {
  BaselineOptions options;
  options.method = MapperMethod::kMma;
  MapperOptions mapper;
  const BaselineOptions mma = ResolveBaseline(options, &mapper);
  EXPECT_EQ(mapper.rotation_averaging.strategy, RotationStrategy::kJoint);
  EXPECT_EQ(mma.positions.input, TranslationSource::kRelativeTranslations);
  EXPECT_EQ(mma.positions.objective, TranslationObjective::kDistance);
  options.positions.objective = TranslationObjective::kBilinear;
  EXPECT_EQ(ResolveBaseline(options, &mapper).positions.objective,
            TranslationObjective::kBilinear);
}

TEST(ResolveBaselineTest, ContradictionsAreErrors) {
  MapperOptions mapper;
  BaselineOptions options;
  options.method = MapperMethod::kMma;
  options.positions.input = TranslationSource::kTracks;
  EXPECT_THROW(ResolveBaseline(options, &mapper), Error);
  options = BaselineOptions();
  options.method = MapperMethod::kDmraMgp;
  options.positions.objective = TranslationObjective::kDistance;
  EXPECT_THROW(ResolveBaseline(options, &mapper), Error);
}

TEST(MethodsTest, ThreadsDoNotMatter) {
  const Simulation simulation = EasyDrive(RigPreset::kStereo);
  for (const MapperMethod method :
       {MapperMethod::kDmraMgp, MapperMethod::kMma, MapperMethod::kSingle}) {
    const MapperResult one = Map(simulation, method, 1);
    const MapperResult three = Map(simulation, method, 3);
    ASSERT_EQ(one.models.size(), 1u);
    ASSERT_EQ(three.models.size(), 1u);
    const auto& a = one.models[0].reconstruction.rig_from_world;
    const auto& b = three.models[0].reconstruction.rig_from_world;
    ASSERT_EQ(a.size(), b.size());
    for (size_t i = 0; i < a.size(); ++i) {
      ASSERT_TRUE(a[i] && b[i]);
      EXPECT_EQ(a[i]->translation, b[i]->translation);
      EXPECT_EQ(a[i]->rotation.coeffs(), b[i]->rotation.coeffs());
    }
  }
}

}  // namespace
}  // namespace mgsfm
