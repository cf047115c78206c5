// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/motion_search.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "base/random.h"
#include "geometry/so3.h"
#include "moving_objects/motion_rivals.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

constexpr size_t kNumSteps = 12;

Rigid3 Forward(double length) {
  return Rigid3::FromRotationAndCenter(Quaterniond::Identity(),
                                       {0.0, 0.0, length});
}

// Each step has three motions of known distance. One is smooth.
std::vector<StepHypotheses> RandomSteps(int seed) {
  Random random(static_cast<uint64_t>(seed));
  std::vector<StepHypotheses> steps(kNumSteps);
  for (StepHypotheses& step : steps) {
    for (int h = 0; h < 3; ++h) {
      const double share = random.Uniform(0.05, 0.9);
      const double length =
          h == 0 ? random.Uniform(1.4, 1.6) : random.Uniform(0.5, 3.0);
      step.push_back({{Forward(length)}, share, share});
    }
  }
  return steps;
}

Steps MakeRegularSteps(const std::vector<StepHypotheses>& hypotheses) {
  return MakeSteps(hypotheses, std::vector<double>(hypotheses.size(), 1.0));
}

// The margin of a step is the rise of the cost without its motion and all that
// are similar. No step may be skipped.
TEST(MotionSearchTest, MarginsAreTheCostOfTheNextBestMotion) {
  const Mask is_doubtful(kNumSteps, false);
  for (int seed = 1; seed <= 10; ++seed) {
    const Steps steps = MakeRegularSteps(RandomSteps(seed));
    const MotionChoice best = ChooseMotions(steps, is_doubtful);
    for (size_t k = 0; k < kNumSteps; ++k) {
      ASSERT_TRUE(best.motions[k].has_value());
      Steps others = steps;
      std::vector<Candidate>& step = others.candidates[k];
      const auto is_similar = [&](const Candidate& candidate) {
        return AreEqualMotions({candidate.later_from_earlier},
                               {best.motions[k]->candidate.later_from_earlier},
                               steps.noise, 2.0);
      };
      step.erase(std::remove_if(step.begin(), step.end(), is_similar),
                 step.end());
      if (step.empty()) {
        EXPECT_TRUE(std::isinf(best.margins[k]));
        continue;
      }
      const MotionChoice next = ChooseMotions(others, is_doubtful);
      EXPECT_NEAR(best.margins[k], next.cost - best.cost, 1e-9);
    }
  }
}

// Forwards and backwards, a drive has the same motions and margins.
TEST(MotionSearchTest, MarginsDoNotDependOnTheDirectionOfTime) {
  std::vector<StepHypotheses> forward = RandomSteps(5);
  std::vector<StepHypotheses> backward(forward.rbegin(), forward.rend());
  const Mask is_doubtful(kNumSteps, true);
  const MotionChoice a = ChooseMotions(MakeRegularSteps(forward), is_doubtful);
  const MotionChoice b = ChooseMotions(MakeRegularSteps(backward), is_doubtful);
  EXPECT_NEAR(a.cost, b.cost, 1e-9);
  for (size_t k = 0; k < kNumSteps; ++k) {
    const double of_backward = b.margins[kNumSteps - 1 - k];
    EXPECT_TRUE(a.margins[k] == of_backward ||
                std::abs(a.margins[k] - of_backward) < 1e-9)
        << k << ": " << a.margins[k] << " " << of_backward;
  }
}

// A stop from one step to the next costs more than to leave out all motions of
// a vehicle that keeps its distance.
TEST(MotionSearchTest, AnyNumberOfStepsMayBeSkipped) {
  for (const size_t num_skipped : {3, 6, 9, 12, 15}) {
    std::vector<StepHypotheses> hypotheses(
        60, StepHypotheses{{{Forward(1.0)}, 0.9, 0.9}});
    for (size_t k = 20; k < 20 + num_skipped; ++k) {
      hypotheses[k] = {{{Forward(0.0)}, 0.9, 0.9}};
    }
    const MotionChoice choice =
        ChooseMotions(MakeRegularSteps(hypotheses), Mask(60, true));
    for (size_t k = 0; k < hypotheses.size(); ++k) {
      EXPECT_EQ(choice.motions[k].has_value(), k < 20 || k >= 20 + num_skipped)
          << k << " " << num_skipped;
    }
  }
}

