// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/evaluation/evaluation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/random.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

Eigen::Vector3d RandomVector(Random* random) {
  return {random->Normal(), random->Normal(), random->Normal()};
}

Sim3 RandomSimilarity(Random* random) {
  return {std::exp(random->Uniform(-3.0, 3.0)), ExpSO3(RandomVector(random)),
          50.0 * RandomVector(random)};
}

const Rigid3 kRightFromLeft{ExpSO3({0.01, 0.02, -0.01}), {-0.5, 0.01, 0.02}};

// The true poses of a stereo drive, optionally on a straight line without
// rotation or without motion.
enum class Path { kCurve, kStraight, kStanding };

std::vector<ImagePoses> TrueImages(Path path, int num_frames = 20) {
  std::vector<ImagePoses> images;
  for (int i = 0; i < num_frames; ++i) {
    const double turn = path == Path::kCurve ? 0.1 * i : 0.0;
    const double distance = path == Path::kStanding ? 0.0 : 2.0 * i;
    const Rigid3 left_from_world = Rigid3::FromRotationAndCenter(
        ExpSO3({0.02 * turn, turn, 0.0}),
        {100.0 + distance, std::sin(turn), 3.0 * std::cos(turn)});
    images.push_back({"left" + std::to_string(i), true, {}, left_from_world});
    images.push_back({"right" + std::to_string(i),
                      false,
                      {},
                      kRightFromLeft * left_from_world});
  }
  return images;
}

// Registers all images without error in a different world frame.
void Register(const Sim3& model_from_world, std::vector<ImagePoses>* images) {
  for (ImagePoses& image : *images) {
    image.cam_from_model =
        TransformWorld(model_from_world, image.cam_from_world);
  }
}

void ExpectNear(const Sim3& a, const Sim3& b, double tolerance) {
  EXPECT_NEAR(a.scale / b.scale, 1.0, tolerance);
  EXPECT_LT(AngleBetween(a.rotation, b.rotation), tolerance);
  // The images are about 100 m away from the origin.
  const Eigen::Vector3d place = b.Inverse() * Eigen::Vector3d(100.0, 0.0, 0.0);
  EXPECT_LT((a * place - b * place).norm(), 100.0 * tolerance);
}

class AlignPosesTest : public testing::TestWithParam<Path> {};

TEST_P(AlignPosesTest, RecoversARandomSimilarity) {
  for (uint64_t seed = 0; seed < 20; ++seed) {
    Random random(seed);
    const Sim3 model_from_world = RandomSimilarity(&random);
    std::vector<ImagePoses> images = TrueImages(GetParam());
    Register(model_from_world, &images);
    const auto world_from_model = AlignPoses(images);
    ASSERT_TRUE(world_from_model.has_value());
    ExpectNear(*world_from_model, model_from_world.Inverse(), 1e-9);
  }
}

TEST_P(AlignPosesTest, IsNotMovedByImagesThatFlewAway) {
  for (const double distance : {3.0, 1e3, 1e9}) {
    Random random(5);
    const Sim3 model_from_world = RandomSimilarity(&random);
    std::vector<ImagePoses> images = TrueImages(GetParam(), 50);
    Register(model_from_world, &images);
    for (size_t i = 0; i < images.size(); ++i) {
      if (i % 10 >= 3) continue;
      images[i].cam_from_model->rotation = ExpSO3(RandomVector(&random));
      images[i].cam_from_model->translation +=
          model_from_world.scale * distance * 20.0 * RandomVector(&random);
    }
    const auto world_from_model = AlignPoses(images);
    ASSERT_TRUE(world_from_model.has_value());
    ExpectNear(*world_from_model, model_from_world.Inverse(), 1e-9);
  }
}

TEST_P(AlignPosesTest, RigidMotionKeepsTheUnit) {
  Random random(4);
  Sim3 model_from_world = RandomSimilarity(&random);
  model_from_world.scale = 1.0;
  std::vector<ImagePoses> images = TrueImages(GetParam());
  Register(model_from_world, &images);
  ExpectNear(*AlignPoses(images, Alignment::kRigid), model_from_world.Inverse(),
             1e-7);
  // A scale error of 2 % is not corrected.
  Register({1.02, model_from_world.rotation, {}}, &images);
  EXPECT_EQ(AlignPoses(images, Alignment::kRigid)->scale, 1.0);
  EXPECT_EQ(AlignPoses(images, Alignment::kNone)->scale, 1.0);
  EXPECT_TRUE(AlignPoses(images, Alignment::kNone)->translation.isZero(0.0));
}

INSTANTIATE_TEST_SUITE_P(Paths, AlignPosesTest,
                         testing::Values(Path::kCurve, Path::kStraight,
                                         Path::kStanding));

TEST(AlignPoses, OneImageGivesRotationAndPlaceAtScaleOne) {
  Random random(3);
  Sim3 model_from_world = RandomSimilarity(&random);
  model_from_world.scale = 1.0;
  std::vector<ImagePoses> images = TrueImages(Path::kCurve, 1);
  images.resize(1);
  Register(model_from_world, &images);
  ExpectNear(*AlignPoses(images), model_from_world.Inverse(), 1e-9);
}

