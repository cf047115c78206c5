// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_continuity.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/random.h"
#include "geometry/so3.h"
#include "support/orders.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr int kNumFrames = 60;

std::vector<double> Regular() {
  std::vector<double> times_s(kNumFrames);
  for (int k = 0; k < kNumFrames; ++k) times_s[k] = 0.1 * k;
  return times_s;
}

// A car that takes a bend, with the z axis forward.
Rigid3 Bend(double time) {
  const double angle = 0.02 * time;
  return Rigid3::FromRotationAndCenter(
      ExpSO3({0.0, -angle, 0.0}),
      100.0 * Vector3d(1.0 - std::cos(angle), 0.0, std::sin(angle)));
}

Rigid3 Straight(double time) {
  return Rigid3::FromRotationAndCenter(Quaterniond::Identity(),
                                       {0.0, 0.0, 2.0 * time});
}

// Stands still from frame 25 to 35, with smooth braking before and after.
Rigid3 Stop(double time) {
  double s = 0.0;
  for (int k = 0; k < std::lround(time); ++k) {
    s += std::clamp(0.2 * (std::abs(k - 30) - 5), 0.0, 2.0);
  }
  return Rigid3::FromRotationAndCenter(Quaterniond::Identity(), {0.0, 0.0, s});
}

// A sequence of one camera with a known motion, one unit of time per 0.1 s. The
// frame of rank k in time has the index order[k].
class Drive {
 public:
  using RigFromWorld = std::function<Rigid3(double time)>;

  explicit Drive(const RigFromWorld& rig_from_world,
                 std::vector<int> order = InOrder(kNumFrames),
                 const std::vector<double>& times_s = Regular())
      : order_(std::move(order)), steps_(kNumFrames - 1) {
    scene_.rigs.push_back({RigId(1), 0, {0}});
    scene_.sensors.push_back({"", 0, 0, Rigid3()});
    std::vector<double> time_of_frame_s(kNumFrames);
    for (int k = 0; k < kNumFrames; ++k) {
      time_of_frame_s[order_[k]] = times_s[k];
      rig_from_world_.push_back(rig_from_world(times_s[k] / 0.1));
    }
    for (int i = 0; i < kNumFrames; ++i) {
      const auto id = static_cast<uint32_t>(i + 1);
      scene_.images.push_back(
          {ImageId(id), "", 0, 0, i, {}, time_of_frame_s[i]});
      scene_.frames.push_back({FrameId(id), "", 0, {i}});
    }
  }

  // The motion from the frame of one rank to that of another.
  Rigid3 TrueMotion(int rank1, int rank2) const {
    return rig_from_world_[rank2] * rig_from_world_[rank1].Inverse();
  }

  // Hypotheses of the steps [begin, end). Their matches are disjoint.
  void AddWorld(int begin, int end, double share,
                std::optional<double> reach = {}) {
    for (int k = begin; k < end; ++k) {
      steps_[k].push_back({{TrueMotion(k, k + 1)}, share, share, {}, reach});
    }
  }
  void AddObject(int begin, int end, const Rigid3& motion, double share,
                 std::optional<double> reach = {}) {
    for (int k = begin; k < end; ++k) {
      steps_[k].push_back({{motion}, share, share, {}, reach});
    }
  }

  // The motions of the world by one camera, which does not know distances.
  void AddDirections(int begin, int end, double share) {
    for (int k = begin; k < end; ++k) {
      const Rigid3 motion = TrueMotion(k, k + 1);
      steps_[k].push_back({{{motion.rotation, Vector3d::Zero()}},
                           share,
                           share,
                           motion.Center().stableNormalized()});
    }
  }

  // A hypothesis of the motion between the frames of two ranks.
  void AddLong(int rank1, int rank2, const MotionHypothesis& hypothesis) {
    long_motions_[{rank1, rank2}].push_back(hypothesis);
  }