TEST(MotionSearchTest, AMotionWithoutRivalHasAnInfiniteMargin) {
  const std::vector<StepHypotheses> hypotheses(
      kNumSteps, StepHypotheses{{{Forward(1.0)}, 0.9, 0.9}});
  const MotionChoice choice =
      ChooseMotions(MakeRegularSteps(hypotheses), Mask(kNumSteps, true));
  for (size_t k = 0; k < kNumSteps; ++k) {
    EXPECT_TRUE(choice.motions[k].has_value());
    EXPECT_TRUE(std::isinf(choice.margins[k]));
  }
}

// The steps of a rig that goes straight on, of which those in the middle have a
// second hypothesis: their direction without a distance.
Steps StepsWithAFreeDirection(double unexplained) {
  std::vector<StepHypotheses> hypotheses(
      kNumSteps, StepHypotheses{{{Forward(1.0)}, 0.5, 0.5}});
  MotionHypothesis free{{Forward(0.0)}, 0.5, 0.5};
  free.free_direction = Forward(1.0).Center().normalized();
  for (size_t k = 1; k + 1 < kNumSteps; ++k) hypotheses[k].push_back(free);
  Steps steps = MakeRegularSteps(hypotheses);
  steps.compare = [=](size_t, const Rigid3&, const Rigid3&) {
    return MotionExclusion{unexplained, unexplained, 0};
  };
  for (size_t k = 0; k < kNumSteps; ++k) {
    steps.candidates[k] = TryDistances(steps, k);
  }
  return steps;
}

// An object that keeps its distance from step `first` to the next one. Its few
// points leave a turn and a shift open, so that both motions differ.
Steps StepsWithAnObject(size_t first) {
  std::vector<StepHypotheses> hypotheses;
  std::vector<double> durations;
  for (size_t k = 0; k < kNumSteps; ++k) {
    durations.push_back(1.0 + 0.5 * static_cast<double>(k % 2));
    hypotheses.push_back({{{Forward(durations[k])}, 0.8, 0.8}});
  }
  for (const size_t k : {first, first + 1}) {
    const double angle_rad = DegToRad(k == first ? 4.0 : -4.0);
    const Rigid3 of_object{Quaterniond(ExpSO3({0.0, angle_rad, 0.0})),
                           {10.0 * angle_rad, 0.0, 0.0}};
    hypotheses[k].push_back({{of_object}, 0.2, 0.2});
  }
  return MakeSteps(hypotheses, std::move(durations));
}

// Errors do not last, objects do: their matches show them in the next step,
// with the velocity that they have.
TEST(MotionRivalsTest, AnObjectRecursByItsMatches) {
  for (const size_t first : {size_t{0}, size_t{4}, kNumSteps - 2}) {
    Steps steps = StepsWithAnObject(first);
    double exclusion = 0.2;
    steps.compare = [&](size_t k, const Rigid3&, const Rigid3&) {
      return MotionExclusion{k == first ? 0.2 : exclusion, 0.0, 0};
    };
    EXPECT_FALSE(HasRivals(steps, first)) << first;
    const Rigid3 object = steps.candidates[first].back().later_from_earlier;
    const double ratio = steps.durations[first + 1] / steps.durations[first];
    steps.refine = [&](size_t k, const Rigid3& motion) {
      if (k != first + 1) return std::optional<MeasuredMotion>();
      EXPECT_LT(
          (LogSO3(motion.rotation) - ratio * LogSO3(object.rotation)).norm(),
          1e-9);
      return std::optional<MeasuredMotion>({motion});
    };
    EXPECT_TRUE(HasRivals(steps, first)) << first;
    exclusion = 0.1;  // the matches do not tell it from the scene
    EXPECT_FALSE(HasRivals(steps, first)) << first;
  }
}

// Matches that show the motion of the scene, another one, or none, show no
// object.
TEST(MotionRivalsTest, OtherMotionsShowNoObject) {
  Steps steps = StepsWithAnObject(4);
  steps.compare = [](size_t, const Rigid3&, const Rigid3&) {
    return MotionExclusion{0.2, 0.2, 0};
  };
  std::optional<MeasuredMotion> shown;
  steps.refine = [&](size_t, const Rigid3&) { return shown; };
  EXPECT_FALSE(HasRivals(steps, 4));
  for (const Rigid3& motion : {Forward(1.0), Forward(20.0)}) {
    shown = MeasuredMotion{motion};
    EXPECT_FALSE(HasRivals(steps, 4));
  }
}

