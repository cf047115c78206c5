// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "frontend/matching/simulated_pair.h"
#include "geometry/so3.h"
#include "matching/frame_pair_verification.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

// Rig motion between two frames, in meters.
const Rigid3 kMotion{ExpSO3({0.01, -0.06, 0.01}), {0.1, 0.02, -1.4}};

// A pair of images of one or two cameras.
struct SimulatedUnitPair {
  int camera1 = 0;
  int camera2 = 0;
  Rigid3 motion = kMotion;  // rig motion of the matches
  PairSimulationOptions matches;
};

// Two frames of a rig with the matches of some image pairs.
class Units {
 public:
  Units(RigPreset preset, const std::vector<SimulatedUnitPair>& pairs,
        uint64_t seed)
      : rig_(MakeRig(preset)), specs_(pairs) {
    Random random(seed);
    for (const SimulatedUnitPair& spec : pairs)
      pairs_.push_back(Make(spec, &random));
  }

  std::vector<ImagePair> Single() const {
    std::vector<ImagePair> results;
    for (const SimulatedPair& pair : pairs_) {
      results.push_back(VerifyPair(pair.view1.View(), pair.view2.View(),
                                   pair.matches, {}, Random(1)));
    }
    return results;
  }

  std::vector<ImagePair> Together(
      const std::optional<Rigid3>& motion = std::nullopt) const {
    const std::vector<ImagePair> single = Single();
    std::vector<UnitImagePair> unit;
    for (size_t p = 0; p < pairs_.size(); ++p) {
      unit.push_back({pairs_[p].view1.View(), pairs_[p].view2.View(),
                      rig_[specs_[p].camera1].sensor_from_rig,
                      rig_[specs_[p].camera2].sensor_from_rig,
                      &pairs_[p].matches, single[p]});
    }
    std::vector<ImagePair> results = single;
    const auto changed = VerifyUnits(unit, motion, {}, {}, Random(2));
    for (size_t p = 0; p < results.size(); ++p) {
      if (changed[p]) results[p] = *changed[p];
    }
    return results;
  }

  size_t CountTrue(size_t p, const ImagePair& verified) const {
    return std::count_if(verified.matches.begin(), verified.matches.end(),
                         [&](const Match& match) {
                           return match.keypoint_idx1 < pairs_[p].num_true;
                         });
  }

  double RotationErrorDeg(size_t p, const ImagePair& verified) const {
    const Rigid3 truth = CameraMotion(specs_[p], kMotion);
    return RadToDeg(
        AngleBetween(verified.relative_pose->cam2_from_cam1, truth.rotation));
  }

 private:
  Rigid3 CameraMotion(const SimulatedUnitPair& spec,
                      const Rigid3& motion) const {
    return rig_[spec.camera2].sensor_from_rig * motion *
           rig_[spec.camera1].sensor_from_rig.Inverse();
  }

  SimulatedPair Make(const SimulatedUnitPair& spec, Random* random) const {
    const SimulatedCamera& camera1 = rig_[spec.camera1];
    const SimulatedCamera& camera2 = rig_[spec.camera2];
    // Both cameras of these pairs have the same model.
    const Camera camera = MakeCamera(camera1.model, camera1.width_px,
                                     camera1.height_px, camera1.params);
    EXPECT_EQ(camera1.params, camera2.params);
    return SimulatePair(camera, CameraMotion(spec, spec.motion), spec.matches,
                        random, [](Random* r) {
                          return Eigen::Vector3d(r->Uniform(-8.0, 8.0),
                                                 r->Uniform(-3.0, 3.0),
                                                 r->Uniform(4.0, 20.0));
                        });
  }

  std::vector<SimulatedCamera> rig_;
  std::vector<SimulatedUnitPair> specs_;
  std::vector<SimulatedPair> pairs_;
};

constexpr size_t kLeft = 0, kRight = 1, kSideLeft = 2, kSideRight = 3;
const PairSimulationOptions kMany{80, 40, 0.5};
const PairSimulationOptions kFew{11, 9, 0.5};
const PairSimulationOptions kNone{0, 25, 0.5};

bool IsVerified(const ImagePair& pair) { return !pair.matches.empty(); }

