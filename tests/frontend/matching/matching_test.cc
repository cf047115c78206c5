// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/matching/matching.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>

#include "frontend/matching/feature_world.h"
#include "geometry/so3.h"
#include "support/error_of.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

constexpr int kLapFrames = 4 * FeatureWorld::kFramesPerSide;

// Several blocks, of which the last is not full.
ExhaustiveMatchingOptions SmallBlocks() {
  ExhaustiveMatchingOptions options;
  options.block_size = 7;
  return options;
}

class MatchingTest : public testing::Test {
 protected:
  FeatureDatabase MakeDatabase(const std::string& name, int num_frames,
                               bool ids_descend = false) const {
    FeatureDatabase database((dir_.path() / name).string(),
                             FeatureDatabase::OpenMode::kOrCreate);
    FeatureWorld(1).Write(&database, num_frames, ids_descend);
    return database;
  }

  static PairMatchingSummary MatchAll(FeatureDatabase* database,
                                      const Context& context = {},
                                      const PairMatchingOptions& options = {}) {
    return MatchExhaustively(database, LoadSceneOf(*database), SmallBlocks(),
                             options, context);
  }

  std::string WriteList(const std::string& text) const {
    const std::string path = (dir_.path() / "list.txt").string();
    WriteTextFile(path, text);
    return path;
  }

  TempDir dir_;
};

NamePair Names(int sensor1, int frame1, int sensor2, int frame2) {
  return {FeatureWorld::ImageName(sensor1, frame1),
          FeatureWorld::ImageName(sensor2, frame2)};
}

bool IsVerified(const std::map<NamePair, TwoViewGeometryRow>& geometries,
                const NamePair& names) {
  const auto found = geometries.find(names);
  return found != geometries.end() && found->second.matches.size() >= 15;
}

TEST_F(MatchingTest, ExhaustivePairsHaveTrueGeometry) {
  FeatureDatabase database = MakeDatabase("a.db", 8);
  const PairMatchingSummary summary = MatchAll(&database);
  EXPECT_EQ(summary.num_pairs, 16u * 15u / 2u);
  EXPECT_EQ(summary.num_done, 0u);
  const auto geometries = ReadGeometries(database);
  EXPECT_EQ(geometries.size(), summary.num_pairs);
  EXPECT_EQ(database.CountMatches().size(), summary.num_pairs);
  size_t num_verified = 0;
  for (int i = 0; i < 16; ++i) {
    for (int j = i + 1; j < 16; ++j) {
      const int frame1 = i % 8, frame2 = j % 8;
      const auto& row = geometries.at(Names(i / 8, frame1, j / 8, frame2));
      // Frames 6 and 7 see the second wall.
      if (FeatureWorld::Side(frame1) != FeatureWorld::Side(frame2)) {
        EXPECT_EQ(row.config, TwoViewConfig::kDegenerate);
        EXPECT_TRUE(row.matches.empty());
        continue;
      }
      if (row.matches.empty()) continue;
      ++num_verified;
      ASSERT_TRUE(row.cam2_from_cam1);
      EXPECT_LT(RadToDeg(AngleBetween(row.cam2_from_cam1->rotation,
                                      Eigen::Quaterniond::Identity())),
                0.5);
      const Eigen::Vector3d translation = FeatureWorld::Center(i / 8, frame1) -
                                          FeatureWorld::Center(j / 8, frame2);
      EXPECT_LT(
          RadToDeg(AngleBetween(row.cam2_from_cam1->translation, translation)),
          5.0);
    }
  }
  EXPECT_EQ(num_verified, summary.num_verified);
  EXPECT_GT(num_verified, 50u);
}

TEST_F(MatchingTest, DoesNotDependOnThreadsIdsOrCache) {
  FeatureDatabase database = MakeDatabase("a.db", 8);
  MatchAll(&database);
  FeatureDatabase descending = MakeDatabase("b.db", 8, true);
  Context context;
  context.num_threads = 3;
  PairMatchingOptions options;
  options.cache_size_mib = 1;
  MatchAll(&descending, context, options);
  EXPECT_TRUE(AreEqual(ReadGeometries(database), ReadGeometries(descending)));
}

