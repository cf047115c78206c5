// SPDX-License-Identifier: BSD-3-Clause
#include "seams/motion_jumps.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

constexpr int kNumFrames = 30;
constexpr int kNumFramesOfSmallModel = 14;
constexpr int kLastBefore = 17;  // the frame before the jump

// The true relative poses of all pairs, in a unit that differs from that of the
// model.
class Drive {
 public:
  Drive() {
    SimulationOptions options;
    options.rig = RigPreset::kStereo;
    options.num_frames = kNumFrames;
    simulation_ = Simulate(options);
    for (const ImagePair& pair : simulation_.view_graph.pairs) {
      Rigid3 cam2_from_cam1 = CamFromWorld(pair.image_idx2) *
                              CamFromWorld(pair.image_idx1).Inverse();
      cam2_from_cam1.translation *= 3.0;
      expected_.emplace_back(cam2_from_cam1);
    }
  }

  // Moves all frames from the first one by other steps.
  template <class Function>
  void ChangeSteps(const Function& change) {
    auto& poses = simulation_.ground_truth.rig_from_world;
    std::vector<Eigen::Vector3d> centers;
    for (const auto& pose : poses) centers.push_back(pose->Center());
    Eigen::Vector3d center = centers[0];
    for (int i = 1; i < kNumFrames; ++i) {
      center += change(Eigen::Vector3d(centers[i] - centers[i - 1]));
      poses[i] = Rigid3::FromRotationAndCenter(poses[i]->rotation, center);
    }
  }

  // Leaves less than half of the frames.
  void MakeSmall() {
    auto& poses = simulation_.ground_truth.rig_from_world;
    for (size_t i = kNumFramesOfSmallModel; i < poses.size(); ++i) {
      poses[i].reset();
    }
  }

  // Expects all steps to be turned by the given angle.
  void TurnExpected(double angle_deg) {
    const Eigen::Quaterniond turn(
        Eigen::AngleAxisd(DegToRad(angle_deg), Eigen::Vector3d::UnitY()));
    for (size_t i = 0; i < expected_.size(); ++i) {
      const ImagePair& pair = simulation_.view_graph.pairs[i];
      if (FrameOf(pair.image_idx1) == FrameOf(pair.image_idx2)) continue;
      expected_[i]->translation = turn * expected_[i]->translation;
    }
  }

  // Expects frames from one to another to stand nearly still.
  void ExpectStop(int first, int last) {
    for (size_t i = 0; i < expected_.size(); ++i) {
      const ImagePair& pair = simulation_.view_graph.pairs[i];
      const int frame1 = FrameOf(pair.image_idx1);
      const int frame2 = FrameOf(pair.image_idx2);
      if (frame1 != frame2 && std::min(frame1, frame2) >= first &&
          std::max(frame1, frame2) <= last) {
        expected_[i]->translation *= 0.05;
      }
    }
  }

  // Moves the later frames away from the others, in steps of one frame.
  void PullApart(double num_steps) {
    auto& poses = simulation_.ground_truth.rig_from_world;
    const Eigen::Vector3d jump = num_steps * (poses[kLastBefore + 1]->Center() -
                                              poses[kLastBefore]->Center());
    for (int i = kLastBefore + 1; i < kNumFrames; ++i) {
      poses[i] = Rigid3::FromRotationAndCenter(poses[i]->rotation,
                                               poses[i]->Center() + jump);
    }
  }

  std::vector<std::pair<int, int>> FindJumps() const { return Compare().jumps; }
  // All of them across the gap, with the frames next to it.
  void ExpectJumps() const {
    const auto jumps = FindJumps();
    EXPECT_THAT(jumps,
                testing::Contains(std::pair(kLastBefore, kLastBefore + 1)));
    for (const auto& [before, after] : jumps) {
      EXPECT_LE(before, kLastBefore);
      EXPECT_GT(after, kLastBefore);
    }
  }
  ComparedMotions Compare() const { return Compare(expected_); }
  ComparedMotions Compare(
      const std::vector<std::optional<Rigid3>>& expected) const {
    const FramePairIndex index(simulation_.scene, simulation_.view_graph,
                               SequenceMode::kYes);
    return CompareMotions(simulation_.scene, index, simulation_.view_graph,
                          expected, simulation_.ground_truth,
                          PairFilteringOptions().max_relative_baseline_error);
  }

 private:
  Rigid3 CamFromWorld(int image_idx) const {
    return *simulation_.ground_truth.CamFromWorld(simulation_.scene, image_idx);
  }

