// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/pose_graph.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"
#include "support/orders.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kNumFrames = 60;
constexpr double kRadius = 20.0;
constexpr double kDriftPerFrame_rad = DegToRad(0.1);

// Two cameras on a circular drive, with exact pairs of neighbors and of the
// two ends. The rotations pitch a little more from frame to frame, and the
// positions follow them: they leave the two ends apart. The frame of rank k on
// the circle has the index order[k].
class DriftingCircle {
 public:
  explicit DriftingCircle(std::vector<int> order, double unit = 1.0)
      : order_(std::move(order)), unit_(unit) {
    scene_.rigs.push_back({RigId(1), 0, {0, 1}});
    scene_.sensors.push_back({"left", 0, 0, std::nullopt});
    scene_.sensors.push_back({"right", 0, 0, std::nullopt});
    rotations_.sensor_from_rig = {Quaterniond::Identity(),
                                  ExpSO3({0.02, -0.3, 0.01})};
    initial_.positions.sensor_translation = {Vector3d::Zero(),
                                             Vector3d(-0.8, 0.1, 0.2)};
    initial_.positions.frame_is_placed = Mask(kNumFrames, true);
    initial_.positions.frame_center.resize(kNumFrames);
    initial_.group_factor = {unit};
    rotations_.rig_from_world.resize(kNumFrames);
    rotations_.component.assign(kNumFrames, 0);
    for (int f = 0; f < kNumFrames; ++f) {
      const auto id = static_cast<uint32_t>(f);
      scene_.frames.push_back({FrameId(id + 1), "", 0, {2 * f, 2 * f + 1}});
      scene_.images.push_back({ImageId(2 * id + 1), "", 0, 0, f, {}});
      scene_.images.push_back({ImageId(2 * id + 2), "", 0, 1, f, {}});
    }
    Drift();
  }

  void AddPairs(std::optional<int> rank_without_pairs = std::nullopt) {
    for (int k = 0; k < kNumFrames; ++k) {
      for (int gap = 1; gap <= 2; ++gap) {
        const int next = (k + gap) % kNumFrames;
        if (k == rank_without_pairs || next == rank_without_pairs) continue;
        Add(k, 0, next, 0);
        Add(k, 0, next, 1);
        Add(next, 1, k, 1);
      }
    }
  }

  // A pair that measures a relative pose with another baseline.
  void Add(int rank1, int sensor1, int rank2, int sensor2,
           const Vector3d& error = Vector3d::Zero()) {
    BaselineDirection baseline;
    baseline.image_idx1 = 2 * order_[rank1] + sensor1;
    baseline.image_idx2 = 2 * order_[rank2] + sensor2;
    baseline.kind = BaselineKind::kDirection;
    baseline.sigma_rad = 0.005;
    const Quaterniond cam1 = CamFromWorld(rank1, sensor1);
    const Vector3d in_cam1 =
        cam1 * (Center(rank2, sensor2) - Center(rank1, sensor1) + error);
    // The measurement has the axes of the estimated rotation.
    baseline.direction =
        rotations_.CamFromWorld(scene_, baseline.image_idx1)->inverse() *
        in_cam1.normalized();
    baselines_.push_back(baseline);
    scales_.pairs.push_back(PairScale{in_cam1.norm() / unit_, 0.05, 0});
    ImagePair pair;
    pair.image_idx1 = baseline.image_idx1;
    pair.image_idx2 = baseline.image_idx2;
    pair.relative_pose = RelativePose{
        CamFromWorld(rank2, sensor2) * cam1.inverse(), std::nullopt};
    view_graph_.pairs.push_back(pair);
  }

  // Puts the last pair into a group of lengths of its own, with a wrong guess.
  void GuessLengthOfLastPair() {
    scales_.pairs.back()->group =
        static_cast<int>(initial_.group_factor.size());
    initial_.group_factor.push_back(2.5 * unit_);
  }

  PoseGraphEstimate Refine(const Context& context = {}) {
    scales_.group_sizes.assign(initial_.group_factor.size(), 1);
    scales_.typical_depth = 15.0 / unit_;
    const PositionProblem problem = MakePositionProblem(scene_, rotations_);
    return RefinePoseGraph(
        {problem, baselines_, scales_, initial_, Mask(baselines_.size(), true)},
        view_graph_, rotations_, context);
  }

  // The largest error of the rotations relative to the first frame.
  double MaxError(const PoseGraphEstimate& estimate) const {
    const auto& rotations = estimate.rig_from_world;
    const Quaterniond aligned =
        rotations[0]->inverse() * RigFromWorld(RankOfFirst());
    double max_error = 0.0;
    for (int k = 0; k < kNumFrames; ++k) {
      max_error = std::max(
          max_error,
          (*rotations[order_[k]] * aligned).angularDistance(RigFromWorld(k)));
    }
    return max_error;
  }