TEST_F(MatchingTest, SkipsPairsInTheDatabase) {
  FeatureDatabase whole = MakeDatabase("whole.db", 8);
  MatchAll(&whole);
  FeatureDatabase database = MakeDatabase("a.db", 8);
  const Scene scene = LoadSceneOf(database);
  const std::string list =
      WriteList("cam1/0003.png cam0/0003.png\ncam0/0000.png cam0/0001.png\n");
  ImportMatches(&database, scene, list, MatchListType::kPairs, {}, {});
  EXPECT_EQ(database.CountInlierMatches().size(), 2u);
  const PairMatchingSummary summary = MatchAll(&database);
  EXPECT_EQ(summary.num_done, 2u);
  EXPECT_TRUE(AreEqual(ReadGeometries(database), ReadGeometries(whole)));
  // Matches without two-view geometry are verified, but not matched again.
  const auto geometries = ReadGeometries(database);
  const auto matches = database.CountMatches();
  database.DeleteTwoViewGeometries();
  for (const Image& image : scene.images) {
    database.WriteDescriptors(
        image.id,
        DescriptorMatrix::Zero(database.ReadKeypoints(image.id).size(), 128));
  }
  MatchAll(&database);
  EXPECT_TRUE(AreEqual(ReadGeometries(database), geometries));
}

TEST_F(MatchingTest, InterruptedRunResumes) {
  FeatureDatabase whole = MakeDatabase("whole.db", 12);
  MatchAll(&whole);
  FeatureDatabase database = MakeDatabase("a.db", 12);
  std::atomic<int> num_calls{0};
  Context context;
  context.is_canceled = [&] { return ++num_calls > 100; };
  EXPECT_THROW(MatchAll(&database, context), Interrupted);
  const size_t num_done = database.CountInlierMatches().size();
  EXPECT_GT(num_done, 0u);
  EXPECT_LT(num_done, 24u * 23u / 2u);
  EXPECT_EQ(database.CountMatches().size(), num_done);
  EXPECT_EQ(MatchAll(&database).num_done, num_done);
  EXPECT_TRUE(AreEqual(ReadGeometries(database), ReadGeometries(whole)));
}

TEST_F(MatchingTest, SequentialFindsNeighborsAndLoops) {
  const int num_frames = kLapFrames + 4;
  FeatureDatabase database = MakeDatabase("a.db", num_frames);
  SequentialMatchingOptions options;
  options.pairs.overlap = 3;
  options.pairs.num_probe_frames = 6;
  MatchSequentially(&database, LoadSceneOf(database), options, {}, {}, {});
  const auto geometries = ReadGeometries(database);
  for (int frame = 0; frame + 1 < num_frames; ++frame) {
    if (FeatureWorld::Side(frame) != FeatureWorld::Side(frame + 1)) continue;
    for (const int sensor : {0, 1}) {
      EXPECT_TRUE(
          IsVerified(geometries, Names(sensor, frame, sensor, frame + 1)));
    }
    EXPECT_TRUE(IsVerified(geometries, Names(0, frame, 1, frame)));
    EXPECT_TRUE(IsVerified(geometries, Names(0, frame, 1, frame + 1)));
  }
  // The second pass along the first wall.
  for (int frame = 0; frame < 4; ++frame) {
    for (const int sensor : {0, 1}) {
      EXPECT_TRUE(IsVerified(geometries,
                             Names(sensor, frame, sensor, frame + kLapFrames)));
    }
  }
  for (const auto& [names, row] : geometries) {
    const int frame1 = std::stoi(names.first.substr(5));
    const int frame2 = std::stoi(names.second.substr(5));
    if (row.matches.empty()) continue;
    EXPECT_EQ(FeatureWorld::Side(frame1), FeatureWorld::Side(frame2));
  }
  EXPECT_LT(geometries.size(), 800u);  // of 1540
}

// Two parallel cameras.
Scene WithKnownRig(Scene scene) {
  scene.sensors[1].sensor_from_rig =
      Rigid3{Eigen::Quaterniond::Identity(),
             FeatureWorld::Center(0, 0) - FeatureWorld::Center(1, 0)};
  return scene;
}

// Writes the first ten matches, too few to verify a pair on its own.
void WriteFewMatches(const std::map<NamePair, TwoViewGeometryRow>& geometries,
                     const NamePair& names, const Scene& scene,
                     FeatureDatabase* database) {
  std::vector<Match> matches = geometries.at(names).matches;
  ASSERT_GT(matches.size(), 20u);
  matches.resize(10);
  const auto id_of = [&](const std::string& name) {
    return std::find_if(scene.images.begin(), scene.images.end(),
                        [&](const Image& image) { return image.name == name; })
        ->id;
  };
  database->WriteMatches(id_of(names.first), id_of(names.second), matches);
}

Eigen::Vector3d CenterOf(const std::string& image_name) {
  return FeatureWorld::Center(image_name[3] - '0',
                              std::stoi(image_name.substr(5)));
}