  RigPath FindPath() const {
    std::vector<int> rank_of_frame(kNumFrames);
    for (int k = 0; k < kNumFrames; ++k) rank_of_frame[order_[k]] = k;
    const auto find = [&](int earlier, int later) {
      const int rank1 = rank_of_frame[earlier], rank2 = rank_of_frame[later];
      if (rank2 == rank1 + 1) return steps_[rank1];
      const auto it = long_motions_.find({rank1, rank2});
      return it == long_motions_.end() ? StepHypotheses() : it->second;
    };
    return FindRigPath(TemporalOrder(scene_), kNumFrames, {find}, 1);
  }
  bool AreComparable(const RigPath& path, int rank1, int rank2) const {
    return path.IsComparable(order_[rank1], order_[rank2]);
  }
  bool IsDoubtful(const RigPath& path, int rank) const {
    return path.is_doubtful[order_[rank]];
  }

  // All frames with ranks in [begin, end) have their true relative poses.
  void ExpectTruth(const RigPath& path, int begin, int end) const {
    for (int k = begin + 1; k < end; ++k) {
      ASSERT_TRUE(AreComparable(path, begin, k)) << begin << " " << k;
      const Rigid3 motion = path.Between(order_[begin], order_[k]);
      const Rigid3 truth = TrueMotion(begin, k);
      EXPECT_LT((motion.Center() - truth.Center()).norm(), 1e-6) << k;
      EXPECT_LT(AngleBetween(motion.rotation, truth.rotation), 1e-6) << k;
    }
  }

 private:
  std::vector<int> order_;
  Scene scene_;
  std::vector<Rigid3> rig_from_world_;  // per rank
  std::vector<StepHypotheses> steps_;
  std::map<std::pair<int, int>, StepHypotheses> long_motions_;
};

TEST(MotionContinuityTest, ALorryThatKeepsItsDistanceIsExposed) {
  for (const std::vector<int>& order :
       {InOrder(kNumFrames), Shuffled(kNumFrames)}) {
    Drive drive(Bend, order);
    drive.AddWorld(0, 15, 0.9);
    drive.AddObject(15, 45, {Quaterniond::Identity(), {0.0, 0.01, 0.0}}, 0.7);
    drive.AddWorld(15, 45, 0.25);
    drive.AddWorld(45, kNumFrames - 1, 0.9);
    const RigPath path = drive.FindPath();
    drive.ExpectTruth(path, 0, kNumFrames);
    for (int k = 0; k < kNumFrames; ++k) {
      EXPECT_EQ(drive.IsDoubtful(path, k), k >= 8 && k <= 52) << k;
    }
  }
}

// The motion of the hidden steps is interpolated, which is exact in a bend.
TEST(MotionContinuityTest, TheWorldMayBeHiddenForSomeFrames) {
  Drive drive(Bend);
  drive.AddObject(15, 45, Rigid3(), 0.7);
  drive.AddWorld(0, 28, 0.25);
  drive.AddWorld(32, kNumFrames - 1, 0.25);
  drive.ExpectTruth(drive.FindPath(), 0, kNumFrames);
}

// One camera looks past the lorry that fills all views with depths. Distances
// are interpolated, which is exact in a bend.
TEST(MotionContinuityTest, ACameraThatSeesTheWorldExposesALorry) {
  Drive drive(Bend);
  drive.AddWorld(0, 15, 0.9);
  drive.AddDirections(0, kNumFrames - 1, 0.25);
  drive.AddObject(15, 45, {Quaterniond::Identity(), {0.0, 0.01, 0.0}}, 0.9);
  drive.AddWorld(45, kNumFrames - 1, 0.9);
  drive.ExpectTruth(drive.FindPath(), 0, kNumFrames);
}

// Wrong places of the sensors turn the motions by depth everywhere, and away
// from the image pairs. No two groups of matches exclude each other.
TEST(MotionContinuityTest, DepthsThatDisagreeEverywhereShowNoObject) {
  const Quaterniond error(ExpSO3({0.0, DegToRad(3.0), 0.0}));
  Drive drive(Bend);
  drive.AddDirections(0, kNumFrames - 1, 1.0);
  for (int k = 0; k + 1 < kNumFrames; ++k) {
    const Rigid3 motion = drive.TrueMotion(k, k + 1);
    drive.AddObject(
        k, k + 1,
        Rigid3::FromRotationAndCenter(error * motion.rotation, motion.Center()),
        0.9);
  }
  EXPECT_FALSE(drive.FindPath().is_doubtful.Any());
}