TEST(RigVerification, UnitKeepsPairsWithFewMatches) {
  for (const RigPreset preset : {RigPreset::kKitti360, RigPreset::kStereo}) {
    std::vector<SimulatedUnitPair> pairs = {{kLeft, kLeft, kMotion, kMany},
                                            {kRight, kRight, kMotion, kFew},
                                            {kLeft, kRight, kMotion, kFew},
                                            {kRight, kLeft, kMotion, kNone}};
    if (preset == RigPreset::kKitti360) {
      pairs.push_back({kSideLeft, kSideLeft, kMotion, kFew});
      pairs.push_back({kSideRight, kSideRight, kMotion, kNone});
    }
    for (uint64_t seed = 1; seed <= 3; ++seed) {
      const Units units(preset, pairs, seed);
      const auto single = units.Single(), together = units.Together();
      for (size_t p = 0; p < pairs.size(); ++p) {
        const size_t num_true = pairs[p].matches.num_true;
        EXPECT_EQ(IsVerified(single[p]), num_true == kMany.num_true);
        EXPECT_EQ(IsVerified(together[p]), num_true > 0) << p;
        if (!IsVerified(together[p])) continue;
        EXPECT_GE(units.CountTrue(p, together[p]), num_true - 2);
        EXPECT_LT(units.RotationErrorDeg(p, together[p]), 0.3);
        EXPECT_TRUE(together[p].relative_pose->translation_direction);
      }
    }
  }
}

// No pair has enough matches on its own.
TEST(RigVerification, UnitVerifiesWherePairsCannot) {
  const PairSimulationOptions few{13, 7, 0.5};
  const std::vector<SimulatedUnitPair> pairs = {
      {kLeft, kLeft, kMotion, few},
      {kRight, kRight, kMotion, few},
      {kSideLeft, kSideLeft, kMotion, few},
      {kSideRight, kSideRight, kMotion, few}};
  const Units units(RigPreset::kKitti360, pairs, 4);
  const auto single = units.Single(), together = units.Together();
  for (size_t p = 0; p < pairs.size(); ++p) {
    EXPECT_FALSE(IsVerified(single[p]));
    EXPECT_GE(units.CountTrue(p, together[p]), 11u);
    EXPECT_LT(units.RotationErrorDeg(p, together[p]), 1.0);
  }
}

// Matches of a moving object or a duplicate structure are consistent with a
// different motion.
TEST(RigVerification, UnitRejectsPairsThatContradictIt) {
  const Rigid3 other{ExpSO3({0.0, 0.1, 0.0}), {1.0, 0.0, 0.3}};
  const std::vector<SimulatedUnitPair> stereo = {
      {kLeft, kLeft, kMotion, {60, 20, 0.5}},
      {kRight, kRight, other, {50, 20, 0.5}},
      {kLeft, kRight, kMotion, {40, 20, 0.5}},
      {kRight, kLeft, kMotion, kFew}};
  const std::vector<SimulatedUnitPair> kitti360 = {
      {kLeft, kLeft, kMotion, {40, 20, 0.5}},
      {kRight, kRight, kMotion, {30, 20, 0.5}},
      {kSideLeft, kSideLeft, other, {60, 20, 0.5}},
      {kSideRight, kSideRight, kMotion, {40, 20, 0.5}}};
  for (const auto& [preset, pairs] :
       {std::make_pair(RigPreset::kStereo, stereo),
        std::make_pair(RigPreset::kKitti360, kitti360)}) {
    for (uint64_t seed = 1; seed <= 3; ++seed) {
      const Units units(preset, pairs, seed);
      const auto single = units.Single(), together = units.Together();
      for (size_t p = 0; p < pairs.size(); ++p) {
        const bool is_wrong =
            pairs[p].motion.translation != kMotion.translation;
        EXPECT_TRUE(IsVerified(single[p]) || !is_wrong);
        EXPECT_EQ(IsVerified(together[p]), !is_wrong) << p;
      }
    }
  }
}

// A single supporting pair is not enough to accept a motion.
TEST(RigVerification, SinglePairIsNoUnit) {
  const std::vector<SimulatedUnitPair> pairs = {
      {kLeft, kLeft, kMotion, kMany},
      {kRight, kRight, kMotion, kNone},
      {kLeft, kRight, kMotion, kNone}};
  const Units units(RigPreset::kStereo, pairs, 5);
  const auto single = units.Single(), together = units.Together();
  for (size_t p = 0; p < pairs.size(); ++p) {
    EXPECT_EQ(together[p].config, single[p].config);
    EXPECT_EQ(together[p].matches.size(), single[p].matches.size());
  }
}

TEST(RigVerification, KnownMotionIsNotEstimated) {
  const std::vector<SimulatedUnitPair> pairs = {
      {kLeft, kLeft, kMotion, kFew}, {kRight, kRight, kMotion, kFew}};
  const Units units(RigPreset::kStereo, pairs, 6);
  const auto right = units.Together(kMotion);
  EXPECT_TRUE(IsVerified(right[0]) && IsVerified(right[1]));
  const auto wrong =
      units.Together(Rigid3{ExpSO3({0.0, 0.1, 0.0}), {1.0, 0.0, 0.3}});
  EXPECT_FALSE(IsVerified(wrong[0]) || IsVerified(wrong[1]));
}

}  // namespace
}  // namespace mgsfm