// With a known rig, pairs with few matches are kept and others do not get
// worse. Repeated or interrupted runs give the same result.
TEST_F(MatchingTest, KnownRigIsVerifiedJointly) {
  FeatureDatabase database = MakeDatabase("a.db", 8);
  FeatureDatabase known = MakeDatabase("b.db", 8);
  MatchAll(&database);
  const auto single = ReadGeometries(database);
  const Scene scene = WithKnownRig(LoadSceneOf(known));
  // The images of the second pair are not in the order of their frames.
  const NamePair few[] = {Names(1, 0, 1, 1), Names(0, 3, 1, 2)};
  for (const NamePair& names : few) {
    WriteFewMatches(single, names, scene, &known);
  }
  const auto match = [&](const Context& context) {
    MatchExhaustively(&known, scene, SmallBlocks(), {}, context);
  };
  std::atomic<int> num_calls{0};
  Context interrupted;
  interrupted.is_canceled = [&] { return ++num_calls > 100; };
  EXPECT_THROW(match(interrupted), Interrupted);
  match({});
  const auto together = ReadGeometries(known);
  EXPECT_EQ(together.size(), single.size());
  for (const auto& [names, row] : together) {
    const bool was_verified = !single.at(names).matches.empty();
    EXPECT_EQ(!row.matches.empty(), was_verified);
    if (!was_verified) continue;
    EXPECT_LT(RadToDeg(AngleBetween(row.cam2_from_cam1->rotation,
                                    Eigen::Quaterniond::Identity())),
              0.5);
  }
  for (const NamePair& names : few) {
    const TwoViewGeometryRow& row = together.at(names);
    EXPECT_GE(row.matches.size(), 9u);
    EXPECT_LT(
        RadToDeg(AngleBetween(row.cam2_from_cam1->translation,
                              CenterOf(names.first) - CenterOf(names.second))),
        2.0);
  }
  match({});
  EXPECT_TRUE(AreEqual(ReadGeometries(known), together));
}

TEST_F(MatchingTest, RigVerificationIsOptional) {
  FeatureDatabase database = MakeDatabase("a.db", 4);
  MatchAll(&database);
  FeatureDatabase known = MakeDatabase("b.db", 4);
  PairMatchingOptions options;
  options.rig_verification.rig_verification = false;
  MatchExhaustively(&known, WithKnownRig(LoadSceneOf(known)), SmallBlocks(),
                    options, {});
  EXPECT_TRUE(AreEqual(ReadGeometries(known), ReadGeometries(database)));
}

TEST_F(MatchingTest, SequentialWithoutLoopDetection) {
  FeatureDatabase database = MakeDatabase("a.db", kLapFrames + 2);
  SequentialMatchingOptions options;
  options.pairs.overlap = 2;
  options.loop_detection = false;
  const auto summary =
      MatchSequentially(&database, LoadSceneOf(database), options, {}, {}, {});
  EXPECT_FALSE(
      IsVerified(ReadGeometries(database), Names(0, 0, 0, kLapFrames)));
  const auto again =
      MatchSequentially(&database, LoadSceneOf(database), options, {}, {}, {});
  EXPECT_EQ(again.num_done, summary.num_pairs);
  EXPECT_EQ(again.num_verified, summary.num_verified);
}

TEST_F(MatchingTest, VocabularyFindsImagesOfTheSameWall) {
  FeatureDatabase database = MakeDatabase("a.db", kLapFrames);
  VocabTreeMatchingOptions options;
  options.num_images = 5;
  options.max_num_features = 150;
  const auto summary =
      MatchByVocabulary(&database, LoadSceneOf(database), options, {}, {}, {});
  EXPECT_GT(summary.num_verified, 100u);
  EXPECT_GT(summary.num_verified, 0.8 * summary.num_pairs);
}

TEST_F(MatchingTest, SpatialUsesPositions) {
  FeatureDatabase database = MakeDatabase("a.db", 6);
  const Scene scene = LoadSceneOf(database);
  SpatialMatchingOptions options;
  EXPECT_THAT(
      ErrorOf([&] { MatchSpatially(&database, scene, options, {}, {}); }),
      testing::HasSubstr("has no position priors"));
  for (const Image& image : scene.images) {
    const int frame = std::stoi(image.name.substr(5));
    if (image.name[3] != '0') continue;
    // Frames are about 10 m apart, to the north.
    database.WritePosePrior({image.id,
                             PosePriorRow::CoordinateSystem::kWgs84,
                             {49.0 + 9e-5 * frame, 8.4, 100.0},
                             {}});
  }
  options.max_distance = 15.0;
  const auto summary = MatchSpatially(&database, scene, options, {}, {});
  // 6 frames with both images, 5 pairs of neighbors with four pairs each.
  EXPECT_EQ(summary.num_pairs, 6u + 5u * 4u);
}

