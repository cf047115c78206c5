// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/model_tools/model_tools.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <numeric>
#include <set>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/simulator/simulation.h"
#include "support/partial_model.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

SceneModel Drive(int num_frames = 12) {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.num_frames = num_frames;
  options.num_points_per_frame = 60;
  options.max_num_features_per_image = 60;
  Simulation simulation = Simulate(options);
  SceneModel drive{std::move(simulation.scene),
                   std::move(simulation.ground_truth)};
  RemoveLargeErrors(1.0, &drive);
  return drive;
}

Sim3 RandomSimilarity(uint64_t seed) {
  Random random(seed);
  const auto vector = [&] {
    return Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal());
  };
  return {std::exp(random.Uniform(-2.0, 2.0)), ExpSO3(vector()),
          30.0 * vector()};
}

// Poses by image name, because the indices in a part of a drive differ.
std::map<std::string, Rigid3> PosesOf(const SceneModel& model) {
  std::map<std::string, Rigid3> poses;
  for (size_t i = 0; i < model.scene.images.size(); ++i) {
    poses[model.scene.images[i].name] =
        *model.reconstruction.CamFromWorld(model.scene, static_cast<int>(i));
  }
  return poses;
}

void ExpectSamePoses(const SceneModel& a, const SceneModel& b) {
  const auto poses_a = PosesOf(a), poses_b = PosesOf(b);
  ASSERT_EQ(poses_a.size(), poses_b.size());
  for (const auto& [name, pose] : poses_a) {
    const Rigid3& other = poses_b.at(name);
    EXPECT_LT(AngleBetween(pose.rotation, other.rotation), 1e-7) << name;
    EXPECT_LT((pose.Center() - other.Center()).norm(), 1e-6) << name;
  }
}

// The observations of a point: image names and keypoints.
using Track = std::set<std::pair<std::string, int>>;
std::map<Track, Eigen::Vector3d> PointsOf(const SceneModel& model) {
  std::map<Track, Eigen::Vector3d> points;
  for (const Point3D& point : model.reconstruction.points) {
    Track track;
    for (const Observation& o : point.track) {
      track.emplace(model.scene.images[o.image_idx].name, o.keypoint_idx);
    }
    points[track] = point.point_in_world;
  }
  EXPECT_EQ(points.size(), model.reconstruction.points.size());
  return points;
}

template <class Predicate>
SceneModel Part(SceneModel model, const Predicate& is_kept) {
  Mask keeps;
  for (const Image& image : model.scene.images) keeps.push_back(is_kept(image));
  KeepImages(keeps, &model);
  CheckConsistent(model.scene);
  return model;
}

SceneModel Frames(const SceneModel& model, int begin, int end) {
  return Part(model, [&](const Image& image) {
    return image.frame_idx >= begin && image.frame_idx < end;
  });
}

// --------------------------------------------------------------- selection

TEST(ModelTools, DeletedImagesLeaveAllOthersAsTheyWere) {
  const SceneModel drive = Drive();
  // All of frame 3, and the reference images of frame 5.
  const auto is_kept = [&](const Image& image) {
    return image.frame_idx != 3 &&
           !(image.frame_idx == 5 && drive.scene.IsReference(image.sensor_idx));
  };
  const SceneModel part = Part(drive, is_kept);
  EXPECT_EQ(part.scene.frames.size(), drive.scene.frames.size() - 1);
  EXPECT_EQ(part.scene.sensors.size(), drive.scene.sensors.size());
  const auto before = PosesOf(drive), after = PosesOf(part);
  for (const auto& [name, pose] : after) {
    EXPECT_EQ(pose.translation, before.at(name).translation);
  }
  EXPECT_EQ(after.size(), before.size() - 5);
  for (const auto& [track, place] : PointsOf(part)) {
    EXPECT_GE(track.size(), 2u);
    for (const auto& [name, keypoint_idx] : track) {
      EXPECT_EQ(after.count(name), 1u) << name;
    }
  }
  size_t num_observations = 0;
  for (const Point3D& point : drive.reconstruction.points) {
    size_t num_left = 0;
    for (const Observation& o : point.track) {
      num_left += is_kept(drive.scene.images[o.image_idx]) ? 1 : 0;
    }
    if (num_left >= 2) num_observations += num_left;
  }
  EXPECT_EQ(AnalyzeModel(part).num_observations, num_observations);
}