// The centers differ only by rounding, or by noise in the model.
TEST(AlignPoses, StandingCameraHasScaleOne) {
  Random random(4);
  for (const double noise : {0.0, 0.01}) {
    std::vector<ImagePoses> images;
    for (int i = 0; i < 30; ++i) {
      images.push_back({"",
                        true,
                        {},
                        Rigid3::FromRotationAndCenter(
                            ExpSO3(RandomVector(&random)), {1e3, -5e2, 7.0})});
    }
    Register(Sim3(), &images);
    for (ImagePoses& image : images) {
      image.cam_from_model->translation += noise * RandomVector(&random);
    }
    EXPECT_EQ(AlignPoses(images)->scale, 1.0);
  }
}

// Most frames coincide; only a few moving frames determine the scale.
TEST(AlignPoses, StandingFramesDoNotOutvoteMovingOnes) {
  Random random(6);
  std::vector<ImagePoses> images = TrueImages(Path::kCurve, 10);
  for (int i = 0; i < 80; ++i) images.push_back(images.front());
  const Sim3 model_from_world = RandomSimilarity(&random);
  Register(model_from_world, &images);
  for (ImagePoses& image : images) {
    image.cam_from_model->translation +=
        model_from_world.scale * 1e-3 * RandomVector(&random);
  }
  EXPECT_NEAR(AlignPoses(images)->scale * model_from_world.scale, 1.0, 2e-3);
}

TEST(Evaluate, TruthAgainstItselfHasNoError) {
  std::vector<ImagePoses> images = TrueImages(Path::kCurve);
  Register(Sim3(), &images);
  const Evaluation evaluation =
      Evaluate(images, true, {{"right", kRightFromLeft, kRightFromLeft}}, {});
  EXPECT_EQ(evaluation.num_images, 40);
  EXPECT_EQ(evaluation.num_registered, 40);
  EXPECT_LT(evaluation.rotation_deg->max, 1e-9);
  EXPECT_LT(evaluation.position_m->max, 1e-9);
  for (const auto& areas : {evaluation.rotation_auc, evaluation.position_auc}) {
    EXPECT_FALSE(areas.empty());
    for (const AreaUnderCurve& auc : areas) EXPECT_NEAR(auc.area, 1.0, 1e-7);
  }
  ASSERT_EQ(evaluation.sensors.size(), 1u);
  EXPECT_LT(evaluation.sensors[0].rotation_deg, 1e-9);
  EXPECT_LT(*evaluation.sensors[0].direction_deg, 1e-9);
  EXPECT_NEAR(evaluation.sensors[0].length_m, kRightFromLeft.translation.norm(),
              1e-9);
  EXPECT_NEAR(
      *evaluation.extent_m,
      (images[0].cam_from_world.Center() - images[38].cam_from_world.Center())
          .norm(),
      1e-9);
}

// The model has another unit of length, which alignment must determine before
// comparing lengths in the rig.
TEST(Evaluate, ErrorsOfTheRigAreThosePutIn) {
  Random random(8);
  const Sim3 model_from_world = RandomSimilarity(&random);
  std::vector<ImagePoses> images = TrueImages(Path::kCurve);
  Register(model_from_world, &images);
  const double turn = DegToRad(0.7), bend = DegToRad(2.0);
  Rigid3 estimate = kRightFromLeft;
  estimate.rotation = ExpSO3({0.0, turn, 0.0}) * estimate.rotation;
  const Eigen::Vector3d axis =
      estimate.translation.cross(Eigen::Vector3d::UnitZ()).normalized();
  estimate.translation = 1.1 * model_from_world.scale *
                         (ExpSO3(bend * axis) * estimate.translation);
  for (const bool has_true_poses : {true, false}) {
    const Evaluation evaluation = Evaluate(
        images, has_true_poses, {{"right", estimate, kRightFromLeft}}, {});
    ASSERT_EQ(evaluation.sensors.size(), 1u);
    const SensorErrors& errors = evaluation.sensors[0];
    const double true_length = kRightFromLeft.translation.norm();
    EXPECT_NEAR(errors.rotation_deg, 0.7, 1e-9);
    EXPECT_NEAR(*errors.direction_deg, 2.0, 1e-9);
    EXPECT_NEAR(errors.true_length_m, true_length, 1e-12);
    // Without true image poses, the rig determines the unit of length.
    EXPECT_NEAR(errors.length_m, (has_true_poses ? 1.1 : 1.0) * true_length,
                1e-9);
    EXPECT_EQ(evaluation.position_m.has_value(), has_true_poses);
  }
}