TEST_F(MatchingTest, SpatialRefusesPositionsThatCannotBe) {
  using CoordinateSystem = PosePriorRow::CoordinateSystem;
  const auto error_of = [&](const std::string& name, CoordinateSystem system,
                            double x) {
    FeatureDatabase database = MakeDatabase(name, 2);
    const Scene scene = LoadSceneOf(database);
    database.WritePosePrior(
        {scene.images[0].id, CoordinateSystem::kWgs84, {49.0, 8.4, 100.0}, {}});
    database.WritePosePrior({scene.images[1].id, system, {x, 8.4, 100.0}, {}});
    return ErrorOf([&] { MatchSpatially(&database, scene, {}, {}, {}); });
  };
  EXPECT_THAT(error_of("pole.db", CoordinateSystem::kWgs84, 149.0),
              testing::HasSubstr("is not a latitude"));
  EXPECT_THAT(error_of("mixed.db", CoordinateSystem::kCartesian, 49.0),
              testing::HasSubstr("partly WGS84, partly Cartesian"));
}

TEST_F(MatchingTest, ImportsRawAndInlierMatches) {
  FeatureDatabase database = MakeDatabase("a.db", 2);
  const Scene scene = LoadSceneOf(database);
  const NamePair names = Names(0, 0, 0, 1);
  MatchAll(&database);
  const auto reference = ReadGeometries(database).at(names);
  std::string text = names.second + " " + names.first + "\n";
  for (const Match& match : reference.matches) {
    text += std::to_string(match.keypoint_idx2) + " " +
            std::to_string(match.keypoint_idx1) + "\n";
  }
  const std::string list = WriteList(text);
  for (const auto type : {MatchListType::kRaw, MatchListType::kInliers}) {
    database.DeleteMatches();
    database.DeleteTwoViewGeometries();
    ImportMatches(&database, scene, list, type, {}, {});
    const auto geometries = ReadGeometries(database);
    ASSERT_EQ(geometries.size(), 1u);
    const auto& imported = geometries.at(names);
    EXPECT_EQ(imported.config, type == MatchListType::kRaw
                                   ? reference.config
                                   : TwoViewConfig::kUncalibrated);
    ASSERT_EQ(imported.matches.size(), reference.matches.size());
    for (size_t i = 0; i < imported.matches.size(); ++i) {
      EXPECT_EQ(imported.matches[i].keypoint_idx2,
                reference.matches[i].keypoint_idx2);
    }
    EXPECT_EQ(database.CountMatches().size(), 1u);
  }
}

TEST_F(MatchingTest, BadImportChangesNothing) {
  FeatureDatabase database = MakeDatabase("a.db", 2);
  const Scene scene = LoadSceneOf(database);
  const std::string list = WriteList(
      "cam0/0000.png cam0/0001.png\n0 0\n\ncam0/0000.png "
      "cam1/0000.png\n0 99999\n");
  EXPECT_THAT(ErrorOf([&] {
                ImportMatches(&database, scene, list, MatchListType::kRaw, {},
                              {});
              }),
              testing::AllOf(testing::HasSubstr("99999"),
                             testing::HasSubstr("cam1/0000.png")));
  EXPECT_TRUE(database.CountMatches().empty());
  EXPECT_THAT(ErrorOf([&] {
                ImportMatches(&database, scene, "/nowhere.txt",
                              MatchListType::kRaw, {}, {});
              }),
              testing::HasSubstr("/nowhere.txt"));
}

TEST_F(MatchingTest, InconsistentFeaturesAreNamed) {
  FeatureDatabase database = MakeDatabase("a.db", 2);
  const Scene scene = LoadSceneOf(database);
  database.WriteDescriptors(scene.images[1].id, DescriptorMatrix::Zero(3, 128));
  EXPECT_THAT(ErrorOf([&] { MatchAll(&database); }),
              testing::HasSubstr(scene.images[1].name));
}

TEST_F(MatchingTest, ImagesWithoutFeaturesMatchNothing) {
  FeatureDatabase database = MakeDatabase("a.db", 2);
  const Scene scene = LoadSceneOf(database);
  database.WriteKeypoints(scene.images[0].id, {});
  database.WriteDescriptors(scene.images[0].id, DescriptorMatrix(0, 128));
  MatchAll(&database);
  const auto geometries = ReadGeometries(database);
  EXPECT_TRUE(geometries.at(Names(0, 0, 0, 1)).matches.empty());
  EXPECT_TRUE(IsVerified(geometries, Names(1, 0, 1, 1)));
}

}  // namespace
}  // namespace mgsfm