// Where the motion is erratic, one wrong image pair is no object: it neither
// recurs in an adjacent step nor explains one better.
TEST(MotionContinuityTest, AnErrorOfOneStepShowsNoObject) {
  Random random(7);
  std::vector<Rigid3> poses(1);
  for (int k = 0; k + 1 < kNumFrames; ++k) {
    const auto noise = [&] { return random.Uniform(-1.0, 1.0); };
    const Vector3d turn_rad = 0.3 * Vector3d(noise(), noise(), noise());
    const Vector3d center(noise(), noise(), noise());
    poses.push_back(Rigid3::FromRotationAndCenter(ExpSO3(turn_rad), center) *
                    poses.back());
  }
  Drive drive([&](double time) { return poses[std::lround(time)]; });
  drive.AddWorld(0, kNumFrames - 1, 0.9);
  drive.AddObject(30, 31, Rigid3(), 0.4);
  EXPECT_FALSE(drive.FindPath().is_doubtful.Any());
}

// Steps without a motion that matches support count as unknown.
TEST(MotionContinuityTest, StepsThatNothingMeasuresAreUnknown) {
  Drive drive(Bend);
  drive.AddWorld(0, 29, 0.5);
  drive.AddWorld(31, kNumFrames - 1, 0.5);
  drive.AddObject(20, 40, {Quaterniond::Identity(), {0.0, 0.01, 0.0}}, 0.9);
  const RigPath path = drive.FindPath();
  for (int k = 1; k < kNumFrames; ++k) {
    const int group = k < 30 ? 0 : k == 30 ? 1 : 2;
    EXPECT_EQ(path.group[k], group) << k;
  }
}

// The rig speeds up behind a lorry that hides the world from consecutive
// frames. Frames before and after it measure the motion between them. Without a
// distance, they do not tell that the rig speeds up.
TEST(MotionContinuityTest, AMotionOverSeveralStepsFillsAGap) {
  const auto speeding_up = [](double time) {
    return Straight(time + 0.15 * std::clamp(time - 30.0, 0.0, 2.0));
  };
  for (const bool has_distance : {true, false}) {
    Drive drive(speeding_up);
    drive.AddWorld(0, 30, 0.5);
    drive.AddWorld(32, kNumFrames - 1, 0.5);
    drive.AddObject(20, 40, {Quaterniond::Identity(), {0.0, 0.01, 0.0}}, 0.5);
    EXPECT_NEAR(drive.FindPath().Between(30, 32).Center().z(), 4.0, 1e-6);
    MotionHypothesis hypothesis{{drive.TrueMotion(28, 33)}, 0.5, 0.5};
    if (!has_distance) {
      hypothesis.free_direction = Vector3d::UnitZ();
      hypothesis.later_from_earlier = Rigid3();
    }
    drive.AddLong(28, 33, hypothesis);
    const RigPath path = drive.FindPath();
    EXPECT_NEAR(path.Between(30, 32).Center().z(), has_distance ? 4.6 : 4.0,
                1e-6);
    EXPECT_EQ(path.group[29], path.group[33]);
    EXPECT_NE(path.group[29], path.group[31]);
    EXPECT_TRUE(path.is_in_long_motion[31] && path.is_in_long_motion[32]);
    EXPECT_FALSE(path.is_in_long_motion[30] || path.is_in_long_motion[33]);
  }
}

