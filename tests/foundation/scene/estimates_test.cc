// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/scene/estimates.h"

#include <gtest/gtest.h>

#include "geometry/so3.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

class EstimatesTest : public ::testing::Test {
 protected:
  EstimatesTest() {
    SimulationOptions options;
    options.num_frames = 4;
    options.max_num_features_per_image = 50;
    simulation_ = Simulate(options);
    for (const auto& pose : Truth().sensor_from_rig) {
      rotations_.sensor_from_rig.push_back(pose->rotation);
      positions_.sensor_from_rig_translation.push_back(pose->translation);
    }
    for (const auto& pose : Truth().rig_from_world) {
      rotations_.rig_from_world.push_back(pose->rotation);
      positions_.frame_center_in_world.push_back(pose->Center());
    }
    for (const Point3D& point : Truth().points) {
      positions_.point_in_world.push_back(point.point_in_world);
      tracks_.observations.insert(tracks_.observations.end(),
                                  point.track.begin(), point.track.end());
      tracks_.FinishGroup();
    }
  }

  const Scene& GetScene() const { return simulation_.scene; }
  const Reconstruction& Truth() const { return simulation_.ground_truth; }
  Reconstruction Join() const {
    return JoinEstimates(GetScene(), rotations_, positions_, tracks_);
  }

  Simulation simulation_;
  RotationEstimate rotations_;
  PositionEstimate positions_;
  ObservationGroups tracks_;
};

TEST_F(EstimatesTest, JoinsToTheModelTheyAreOf) {
  const Reconstruction joined = Join();
  for (size_t i = 0; i < GetScene().images.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const auto pose = joined.CamFromWorld(GetScene(), image_idx);
    const auto true_pose = Truth().CamFromWorld(GetScene(), image_idx);
    ASSERT_TRUE(pose && true_pose);
    EXPECT_LT((pose->Center() - true_pose->Center()).norm(), 1e-12);
    EXPECT_LT(AngleBetween(pose->rotation, true_pose->rotation), 1e-7);
    EXPECT_LT(AngleBetween(*rotations_.CamFromWorld(GetScene(), image_idx),
                           true_pose->rotation),
              1e-7);
  }
  size_t num_long_tracks = 0;
  for (const Point3D& point : Truth().points) {
    num_long_tracks += point.track.size() >= 2;
  }
  EXPECT_EQ(joined.points.size(), num_long_tracks);
}

TEST_F(EstimatesTest, WhatIsNotEstimatedIsLeftOut) {
  positions_.frame_center_in_world[1].reset();
  rotations_.rig_from_world[2].reset();
  positions_.point_in_world[0].reset();
  const Reconstruction joined = Join();
  for (size_t i = 0; i < GetScene().images.size(); ++i) {
    const int frame_idx = GetScene().images[i].frame_idx;
    const int image_idx = static_cast<int>(i);
    const bool is_known = frame_idx != 1 && frame_idx != 2;
    EXPECT_EQ(joined.IsRegistered(GetScene(), image_idx), is_known);
    EXPECT_EQ(joined.CamFromWorld(GetScene(), image_idx).has_value(), is_known);
  }
  for (const Point3D& point : joined.points) {
    EXPECT_GE(point.track.size(), 2u);
    EXPECT_NE(point.point_in_world, Truth().points[0].point_in_world);
    for (const Observation& observation : point.track) {
      EXPECT_TRUE(joined.IsRegistered(GetScene(), observation.image_idx));
    }
  }
}

TEST_F(EstimatesTest, ImagesOfSensorsWithoutTranslationAreNotRegistered) {
  const int sensor_idx = static_cast<int>(GetScene().sensors.size()) - 1;
  positions_.sensor_from_rig_translation[sensor_idx].reset();
  const Reconstruction joined = Join();
  for (size_t i = 0; i < GetScene().images.size(); ++i) {
    EXPECT_EQ(joined.IsRegistered(GetScene(), static_cast<int>(i)),
              GetScene().images[i].sensor_idx != sensor_idx);
  }
  for (const Point3D& point : joined.points) {
    for (const Observation& observation : point.track) {
      EXPECT_TRUE(joined.IsRegistered(GetScene(), observation.image_idx));
    }
  }
}

TEST_F(EstimatesTest, MovingTheWorldKeepsWhatCamerasSee) {
  const Sim3 new_from_old = {2.5, ExpSO3(Eigen::Vector3d(0.3, -1.0, 0.2)),
                             Eigen::Vector3d(4.0, -5.0, 6.0)};
  Reconstruction moved = Truth();
  TransformWorld(new_from_old, &moved);
  for (size_t p = 0; p < moved.points.size(); ++p) {
    for (const Observation& observation : moved.points[p].track) {
      const auto old_pose =
          Truth().CamFromWorld(GetScene(), observation.image_idx);
      const auto new_pose =
          moved.CamFromWorld(GetScene(), observation.image_idx);
      const Eigen::Vector3d in_old_cam =
          *old_pose * Truth().points[p].point_in_world;
      const Eigen::Vector3d in_new_cam =
          *new_pose * moved.points[p].point_in_world;
      EXPECT_LT((in_new_cam - new_from_old.scale * in_old_cam).norm(), 1e-10);
      const Camera& camera =
          GetScene()
              .cameras[GetScene().images[observation.image_idx].camera_idx];
      const auto old_pixel =
          ProjectToPixel(camera.model, camera.params.data(), in_old_cam);
      const auto new_pixel =
          ProjectToPixel(camera.model, camera.params.data(), in_new_cam);
      ASSERT_TRUE(old_pixel && new_pixel);
      EXPECT_LT((*new_pixel - *old_pixel).norm(), 1e-8);
    }
  }
}

TEST(Observation, OrderIsByImageThenKeypoint) {
  EXPECT_LT((Observation{1, 9}), (Observation{2, 0}));
  EXPECT_LT((Observation{1, 1}), (Observation{1, 2}));
  EXPECT_FALSE((Observation{1, 1} < Observation{1, 1}));
  EXPECT_EQ((Observation{1, 1}), (Observation{1, 1}));
}

TEST(ObservationGroups, AreDelimitedByFinishGroup) {
  ObservationGroups groups;
  EXPECT_EQ(groups.size(), 0u);
  groups.observations = {{0, 1}, {1, 1}};
  groups.FinishGroup();
  groups.FinishGroup();
  groups.observations.push_back({2, 2});
  groups.FinishGroup();
  ASSERT_EQ(groups.size(), 3u);
  EXPECT_EQ(groups.length(0), 2u);
  EXPECT_EQ(groups.length(1), 0u);
  EXPECT_EQ(groups.begin(2)->image_idx, 2);
  EXPECT_EQ(groups.end(2) - groups.begin(2), 1);
}

}  // namespace
}  // namespace mgsfm
