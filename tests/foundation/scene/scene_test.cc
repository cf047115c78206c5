// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/scene/scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <numeric>

#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

Scene MakeScene() {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.num_frames = 3;
  options.max_num_features_per_image = 30;
  return Simulate(options).scene;
}

TEST(CheckConsistent, RefusesEveryWayToBeInconsistent) {
  const Scene good = MakeScene();
  EXPECT_NO_THROW(CheckConsistent(good));
  const std::function<void(Scene*)> damages[] = {
      [](Scene* s) { s->cameras[0].params.push_back(0.0); },
      [](Scene* s) { s->cameras[0].model = CameraModelId(1000); },
      [](Scene* s) { s->sensors[1].camera_idx = 99; },
      [](Scene* s) { s->sensors[1].rig_idx = -1; },
      [](Scene* s) { s->rigs[0].sensor_idxs.pop_back(); },
      [](Scene* s) { s->rigs[0].ref_sensor_idx = -1; },
      [](Scene* s) {
        s->sensors[s->rigs[0].ref_sensor_idx].sensor_from_rig.reset();
      },
      [](Scene* s) {
        s->sensors[s->rigs[0].ref_sensor_idx].sensor_from_rig =
            Rigid3{Eigen::Quaterniond::Identity(), Eigen::Vector3d::UnitX()};
      },
      [](Scene* s) {
        s->sensors[s->rigs[0].ref_sensor_idx].sensor_from_rig = Rigid3{
            ExpSO3(Eigen::Vector3d(0.0, 0.1, 0.0)), Eigen::Vector3d::Zero()};
      },
      [](Scene* s) { s->frames[0].rig_idx = 1; },
      [](Scene* s) { s->frames[0].image_idxs.push_back(0); },
      [](Scene* s) { s->frames[0].image_idxs[0] = 1000; },
      [](Scene* s) { s->frames[0].image_idxs.pop_back(); },
      [](Scene* s) {  // two images of one sensor
        const Image& first = s->images[s->frames[0].image_idxs[0]];
        Image& second = s->images[s->frames[0].image_idxs[1]];
        second.sensor_idx = first.sensor_idx;
        second.camera_idx = first.camera_idx;
      },
      [](Scene* s) { s->images[0].frame_idx = 1; },
      [](Scene* s) { s->images[0].camera_idx = 3; },
      [](Scene* s) { s->images[0].sensor_idx = 77; },
  };
  for (const auto& damage : damages) {
    Scene bad = good;
    damage(&bad);
    EXPECT_THROW(CheckConsistent(bad), ContractError)
        << "damage " << &damage - damages;
  }
}

TEST(ComputeBearings, AreUnitRaysThatProjectToTheKeypoints) {
  const Scene scene = MakeScene();
  const Bearings bearings = ComputeBearings(scene, 2);
  ASSERT_EQ(bearings.images.size(), scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    const Camera& camera = scene.cameras[image.camera_idx];
    ASSERT_EQ(bearings.images[i].size(), image.keypoints_px.size());
    for (size_t k = 0; k < image.keypoints_px.size(); ++k) {
      ASSERT_TRUE(bearings.HasRay(static_cast<int>(i), static_cast<int>(k)));
      const Eigen::Vector3d& ray =
          bearings.Ray(static_cast<int>(i), static_cast<int>(k));
      EXPECT_NEAR(ray.norm(), 1.0, 1e-14);
      const auto pixel =
          ProjectToPixel(camera.model, camera.params.data(), ray);
      ASSERT_TRUE(pixel.has_value());
      EXPECT_LT((pixel->cast<float>() - image.keypoints_px[k]).norm(), 1e-3f);
    }
  }
}

TEST(ComputeBearings, KeypointsThatNoRayReachesHaveNone) {
  Scene scene = MakeScene();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  scene.images[0].keypoints_px[0] = Eigen::Vector2f(nan, 1.0f);
  const Bearings bearings = ComputeBearings(scene, 1);
  EXPECT_FALSE(bearings.HasRay(0, 0));
  EXPECT_EQ(bearings.Ray(0, 0), Eigen::Vector3d::Zero());
  EXPECT_TRUE(bearings.HasRay(0, 1));
}

// The image of an equidistant fisheye ends at pi focal lengths from the
// principal point.
TEST(ComputeBearings, PixelsBeyondTheFieldOfViewHaveNone) {
  Scene scene = MakeScene();
  Camera& camera = scene.cameras[scene.images[0].camera_idx];
  camera.model = CameraModelId::kSimpleFisheye;
  camera.params = {100.0, 500.0, 400.0};
  scene.images[0].keypoints_px = {Eigen::Vector2f(500.0f + 310.0f, 400.0f),
                                  Eigen::Vector2f(500.0f + 320.0f, 400.0f)};
  const Bearings bearings = ComputeBearings(scene, 1);
  EXPECT_TRUE(bearings.HasRay(0, 0));
  EXPECT_FALSE(bearings.HasRay(0, 1));
}

