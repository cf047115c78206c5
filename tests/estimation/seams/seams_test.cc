// SPDX-License-Identifier: BSD-3-Clause
#include "seams/seams.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "mgsfm/simulator/simulation.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {
namespace {

constexpr int kNumFrames = 12;
constexpr int kFirstBeyond = 8;  // of the frames that the tests cut off

struct Drive {
  Simulation simulation;
  Mask pair_is_used;
  std::vector<RejectedGroup> rejected_groups;
  SequenceMode is_sequence = SequenceMode::kAuto;
  std::vector<std::pair<int, int>> jumps;
  std::vector<std::pair<int, int>> confirmed;

  Drive() {
    SimulationOptions options;
    options.num_frames = kNumFrames;
    simulation = Simulate(options);
    pair_is_used = Mask(simulation.view_graph.pairs.size(), true);
  }

  int FrameOf(int image_idx) const {
    return simulation.scene.images[image_idx].frame_idx;
  }
  bool Crosses(int frame1, int frame2) const {
    return (frame1 < kFirstBeyond) != (frame2 < kFirstBeyond);
  }

  // Splits the tracks of all but the first points at the cut.
  void KeepCrossingPoints(int num_kept) {
    std::vector<Point3D> points;
    for (Point3D& point : simulation.ground_truth.points) {
      Point3D beyond = point;
      const auto is_beyond = [&](const Observation& o) {
        return FrameOf(o.image_idx) >= kFirstBeyond;
      };
      const bool crosses =
          std::any_of(point.track.begin(), point.track.end(), is_beyond) &&
          !std::all_of(point.track.begin(), point.track.end(), is_beyond);
      if (crosses && num_kept-- <= 0) {
        point.track.erase(
            std::remove_if(point.track.begin(), point.track.end(), is_beyond),
            point.track.end());
        beyond.track.erase(
            std::remove_if(beyond.track.begin(), beyond.track.end(),
                           [&](const auto& o) { return !is_beyond(o); }),
            beyond.track.end());
        if (beyond.track.size() >= 2) points.push_back(beyond);
      }
      if (point.track.size() >= 2) points.push_back(point);
    }
    simulation.ground_truth.points = std::move(points);
  }

  // Splits all points at the cut, and adds points of the frames next to it.
  void JoinByTwoFrames() {
    std::vector<Point3D> points;
    for (Point3D point : simulation.ground_truth.points) {
      const auto is_elsewhere = [&](const Observation& o) {
        const int frame = FrameOf(o.image_idx);
        return frame != kFirstBeyond - 1 && frame != kFirstBeyond;
      };
      point.track.erase(
          std::remove_if(point.track.begin(), point.track.end(), is_elsewhere),
          point.track.end());
      if (!point.track.empty()) points.push_back(point);
    }
    KeepCrossingPoints(0);
    auto& all = simulation.ground_truth.points;
    all.insert(all.begin(), points.begin(), points.end());
  }

  // Rejects most of the pairs across the cut: they contradict the model.
  void RejectCrossingPairs() {
    Mask is_rejected(pair_is_used.size(), false);
    for (size_t i = 0; i < is_rejected.size(); ++i) {
      const ImagePair& pair = simulation.view_graph.pairs[i];
      is_rejected[i] =
          Crosses(FrameOf(pair.image_idx1), FrameOf(pair.image_idx2)) &&
          i % 8 != 0;
    }
    pair_is_used.Remove(is_rejected);
    rejected_groups = GroupRejectedPairs(Index(), is_rejected);
  }

  void RemoveCrossingPairs() {
    auto& pairs = simulation.view_graph.pairs;
    pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                               [&](const ImagePair& pair) {
                                 return Crosses(FrameOf(pair.image_idx1),
                                                FrameOf(pair.image_idx2));
                               }),
                pairs.end());
    pair_is_used = Mask(pairs.size(), true);
  }

  FramePairIndex Index() const {
    return {simulation.scene, simulation.view_graph, is_sequence};
  }
  Confidence Estimate(const ConfidenceOptions& options = {}) const {
    const FramePairIndex index = Index();
    return EstimateConfidence({simulation.scene,
                               index,
                               simulation.view_graph,
                               pair_is_used,
                               rejected_groups,
                               simulation.ground_truth,
                               {0.0, jumps, confirmed}},
                              options);
  }
};

std::vector<int> FramesBeyond() {
  std::vector<int> frames(kNumFrames - kFirstBeyond);
  std::iota(frames.begin(), frames.end(), kFirstBeyond);
  return frames;
}

TEST(Seams, AreNotInASoundModel) {
  const Confidence confidence = Drive().Estimate();
  EXPECT_TRUE(confidence.seams.empty());
  for (const auto& of_frame : confidence.of_frame) {
    ASSERT_TRUE(of_frame.has_value());
    EXPECT_GT(*of_frame, 0.8);
  }
}

