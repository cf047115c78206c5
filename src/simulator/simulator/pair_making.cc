// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/pair_making.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "base/ranges.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "math/random_vector.h"
#include "mgsfm/base/mask.h"
#include "simulator/random_streams.h"

namespace mgsfm {
namespace {

// Baselines below this length have no epipolar geometry.
constexpr double kMinBaseline_m = 1e-9;
// A pair is planar or panoramic if a pure rotation explains this fraction of
// its matches, the default of COLMAP (max_H_inlier_ratio).
constexpr double kPanoramicShare = 0.8;
// Maximum distance of epipolar outliers to the epipolar line.
constexpr double kEpipolarOutlierError_px = 2.0;

bool HasBaseline(const Rigid3& cam2_from_cam1) {
  return cam2_from_cam1.translation.norm() > kMinBaseline_m;
}

Rigid3 WithUnitBaseline(const Rigid3& cam2_from_cam1) {
  if (!HasBaseline(cam2_from_cam1)) return cam2_from_cam1;
  return {cam2_from_cam1.rotation, cam2_from_cam1.translation.normalized()};
}

// The relative pose consistent with the matches: the true one, or for duplicate
// structures that in a world in which the duplicate coincides with its
// original.
Rigid3 PoseOfMatches(const PairPlan& plan, const World& world,
                     const Photographs& photographs) {
  const Rigid3& cam1_from_world =
      photographs.exposures[plan.image1].cam_from_world;
  const Rigid3& cam2_from_world =
      photographs.exposures[plan.image2].cam_from_world;
  if (plan.duplicate < 0) return cam2_from_world * cam1_from_world.Inverse();
  const Rigid3& copy_from_original = world.copy_from_original[plan.duplicate];
  return plan.first_sees_copy
             ? cam2_from_world *
                   (cam1_from_world * copy_from_original).Inverse()
             : cam2_from_world * copy_from_original * cam1_from_world.Inverse();
}

// The key by which an identity is matched; -1 if it is not matched.
int AppearanceOf(const World& world, int identity, int duplicate,
                 bool is_copy) {
  if (duplicate < 0) return identity;
  if (identity >= static_cast<int>(world.points.size())) return -1;
  const WorldPoint& point = world.points[identity];
  const bool is_of_structure =
      point.duplicate == duplicate && point.is_copy == is_copy;
  return is_of_structure ? point.appearance : -1;
}

// Vehicles and duplicate structures look the same on both sides of a weak cut.
bool AreSeenAlike(const PairPlan& plan, const World& world,
                  const WeakCuts& weak_cuts, const Photographs& photographs,
                  int identity) {
  return plan.duplicate >= 0 ||
         identity >= static_cast<int>(world.points.size()) ||
         weak_cuts.AreSeenAlike(photographs.exposures[plan.image1].frame,
                                photographs.exposures[plan.image2].frame,
                                identity);
}

std::vector<Match> Correspondences(const PairPlan& plan, const World& world,
                                   const WeakCuts& weak_cuts,
                                   const Photographs& photographs) {
  const std::vector<int>& ids1 = photographs.features[plan.image1].identities;
  const std::vector<int>& ids2 = photographs.features[plan.image2].identities;
  std::vector<Match> matches;
  for (size_t i = 0, j = 0; i < ids1.size() && j < ids2.size();) {
    if (std::max(ids1[i], ids2[j]) == kClutter) break;
    const int appearance1 =
        AppearanceOf(world, ids1[i], plan.duplicate, plan.first_sees_copy);
    const int appearance2 =
        AppearanceOf(world, ids2[j], plan.duplicate, !plan.first_sees_copy);
    if (appearance1 < 0) {
      ++i;
    } else if (appearance2 < 0) {
      ++j;
    } else if (appearance1 != appearance2) {
      ++(appearance1 < appearance2 ? i : j);
    } else {
      if (AreSeenAlike(plan, world, weak_cuts, photographs, ids1[i])) {
        matches.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(j)});
      }
      ++i;
      ++j;
    }
  }
  return matches;
}