// At the start of a sequence or later, in a tight bend.
TEST(MotionContinuityTest, AMotionOverSeveralStepsIsDivided) {
  const auto tight_bend = [](double time) { return Bend(5.0 * time); };
  std::vector<double> uneven = Regular();
  uneven[1] += 0.04;
  uneven[31] -= 0.05;
  for (const int begin : {0, 30}) {
    for (const auto& times_s : {Regular(), uneven}) {
      Drive drive(tight_bend, InOrder(kNumFrames), times_s);
      drive.AddWorld(0, begin, 0.5);
      drive.AddWorld(begin + 2, kNumFrames - 1, 0.5);
      drive.AddObject(std::max(0, begin - 5), begin + 5, Rigid3(), 0.5);
      drive.AddLong(begin, begin + 4,
                    {{drive.TrueMotion(begin, begin + 4)}, 0.5, 0.5});
      const RigPath path = drive.FindPath();
      // Steps of one velocity have the same chords if they take equal times.
      if (times_s == Regular()) drive.ExpectTruth(path, 0, kNumFrames);
      drive.ExpectTruth(path, begin + 2, kNumFrames);
      const Rigid3 motion = path.Between(begin, begin + 2);
      const Rigid3 truth = drive.TrueMotion(begin, begin + 2);
      EXPECT_LT((motion.Center() - truth.Center()).norm(), 1e-6);
      EXPECT_LT(AngleBetween(motion.rotation, truth.rotation), 1e-6);
      EXPECT_TRUE(path.is_in_long_motion[begin + 1]);
      EXPECT_EQ(path.group[begin], path.group[begin + 2]);
      EXPECT_NE(path.group[begin], path.group[begin + 1]);
    }
  }
}

// A direction fits any speed, but a measured one is better.
TEST(MotionContinuityTest, DistancesCountWhereTheRigBrakes) {
  Drive drive(Stop);
  drive.AddWorld(0, kNumFrames - 1, 0.5);
  drive.AddDirections(0, kNumFrames - 1, 1.0);
  const RigPath path = drive.FindPath();
  drive.ExpectTruth(path, 0, kNumFrames);
  EXPECT_FALSE(path.is_doubtful.Any());
}

// Brakes from frame 20 to 26, from 2 to 0.5 per step.
Rigid3 Braking(double time) {
  double s = 0.0;
  for (int k = 0; k < std::lround(time); ++k) {
    s += std::clamp(2.0 - 0.25 * (k - 20), 0.5, 2.0);
  }
  return Rigid3::FromRotationAndCenter(Quaterniond::Identity(), {0.0, 0.0, s});
}

// No distance is known while the rig brakes. A lorry that turns off seems to
// move with the speed after braking.
TEST(MotionContinuityTest, ARigBrakesWhereNoDistanceIsKnown) {
  Drive drive(Braking);
  drive.AddWorld(0, 22, 0.5);
  drive.AddDirections(0, kNumFrames - 1, 0.5);
  drive.AddWorld(26, kNumFrames - 1, 0.5);
  drive.AddObject(22, 40,
                  Rigid3::FromRotationAndCenter(
                      ExpSO3({0.0, DegToRad(1.5), 0.0}), {0.0, 0.0, 0.5}),
                  0.5);
  drive.ExpectTruth(drive.FindPath(), 0, kNumFrames);
}

// Drives straight on until frame 30, and then turns.
Rigid3 Turning(double time, double angle_deg) {
  Rigid3 rig_from_world;
  for (int k = 0; k < std::lround(time); ++k) {
    const double angle = k < 30 ? 0.0 : DegToRad(angle_deg);
    rig_from_world = Rigid3::FromRotationAndCenter(ExpSO3({0.0, angle, 0.0}),
                                                   {0.0, 0.0, 1.0}) *
                     rig_from_world;
  }
  return rig_from_world;
}
Rigid3 LeftTurn(double time) { return Turning(time, 6.0); }
Rigid3 RightTurnStep() {
  return Turning(31, -6.0) * Turning(30, -6.0).Inverse();
}

// A turn and its mirror image are equally smooth.
TEST(MotionContinuityTest, EquallySmoothMotionsAreAmbiguous) {
  for (const std::vector<int>& order :
       {InOrder(kNumFrames), Shuffled(kNumFrames)}) {
    Drive drive(LeftTurn, order);
    drive.AddWorld(0, kNumFrames - 1, 0.45);
    drive.AddObject(30, kNumFrames - 1, RightTurnStep(), 0.45);
    const RigPath path = drive.FindPath();
    drive.ExpectTruth(path, 0, 31);
    for (int k = 31; k < kNumFrames; ++k) {
      EXPECT_FALSE(drive.AreComparable(path, k - 1, k)) << k;
      EXPECT_TRUE(path.IsAmbiguousBetween(order[k - 1], order[k])) << k;
    }
    EXPECT_FALSE(path.IsAmbiguousBetween(order[0], order[30]));
  }
}

