// SPDX-License-Identifier: BSD-3-Clause
// Inputs on which other systems crash, or silently go wrong: each from a
// database to models.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <string>

#include "mgsfm/base/random.h"
#include "mgsfm/eval/evaluation.h"
#include "mgsfm/geometry/so3.h"
#include "mgsfm/io/scene_loading.h"
#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {
namespace {

// A database without rigs, and the true poses by image name.
struct Drive {
  DatabaseContents contents;
  std::map<std::string, Rigid3> true_poses;
};

SimulationOptions SmallDrive(RigPreset rig, int num_frames = 12) {
  SimulationOptions options;
  options.rig = rig;
  options.num_frames = num_frames;
  options.max_num_features_per_image = 200;
  options.pixel_noise_px = 0.3;
  return options;
}

Drive MakeDrive(const Simulation& simulation) {
  const Scene& scene = simulation.scene;
  Drive drive{MakeDatabaseContents(scene, simulation.view_graph), {}};
  drive.contents.path = "simulated.db";
  for (size_t i = 0; i < scene.images.size(); ++i) {
    drive.true_poses[scene.images[i].name] =
        *simulation.ground_truth.CamFromWorld(scene, static_cast<int>(i));
  }
  return drive;
}

Drive MakeDriveWithoutRigs(const SimulationOptions& options) {
  Drive drive = MakeDrive(Simulate(options));
  drive.contents.rigs.clear();
  drive.contents.frames.clear();
  return drive;
}

std::string NameOf(const DatabaseContents& contents, ImageId id) {
  for (const ImageRow& image : contents.images) {
    if (image.id == id) return image.name;
  }
  return "";
}

bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// Takes out the pairs for whose image names the function is true.
void RemovePairs(
    const std::function<bool(const std::string&, const std::string&)>& is_bad,
    DatabaseContents* contents) {
  auto& pairs = contents->pairs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                             [&](const TwoViewGeometryRow& pair) {
                               return is_bad(NameOf(*contents, pair.image_id1),
                                             NameOf(*contents, pair.image_id2));
                             }),
              pairs.end());
}

void RemoveImages(const std::function<bool(const std::string&)>& is_bad,
                  DatabaseContents* contents) {
  RemovePairs(
      [&](const std::string& name1, const std::string& name2) {
        return is_bad(name1) || is_bad(name2);
      },
      contents);
  auto& images = contents->images;
  images.erase(
      std::remove_if(images.begin(), images.end(),
                     [&](const ImageRow& image) { return is_bad(image.name); }),
      images.end());
}

struct Outcome {
  Scene scene;
  MapperResult result;
};

Outcome Map(const Drive& drive, int min_num_frames = 3) {
  Context context;
  context.num_threads = 2;
  LoadedScene loaded =
      LoadScene(drive.contents, SceneLoadingOptions(), context);
  MapperOptions options;
  options.min_num_frames = min_num_frames;
  MapperResult result =
      RunMapper(loaded.scene, loaded.view_graph, options, context);
  return {std::move(loaded.scene), std::move(result)};
}

Evaluation EvaluateModel(const Drive& drive, const Outcome& outcome,
                         size_t model_idx = 0) {
  const Reconstruction& model = outcome.result.models[model_idx].reconstruction;
  std::vector<ImagePoses> images;
  for (size_t i = 0; i < outcome.scene.images.size(); ++i) {
    const Image& image = outcome.scene.images[i];
    const bool is_reference = outcome.scene.IsReference(image.sensor_idx);
    images.push_back({image.name, is_reference,
                      model.CamFromWorld(outcome.scene, static_cast<int>(i)),
                      drive.true_poses.at(image.name)});
  }
  return Evaluate(images, true, {}, {});
}

void ExpectRight(const Evaluation& evaluation) {
  ASSERT_TRUE(evaluation.position_m.has_value());
  EXPECT_LT(evaluation.position_m->max, 0.05);
  EXPECT_LT(evaluation.rotation_deg->max, 0.2);
}