TEST(SplitRig, LaterFramesGetSensorsOfTheirOwn) {
  Scene scene = MakeScene();
  for (Sensor& sensor : scene.sensors) {
    if (!sensor.sensor_from_rig) sensor.sensor_from_rig = Rigid3();
  }
  const Scene split = SplitRig(scene, scene.frames[1].name);
  EXPECT_NO_THROW(CheckConsistent(split));
  ASSERT_EQ(split.rigs.size(), 2u);
  EXPECT_EQ(split.sensors.size(), 2 * scene.sensors.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = split.images[i];
    const bool is_late = scene.images[i].frame_idx >= 1;
    EXPECT_EQ(image.frame_idx, scene.images[i].frame_idx);
    EXPECT_EQ(split.sensors[image.sensor_idx].rig_idx, is_late ? 1 : 0);
    EXPECT_EQ(split.sensors[image.sensor_idx].name,
              scene.sensors[scene.images[i].sensor_idx].name);
  }
  // The known poses are those before the split.
  for (size_t k = 0; k < split.sensors.size(); ++k) {
    EXPECT_EQ(split.sensors[k].sensor_from_rig.has_value(),
              split.sensors[k].rig_idx == 0 ||
                  split.IsReference(static_cast<int>(k)));
  }
}

// Names may be in another order than times.
TEST(SplitRig, LaterFramesAreThoseOfLaterTimes) {
  Scene scene = MakeScene();
  for (Image& image : scene.images) image.timestamp_s = -1.0 * image.frame_idx;
  EXPECT_THROW((void)SplitRig(scene, scene.frames.back().name), Error);
  const Scene split = SplitRig(scene, scene.frames[0].name);
  EXPECT_NE(split.frames[0].rig_idx, split.frames.back().rig_idx);
  EXPECT_EQ(split.frames.back().rig_idx, scene.frames.back().rig_idx);
}

TEST(SplitRig, RefusesFramesThatSplitNothing) {
  const Scene scene = MakeScene();
  EXPECT_THROW((void)SplitRig(scene, "no frame"), Error);
  EXPECT_THROW((void)SplitRig(scene, scene.frames[0].name), Error);
}

// Frames without an image of the reference sensor are not behind all others.
TEST(OrderOfFrames, FollowsTheCommonPartOfNamesOrTheTimes) {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.num_frames = 12;
  options.missing_image_ratio = 0.5;
  Scene scene = Simulate(options).scene;
  const auto expect_ordered = [&] {
    for (size_t f = 1; f < scene.frames.size(); ++f) {
      EXPECT_LT(scene.frames[f - 1].name, scene.frames[f].name);
    }
    EXPECT_NO_THROW(CheckConsistent(scene));
  };
  std::reverse(scene.frames.begin(), scene.frames.end());
  for (Image& image : scene.images) {
    image.frame_idx =
        static_cast<int>(scene.frames.size()) - 1 - image.frame_idx;
  }
  const Scene reversed = scene;
  const std::vector<int> order = SortFrames(&scene);
  expect_ordered();
  for (size_t f = 0; f < order.size(); ++f) {
    EXPECT_EQ(reversed.frames[order[f]].name, scene.frames[f].name);
  }
  // Without times, names decide; numbers of fewer digits are smaller.
  scene = reversed;
  for (Image& image : scene.images) image.timestamp_s.reset();
  SortFrames(&scene);
  expect_ordered();
  scene.frames[0].name = "x10";
  scene.frames[1].name = "x9";
  const std::vector<int> by_number = OrderOfFrames(scene);
  EXPECT_EQ(by_number.back(), 0);
  EXPECT_EQ(by_number[by_number.size() - 2], 1);
}

// Two cameras took the photographs of one folder, by turns.
TEST(OrderOfFrames, SingleImagesOfAFolderAreOneSequence) {
  Scene scene = SeparateImages(MakeScene());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    scene.images[i].name = "photos/" + std::to_string(i) + ".jpg";
    scene.images[i].timestamp_s.reset();
  }
  std::vector<int> expected(scene.images.size());
  std::iota(expected.begin(), expected.end(), 0);
  ASSERT_GT(expected.size(), 10u);
  EXPECT_EQ(OrderOfFrames(scene), expected);
}

TEST(CameraLabel, NamesTheSensorsThatUseACamera) {
  Scene scene = MakeScene();
  scene.cameras[0].id = CameraId(7);
  EXPECT_EQ(CameraLabel(scene, 0), "camera 7 ('cam0')");
  scene.sensors[2].camera_idx = 0;
  EXPECT_EQ(CameraLabel(scene, 0), "camera 7 ('cam0', 'cam2')");
  for (Sensor& sensor : scene.sensors) sensor.name = "";
  EXPECT_EQ(CameraLabel(scene, 0), "camera 7");
}

}  // namespace
}  // namespace mgsfm