TEST(ModelTools, ABoxKeepsItsPointsAndWhoeverSeesThem) {
  const SceneModel drive = Drive();
  const Eigen::AlignedBox3d box = BoxOfQuantiles(drive, 0.0, 0.4);
  SceneModel part = drive;
  KeepBox(box, &part);
  CheckConsistent(part.scene);
  EXPECT_LT(part.reconstruction.points.size(),
            drive.reconstruction.points.size());
  std::set<std::string> frames;
  size_t num_inside = 0;
  for (const Point3D& point : drive.reconstruction.points) {
    if (!box.contains(point.point_in_world)) continue;
    ++num_inside;
    for (const Observation& o : point.track) {
      frames.insert(
          drive.scene.frames[drive.scene.images[o.image_idx].frame_idx].name);
    }
  }
  EXPECT_GT(num_inside, 0u);
  EXPECT_EQ(part.reconstruction.points.size(), num_inside);
  EXPECT_EQ(part.scene.frames.size(), frames.size());
  EXPECT_EQ(part.scene.images.size(), 4 * frames.size());
  EXPECT_TRUE(
      BoxOfQuantiles(drive, 0.0, 1.0)
          .contains(drive.reconstruction.points.front().point_in_world));
}

// --------------------------------------------------------------- alignment

TEST(ModelTools, ThePathLiesOnTheGround) {
  for (uint64_t seed = 0; seed < 10; ++seed) {
    // A planar path, on which all cameras stand upright: y is down.
    SceneModel drive = Drive();
    for (size_t i = 0; i < drive.reconstruction.rig_from_world.size(); ++i) {
      const double angle = seed % 2 == 0 ? 0.2 * static_cast<double>(i) : 0.0;
      drive.reconstruction.rig_from_world[i] = Rigid3::FromRotationAndCenter(
          ExpSO3({0.0, -angle, 0.0}),
          {std::sin(angle), 0.0, static_cast<double>(i)});
    }
    TransformWorld(RandomSimilarity(seed), &drive.reconstruction);
    const std::optional<Sim3> transform = AlignToGroundPlane(drive);
    ASSERT_TRUE(transform.has_value());
    EXPECT_EQ(transform->scale, 1.0);
    TransformWorld(*transform, &drive.reconstruction);
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const auto& pose : drive.reconstruction.rig_from_world) {
      EXPECT_NEAR(pose->Center().z(), 0.0, 1e-7);
      const Eigen::Vector3d up =
          pose->rotation.conjugate() * -Eigen::Vector3d::UnitY();
      EXPECT_NEAR(up.z(), 1.0, 1e-9);
      mean += pose->Center();
    }
    EXPECT_LT(mean.norm(), 1e-6);
    // The second alignment changes nothing.
    const std::optional<Sim3> again = AlignToGroundPlane(drive);
    EXPECT_LT(AngleBetween(again->rotation, Eigen::Quaterniond::Identity()),
              1e-6);
  }
}

TEST(ModelTools, CommonImagesAlignModels) {
  const SceneModel drive = Drive();
  for (uint64_t seed = 0; seed < 5; ++seed) {
    SceneModel part = Frames(drive, 2, 9);
    TransformWorld(RandomSimilarity(seed), &part.reconstruction);
    const std::vector<ImagePoses> pairs = PairImages(part, drive);
    ASSERT_EQ(pairs.size(), part.scene.images.size());
    TransformWorld(*AlignPoses(pairs), &part.reconstruction);
    ExpectSamePoses(part, Frames(drive, 2, 9));
  }
}

// ----------------------------------------------------------------- merging