// Relative rotations, which need no alignment: the one by positions is loose on
// a path of few metres.
void ExpectRightRotations(const Drive& drive, const Outcome& outcome) {
  ASSERT_EQ(outcome.result.models.size(), 1u);
  const Reconstruction& model = outcome.result.models[0].reconstruction;
  const auto rotation_from_first = [&](int i) {
    const auto first = model.CamFromWorld(outcome.scene, 0);
    const auto pose = model.CamFromWorld(outcome.scene, i);
    EXPECT_TRUE(first && pose);
    return Eigen::Quaterniond(pose->rotation * first->rotation.conjugate());
  };
  const auto true_rotation_from_first = [&](int i) {
    const auto rotation = [&](int k) {
      return drive.true_poses.at(outcome.scene.images[k].name).rotation;
    };
    return Eigen::Quaterniond(rotation(i) * rotation(0).conjugate());
  };
  for (size_t i = 0; i < outcome.scene.images.size(); ++i) {
    const int idx = static_cast<int>(i);
    EXPECT_LT(RadToDeg(AngleBetween(rotation_from_first(idx),
                                    true_rotation_from_first(idx))),
              0.2);
  }
}

// One model of everything.
void ExpectAllRight(const Drive& drive, const Outcome& outcome) {
  ASSERT_EQ(outcome.result.models.size(), 1u);
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered,
            static_cast<int>(drive.contents.images.size()));
  EXPECT_TRUE(outcome.result.unregistered_frames.empty());
  ExpectRight(evaluation);
}

TEST(Hazards, FramesWithoutReferenceImage) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kKitti360));
  RemoveImages(
      [](const std::string& name) {
        return name == "cam0/000003.png" || name == "cam0/000004.png" ||
               name == "cam0/000011.png";
      },
      &drive.contents);
  ExpectAllRight(drive, Map(drive));
}

TEST(Hazards, ArbitraryCameraIds) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kKitti360));
  std::map<CameraId, CameraId> new_ids;
  const uint32_t ids[] = {2147483646, 7, 100000, 3};
  for (size_t i = 0; i < 4; ++i) {
    Camera& camera = drive.contents.cameras[i];
    camera.id = new_ids.emplace(camera.id, CameraId(ids[i])).first->second;
  }
  for (ImageRow& image : drive.contents.images) {
    image.camera_id = new_ids.at(image.camera_id);
  }
  ExpectAllRight(drive, Map(drive));
}

TEST(Hazards, SharedCameraOverFolders) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo));
  drive.contents.cameras.pop_back();
  for (ImageRow& image : drive.contents.images) {
    image.camera_id = drive.contents.cameras[0].id;
  }
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.frames.size(), 12u);
  ExpectAllRight(drive, outcome);
}

// Puts all ids and names of a drive elsewhere, so that another one can join it.
void Rename(const std::function<std::string(const std::string&)>& new_name,
            uint32_t id_offset, Drive* drive) {
  const auto shift = [id_offset](auto* id) {
    *id = std::decay_t<decltype(*id)>(id->value() + id_offset);
  };
  DatabaseContents& contents = drive->contents;
  std::map<std::string, Rigid3> true_poses;
  for (Camera& camera : contents.cameras) shift(&camera.id);
  for (ImageRow& image : contents.images) {
    true_poses[new_name(image.name)] = drive->true_poses.at(image.name);
    image.name = new_name(image.name);
    shift(&image.id);
    shift(&image.camera_id);
  }
  for (TwoViewGeometryRow& pair : contents.pairs) {
    shift(&pair.image_id1);
    shift(&pair.image_id2);
  }
  for (RigRow& rig : contents.rigs) {
    shift(&rig.id);
    if (rig.ref_camera_id) shift(&*rig.ref_camera_id);
    for (RigSensorRow& sensor : rig.sensors) shift(&sensor.camera_id);
  }
  for (FrameRow& frame : contents.frames) {
    shift(&frame.id);
    shift(&frame.rig_id);
    for (FrameDataRow& data : frame.data) {
      shift(&data.camera_id);
      shift(&data.image_id);
    }
  }
  drive->true_poses = true_poses;
}

