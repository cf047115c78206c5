// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/motion_jumps.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {
namespace {

constexpr int kNumFrames = 30;
constexpr int kLastBefore = 17;  // the frame before the jump

// The true lengths of all baselines, in a unit that differs from that of the
// model.
class Drive {
 public:
  Drive() {
    SimulationOptions options;
    options.num_frames = kNumFrames;
    simulation_ = Simulate(options);
    for (const ImagePair& pair : simulation_.view_graph.pairs) {
      const auto cam1 = CamFromWorld(pair.image_idx1);
      const auto cam2 = CamFromWorld(pair.image_idx2);
      lengths_.push_back(3.0 * (cam1.Center() - cam2.Center()).norm());
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

  std::vector<std::pair<int, int>> FindJumps() const { return Find(lengths_); }
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
  std::vector<std::pair<int, int>> Find(
      const std::vector<std::optional<double>>& lengths) const {
    const FramePairIndex index(simulation_.scene, simulation_.view_graph,
                               SequenceMode::kYes);
    return FindMotionJumps(simulation_.scene, index, simulation_.view_graph,
                           lengths, simulation_.ground_truth);
  }

 private:
  Rigid3 CamFromWorld(int image_idx) const {
    return *simulation_.ground_truth.CamFromWorld(simulation_.scene, image_idx);
  }

  Simulation simulation_;
  std::vector<std::optional<double>> lengths_;
};

TEST(MotionJumps, AreNotInATrueModel) {
  EXPECT_TRUE(Drive().FindJumps().empty());
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

TEST(MotionJumps, NeedExpectedLengths) {
  Drive drive;
  drive.PullApart(3.0);
  EXPECT_TRUE(drive.Find({}).empty());
}

}  // namespace
}  // namespace mgsfm