// An image pair that leaves the distance open explains every motion along its
// direction.
TEST(MotionRivalsTest, AnOpenDistanceShowsNoObject) {
  Steps steps = StepsWithAnObject(4);
  steps.candidates[4].back().later_from_earlier = Forward(3.0);
  MotionHypothesis free{{Forward(0.0)}, 0.8, 0.8};
  free.free_direction = Vector3d::UnitZ();
  steps.candidates[5] = {Candidate{free}};
  steps.compare = [](size_t, const Rigid3&, const Rigid3&) {
    return MotionExclusion{0.2, 0.2, 0};
  };
  steps.refine = [](size_t k, const Rigid3& motion) {
    return k == 5 ? std::optional<MeasuredMotion>({motion}) : std::nullopt;
  };
  EXPECT_FALSE(HasRivals(steps, 4));
  steps.candidates[5] = {Candidate{{{Forward(1.5)}, 0.8, 0.8}}};
  EXPECT_TRUE(HasRivals(steps, 4));
}

// A direction whose matches leave the distance open is no rival of a motion
// along it; one whose matches contradict the distance is.
TEST(MotionSearchTest, AnOpenDistanceIsNoRival) {
  const Mask is_doubtful(kNumSteps, true);
  const MotionChoice open =
      ChooseMotions(StepsWithAFreeDirection(0.0), is_doubtful);
  const MotionChoice contradicted =
      ChooseMotions(StepsWithAFreeDirection(1.0), is_doubtful);
  for (size_t k = 1; k + 1 < kNumSteps; ++k) {
    EXPECT_TRUE(std::isinf(open.margins[k])) << k;
    EXPECT_TRUE(std::isfinite(contradicted.margins[k])) << k;
  }
}

// Only motions that differ and have enough matches are compared.
TEST(MotionCandidatesTest, NearnessIsRelativeToTheFarthestRival) {
  const std::vector<StepHypotheses> hypotheses{
      {{{Forward(1.0)}, 0.4, 0.4, {}, 12.0},
       {{Forward(0.1)}, 0.3, 0.3, {}, 3.0},
       {{Forward(0.5)}, 0.1, 0.1, {}, 50.0},   // few matches
       {{Forward(1.05)}, 0.2, 0.2, {}, 20.0},  // equal to the first
       {{Forward(0.7)}, 0.2, 0.2},             // unknown
       {{Forward(0.0)}, 0.2, 0.2, Vector3d::UnitZ().eval()}}};
  const Steps steps = MakeRegularSteps(hypotheses);
  ASSERT_EQ(steps.candidates[0].size(), 6u);
  const auto nearness = [&](size_t h) {
    return steps.candidates[0][h].nearness;
  };
  EXPECT_EQ(nearness(0), 0.0);
  EXPECT_DOUBLE_EQ(nearness(1), std::log(20.0 / 3.0));
  EXPECT_EQ(nearness(2), 0.0);
  EXPECT_DOUBLE_EQ(nearness(3), 0.0);
  EXPECT_EQ(nearness(4), 0.0);
  // Agrees with all directions, and so with that of the scene.
  ASSERT_TRUE(steps.candidates[0][5].free_direction.has_value());
  EXPECT_EQ(nearness(5), 0.0);
}

// A camera that sees a lorry ahead in a turn has its direction.
TEST(MotionCandidatesTest, PairsAreAsNearAsTheMotionThatTheyAgreeWith) {
  const Rigid3 of_lorry = Rigid3::FromRotationAndCenter(
      ExpSO3({0.0, DegToRad(4.0), 0.0}), {0.0, 0.0, 1.0});
  const std::vector<StepHypotheses> hypotheses{
      {{{Forward(1.0)}, 0.4, 0.4, {}, 12.0},
       {{of_lorry}, 0.4, 0.4, {}, 3.0},
       {{{of_lorry.rotation, Vector3d::Zero()}},
        0.7,
        0.7,
        Vector3d::UnitZ().eval()}}};
  const Steps steps = MakeRegularSteps(hypotheses);
  ASSERT_EQ(steps.candidates[0].size(), 3u);
  EXPECT_DOUBLE_EQ(steps.candidates[0][2].nearness, std::log(12.0 / 3.0));
}