template <class T>
void Append(const std::vector<T>& from, std::vector<T>* to) {
  to->insert(to->end(), from.begin(), from.end());
}

Drive Join(const Drive& a, const Drive& b) {
  Drive joint = a;
  Append(b.contents.cameras, &joint.contents.cameras);
  Append(b.contents.images, &joint.contents.images);
  Append(b.contents.pairs, &joint.contents.pairs);
  Append(b.contents.rigs, &joint.contents.rigs);
  Append(b.contents.frames, &joint.contents.frames);
  joint.true_poses.insert(b.true_poses.begin(), b.true_poses.end());
  return joint;
}

constexpr uint32_t kIdOffset = 10000;

// The keypoints of each image by the world point they show.
std::map<std::string, std::map<double, uint32_t>> KeypointsByPoint(
    const Simulation& simulation) {
  std::map<std::string, std::map<double, uint32_t>> keypoints;
  for (const Point3D& point : simulation.ground_truth.points) {
    for (const Observation& o : point.track) {
      keypoints[simulation.scene.images[o.image_idx].name]
               [point.point_in_world.x()] =
                   static_cast<uint32_t>(o.keypoint_idx);
    }
  }
  return keypoints;
}

// Two vehicles, of different rigs, on one road: matches between their forward
// cameras join them to one model.
TEST(Hazards, TwoRigsInOneDatabase) {
  const Simulation stereo_simulation = Simulate(SmallDrive(RigPreset::kStereo));
  const Simulation kitti_simulation =
      Simulate(SmallDrive(RigPreset::kKitti360));
  Drive stereo = MakeDrive(stereo_simulation);
  Drive kitti = MakeDrive(kitti_simulation);
  const auto stereo_keypoints = KeypointsByPoint(stereo_simulation);
  const auto kitti_keypoints = KeypointsByPoint(kitti_simulation);
  std::vector<TwoViewGeometryRow> pairs;
  for (const ImageRow& image1 : stereo.contents.images) {
    for (const ImageRow& image2 : kitti.contents.images) {
      const int gap =
          std::stoi(image1.name.substr(5)) - std::stoi(image2.name.substr(5));
      if (std::abs(gap) != 1 || !Contains(image2.name, "cam0")) continue;
      TwoViewGeometryRow pair{image1.id,
                              ImageId(image2.id.value() + kIdOffset),
                              TwoViewConfig::kCalibrated,
                              {},
                              {},
                              {},
                              {},
                              {}};
      pair.cam2_from_cam1 = kitti.true_poses.at(image2.name) *
                            stereo.true_poses.at(image1.name).Inverse();
      for (const auto& [point, keypoint1] : stereo_keypoints.at(image1.name)) {
        const auto& keypoints2 = kitti_keypoints.at(image2.name);
        const auto it = keypoints2.find(point);
        if (it != keypoints2.end()) {
          pair.matches.push_back({keypoint1, it->second});
        }
      }
      if (pair.matches.size() >= 30) pairs.push_back(pair);
    }
  }
  ASSERT_FALSE(pairs.empty());
  Rename([](const std::string& name) { return "stereo/" + name; }, 0, &stereo);
  Rename([](const std::string& name) { return "kitti/" + name; }, kIdOffset,
         &kitti);
  Drive drive = Join(stereo, kitti);
  Append(pairs, &drive.contents.pairs);
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.rigs.size(), 2u);
  EXPECT_EQ(outcome.scene.frames.size(), 24u);
  ExpectAllRight(drive, outcome);
}

