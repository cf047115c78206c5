// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/motion_continuity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <random>

namespace mgsfm {
namespace {

using Eigen::Vector3d;

constexpr int kNumFrames = 60;
constexpr int kMaxGap = 3;

// A sequence of one camera whose pairs have known baselines. Frame k in time
// has the index order[k].
class Drive {
 public:
  explicit Drive(std::vector<int> order) : order_(std::move(order)) {
    std::vector<int> rank(order_.size());
    for (size_t k = 0; k < order_.size(); ++k) {
      rank[order_[k]] = static_cast<int>(k);
    }
    scene_.rigs.push_back({RigId(1), 0, {0}});
    scene_.sensors.push_back({"", 0, 0, Rigid3()});
    for (int i = 0; i < kNumFrames; ++i) {
      scene_.images.push_back({ImageId(static_cast<uint32_t>(i + 1)),
                               "",
                               0,
                               0,
                               i,
                               {},
                               0.1 * rank[i]});
      scene_.frames.push_back(
          {FrameId(static_cast<uint32_t>(i + 1)), "", 0, {i}});
      rotations_.rig_from_world.emplace_back(Eigen::Quaterniond::Identity());
    }
  }

  // A pair between two frames in time, one later than the other.
  size_t Add(int rank1, int rank2, const Vector3d& baseline,
             double num_matches) {
    ImagePair pair;
    pair.image_idx1 = order_[rank1];
    pair.image_idx2 = order_[rank2];
    Vector3d from_first = baseline;
    if (pair.image_idx1 > pair.image_idx2) {
      std::swap(pair.image_idx1, pair.image_idx2);
      from_first = -baseline;
    }
    view_graph_.pairs.push_back(pair);
    baselines_.push_back({{from_first, num_matches}});
    return view_graph_.pairs.size() - 1;
  }

  // The pairs of all neighbours along a path.
  std::vector<size_t> AddWorld(
      const std::function<Vector3d(int)>& center_at_rank, double num_matches) {
    std::vector<size_t> pairs;
    for (int k = 0; k < kNumFrames; ++k) {
      for (int l = k + 1; l <= std::min(k + kMaxGap, kNumFrames - 1); ++l) {
        pairs.push_back(
            Add(k, l, center_at_rank(l) - center_at_rank(k), num_matches));
      }
    }
    return pairs;
  }

  Mask FindDiscontinuous(SequenceMode mode = SequenceMode::kYes) const {
    return CheckMotion(scene_, FramePairIndex(scene_, view_graph_, mode),
                       view_graph_, rotations_, baselines_, {})
        .pair_is_discontinuous;
  }

 private:
  std::vector<int> order_;
  Scene scene_;
  ViewGraph view_graph_;
  RotationEstimate rotations_;
  SupportedBaselines baselines_;
};

std::vector<int> InOrder() {
  std::vector<int> order(kNumFrames);
  std::iota(order.begin(), order.end(), 0);
  return order;
}

std::vector<int> Shuffled() {
  std::vector<int> order = InOrder();
  std::mt19937 random(1);
  std::shuffle(order.begin(), order.end(), random);
  return order;
}

// A car that takes a bend.
Vector3d Bend(int rank) {
  const double angle = 0.02 * rank;
  return 100.0 * Vector3d(std::sin(angle), 0.0, 1.0 - std::cos(angle));
}

// Stands still from frame 25 to 35, with smooth braking before and after.
Vector3d Stop(int rank) {
  double s = 0.0;
  for (int k = 0; k < rank; ++k) {
    s += std::clamp(0.2 * (std::abs(k - 30) - 5), 0.0, 2.0);
  }
  return {s, 0.0, 0.0};
}

TEST(MotionContinuityTest, ALorryThatKeepsItsDistanceIsExposed) {
  for (const std::vector<int>& order : {InOrder(), Shuffled()}) {
    Drive drive(order);
    const std::vector<size_t> world = drive.AddWorld(Bend, 60.0);
    std::vector<size_t> lorry;
    for (int k = 15; k < 45; ++k) {
      for (int gap = 1; gap <= 10; ++gap) {
        lorry.push_back(
            drive.Add(k, k + gap, Vector3d(0.0, 0.01 * gap, 0.0), 200.0));
      }
    }
    const Mask is_discontinuous = drive.FindDiscontinuous();
    for (const size_t i : world) EXPECT_FALSE(is_discontinuous[i]);
    for (const size_t i : lorry) EXPECT_TRUE(is_discontinuous[i]);
  }
}

TEST(MotionContinuityTest, TheWorldMayBeHiddenForSomeFrames) {
  Drive drive(InOrder());
  std::vector<size_t> lorry;
  for (int k = 0; k + 1 < kNumFrames; ++k) {
    const bool is_hidden = k >= 28 && k < 32;
    if (!is_hidden) drive.Add(k, k + 1, Bend(k + 1) - Bend(k), 60.0);
    if (k < 15 || k >= 45) continue;
    lorry.push_back(drive.Add(k, k + 1, Vector3d::Zero(), 200.0));
  }
  const Mask is_discontinuous = drive.FindDiscontinuous();
  EXPECT_EQ(is_discontinuous.Count(), lorry.size());
  for (const size_t i : lorry) EXPECT_TRUE(is_discontinuous[i]);
}

TEST(MotionContinuityTest, AStopIsNoObject) {
  Drive drive(InOrder());
  drive.AddWorld(Stop, 60.0);
  // A vehicle that passes while the rig stands still.
  std::vector<size_t> passing;
  for (int k = 27; k < 32; ++k) {
    passing.push_back(drive.Add(k, k + 1, Vector3d(0.0, 0.0, 1.5), 100.0));
  }
  const Mask is_discontinuous = drive.FindDiscontinuous();
  EXPECT_EQ(is_discontinuous.Count(), passing.size());
  for (const size_t i : passing) EXPECT_TRUE(is_discontinuous[i]);
}

TEST(MotionContinuityTest, NothingIsKnownWithoutTemporalOrder) {
  Drive drive(InOrder());
  drive.AddWorld(Bend, 60.0);
  for (int k = 15; k < 45; ++k) {
    drive.Add(k, k + 1, Vector3d::Zero(), 200.0);
  }
  EXPECT_FALSE(drive.FindDiscontinuous(SequenceMode::kNo).Any());
}

TEST(MotionContinuityTest, JerkyMotionIsAcceptedIfNothingContradictsIt) {
  Drive drive(InOrder());
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Vector3d> centers(kNumFrames);
  for (int k = 1; k < kNumFrames; ++k) {
    centers[k] = centers[k - 1] + Vector3d(1.0 + uniform(random),
                                           uniform(random), uniform(random));
  }
  drive.AddWorld([&](int rank) { return centers[rank]; }, 60.0);
  EXPECT_LT(drive.FindDiscontinuous().Count(), 3u);
}

}  // namespace
}  // namespace mgsfm
