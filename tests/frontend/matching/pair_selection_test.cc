// SPDX-License-Identifier: BSD-3-Clause
#include "matching/pair_selection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <set>
#include <string>

#include "frontend/matching/rig_scene.h"

namespace mgsfm {
namespace {

bool Contains(const ImagePairList& pairs, int image1, int image2) {
  return std::binary_search(
      pairs.begin(), pairs.end(),
      ImageIdxPair{std::min(image1, image2), std::max(image1, image2)});
}

Scene StereoScene(int num_frames) { return MakeRigScene(2, num_frames); }

// The frame of an image in its sequence, and its slot.
struct Where {
  int frame = -1;
  int slot = -1;
};
std::vector<Where> Locate(const FrameSequence& sequence, size_t num_images) {
  std::vector<Where> where(num_images);
  for (int i = 0; i < sequence.num_frames(); ++i) {
    for (int slot = 0; slot < sequence.num_slots; ++slot) {
      const std::optional<int> image = sequence.images[i][slot];
      if (image) where[*image] = {i, slot};
    }
  }
  return where;
}

TEST(FrameSequences, HoldAllImagesInOrderOfNames) {
  const Scene scene = MakeRigScene(
      2, 9, [](int sensor, int frame) { return (frame + sensor) % 3 != 1; });
  const auto sequences = MakeFrameSequences(scene);
  ASSERT_EQ(sequences.size(), 1u);
  EXPECT_EQ(sequences[0].num_slots, 2);
  std::set<int> images;
  std::string last_name;
  for (int i = 0; i < sequences[0].num_frames(); ++i) {
    const std::string& name = scene.frames[sequences[0].frame_idxs[i]].name;
    EXPECT_LT(last_name, name);
    last_name = name;
    for (const std::optional<int>& image : sequences[0].images[i]) {
      if (!image) continue;
      images.insert(*image);
      EXPECT_EQ(scene.images[*image].frame_idx, sequences[0].frame_idxs[i]);
    }
  }
  EXPECT_EQ(images.size(), scene.images.size());
}

// A folder whose images all have different cameras.
TEST(FrameSequences, SingleCamerasOfAFolderAreOneSequence) {
  Scene scene;
  for (int i = 0; i < 4; ++i) {
    const std::string folder = i < 3 ? "a/" : "b/";
    const auto id = static_cast<uint32_t>(i);
    scene.cameras.push_back(
        {CameraId(id), CameraModelId::kSimplePinhole, 10, 10, {1, 5, 5}});
    scene.rigs.push_back({RigId(id), i, {i}});
    scene.sensors.push_back({"", i, i, Rigid3()});
    scene.frames.push_back({FrameId(id), std::to_string(i), i, {i}});
    scene.images.push_back(
        {ImageId(id), folder + std::to_string(i), i, i, i, {}});
  }
  const auto sequences = MakeFrameSequences(scene);
  ASSERT_EQ(sequences.size(), 2u);
  const std::vector<std::vector<std::optional<int>>> expected = {{0}, {1}, {2}};
  EXPECT_EQ(sequences[0].images, expected);
  SequentialPairOptions options;
  options.overlap = 1;
  EXPECT_EQ(SameSensorPairs(sequences, options),
            (ImagePairList{{0, 1}, {1, 2}}));
}

TEST(SequentialPairs, SameSensorWithinOverlap) {
  const Scene scene = StereoScene(30);
  const auto sequences = MakeFrameSequences(scene);
  const auto where = Locate(sequences[0], scene.images.size());
  SequentialPairOptions options;
  options.overlap = 4;
  for (const bool quadratic : {false, true}) {
    options.quadratic_overlap = quadratic;
    const ImagePairList pairs = SameSensorPairs(sequences, options);
    for (int i = 0; i < static_cast<int>(where.size()); ++i) {
      for (int j = i + 1; j < static_cast<int>(where.size()); ++j) {
        const int distance = std::abs(where[i].frame - where[j].frame);
        const bool is_near = distance <= 4 || (quadratic && distance == 8);
        EXPECT_EQ(Contains(pairs, i, j),
                  where[i].slot == where[j].slot && is_near);
      }
    }
  }
}

TEST(SequentialPairs, ShortSequencesProbeAllSensors) {
  const Scene scene = StereoScene(6);
  const auto sequences = MakeFrameSequences(scene);
  const auto where = Locate(sequences[0], scene.images.size());
  SequentialPairOptions options;
  options.overlap = 2;
  options.quadratic_overlap = false;
  const ImagePairList pairs = ProbePairs(sequences, options);
  for (int i = 0; i < static_cast<int>(where.size()); ++i) {
    for (int j = i + 1; j < static_cast<int>(where.size()); ++j) {
      EXPECT_EQ(Contains(pairs, i, j),
                where[i].slot != where[j].slot &&
                    std::abs(where[i].frame - where[j].frame) <= 2);
    }
  }
}

TEST(SequentialPairs, LearnsWhichSensorsOverlap) {
  const Scene scene = StereoScene(60);
  const auto sequences = MakeFrameSequences(scene);
  const auto where = Locate(sequences[0], scene.images.size());
  SequentialPairOptions options;
  options.overlap = 5;
  options.quadratic_overlap = false;
  options.num_probe_frames = 6;
  // Slot 1 sees the same scene as slot 0 three frames later.
  const auto overlaps = [&](const ImageIdxPair& pair) {
    Where first = where[pair.image_idx1], second = where[pair.image_idx2];
    if (first.slot == 1) std::swap(first, second);
    return first.slot == 0 && second.slot == 1 &&
           second.frame - first.frame == 3;
  };
  const ImagePairList probes = ProbePairs(sequences, options);
  EXPECT_LT(probes.size(), 80u);
  const ImagePairList learnt =
      OverlappingSensorPairs(sequences, sequences, options, overlaps);
  EXPECT_EQ(learnt.size(), 57u);
  EXPECT_TRUE(std::all_of(learnt.begin(), learnt.end(), overlaps));
  options.expand_rig_images = false;
  EXPECT_TRUE(ProbePairs(sequences, options).empty());
  EXPECT_TRUE(
      OverlappingSensorPairs(sequences, sequences, options, overlaps).empty());
}

TEST(SequentialPairs, RareOverlapNeedsTheRatio) {
  const auto sequences = MakeFrameSequences(StereoScene(60));
  SequentialPairOptions options;
  options.overlap = 1;
  options.num_probe_frames = 10;
  options.min_probe_ratio = 0.2;
  const auto count = [&](int num_verified) {
    int num_left = num_verified;
    return OverlappingSensorPairs(
               sequences, sequences, options,
               [&](const ImageIdxPair&) { return num_left-- > 0; })
        .size();
  };
  EXPECT_EQ(count(0), 0u);
  EXPECT_EQ(count(1), 0u);
  EXPECT_EQ(count(2), 60u);  // at distance 0
}

TEST(SpatialPairs, NearestWithinTheDistance) {
  const Scene scene = StereoScene(10);
  std::vector<std::optional<Eigen::Vector3d>> positions(scene.images.size());
  // Only the first image of a frame has a position; frames are 10 m apart.
  const auto sequences = MakeFrameSequences(scene);
  for (int i = 0; i < 10; ++i) {
    positions[*sequences[0].images[i][0]] =
        Eigen::Vector3d(10.0 * i, 0, 5.0 * i);
  }
  SpatialMatchingOptions options;
  options.max_distance = 15.0;
  const auto where = Locate(sequences[0], scene.images.size());
  ImagePairList pairs = SpatialPairs(scene, positions, options, {});
  for (int i = 0; i < static_cast<int>(where.size()); ++i) {
    for (int j = i + 1; j < static_cast<int>(where.size()); ++j) {
      EXPECT_EQ(Contains(pairs, i, j),
                std::abs(where[i].frame - where[j].frame) <= 1);
    }
  }
  options.max_num_neighbors = 1;
  pairs = SpatialPairs(scene, positions, options, {});
  EXPECT_EQ(pairs.size(), 10u);  // the other image of the frame
  options.ignore_z = false;
  options.max_num_neighbors = 50;
  options.max_distance = 11.0;  // less than the distance with height
  EXPECT_EQ(SpatialPairs(scene, positions, options, {}).size(), 10u);
  for (auto& position : positions) position.reset();
  EXPECT_TRUE(SpatialPairs(scene, positions, options, {}).empty());
}

}  // namespace
}  // namespace mgsfm