// cam0/a/000000.png and cam0/b/000000.png were not taken at the same time; and
// nothing connects the two sequences.
TEST(Hazards, SameFileNamesInTwoSequencesAreTwoModels) {
  SimulationOptions options = SmallDrive(RigPreset::kStereo);
  Drive first = MakeDriveWithoutRigs(options);
  options.random_seed = 9;
  options.num_frames = 8;
  Drive second = MakeDriveWithoutRigs(options);
  const auto insert = [](const std::string& sequence) {
    return [sequence](const std::string& name) {
      return name.substr(0, 5) + sequence + "/" + name.substr(5);
    };
  };
  Rename(insert("a"), 0, &first);
  Rename(insert("b"), kIdOffset, &second);
  for (ImageRow& image : second.contents.images) {
    image.camera_id = CameraId(image.camera_id.value() - kIdOffset);
  }
  second.contents.cameras.clear();
  const Drive drive = Join(first, second);
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.rigs.size(), 1u);
  EXPECT_EQ(outcome.scene.frames.size(), 20u);
  ASSERT_EQ(outcome.result.models.size(), 2u);
  for (size_t i = 0; i < 2; ++i) {
    const Evaluation evaluation = EvaluateModel(drive, outcome, i);
    EXPECT_EQ(evaluation.num_registered, i == 0 ? 24 : 16);
    ExpectRight(evaluation);
  }
}

// Two sequences that only wrong pairs join.
TEST(Hazards, WrongPairsDoNotJoinParts) {
  const SimulationOptions options = SmallDrive(RigPreset::kStereo, 14);
  Drive drive = MakeDriveWithoutRigs(options);
  const auto is_late = [](const std::string& name) {
    return name.substr(5) >= "000008.png";
  };
  Random random(3);
  int num_joining = 0;
  for (TwoViewGeometryRow& pair : drive.contents.pairs) {
    if (is_late(NameOf(drive.contents, pair.image_id1)) ==
            is_late(NameOf(drive.contents, pair.image_id2)) ||
        num_joining > 3) {
      continue;
    }
    ++num_joining;
    pair.config = TwoViewConfig::kCalibrated;
    pair.cam2_from_cam1 = Rigid3{
        ExpSO3({random.Normal(), random.Normal(), random.Normal()}),
        Eigen::Vector3d(random.Normal(), random.Normal(), random.Normal())};
    pair.E.reset();
    for (Match& match : pair.matches) match.keypoint_idx2 = random.Index(150);
  }
  int num_kept = 0;
  RemovePairs(
      [&](const std::string& name1, const std::string& name2) {
        return is_late(name1) != is_late(name2) && ++num_kept > num_joining;
      },
      &drive.contents);
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 2u);
  for (size_t i = 0; i < 2; ++i) ExpectRight(EvaluateModel(drive, outcome, i));
}

bool AreOfDifferentSensors(const std::string& name1, const std::string& name2) {
  return name1.substr(0, 4) != name2.substr(0, 4);
}

// Its rotation in the rig follows from its motion, if that turns enough; else
// it must be left out, not be taken for that of the reference.
TEST(Hazards, CameraNeverRegisteredWithOthers) {
  SimulationOptions options = SmallDrive(RigPreset::kKitti360, 36);
  for (const PathPreset path : {PathPreset::kCurve, PathPreset::kStraight}) {
    options.path = path;
    const Simulation simulation = Simulate(options);
    Drive drive = MakeDriveWithoutRigs(options);
    RemovePairs(
        [](const std::string& name1, const std::string& name2) {
          return AreOfDifferentSensors(name1, name2) &&
                 (Contains(name1, "cam3") || Contains(name2, "cam3"));
        },
        &drive.contents);
    const Outcome outcome = Map(drive);
    ASSERT_EQ(outcome.result.models.size(), 1u);
    const Reconstruction& model = outcome.result.models[0].reconstruction;
    const InternalRotationSummary& rotation =
        outcome.result.rotation.sensors[3];
    EXPECT_FALSE(rotation.message.empty());
    // Whether a short winding drive turns enough is for the noise to say.
    if (path == PathPreset::kStraight) {
      EXPECT_FALSE(rotation.is_observable);
    }
    ASSERT_EQ(model.sensor_from_rig[3].has_value(), rotation.is_observable);
    if (rotation.is_observable) {
      EXPECT_LT(RadToDeg(AngleBetween(
                    model.sensor_from_rig[3]->rotation,
                    simulation.ground_truth.sensor_from_rig[3]->rotation)),
                1.0);
    }
    const Evaluation evaluation = EvaluateModel(drive, outcome);
    EXPECT_EQ(evaluation.num_registered, rotation.is_observable ? 144 : 108);
    EXPECT_LT(evaluation.rotation_deg->max, 1.0);
  }
}