 private:
  static Quaterniond RigFromWorld(int rank) {
    return ExpSO3({0.0, -2.0 * M_PI * rank / kNumFrames, 0.0});
  }
  Quaterniond CamFromWorld(int rank, int sensor) const {
    return *rotations_.sensor_from_rig[sensor] * RigFromWorld(rank);
  }
  static Vector3d RigCenter(int rank) {
    const double angle = 2.0 * M_PI * rank / kNumFrames;
    return kRadius * Vector3d(std::cos(angle), 0.0, -std::sin(angle));
  }
  Vector3d Center(int rank, int sensor) const {
    return RigCenter(rank) - CamFromWorld(rank, sensor).inverse() *
                                 initial_.positions.sensor_translation[sensor];
  }
  int RankOfFirst() const {
    for (int k = 0; k < kNumFrames; ++k) {
      if (order_[k] == 0) return k;
    }
    return 0;
  }

  void Drift() {
    Vector3d center = RigCenter(0);
    for (int k = 0; k < kNumFrames; ++k) {
      const Quaterniond drifted =
          ExpSO3({k * kDriftPerFrame_rad, 0.0, 0.0}) * RigFromWorld(k);
      rotations_.rig_from_world[order_[k]] = drifted;
      initial_.positions.frame_center[order_[k]] = center;
      center += drifted.inverse() *
                (RigFromWorld(k) * (RigCenter(k + 1) - RigCenter(k)));
    }
  }

  std::vector<int> order_;
  double unit_;
  Scene scene_;
  ViewGraph view_graph_;
  RotationEstimate rotations_;
  InitialPositions initial_;
  std::vector<BaselineDirection> baselines_;
  PairScales scales_;
};

TEST(PoseGraphTest, ClosesALoopByTurningEveryStepInAnyOrderAndUnit) {
  for (const auto& order : {InOrder(kNumFrames), Shuffled(kNumFrames)}) {
    for (const double unit : {1.0, 0.2}) {
      DriftingCircle circle(order, unit);
      circle.AddPairs();
      const PoseGraphEstimate estimate = circle.Refine();
      EXPECT_EQ(estimate.summary.termination, Termination::kConverged);
      EXPECT_LT(circle.MaxError(estimate), 1e-5);
    }
  }
}

TEST(PoseGraphTest, DoesNotTrustGuessedLengths) {
  DriftingCircle circle(InOrder(kNumFrames));
  circle.AddPairs();
  for (int k = 0; k < 10; ++k) {
    circle.Add(k, 0, k + 3, 0);
    circle.GuessLengthOfLastPair();
  }
  EXPECT_LT(circle.MaxError(circle.Refine()), 1e-5);
}

TEST(PoseGraphTest, FramesWithoutPairsTurnLikeTheFrameBefore) {
  constexpr int kRank = 25;
  DriftingCircle circle(InOrder(kNumFrames));
  circle.AddPairs(kRank);
  // The frame was off by kRank times the drift, about an axis that turns by
  // 6 degrees from frame to frame.
  EXPECT_LT(circle.MaxError(circle.Refine()), 0.2 * kRank * kDriftPerFrame_rad);
}

TEST(PoseGraphTest, CanBeCanceled) {
  DriftingCircle circle(InOrder(kNumFrames));
  circle.AddPairs();
  Context context;
  context.is_canceled = [] { return true; };
  EXPECT_THROW((void)circle.Refine(context), Interrupted);
}

TEST(PoseGraphTest, IgnoresAFewWrongLoops) {
  DriftingCircle circle(InOrder(kNumFrames));
  circle.AddPairs();
  for (int k = 0; k < 6; ++k) {
    circle.Add(k, 0, k + kNumFrames / 2, 0, Vector3d(30.0, 5.0, -10.0));
  }
  EXPECT_LT(circle.MaxError(circle.Refine()), DegToRad(0.1));
}

TEST(PoseGraphTest, KeepsRotationsWithoutPairsBetweenFrames) {
  Scene scene;
  RotationEstimate rotations;
  rotations.rig_from_world = {ExpSO3({0.1, 0.2, 0.3}), std::nullopt};
  const PositionProblem problem;
  const PairScales scales;
  const InitialPositions initial;
  const PoseGraphEstimate estimate = RefinePoseGraph(
      {problem, {}, scales, initial, Mask()}, ViewGraph(), rotations, {});
  EXPECT_EQ(estimate.rig_from_world[0]->coeffs(),
            rotations.rig_from_world[0]->coeffs());
  EXPECT_FALSE(estimate.rig_from_world[1]);
}

}  // namespace
}  // namespace mgsfm