// A wrong measurement of the first step, near competing motions, leaves the
// step unknown. It is not ambiguous, because no motion before it contradicts
// its pairs.
TEST(MotionContinuityTest, TheFirstStepIsNotAmbiguousWithoutRivals) {
  Drive drive(Straight);
  drive.AddWorld(1, kNumFrames - 1, 0.6);
  drive.AddObject(2, 8, Rigid3(), 0.3);
  drive.AddObject(
      0, 1,
      Rigid3::FromRotationAndCenter(Quaterniond::Identity(), {0.0, 0.0, 8.0}),
      0.05);
  const RigPath path = drive.FindPath();
  EXPECT_FALSE(drive.AreComparable(path, 0, 1));
  EXPECT_FALSE(path.IsAmbiguousBetween(0, 1));
  drive.ExpectTruth(path, 1, kNumFrames);
}

TEST(MotionContinuityTest, TheMotionThatGoesOnIsNotAmbiguous) {
  Drive drive(LeftTurn);
  drive.AddWorld(0, kNumFrames - 1, 0.45);
  drive.AddObject(30, 45, RightTurnStep(), 0.45);
  drive.ExpectTruth(drive.FindPath(), 0, kNumFrames);
}

// The turn is ambiguous no longer if the points of one motion are nearer.
TEST(MotionContinuityTest, AnObjectIsNearerThanTheWorld) {
  for (const double reach_of_object : {2.0, 20.0}) {
    Drive drive(LeftTurn);
    drive.AddWorld(0, kNumFrames - 1, 0.45, 10.0);
    drive.AddObject(30, kNumFrames - 1, RightTurnStep(), 0.45, reach_of_object);
    const RigPath path = drive.FindPath();
    drive.ExpectTruth(path, 0, 31);
    const Rigid3 left = drive.TrueMotion(30, 31);
    const Rigid3 motion = path.Between(30, 31);
    EXPECT_LT(AngleBetween(
                  motion.rotation,
                  (reach_of_object < 10.0 ? left : RightTurnStep()).rotation),
              1e-6);
    EXPECT_FALSE(path.IsAmbiguousBetween(0, kNumFrames - 1));
  }
}

// The rig stands still and starts together with a lorry that has most matches,
// up to the end of the sequence.
TEST(MotionContinuityTest, ARigStartsBesideALorry) {
  const auto starting = [](double time) {
    const double k = std::max(0.0, time - 20.0);
    return Rigid3::FromRotationAndCenter(Quaterniond::Identity(),
                                         {0.0, 0.0, 0.03 * k * k});
  };
  Drive drive(starting);
  drive.AddWorld(0, 20, 0.9);
  drive.AddWorld(20, kNumFrames - 1, 0.2, 12.0);
  drive.AddObject(20, kNumFrames - 1,
                  {Quaterniond::Identity(), {0.0, 0.01, 0.0}}, 0.7, 3.0);
  // Both motions are equal at first.
  drive.ExpectTruth(drive.FindPath(), 25, kNumFrames);
}

// Wrong depths of one camera look like another motion in each step.
TEST(MotionContinuityTest, MotionsThatDoNotLastAreNoObjects) {
  Random random(3);
  Drive drive(Straight);
  drive.AddWorld(0, kNumFrames - 1, 0.5);
  for (int k = 0; k + 1 < kNumFrames; ++k) {
    const double side = k % 2 == 0 ? 1.0 : -1.0;
    drive.AddObject(
        k, k + 1,
        {Quaterniond::Identity(), {side, random.Uniform(-1.0, 1.0), -1.0}},
        0.3);
  }
  const RigPath path = drive.FindPath();
  drive.ExpectTruth(path, 0, kNumFrames);
  EXPECT_FALSE(path.is_doubtful.Any());
}

TEST(MotionContinuityTest, AStopIsNoObject) {
  Drive drive(Stop);
  drive.AddWorld(0, kNumFrames - 1, 0.35);
  // A vehicle that passes while the rig stands still.
  drive.AddObject(27, 32, {Quaterniond::Identity(), {0.0, 0.0, 1.5}}, 0.6);
  const RigPath path = drive.FindPath();
  drive.ExpectTruth(path, 0, kNumFrames);
  EXPECT_TRUE(drive.IsDoubtful(path, 30));
  EXPECT_FALSE(drive.IsDoubtful(path, 19));
}