// Each keypoint has at most one match, as with cross-checked matching. Wrong
// matches therefore use keypoints without a correct match.
void AddMismatches(double mismatch_ratio, size_t num_keypoints2, Random random,
                   std::vector<Match>* matches) {
  if (mismatch_ratio == 0.0) return;
  Mask is_taken(num_keypoints2, false);
  std::vector<Match*> mismatches;
  for (Match& match : *matches) {
    const bool is_wrong = random.Uniform() < mismatch_ratio;
    if (is_wrong) mismatches.push_back(&match);
    is_taken[match.keypoint_idx2] = !is_wrong;
  }
  std::vector<uint32_t> pool;
  for (size_t i = 0; i < is_taken.size(); ++i) {
    if (!is_taken[i]) pool.push_back(static_cast<uint32_t>(i));
  }
  for (Match* match : mismatches) {
    const uint32_t size = static_cast<uint32_t>(pool.size());
    uint32_t draw = random.Index(size);
    if (pool[draw] == match->keypoint_idx2) draw = (draw + 1) % size;
    match->keypoint_idx2 = pool[draw];
    pool[draw] = pool.back();
    pool.pop_back();
  }
}

const Eigen::Vector3d& Ray1(const Photographs& photographs, int image,
                            const Match& match) {
  return photographs.features[image].rays[match.keypoint_idx1];
}
const Eigen::Vector3d& Ray2(const Photographs& photographs, int image,
                            const Match& match) {
  return photographs.features[image].rays[match.keypoint_idx2];
}

}  // namespace

std::optional<MadePair> PairMaker::Make(const PairPlan& plan) const {
  std::vector<Match> matches =
      Correspondences(plan, footage_.world, weak_cuts_, footage_.photographs);
  if (static_cast<int>(matches.size()) < footage_.options.min_num_matches) {
    return std::nullopt;
  }
  const bool is_duplicate = plan.duplicate >= 0;
  Random random = RandomOfPair(Effect::kRandomPairs, plan.image1, plan.image2);
  if (!is_duplicate && random.Uniform() < footage_.options.wrong_pair_ratio) {
    return MakeRandomPair(plan, std::move(matches));
  }
  const Rigid3 cam2_from_cam1 =
      PoseOfMatches(plan, footage_.world, footage_.photographs);
  AddMismatches(footage_.options.mismatch_ratio,
                footage_.photographs.features[plan.image2].size(),
                RandomOfPair(Effect::kMismatches, plan.image1, plan.image2),
                &matches);
  MoveAlongEpipolarLines(plan, cam2_from_cam1, &matches);
  return Verify(plan.image1, plan.image2,
                is_duplicate ? PairKind::kDuplicatedStructure : PairKind::kTrue,
                cam2_from_cam1, matches);
}

std::optional<MadePair> PairMaker::Verify(
    int image1, int image2, PairKind kind, const Rigid3& cam2_from_cam1,
    const std::vector<Match>& raw_matches) const {
  Hypothesis best{kind, WithUnitBaseline(cam2_from_cam1), raw_matches};
  if (footage_.options.max_verification_error_px > 0.0) {
    best.inliers = Inliers(best.cam2_from_cam1, image1, image2, raw_matches);
    auto of_vehicle = MotionOfVehicle(image1, image2, raw_matches);
    if (of_vehicle && of_vehicle->inliers.size() > best.inliers.size()) {
      best = std::move(*of_vehicle);
    }
  }
  if (static_cast<int>(best.inliers.size()) <
      footage_.options.min_num_matches) {
    return std::nullopt;
  }
  MadePair made = Finish(image1, image2, std::move(best));
  made.pair.outliers = OutliersOf(raw_matches, made.pair.matches);
  return made;
}

Random PairMaker::RandomOfPair(Effect effect, int image1, int image2) const {
  return RandomOf(footage_.options.random_seed, effect,
                  footage_.photographs.exposures[image1].Key() << 32 |
                      footage_.photographs.exposures[image2].Key());
}