TEST(Seams, AreWhereFewPointsCross) {
  Drive drive;
  drive.KeepCrossingPoints(4);
  const Confidence confidence = drive.Estimate();
  ASSERT_EQ(confidence.seams.size(), 1u);
  const Seam& seam = confidence.seams[0];
  EXPECT_EQ(seam.reason, SeamReason::kFewTies);
  EXPECT_EQ(seam.frame_idxs_beyond, FramesBeyond());
  EXPECT_GE(seam.frame_idx_beyond, kFirstBeyond);
  EXPECT_LT(seam.frame_idx_core, kFirstBeyond);
  EXPECT_EQ(seam.num_tracks, 4);
  for (int i = 0; i < kNumFrames; ++i) {
    EXPECT_EQ(*confidence.of_frame[i] < 0.5, i >= kFirstBeyond) << i;
  }
}

// Two frames also agree on an object that moves.
TEST(Seams, AreWhereOnlyTwoFramesObserveThePoints) {
  Drive drive;
  drive.JoinByTwoFrames();
  const Confidence confidence = drive.Estimate();
  ASSERT_EQ(confidence.seams.size(), 1u);
  EXPECT_EQ(confidence.seams[0].reason, SeamReason::kFewTies);
  EXPECT_EQ(confidence.seams[0].frame_idxs_beyond, FramesBeyond());
  EXPECT_EQ(confidence.seams[0].num_ties, 0);
  EXPECT_GT(confidence.seams[0].num_tracks, 20);
}

// Two frames observe all points of a model of two frames.
TEST(Seams, AreNotInAModelOfTwoFrames) {
  Drive drive;
  auto& model = drive.simulation.ground_truth;
  for (int i = 2; i < kNumFrames; ++i) model.rig_from_world[i].reset();
  std::vector<Point3D> points;
  for (Point3D& point : model.points) {
    point.track.erase(std::remove_if(point.track.begin(), point.track.end(),
                                     [&](const auto& o) {
                                       return drive.FrameOf(o.image_idx) >= 2;
                                     }),
                      point.track.end());
    if (point.track.size() >= 2) points.push_back(point);
  }
  model.points = points;
  EXPECT_TRUE(drive.Estimate().seams.empty());
}

TEST(Seams, AreNotWhereTheMotionIsConfirmed) {
  Drive drive;
  drive.KeepCrossingPoints(80);
  drive.RejectCrossingPairs();
  drive.confirmed = {{kFirstBeyond - 1, kFirstBeyond}};
  EXPECT_TRUE(drive.Estimate().seams.empty());
  drive.jumps = {{kFirstBeyond - 1, kFirstBeyond}};
  ASSERT_EQ(drive.Estimate().seams.size(), 1u);
  EXPECT_EQ(drive.Estimate().seams[0].reason, SeamReason::kJump);
}

TEST(Seams, AreWhereManyPairsDisagree) {
  Drive drive;
  drive.KeepCrossingPoints(80);
  drive.RejectCrossingPairs();
  const Confidence confidence = drive.Estimate();
  ASSERT_FALSE(confidence.seams.empty());
  const Seam& seam = confidence.seams[0];
  EXPECT_EQ(seam.reason, SeamReason::kContradicted);
  EXPECT_EQ(seam.frame_idxs_beyond, FramesBeyond());
  EXPECT_GT(seam.num_against, seam.num_confirmed);
}

// No step of the sequence is as long as the error of the rejected pairs.
TEST(Seams, AreNotWhereNoStepHidesTheError) {
  Drive drive;
  drive.KeepCrossingPoints(80);
  drive.RejectCrossingPairs();
  drive.is_sequence = SequenceMode::kYes;
  EXPECT_EQ(drive.Estimate().seams.size(), 1u);
  for (const size_t i : drive.rejected_groups.at(0).pair_idxs) {
    RelativePose& pose = *drive.simulation.view_graph.pairs[i].relative_pose;
    pose.translation_direction = -*pose.translation_direction;
  }
  // The model moves from frame 2 to frame 9, the pairs the other way.
  auto& pairs = drive.rejected_groups.at(0).pair_idxs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                             [&](size_t i) {
                               const FramePairIndex index = drive.Index();
                               const auto& frames = index.Of(i);
                               return frames.frame_idx2 - frames.frame_idx1 < 3;
                             }),
              pairs.end());
  ASSERT_FALSE(pairs.empty());
  EXPECT_TRUE(drive.Estimate().seams.empty());
}

// Rejected pairs close loops over the cut and over stronger ones.
TEST(Seams, AreTheWeakestCutOfALoop) {
  Drive drive;
  drive.KeepCrossingPoints(80);
  drive.RejectCrossingPairs();
  for (const size_t i : drive.rejected_groups.at(0).pair_idxs) {
    std::vector<Match>& matches = drive.simulation.view_graph.pairs[i].matches;
    const std::vector<Match> right = matches;
    for (size_t k = 0; k < 50 * right.size(); ++k) {
      matches.push_back({right[k % right.size()].keypoint_idx1,
                         right[(k + 1) % right.size()].keypoint_idx2});
    }
  }
  const Confidence confidence = drive.Estimate();
  ASSERT_EQ(confidence.seams.size(), 1u);
  EXPECT_EQ(confidence.seams[0].reason, SeamReason::kContradicted);
  EXPECT_EQ(confidence.seams[0].frame_idxs_beyond, FramesBeyond());
}