// A lorry ahead that turns off seems to swing the rig around, even if its
// distance suggests the right speed.
TEST(MotionContinuityTest, ALorryInATurnIsExposedByItsRotation) {
  Drive drive(Straight);
  drive.AddWorld(0, kNumFrames - 1, 0.3);
  drive.AddObject(25, 31,
                  Rigid3::FromRotationAndCenter(
                      ExpSO3({0.0, DegToRad(10.0), 0.0}), {0.0, 0.0, 2.0}),
                  0.6);
  drive.ExpectTruth(drive.FindPath(), 0, kNumFrames);
}

TEST(MotionContinuityTest, JerkyMotionIsAcceptedIfNothingContradictsIt) {
  Random random(2);
  std::vector<Rigid3> rig_from_world(kNumFrames);
  const auto any = [&random] { return random.Uniform(-1.0, 1.0); };
  for (int k = 1; k < kNumFrames; ++k) {
    const Rigid3 step = Rigid3::FromRotationAndCenter(
        ExpSO3(0.3 * Vector3d(any(), any(), any())),
        {any(), any(), 1.0 + any()});
    rig_from_world[k] = step * rig_from_world[k - 1];
  }
  Drive drive([&](double time) { return rig_from_world[std::lround(time)]; });
  drive.AddWorld(0, kNumFrames - 1, 0.5);
  const RigPath path = drive.FindPath();
  drive.ExpectTruth(path, 0, kNumFrames);
  EXPECT_FALSE(path.is_doubtful.Any());
}

// Where frames are missing, the rig moves further. The motion of a single step
// would be too slow.
TEST(MotionContinuityTest, SpeedsFollowCaptureTimes) {
  std::vector<double> times_s = Regular();
  for (int k = 30; k < kNumFrames; ++k) times_s[k] += 0.2;
  Drive drive(Straight, Shuffled(kNumFrames), times_s);
  drive.AddWorld(0, kNumFrames - 1, 0.3);
  drive.AddObject(29, 30, drive.TrueMotion(0, 1), 0.6);
  drive.ExpectTruth(drive.FindPath(), 0, kNumFrames);
}

// Steps [begin, end) without any hypothesis between two that a lorry contests.
Drive WithGap(int begin, int end,
              const std::vector<double>& times_s = Regular()) {
  Drive drive(Bend, InOrder(kNumFrames), times_s);
  drive.AddWorld(0, begin, 0.4);
  drive.AddObject(begin - 1, begin, Rigid3(), 0.5);
  drive.AddWorld(end, kNumFrames - 1, 0.4);
  drive.AddObject(end, end + 1, Rigid3(), 0.5);
  return drive;
}

TEST(MotionContinuityTest, UpToSevenStepsAreInterpolated) {
  const Drive drive = WithGap(20, 27);
  drive.ExpectTruth(drive.FindPath(), 0, kNumFrames);
}

TEST(MotionContinuityTest, MoreThanSevenUnknownStepsBeginAnotherStretch) {
  const Drive drive = WithGap(20, 28);
  const RigPath path = drive.FindPath();
  drive.ExpectTruth(path, 0, 21);
  drive.ExpectTruth(path, 28, kNumFrames);
  EXPECT_FALSE(drive.AreComparable(path, 20, 28));
}

// Four steps, of which one takes longer than the others.
TEST(MotionContinuityTest, UnknownStepsMayTakeSevenUnitsOfTime) {
  for (const double missing : {3.0, 4.0}) {
    std::vector<double> times_s = Regular();
    for (int k = 22; k < kNumFrames; ++k) times_s[k] += 0.1 * missing;
    const Drive drive = WithGap(20, 24, times_s);
    const RigPath path = drive.FindPath();
    drive.ExpectTruth(path, 0, 21);
    drive.ExpectTruth(path, 24, kNumFrames);
    EXPECT_EQ(drive.AreComparable(path, 20, 24), missing == 3.0);
  }
}