// Two images of a camera, with disjoint errors, and correspondences with depth.
TEST(MotionCandidatesTest, PairsGiveTheRotationAndDepthsTheDistance) {
  const auto turned = [](double angle_deg, double length) {
    return Rigid3::FromRotationAndCenter(
        ExpSO3({0.0, DegToRad(angle_deg), 0.0}), {0.0, 0.0, length});
  };
  const Vector3d left = Vector3d(-0.02, 0.0, 1.0).normalized();
  const Vector3d right = Vector3d(0.02, 0.0, 1.0).normalized();
  const Rigid3 by_depth = turned(0.8, 2.0);
  const std::vector<StepHypotheses> hypotheses{
      {{{by_depth}, 0.4, 0.4},
       {{turned(0.1, 0.0)}, 0.5, 0.5, left},
       {{turned(0.3, 0.0)}, 0.5, 0.5, right}}};
  const Steps steps = MakeRegularSteps(hypotheses);
  ASSERT_EQ(steps.candidates[0].size(), 2u);
  const Candidate& measured = steps.candidates[0][0];
  EXPECT_FALSE(measured.free_direction.has_value());
  EXPECT_LT(AngleBetween(measured.later_from_earlier.rotation,
                         turned(0.2, 2.0).rotation),
            1e-9);
  EXPECT_LT(
      (measured.later_from_earlier.Center() - Vector3d(0.0, 0.0, 2.0)).norm(),
      1e-9);
  EXPECT_DOUBLE_EQ(measured.share, 0.5 * (0.4 + 1.0));
  ASSERT_TRUE(measured.by_depth.has_value());
  EXPECT_LT(AngleBetween(measured.by_depth->later_from_earlier.rotation,
                         by_depth.rotation),
            1e-12);
  const Candidate& group = steps.candidates[0][1];
  ASSERT_TRUE(group.free_direction.has_value());
  EXPECT_LT((*group.free_direction - Vector3d::UnitZ()).norm(), 1e-9);
}

// Image pairs of two cameras and a motion by depth, turned by these angles.
StepHypotheses TurnedMotions(double of_depth_deg, double of_pair_deg) {
  const auto turned = [](double angle_deg, double length) {
    return Rigid3::FromRotationAndCenter(
        ExpSO3({0.0, DegToRad(angle_deg), 0.0}), {0.0, 0.0, length});
  };
  const Vector3d forward = Vector3d::UnitZ();
  return {{{turned(of_depth_deg, 1.0)}, 0.8, 0.8},
          {{turned(0.0, 0.0)}, 0.6, 0.6, forward},
          {{turned(of_pair_deg, 0.0)}, 0.4, 0.4, forward}};
}

// Depths that contradict image pairs in all steps are no evidence, unless image
// pairs contradict each other as much: the rig is then wrong for both.
TEST(MotionCandidatesTest, DepthsThatContradictAllPairsAreNoEvidence) {
  const auto contradict = [](const std::vector<StepHypotheses>& steps) {
    return MakeRegularSteps(steps).noise.depths_contradict_pairs;
  };
  const auto in_all_steps = [&](double of_depth_deg, double of_pair_deg) {
    return contradict(std::vector<StepHypotheses>(
        kNumSteps, TurnedMotions(of_depth_deg, of_pair_deg)));
  };
  EXPECT_TRUE(in_all_steps(6.0, 0.1));
  EXPECT_FALSE(in_all_steps(0.1, 0.1));
  EXPECT_FALSE(in_all_steps(6.0, -8.0));
  // A lorry that two thirds of the steps show has another motion.
  std::vector<StepHypotheses> steps;
  for (size_t k = 0; k < kNumSteps; ++k) {
    steps.push_back(TurnedMotions(k % 3 == 0 ? 0.0 : 6.0, 0.1));
  }
  EXPECT_FALSE(contradict(steps));
}

}  // namespace
}  // namespace mgsfm