// Nothing tells how long the lever arms are, nor which way cameras look beside
// the direction of motion.
TEST(Hazards, StraightMotionWithoutOverlap) {
  SimulationOptions options = SmallDrive(RigPreset::kKitti360);
  options.path = PathPreset::kStraight;
  options.match_different_sensors = false;
  const Drive drive = MakeDriveWithoutRigs(options);
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  for (size_t i = 1; i < 4; ++i) {
    EXPECT_FALSE(outcome.result.rotation.sensors[i].is_observable);
    EXPECT_FALSE(outcome.result.rotation.sensors[i].message.empty());
    EXPECT_FALSE(
        outcome.result.models[0].reconstruction.sensor_from_rig[i].has_value());
  }
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered, 12);
  ExpectRight(evaluation);
}

// All cameras of a known rig move alike then, whatever the unit of length: the
// lever arms do not give it, and the summary says so.
TEST(Hazards, StraightMotionWithoutOverlapButKnownRig) {
  SimulationOptions options = SmallDrive(RigPreset::kKitti360);
  options.path = PathPreset::kStraight;
  options.match_different_sensors = false;
  options.extrinsics_are_known = true;
  const Drive drive = MakeDrive(Simulate(options));
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  const MapperModel& model = outcome.result.models[0];
  EXPECT_FALSE(model.translation.is_metric);
  for (size_t i = 1; i < 4; ++i) {
    EXPECT_FALSE(model.translation.sensors[i].message.empty());
  }
  std::vector<ImagePoses> references;
  for (size_t i = 0; i < outcome.scene.images.size(); ++i) {
    const Image& image = outcome.scene.images[i];
    const auto pose =
        model.reconstruction.CamFromWorld(outcome.scene, static_cast<int>(i));
    ASSERT_TRUE(pose.has_value()) << image.name;
    if (!outcome.scene.IsReference(image.sensor_idx)) continue;
    references.push_back(
        {image.name, true, pose, drive.true_poses.at(image.name)});
  }
  ExpectRight(Evaluate(references, true, {}, {}));
}

// The rig stops in the middle of a drive: copies of frame 6, with noise of
// their own, matched like it and with each other.
TEST(Hazards, StandingFramesAmongMovingOnes) {
  constexpr int kNumCopies = 4;
  const auto is_stop = [](const std::string& name) {
    return Contains(name, "/000006");
  };
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 14));
  DatabaseContents& contents = drive.contents;
  const std::vector<ImageRow> images = contents.images;
  const std::vector<TwoViewGeometryRow> pairs = contents.pairs;
  Random random(4);
  const auto copy_of = [&](ImageId id, int copy) {
    return copy == 0 || !is_stop(NameOf(contents, id))
               ? id
               : ImageId(id.value() + kIdOffset * copy);
  };
  const auto add_pair = [&](TwoViewGeometryRow pair, ImageId id1, ImageId id2) {
    pair.image_id1 = id1;
    pair.image_id2 = id2;
    if (id2 < id1) SwapImages(&pair);
    contents.pairs.push_back(pair);
  };
  for (int copy = 1; copy <= kNumCopies; ++copy) {
    for (ImageRow image : images) {
      if (!is_stop(image.name)) continue;
      TwoViewGeometryRow same{
          image.id, image.id, TwoViewConfig::kPanoramic, {}, {}, {}, {}, {}};
      for (uint32_t i = 0; i < image.keypoints_px.size(); ++i) {
        same.matches.push_back({i, i});
      }
      for (int other = 0; other < copy; ++other) {
        add_pair(same, copy_of(image.id, other), copy_of(image.id, copy));
      }
      const Rigid3 true_pose = drive.true_poses.at(image.name);
      image.id = copy_of(image.id, copy);
      image.name.insert(image.name.rfind('.'), "_" + std::to_string(copy));
      for (Eigen::Vector2f& keypoint : image.keypoints_px) {
        keypoint +=
            Eigen::Vector2d(0.3 * random.Normal(), 0.3 * random.Normal())
                .cast<float>();
      }
      drive.true_poses[image.name] = true_pose;
      contents.images.push_back(image);
    }
    for (const TwoViewGeometryRow& pair : pairs) {
      const ImageId id1 = copy_of(pair.image_id1, copy);
      const ImageId id2 = copy_of(pair.image_id2, copy);
      if (id1 != pair.image_id1 || id2 != pair.image_id2) {
        add_pair(pair, id1, id2);
      }
    }
  }
  const Outcome outcome = Map(drive);
  EXPECT_EQ(outcome.scene.frames.size(), 14u + kNumCopies);
  ExpectAllRight(drive, outcome);
}