TEST(ModelTools, OverlappingHalvesBecomeTheWhole) {
  const SceneModel drive = Drive();
  for (uint64_t seed = 0; seed < 5; ++seed) {
    SceneModel first = Frames(drive, 0, 8);
    SceneModel second = Frames(drive, 5, 12);
    const Sim3 gauge = RandomSimilarity(seed);
    TransformWorld(gauge, &second.reconstruction);
    const MergeSummary summary = MergeModels(second, {}, &first);
    EXPECT_EQ(summary.num_common_frames, 3);
    EXPECT_EQ(summary.num_common_images, 12);
    EXPECT_EQ(summary.num_new_images, 16);
    EXPECT_EQ(summary.num_dropped_points, 0);
    EXPECT_NEAR(summary.first_from_second.scale * gauge.scale, 1.0, 1e-9);
    ExpectSamePoses(first, drive);
    EXPECT_EQ(first.scene.rigs.size(), 1u);
    EXPECT_EQ(first.scene.sensors.size(), 4u);
    EXPECT_EQ(first.scene.frames.size(), 12u);
    // A point without an observation in common frames stays two points.
    std::map<std::pair<std::string, int>, Eigen::Vector3d> place_of;
    for (const auto& [track, place] : PointsOf(drive)) {
      for (const auto& observation : track) place_of[observation] = place;
    }
    size_t num_observations = 0;
    for (const auto& [track, place] : PointsOf(first)) {
      num_observations += track.size();
      for (const auto& observation : track) {
        EXPECT_LT((place_of.at(observation) - place).norm(), 1e-6);
      }
    }
    EXPECT_LE(num_observations, AnalyzeModel(drive).num_observations);
    EXPECT_GT(num_observations, 0.9 * AnalyzeModel(drive).num_observations);
  }
}

TEST(ModelTools, CommonFramesMergeModelsWithoutCommonImages) {
  const SceneModel drive = Drive();
  const auto sensors = [&](int begin, int end) {
    return Part(drive, [&](const Image& image) {
      return image.sensor_idx >= begin && image.sensor_idx < end;
    });
  };
  SceneModel first = sensors(0, 2), second = sensors(2, 4);
  TransformWorld(RandomSimilarity(3), &second.reconstruction);
  const MergeSummary summary = MergeModels(second, {}, &first);
  EXPECT_EQ(summary.num_common_frames, 12);
  ExpectSamePoses(first, drive);
  EXPECT_EQ(first.scene.frames.size(), 12u);
}

// The second model has a rig that the first one lacks.
TEST(ModelTools, KnownPosesStayKnownInMergedModels) {
  SimulationInput input;
  input.rig = MakeRig(RigPreset::kStereo);
  for (const char* name : {"other0/", "other1/"}) {
    SimulatedCamera camera = input.rig[input.rig.size() - 2];
    camera.image_prefix = name;
    input.rig.push_back(camera);
  }
  SimulationOptions options;
  options.num_frames = 12;
  options.extrinsics_are_known = true;
  Simulation simulation = Simulate(options, input);
  SplitRig(2, &simulation);
  simulation.scene.sensors[3].sensor_from_rig =
      simulation.ground_truth.sensor_from_rig[3];
  const SceneModel drive{simulation.scene, simulation.ground_truth};
  const SceneModel first = Part(drive, [&](const Image& image) {
    return drive.scene.frames[image.frame_idx].rig_idx == 0;
  });
  SceneModel merged = first;
  MergeModels(drive, {}, &merged);
  ASSERT_EQ(merged.scene.sensors.size(), drive.scene.sensors.size());
  for (const Sensor& sensor : merged.scene.sensors) {
    ASSERT_TRUE(sensor.sensor_from_rig.has_value()) << sensor.name;
  }
  ExpectSamePoses(merged, drive);
}