void PairMaker::MoveAlongEpipolarLines(const PairPlan& plan,
                                       const Rigid3& cam2_from_cam1,
                                       std::vector<Match>* matches) const {
  if (footage_.options.epipolar_outlier_ratio == 0.0 ||
      !HasBaseline(cam2_from_cam1)) {
    return;
  }
  Random random =
      RandomOfPair(Effect::kEpipolarOutliers, plan.image1, plan.image2);
  const Rigid3 pose = WithUnitBaseline(cam2_from_cam1);
  const double max_error_rad =
      ErrorInRadians(plan.image1, plan.image2, kEpipolarOutlierError_px);
  const SimulatedFeatures& features1 =
      footage_.photographs.features[plan.image1];
  const SimulatedFeatures& features2 =
      footage_.photographs.features[plan.image2];
  Mask is_taken(features2.size(), false);
  for (const Match& match : *matches) is_taken[match.keypoint_idx2] = true;
  for (Match& match : *matches) {
    if (random.Uniform() >= footage_.options.epipolar_outlier_ratio) continue;
    const Eigen::Vector3d& ray1 = features1.rays[match.keypoint_idx1];
    std::vector<uint32_t> on_line;
    for (size_t i = 0; i < features2.size(); ++i) {
      if (!is_taken[i] && std::abs(SampsonAngle(
                              pose, ray1, features2.rays[i])) < max_error_rad) {
        on_line.push_back(static_cast<uint32_t>(i));
      }
    }
    if (on_line.empty()) continue;
    match.keypoint_idx2 =
        on_line[random.Index(static_cast<uint32_t>(on_line.size()))];
    is_taken[match.keypoint_idx2] = true;
  }
}

// The minimum number of matches, all wrong, with a random relative pose.
std::optional<MadePair> PairMaker::MakeRandomPair(
    const PairPlan& plan, std::vector<Match> matches) const {
  Random random(
      RandomOfPair(Effect::kRandomPairs, plan.image1, plan.image2).NextBits());
  const Eigen::Vector3d turn = NormalVector(&random);
  const Rigid3 cam2_from_cam1{ExpSO3(turn), NormalVector(&random)};
  const size_t num_features2 =
      footage_.photographs.features[plan.image2].size();
  matches.resize(footage_.options.min_num_matches);
  for (Match& match : matches) {
    match.keypoint_idx2 = random.Index(static_cast<uint32_t>(num_features2));
  }
  return Verify(plan.image1, plan.image2, PairKind::kIsolatedWrong,
                cam2_from_cam1, matches);
}

double PairMaker::ErrorInRadians(int image1, int image2,
                                 double error_px) const {
  double inverse_focal = 0.0;
  for (const int image : {image1, image2}) {
    const SimulatedCamera& camera =
        footage_.rig[footage_.photographs.exposures[image].camera];
    inverse_focal += 0.5 / PixelsPerRadian(camera);
  }
  return error_px * inverse_focal;
}

bool PairMaker::Passes(const Rigid3& cam2_from_cam1, int image1, int image2,
                       const Match& match, double max_error_rad) const {
  const Eigen::Vector3d& ray1 = Ray1(footage_.photographs, image1, match);
  const Eigen::Vector3d& ray2 = Ray2(footage_.photographs, image2, match);
  if (!HasBaseline(cam2_from_cam1)) {
    return IsRotationInlier(cam2_from_cam1.rotation, ray1, ray2, max_error_rad);
  }
  return std::abs(SampsonAngle(cam2_from_cam1, ray1, ray2)) < max_error_rad;
}

std::vector<Match> PairMaker::Inliers(const Rigid3& cam2_from_cam1, int image1,
                                      int image2,
                                      const std::vector<Match>& matches) const {
  const double max_error_rad = ErrorInRadians(
      image1, image2, footage_.options.max_verification_error_px);
  std::vector<Match> inliers = matches;
  EraseIf(&inliers, [&](const Match& match) {
    return !Passes(cam2_from_cam1, image1, image2, match, max_error_rad);
  });
  return inliers;
}