TEST(Hazards, FewPairs) {
  // Three places almost on a line say little of how the worlds are turned
  // about it, so there is no noise.
  SimulationOptions options = SmallDrive(RigPreset::kMono, 3);
  options.pixel_noise_px = 0.0;
  const Drive mono = MakeDriveWithoutRigs(options);
  ASSERT_EQ(mono.contents.pairs.size(), 3u);
  ExpectRightRotations(mono, Map(mono));
  const Drive stereo = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 2));
  ASSERT_EQ(stereo.contents.pairs.size(), 6u);
  ExpectRightRotations(stereo, Map(stereo, 2));
  // One frame is no motion.
  const Drive single = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 1));
  EXPECT_TRUE(Map(single, 2).result.models.empty());
}

TEST(Hazards, EmptyGraph) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo));
  Drive weak = drive;
  for (TwoViewGeometryRow& pair : weak.contents.pairs) pair.matches.resize(3);
  drive.contents.pairs.clear();
  for (const Drive* input : {&drive, &weak}) {
    const Outcome outcome = Map(*input);
    EXPECT_TRUE(outcome.result.models.empty());
    ASSERT_EQ(outcome.result.unregistered_frames.size(), 12u);
    for (const UnregisteredFrame& frame : outcome.result.unregistered_frames) {
      EXPECT_FALSE(frame.reason.empty());
    }
  }
}

TEST(Hazards, FrameWithoutPairsIsNamed) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo));
  RemovePairs(
      [](const std::string& name1, const std::string& name2) {
        return Contains(name1, "000011") || Contains(name2, "000011");
      },
      &drive.contents);
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  ASSERT_EQ(outcome.result.unregistered_frames.size(), 1u);
  EXPECT_TRUE(Contains(
      outcome.scene.frames[outcome.result.unregistered_frames[0].frame_idx]
          .name,
      "000011"));
  ExpectRight(EvaluateModel(drive, outcome));
}

// Points behind the image plane count like all others.
TEST(Hazards, FisheyesOf180DegreesAndMore) {
  for (const RigPreset rig : {RigPreset::kKitti360, RigPreset::kCube6}) {
    SimulationOptions options = SmallDrive(rig);
    options.max_num_features_per_image = 400;
    const Drive drive = MakeDriveWithoutRigs(options);
    const Outcome outcome = Map(drive);
    ExpectAllRight(drive, outcome);
    int num_behind = 0;
    const Reconstruction& model = outcome.result.models[0].reconstruction;
    for (const Point3D& point : model.points) {
      for (const Observation& o : point.track) {
        const Rigid3 pose = *model.CamFromWorld(outcome.scene, o.image_idx);
        num_behind += (pose * point.point_in_world).z() < 0.0;
      }
    }
    EXPECT_GT(num_behind, 20);
  }
}

// Keypoints where the camera model has no ray.
TEST(Hazards, KeypointsWithoutRay) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kKitti360));
  for (ImageRow& image : drive.contents.images) {
    for (size_t i = 0; i < image.keypoints_px.size(); i += 10) {
      image.keypoints_px[i] = {1e6f, -1e6f};
    }
  }
  ExpectAllRight(drive, Map(drive));
}

}  // namespace
}  // namespace mgsfm
