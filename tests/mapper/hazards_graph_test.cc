// SPDX-License-Identifier: BSD-3-Clause
// Hazards of the connectivity of the view graph.
#include "mapper/hazard_drives.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/tracks/track_establishment.h"

namespace mgsfm {
namespace {

// Pairs of an image with three other frames. Each pair places the image
// elsewhere, rotated by 25 degrees relative to the others.
void AddContradictoryPairs(const PointsOfKeypoints& points,
                           const std::string& name, Drive* drive) {
  const std::string sensor = name.substr(0, 5);
  double angle = -25.0;
  for (const char* other : {"000007.png", "000008.png", "000009.png"}) {
    const Rigid3 wrong{ExpSO3({0.0, DegToRad(angle), 0.0}),
                       {0.02 * angle, 0.0, -0.5}};
    AddWrongPair(points, sensor + other, name,
                 wrong * drive->true_poses.at(sensor + other), drive);
    angle += 25.0;
  }
}

// All poses are finite. Frames that contain one of these names may be anywhere
// or unregistered; all others are correct.
void ExpectTheRest(const Drive& drive, const Outcome& outcome,
                   const std::vector<std::string>& uncertain_frames,
                   int num_others) {
  const Reconstruction& model = outcome.result.models[0].reconstruction;
  std::vector<ImagePoses> others;
  for (size_t i = 0; i < outcome.scene.images.size(); ++i) {
    const std::string& name = outcome.scene.images[i].name;
    const auto pose = model.CamFromWorld(outcome.scene, static_cast<int>(i));
    if (pose) {
      EXPECT_TRUE(pose->translation.allFinite()) << name;
      EXPECT_NEAR(pose->rotation.norm(), 1.0, 1e-9) << name;
    }
    if (std::none_of(uncertain_frames.begin(), uncertain_frames.end(),
                     [&](const std::string& f) { return Contains(name, f); })) {
      others.push_back({name, true, pose, drive.true_poses.at(name)});
    }
  }
  const Evaluation evaluation = Evaluate(others, true, {}, {});
  EXPECT_EQ(evaluation.num_registered, num_others);
  ExpectRight(evaluation);
  for (const UnregisteredFrame& frame : outcome.result.unregistered_frames) {
    const std::string name = FrameNameOf(outcome, frame);
    EXPECT_TRUE(std::any_of(uncertain_frames.begin(), uncertain_frames.end(),
                            [&](const std::string& uncertain) {
                              return Contains(name, uncertain);
                            }))
        << name;
    EXPECT_FALSE(frame.reason.empty());
  }
}

// Every pair is estimated, whatever the remainder of their number: the poses in
// the database are wrong by 1 degree, the matches are correct.
TEST(Hazards, Hazard09NumbersOfPairsOfAllRemainders) {
  SimulationOptions options = SmallDrive(RigPreset::kStereo, 6);
  options.relative_rotation_noise_deg = 1.0;
  Drive drive = MakeDriveWithoutRigs(options);
  Context context;
  context.num_threads = 2;
  for (int remainder = 0; remainder < 10; ++remainder) {
    drive.contents.pairs.pop_back();
    const LoadedScene loaded =
        LoadScene(drive.contents, SceneLoadingOptions(), context);
    const ViewGraphResult result =
        EstimateViewGraph(loaded.scene, ComputeBearings(loaded.scene, 2),
                          loaded.view_graph, ViewGraphOptions(), context);
    ASSERT_EQ(result.estimate.pairs.size(), drive.contents.pairs.size());
    for (const ImagePair& pair : result.estimate.pairs) {
      const std::string& name1 = loaded.scene.images[pair.image_idx1].name;
      const std::string& name2 = loaded.scene.images[pair.image_idx2].name;
      const Eigen::Quaterniond truth =
          drive.true_poses.at(name2).rotation *
          drive.true_poses.at(name1).rotation.conjugate();
      EXPECT_LT(
          RadToDeg(AngleBetween(pair.relative_pose->cam2_from_cam1, truth)),
          0.4)
          << name1 << " " << name2;
    }
  }
}

// Frames 12 and 13 are connected to each other, but to the others only by pairs
// with too few correct matches. Their matches would create tracks into the two
// frames, which are too few for a model.
TEST(Hazards, Hazard10TracksIntoARejectedComponent) {
  constexpr size_t kNumRight = 5, kNumMatches = 60;
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 14));
  const auto is_late = [](const std::string& name) {
    return name.substr(5) >= "000012.png";
  };
  Random random(3);
  for (TwoViewGeometryRow& pair : drive.contents.pairs) {
    if (is_late(NameOf(drive.contents, pair.image_id1)) ==
        is_late(NameOf(drive.contents, pair.image_id2))) {
      continue;
    }
    pair.matches.resize(std::min(kNumMatches, pair.matches.size()));
    for (size_t i = kNumRight; i < pair.matches.size(); ++i) {
      pair.matches[i].keypoint_idx2 = random.Index(150);
    }
  }
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered, 24);
  ExpectRight(evaluation);
  ASSERT_EQ(outcome.result.unregistered_frames.size(), 2u);
  for (const UnregisteredFrame& frame : outcome.result.unregistered_frames) {
    EXPECT_GE(FrameNameOf(outcome, frame), "000012");
    EXPECT_TRUE(Contains(frame.reason, "fewer than 3 frames")) << frame.reason;
  }
}