// One of many images has an error of 0.5 m and 1 deg and is excluded from the
// alignment; some images are not registered.
TEST(Evaluate, UnregisteredImagesCountInTheAreas) {
  std::vector<ImagePoses> images = TrueImages(Path::kCurve, 50);
  Register(Sim3(), &images);
  Rigid3& moved = *images[10].cam_from_model;
  moved = Rigid3::FromRotationAndCenter(
      ExpSO3({DegToRad(1.0), 0.0, 0.0}) * moved.rotation,
      moved.Center() + Eigen::Vector3d(0.0, 0.0, 0.5));
  for (size_t i = 60; i < 80; ++i) images[i].cam_from_model.reset();
  EvaluationOptions options;
  options.position_thresholds_m = {0.2, 2.0};
  options.rotation_thresholds_deg = {4.0};
  const Evaluation evaluation = Evaluate(images, true, {}, options);
  EXPECT_EQ(evaluation.num_images, 100);
  EXPECT_EQ(evaluation.num_registered, 80);
  EXPECT_NEAR(evaluation.position_m->max, 0.5, 1e-9);
  EXPECT_NEAR(evaluation.position_auc[0].area, 0.79, 1e-9);
  EXPECT_NEAR(evaluation.position_auc[1].area, 0.79 + 0.01 * 0.75, 1e-9);
  EXPECT_NEAR(evaluation.rotation_auc[0].area, 0.79 + 0.01 * 0.75, 1e-9);
}

// Four images on the sides of a square. Moving two of them apart by the same
// distance does not change the alignment.
TEST(Evaluate, AreasAgreeWithACalculationByHand) {
  std::vector<ImagePoses> images;
  for (const double x : {-10.0, 10.0}) {
    for (const double y : {-10.0, 10.0}) {
      images.push_back({"",
                        true,
                        {},
                        Rigid3::FromRotationAndCenter(
                            Eigen::Quaterniond::Identity(), {x, y, 0.0})});
    }
  }
  Register(Sim3(), &images);
  // Opposite height differences on the diagonals, which no similarity reduces.
  for (const size_t i : {0, 3}) images[i].cam_from_model->translation.z() = 0.1;
  for (const size_t i : {1, 2}) {
    images[i].cam_from_model->translation.z() = -0.1;
  }
  EvaluationOptions options;
  options.position_thresholds_m = {0.05, 0.2, 0.4};
  const Evaluation evaluation = Evaluate(images, true, {}, options);
  EXPECT_NEAR(evaluation.position_m->mean, 0.1, 1e-3);
  EXPECT_NEAR(evaluation.position_auc[0].area, 0.0, 1e-3);
  EXPECT_NEAR(evaluation.position_auc[1].area, 0.5, 2e-3);
  EXPECT_NEAR(evaluation.position_auc[2].area, 0.75, 2e-3);
}

TEST(Evaluate, NoImageAndNoRegisteredImageAreNoError) {
  for (const int num_frames : {0, 1}) {
    const Evaluation evaluation =
        Evaluate(TrueImages(Path::kCurve, num_frames), true,
                 {{"right", {}, kRightFromLeft}}, {});
    EXPECT_EQ(evaluation.num_images, 2 * num_frames);
    EXPECT_EQ(evaluation.num_registered, 0);
    EXPECT_FALSE(evaluation.world_from_model.has_value());
    EXPECT_THAT(EvaluationToText(evaluation), HasSubstr("registered"));
    EXPECT_EQ(
        nlohmann::json::parse(EvaluationToJson(evaluation))["num_registered"],
        0);
    EXPECT_FALSE(AlignPoses({}).has_value());
  }
}

TEST(EvaluationToJson, HoldsWhatTheTextShows) {
  std::vector<ImagePoses> images = TrueImages(Path::kCurve);
  const Sim3 model_from_world{2.0, ExpSO3({0.5, -0.3, 0.2}), {3.0, 5.0, -7.0}};
  Register(model_from_world, &images);
  const SensorPoses moved{
      "right",
      Rigid3{kRightFromLeft.rotation, 2.0 * kRightFromLeft.translation},
      kRightFromLeft};
  const SensorPoses at_reference{"same", Rigid3(), Rigid3()};
  const Evaluation evaluation =
      Evaluate(images, true, {moved, at_reference, {"unknown", {}, {}}}, {});
  const auto json = nlohmann::json::parse(EvaluationToJson(evaluation));
  EXPECT_EQ(json["num_images"], 40);
  const auto& aligned = json["world_from_model"];
  const auto q = aligned["rotation_wxyz"].get<std::array<double, 4>>();
  const auto t = aligned["translation_m"].get<std::array<double, 3>>();
  ExpectNear({aligned["scale"], {q[0], q[1], q[2], q[3]}, {t[0], t[1], t[2]}},
             model_from_world.Inverse(), 1e-9);
  EXPECT_LT(json["position_m"]["median"].get<double>(), 1e-9);
  EXPECT_EQ(json["position_auc"].size(), 4u);
  ASSERT_EQ(json["sensors"].size(), 2u);
  EXPECT_EQ(json["sensors"][0]["name"], "right");
  EXPECT_LT(json["sensors"][0]["direction_deg"].get<double>(), 1e-6);
  EXPECT_TRUE(json["sensors"][1]["direction_deg"].is_null());
  const std::string text = EvaluationToText(evaluation);
  for (const char* part : {"40 of 40", "right", "position AUC", "extent"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
}

}  // namespace
}  // namespace mgsfm