// Ten steps of half the time between frames elsewhere.
TEST(MotionContinuityTest, UnknownStepsAreFewAlsoIfTheyAreShort) {
  std::vector<double> times_s = Regular();
  for (int k = 20; k < kNumFrames; ++k) {
    times_s[k] -= 0.05 * std::min(k - 20, 10);
  }
  const RigPath path = WithGap(20, 30, times_s).FindPath();
  EXPECT_FALSE(path.IsComparable(20, 30));
}

TEST(MotionContinuityTest,
     AnUnquestionedStepWithoutMotionBeginsAnotherStretch) {
  Drive drive(Bend);
  drive.AddWorld(0, 40, 0.4);
  drive.AddObject(20, 25, Rigid3(), 0.5);
  drive.AddWorld(41, kNumFrames - 1, 0.4);
  const RigPath path = drive.FindPath();
  drive.ExpectTruth(path, 0, 41);
  drive.ExpectTruth(path, 41, kNumFrames);
  EXPECT_FALSE(drive.AreComparable(path, 40, 41));
}

TEST(MotionContinuityTest, ASequenceWithoutHypothesesIsNotComparable) {
  const Drive drive(Bend);
  const RigPath path = drive.FindPath();
  for (int k = 0; k + 1 < kNumFrames; ++k) {
    EXPECT_FALSE(drive.AreComparable(path, k, k + 1)) << k;
  }
}

// Two frames of a slow rig, one of another rig, and three of a fast one.
TEST(MotionContinuityTest, SequencesAreNotComparable) {
  Scene scene;
  int idx = 0;
  for (const int rig_idx : {0, 0, 1, 2, 2, 2}) {
    const auto id = static_cast<uint32_t>(idx + 1);
    scene.images.push_back({ImageId(id), "", 0, rig_idx, idx, {}});
    scene.frames.push_back({FrameId(id), std::to_string(idx), rig_idx, {idx}});
    ++idx;
  }
  for (const uint32_t id : {1, 2, 3}) scene.rigs.push_back({RigId(id), 0, {}});
  const Rigid3 slow{Quaterniond::Identity(), {0.0, 0.0, -1.0}};
  const Rigid3 fast{Quaterniond::Identity(), {0.0, 0.0, -3.0}};
  const RigPath path = FindRigPath(
      TemporalOrder(scene), idx, {[&](int earlier, int later) {
        if (later != earlier + 1) return StepHypotheses();
        return StepHypotheses{{{earlier < 2 ? slow : fast}, 0.5, 0.5}};
      }},
      1);
  for (int i = 0; i < idx; ++i) {
    for (int k = i + 1; k < idx; ++k) {
      EXPECT_EQ(path.IsComparable(i, k), k < 2 || i >= 3) << i << " " << k;
    }
  }
  EXPECT_DOUBLE_EQ(path.Between(0, 1).Center().z(), 1.0);
  EXPECT_DOUBLE_EQ(path.Between(3, 5).Center().z(), 6.0);
  EXPECT_DOUBLE_EQ(path.noise.median_step, 3.0);
}

TEST(MotionContinuityTest, MotionsAreSimilarUpToTheirTolerances) {
  MotionNoise noise;
  noise.median_step = 1.0;
  const auto forward = [](double length, double angle_deg) {
    return MeasuredMotion{Rigid3::FromRotationAndCenter(
        ExpSO3({0.0, DegToRad(angle_deg), 0.0}), {0.0, 0.0, length})};
  };
  const MeasuredMotion step = forward(10.0, 5.0);
  EXPECT_TRUE(AreEqualMotions(step, forward(11.5, 5.5), noise));
  EXPECT_TRUE(AreEqualMotions(forward(11.5, 5.5), step, noise));
  EXPECT_FALSE(AreEqualMotions(step, forward(15.0, 5.0), noise));
  EXPECT_FALSE(AreEqualMotions(step, forward(10.0, 7.0), noise));
  EXPECT_FALSE(AreEqualMotions(step, forward(-10.0, 5.0), noise));
  // Short motions are less certain.
  EXPECT_TRUE(AreEqualMotions(forward(0.0, 0.0), forward(0.03, 0.0), noise));
}

}  // namespace
}  // namespace mgsfm