TEST(ModelTools, IdsStayUniqueInMergedModels) {
  const SceneModel drive = Drive();
  SceneModel first = Frames(drive, 0, 8), second = Frames(drive, 5, 12);
  uint32_t next = 1;
  for (Image& image : first.scene.images) image.id = ImageId(next++);
  next = 1;
  for (Image& image : second.scene.images) image.id = ImageId(next++);
  MergeModels(second, {}, &first);
  std::set<ImageId> ids;
  for (const Image& image : first.scene.images) ids.insert(image.id);
  EXPECT_EQ(ids.size(), first.scene.images.size());
  ExpectSamePoses(first, drive);
}

void ExpectNotMerged(const SceneModel& second, SceneModel first,
                     const std::string& message) {
  try {
    MergeModels(second, {}, &first);
    ADD_FAILURE() << "merged, not: " << message;
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr(message));
  }
}

TEST(ModelTools, ContradictoryModelsAreNotMerged) {
  const SceneModel drive = Drive();
  const SceneModel first = Frames(drive, 0, 8), second = Frames(drive, 5, 12);
  ExpectNotMerged(Frames(drive, 8, 12), first, "0 images in common");
  // Its frames are in another order.
  SceneModel scrambled = drive;
  for (size_t i = 0; i < 12; ++i) {
    scrambled.reconstruction.rig_from_world[i] =
        drive.reconstruction.rig_from_world[(5 * i + 1) % 12];
  }
  scrambled.reconstruction.points.clear();
  ExpectNotMerged(scrambled, drive, "differ in shape");

  SceneModel other = second;
  for (Image& image : other.scene.images) image.keypoints_px.resize(3);
  ExpectNotMerged(other, first, "other keypoints");

  other = second;
  for (Camera& camera : other.scene.cameras) camera.width_px += 1;
  ExpectNotMerged(other, first, "another camera model or size");

  other = second;
  for (size_t i = 0; i < other.scene.sensors.size(); ++i) {
    if (other.scene.IsReference(static_cast<int>(i))) continue;
    auto& pose = other.reconstruction.sensor_from_rig[i];
    pose->rotation = ExpSO3({0.0, 0.2, 0.0}) * pose->rotation;
  }
  ExpectNotMerged(other, first, "the rig has changed");
}

// ---------------------------------------------------------------- analysis

TEST(ModelTools, StatisticsCountWhatIsThere) {
  const SceneModel drive = Drive();
  const ModelStatistics statistics = AnalyzeModel(drive);
  EXPECT_EQ(statistics.num_rigs, 1u);
  EXPECT_EQ(statistics.num_frames, 12u);
  EXPECT_EQ(statistics.num_images, 48u);
  EXPECT_EQ(statistics.num_points, drive.reconstruction.points.size());
  const auto num_observations =
      static_cast<double>(statistics.num_observations);
  EXPECT_NEAR(statistics.mean_observations_per_image, num_observations / 48.0,
              1e-12);
  EXPECT_NEAR(
      statistics.mean_track_length * static_cast<double>(statistics.num_points),
      num_observations, 1e-9);
  // Without noise, keypoints are the projections in single precision.
  EXPECT_LT(*statistics.mean_reprojection_error_px, 1e-3);
}

// The mean over all observations of points with a known error.
TEST(ModelTools, LongTracksCountMoreInTheMeanReprojectionError) {
  SceneModel drive = Drive();
  std::vector<double> errors_px;
  for (Point3D& point : drive.reconstruction.points) {
    point.error_px = point.track.size();
    errors_px.insert(errors_px.end(), point.track.size(), *point.error_px);
  }
  drive.reconstruction.points.front().error_px.reset();
  errors_px.erase(errors_px.begin(),
                  errors_px.begin() +
                      static_cast<std::ptrdiff_t>(
                          drive.reconstruction.points.front().track.size()));
  const double mean_px =
      std::accumulate(errors_px.begin(), errors_px.end(), 0.0) /
      static_cast<double>(errors_px.size());
  EXPECT_NEAR(*AnalyzeModel(drive).mean_reprojection_error_px, mean_px, 1e-9);
}

}  // namespace
}  // namespace mgsfm