// The motion relative to the vehicle with the most matches.
std::optional<PairMaker::Hypothesis> PairMaker::MotionOfVehicle(
    int image1, int image2, const std::vector<Match>& matches) const {
  if (footage_.vehicles == nullptr) return std::nullopt;
  std::map<int, int> num_matches;
  for (const Match& match : matches) {
    const int identity =
        footage_.photographs.features[image1].identities[match.keypoint_idx1];
    const int vehicle = footage_.detector.VehicleOf(identity);
    if (vehicle >= 0) ++num_matches[vehicle];
  }
  int best = -1;
  for (const auto& [vehicle, number] : num_matches) {
    if (number < footage_.options.min_num_matches) continue;
    if (best < 0 || number > num_matches[best]) best = vehicle;
  }
  if (best < 0) return std::nullopt;
  const Exposure& exposure1 = footage_.photographs.exposures[image1];
  const Exposure& exposure2 = footage_.photographs.exposures[image2];
  const Rigid3 pose = WithUnitBaseline(
      exposure2.cam_from_world *
      footage_.vehicles->WorldFromVehicle(best, exposure2.time_s) *
      footage_.vehicles->WorldFromVehicle(best, exposure1.time_s).Inverse() *
      exposure1.cam_from_world.Inverse());
  return Hypothesis{PairKind::kMovingObject, pose,
                    Inliers(pose, image1, image2, matches)};
}

// The estimated relative pose: the hypothesis without noise, otherwise the best
// fit to the inliers.
Rigid3 PairMaker::Estimate(int image1, int image2,
                           const Hypothesis& hypothesis) const {
  Rigid3 pose = hypothesis.cam2_from_cam1;
  const bool is_noisy = footage_.options.pixel_noise_px > 0.0 &&
                        footage_.options.max_verification_error_px > 0.0;
  if (is_noisy) {
    RayMatches rays;
    rays.Reserve(hypothesis.inliers.size());
    for (const Match& match : hypothesis.inliers) {
      rays.Add(Ray1(footage_.photographs, image1, match),
               Ray2(footage_.photographs, image2, match));
    }
    PoseRefinementOptions refinement;
    refinement.loss_scale_rad =
        ErrorInRadians(image1, image2, footage_.options.pixel_noise_px);
    if (HasBaseline(pose)) {
      RefineRelativePose(rays, refinement, &pose);
    } else {
      RefineRotation(rays, refinement, &pose.rotation);
    }
  }
  if (footage_.options.relative_rotation_noise_deg > 0.0) {
    Random random = RandomOfPair(Effect::kPairEstimates, image1, image2);
    const Eigen::Vector3d turn =
        DegToRad(footage_.options.relative_rotation_noise_deg) *
        NormalVector(&random);
    pose.rotation = (pose.rotation * ExpSO3(turn)).normalized();
  }
  return pose;
}

bool PairMaker::IsPanoramic(int image1, int image2,
                            const Hypothesis& hypothesis) const {
  if (footage_.options.max_verification_error_px == 0.0) return false;
  const double max_error_rad = ErrorInRadians(
      image1, image2, footage_.options.max_verification_error_px);
  const auto num_explained =
      CountIf(hypothesis.inliers, [&](const Match& match) {
        return IsRotationInlier(hypothesis.cam2_from_cam1.rotation,
                                Ray1(footage_.photographs, image1, match),
                                Ray2(footage_.photographs, image2, match),
                                max_error_rad);
      });
  return num_explained >= kPanoramicShare * hypothesis.inliers.size();
}

MadePair PairMaker::Finish(int image1, int image2,
                           Hypothesis hypothesis) const {
  const Rigid3 pose = Estimate(image1, image2, hypothesis);
  ImagePair pair;
  pair.image_idx1 = image1;
  pair.image_idx2 = image2;
  pair.config = IsPanoramic(image1, image2, hypothesis)
                    ? TwoViewConfig::kPlanarOrPanoramic
                    : TwoViewConfig::kCalibrated;
  pair.relative_pose = {pose.rotation, std::nullopt};
  if (HasBaseline(pose)) {
    pair.relative_pose->translation_direction = pose.translation;
    pair.E = EssentialFromPose(pose);
  }
  pair.matches = std::move(hypothesis.inliers);
  return {std::move(pair), hypothesis.kind};
}

}  // namespace mgsfm