// All pairs of the last frame contradict each other by more than the rotation
// threshold, so that at most one of them is kept.
TEST(Hazards, Hazard11FrameThatOnlyContradictoryPairsConnect) {
  const Simulation simulation = Simulate(SmallDrive(RigPreset::kStereo));
  const PointsOfKeypoints points = PointsByKeypoint(simulation);
  Drive drive = MakeDrive(simulation);
  drive.contents.rigs.clear();
  drive.contents.frames.clear();
  RemovePairs(
      [](const std::string& name1, const std::string& name2) {
        return Contains(name1, "000011") || Contains(name2, "000011");
      },
      &drive.contents);
  AddContradictoryPairs(points, "cam0/000011.png", &drive);
  AddContradictoryPairs(points, "cam1/000011.png", &drive);
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  EXPECT_TRUE(outcome.result.rotation.frames.IsUsable());
  EXPECT_TRUE(outcome.result.rotation.joint.IsUsable());
  ExpectTheRest(drive, outcome, {"000011"}, 22);
}

TEST(Hazards, Hazard12EmptyGraph) {
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

TEST(Hazards, Hazard12FrameWithoutPairsIsNamed) {
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

TEST(Hazards, Hazard12FewPairs) {
  // Three nearly collinear positions hardly determine the rotation of the
  // alignment about their line, so the input is exact.
  SimulationOptions options = SmallDrive(RigPreset::kMono, 3);
  options.pixel_noise_px = 0.0;
  const Drive mono = MakeDriveWithoutRigs(options);
  ASSERT_EQ(mono.contents.pairs.size(), 3u);
  ExpectRightRotations(mono, Map(mono));
  const Drive stereo = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 2));
  ASSERT_EQ(stereo.contents.pairs.size(), 6u);
  ExpectRightRotations(stereo, Map(stereo, 2));
  // A single frame has no motion.
  const Drive single = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 1));
  EXPECT_TRUE(Map(single, 2).result.models.empty());
}

// Both halves of a drive become models if no pair connects them.
TEST(Hazards, Hazard17AllComponentsBecomeModels) {
  const Drive whole = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 20));
  Drive drive = whole;
  const auto part_of = [](const std::string& name) {
    const int frame = std::stoi(name.substr(5));
    return frame < 9 ? 0 : frame < 15 ? 1 : 2;
  };
  RemovePairs(
      [&](const std::string& name1, const std::string& name2) {
        return part_of(name1) != part_of(name2);
      },
      &drive.contents);
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 3u);
  EXPECT_TRUE(outcome.result.unregistered_frames.empty());
  const int num_images[] = {18, 12, 10};
  for (size_t i = 0; i < 3; ++i) {
    const Evaluation evaluation = EvaluateModel(drive, outcome, i);
    EXPECT_EQ(evaluation.num_registered, num_images[i]);
    ExpectRight(evaluation);
  }
}

// Of two parts that no pair connects, the smaller one has eight images.
TEST(Hazards, Hazard17SmallModelsAreDropped) {
  Drive drive = MakeDriveWithoutRigs(SmallDrive(RigPreset::kStereo, 14));
  const auto is_late = [](const std::string& name) {
    return name.substr(5) >= "000010.png";
  };
  RemovePairs(
      [&](const std::string& name1, const std::string& name2) {
        return is_late(name1) != is_late(name2);
      },
      &drive.contents);
  const Outcome outcome = Map(drive);
  ASSERT_EQ(outcome.result.models.size(), 1u);
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered, 20);
  ExpectRight(evaluation);
  EXPECT_FALSE(outcome.result.unregistered_frames.empty());
  for (const UnregisteredFrame& frame : outcome.result.unregistered_frames) {
    EXPECT_EQ(frame.reason, "its model has fewer than 10 images");
  }
}

// Only wrong pairs connect the two sequences.
TEST(Hazards, Hazard17WrongPairsDoNotConnectComponents) {
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

// All images of a very long drive show one point, and each is matched only with
// the next.
TEST(Hazards, Hazard22VeryLongChainOfMatches) {
  constexpr int kNumImages = 300000;
  Scene scene;
  scene.cameras.push_back({CameraId(1),
                           CameraModelId::kSimplePinhole,
                           100,
                           100,
                           {100.0, 50.0, 50.0},
                           true});
  scene.rigs.push_back({RigId(1), 0, {0}});
  scene.sensors.push_back({"", 0, 0, Rigid3()});
  ViewGraph view_graph;
  for (int i = 0; i < kNumImages; ++i) {
    const auto id = static_cast<uint32_t>(i);
    scene.frames.push_back({FrameId(id), "", 0, {i}});
    scene.images.push_back({ImageId(id), "", 0, 0, i, {{50.0f, 50.0f}}});
    if (i + 1 == kNumImages) continue;
    // Frames from both ends towards the middle.
    const int first = i % 2 == 0 ? i / 2 : kNumImages - 2 - i / 2;
    ImagePair pair;
    pair.image_idx1 = first;
    pair.image_idx2 = first + 1;
    pair.matches = {{0, 0}};
    view_graph.pairs.push_back(std::move(pair));
  }
  const ObservationGroups candidates = EstablishCandidates(
      scene, view_graph, {Mask(view_graph.pairs.size(), 1), {}}, TrackOptions(),
      Context());
  ASSERT_EQ(candidates.size(), 1u);
  EXPECT_EQ(candidates.length(0), size_t{kNumImages});
}

}  // namespace
}  // namespace mgsfm