TEST(Seams, AreWhereNoPointCrosses) {
  ConfidenceOptions options;
  options.min_num_ties = 0;
  for (const bool has_pairs : {true, false}) {
    Drive drive;
    drive.KeepCrossingPoints(0);
    if (!has_pairs) drive.RemoveCrossingPairs();
    const Confidence confidence = drive.Estimate(options);
    ASSERT_EQ(confidence.seams.size(), 1u);
    EXPECT_EQ(confidence.seams[0].reason, SeamReason::kFewTies);
    EXPECT_EQ(confidence.seams[0].num_tracks, 0);
    EXPECT_EQ(confidence.seams[0].frame_idxs_beyond, FramesBeyond());
  }
}

// Though many points cross the cut, the rig cannot have moved that way.
TEST(Seams, AreWhereNeighborsJump) {
  Drive drive;
  drive.KeepCrossingPoints(80);
  drive.jumps = {{kFirstBeyond - 1, kFirstBeyond}};
  const Confidence confidence = drive.Estimate();
  ASSERT_EQ(confidence.seams.size(), 1u);
  EXPECT_EQ(confidence.seams[0].reason, SeamReason::kJump);
  EXPECT_EQ(confidence.seams[0].frame_idxs_beyond, FramesBeyond());
  for (int i = 0; i < kNumFrames; ++i) {
    EXPECT_EQ(*confidence.of_frame[i] == 0.0, i >= kFirstBeyond) << i;
  }
}

// A sequence whose frames share pairs with the next one. Loops alone join the
// sides, from the given frames to those three frames later.
class DriveWithLoops : public Drive {
 public:
  explicit DriveWithLoops(const std::set<int>& starts) {
    is_sequence = SequenceMode::kYes;
    Keep([&](int frame1, int frame2) {
      return Crosses(frame1, frame2)
                 ? frame2 == frame1 + 3 && starts.count(frame1) > 0
                 : frame2 <= frame1 + 1;
    });
  }

  // Adds pairs of the frames next to the cut, as if of other matches.
  void AddContradictedNeighbors() {
    const Drive drive;
    for (ImagePair pair : drive.simulation.view_graph.pairs) {
      if (FrameOf(pair.image_idx1) != kFirstBeyond - 1 ||
          FrameOf(pair.image_idx2) != kFirstBeyond) {
        continue;
      }
      for (size_t k = 0; k < pair.matches.size(); ++k) {
        pair.matches[k].keypoint_idx1 =
            pair.matches[(k + 1) % pair.matches.size()].keypoint_idx1;
      }
      simulation.view_graph.pairs.push_back(pair);
      pair_is_used.push_back(true);
    }
  }

 private:
  // The pairs of frames (frame1 <= frame2) that a function names.
  template <class Function>
  void Keep(const Function& is_kept) {
    auto& pairs = simulation.view_graph.pairs;
    pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                               [&](const ImagePair& pair) {
                                 const auto [frame1, frame2] =
                                     std::minmax({FrameOf(pair.image_idx1),
                                                  FrameOf(pair.image_idx2)});
                                 return !is_kept(frame1, frame2);
                               }),
                pairs.end());
    pair_is_used = Mask(pairs.size(), true);
  }
};

TEST(Seams, AreWhereLoopsOfOnePlaceJoinTheSides) {
  EXPECT_TRUE(DriveWithLoops({5, 6, 7}).Estimate().seams.empty());
  DriveWithLoops drive({6});
  const auto expect_seam = [&] {
    const Confidence confidence = drive.Estimate();
    ASSERT_EQ(confidence.seams.size(), 1u);
    EXPECT_EQ(confidence.seams[0].reason, SeamReason::kOnePlace);
    EXPECT_EQ(confidence.seams[0].frame_idxs_beyond, FramesBeyond());
  };
  expect_seam();
  drive.AddContradictedNeighbors();
  expect_seam();
}

TEST(Seams, AreWhereLoopsHideAJump) {
  DriveWithLoops drive({5, 6, 7});
  drive.jumps = {{kFirstBeyond - 1, kFirstBeyond}};
  const Confidence confidence = drive.Estimate();
  ASSERT_EQ(confidence.seams.size(), 1u);
  const Seam& seam = confidence.seams[0];
  EXPECT_EQ(seam.reason, SeamReason::kRefutedLoops);
  EXPECT_EQ(seam.frame_idxs_beyond, FramesBeyond());
  EXPECT_EQ(seam.frame_idx_beyond, seam.frame_idx_core + 3);
}

TEST(Seams, LeaveUnregisteredFramesWithoutConfidence) {
  Drive drive;
  drive.simulation.ground_truth.rig_from_world[3].reset();
  const Confidence confidence = drive.Estimate();
  EXPECT_FALSE(confidence.of_frame[3].has_value());
  EXPECT_TRUE(confidence.of_frame[4].has_value());
}

}  // namespace
}  // namespace mgsfm