  int FrameOf(int image_idx) const {
    return simulation_.scene.images[image_idx].frame_idx;
  }

  Simulation simulation_;
  std::vector<std::optional<Rigid3>> expected_;
};

TEST(MotionJumps, AreNotInATrueModel) {
  EXPECT_TRUE(Drive().FindJumps().empty());
}

TEST(MotionJumps, AreNoConfirmedMotions) {
  Drive drive;
  const size_t num_compared = drive.Compare().confirmed.size();
  EXPECT_GE(num_compared, size_t{kNumFrames - 1});
  drive.PullApart(3.0);
  const ComparedMotions compared = drive.Compare();
  EXPECT_EQ(compared.jumps.size() + compared.confirmed.size(), num_compared);
  for (const auto& [before, after] : compared.confirmed) {
    EXPECT_EQ(before <= kLastBefore, after <= kLastBefore);
  }
}

TEST(MotionJumps, AreWhereThePartsOfAModelAreTooFarApart) {
  Drive drive;
  drive.PullApart(3.0);
  drive.ExpectJumps();
}

// Twelve steps back: further than any pair reaches.
TEST(MotionJumps, AreWhereAPartOfAModelIsTooFarBack) {
  Drive drive;
  drive.PullApart(-12.0);
  drive.ExpectJumps();
}

TEST(MotionJumps, ToleratesDrift) {
  Drive drive;
  drive.PullApart(0.2);
  EXPECT_TRUE(drive.FindJumps().empty());
}

// One step may be shorter than a typical one, but not two.
void ExpectJumpsToAllLaterFrames(Drive drive) {
  drive.MakeSmall();
  std::set<int> later_frames;
  for (const auto& [before, after] : drive.FindJumps()) {
    later_frames.insert(after);
  }
  for (int i = 2; i < kNumFramesOfSmallModel; ++i) {
    EXPECT_TRUE(later_frames.count(i) == 1) << i;
  }
}

// Pairs on a vehicle alongside: most steps of a small model are wrong, so that
// their median says nothing about the unit.
TEST(MotionJumps, AreWhereTheRigHardlyMoves) {
  Drive drive;
  drive.ChangeSteps([](const Eigen::Vector3d& step) { return 0.05 * step; });
  ExpectJumpsToAllLaterFrames(drive);
}

TEST(MotionJumps, AreWhereTheRigMovesSideways) {
  Drive drive;
  drive.ChangeSteps([](const Eigen::Vector3d& step) {
    return step.norm() * step.cross(Eigen::Vector3d::UnitY()).normalized();
  });
  ExpectJumpsToAllLaterFrames(drive);
}

// An object that moves along with the rig gave all depths there.
TEST(MotionJumps, AreNotWhereOnlyTheExpectedMotionStops) {
  Drive drive;
  drive.ExpectStop(10, 20);
  EXPECT_TRUE(drive.FindJumps().empty());
}

// The image pairs of such an object decided where the model is.
TEST(MotionJumps, AreWhereOnlyTheModelStops) {
  Drive drive;
  int i = 0;
  drive.ChangeSteps([&](const Eigen::Vector3d& step) {
    ++i;
    return Eigen::Vector3d((i > 10 && i <= 20 ? 0.05 : 1.0) * step);
  });
  std::set<int> frames;
  for (const auto& [frame1, frame2] : drive.FindJumps()) {
    frames.insert({frame1, frame2});
  }
  for (int frame = 10; frame <= 20; ++frame) {
    EXPECT_TRUE(frames.count(frame) == 1) << frame;
  }
}

// A crowd moved the expected motions; the model has all frames.
TEST(MotionJumps, ModelsOfMostFramesRefuteExpectedMotions) {
  Drive drive;
  drive.TurnExpected(40.0);
  EXPECT_NEAR(drive.Compare().typical_error, 2.0 * std::sin(DegToRad(20.0)),
              1e-3);
  EXPECT_TRUE(drive.FindJumps().empty());
  EXPECT_TRUE(drive.Compare().AreRefuted());
  drive.MakeSmall();
  EXPECT_FALSE(drive.Compare().AreRefuted());
  EXPECT_EQ(drive.Compare().typical_error, 0.0);
  EXPECT_FALSE(drive.FindJumps().empty());
}

TEST(MotionJumps, NeedExpectedPoses) {
  Drive drive;
  drive.PullApart(3.0);
  EXPECT_TRUE(drive.Compare({}).jumps.empty());
}

}  // namespace
}  // namespace mgsfm
