// SPDX-License-Identifier: BSD-3-Clause
#include "matching/rig_verification.h"

#include <algorithm>
#include <utility>

#include "geometry/epipolar.h"
#include "geometry/generalized_pose.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// Share of the inliers of a PANORAMIC pair that must agree with the rig motion
// for the pair to stay. Most matches of a true pair agree, few of a false one.
constexpr double kMinRotationInlierRatio = 0.5;
// RANSAC also tries the relative pose of each pair, so few samples suffice.
constexpr int kMaxNumTrials = 1000;

bool IsEligible(const UnitImagePair& pair) {
  return pair.view1.camera->has_prior_focal_length &&
         pair.view2.camera->has_prior_focal_length &&
         pair.single.config != TwoViewConfig::kWatermark;
}

// The matches of an eligible pair whose keypoints have rays; otherwise none.
struct PairRays {
  UnitMatches matches;
  std::vector<size_t> match_idxs;  // of each of these in UnitImagePair::matches
};

PairRays CollectRays(const UnitImagePair& pair, double max_error_px) {
  const Camera& camera1 = *pair.view1.camera;
  const Camera& camera2 = *pair.view2.camera;
  PairRays result{{pair.cam1_from_unit1, pair.cam2_from_unit2, {}, 0.0}, {}};
  result.matches.max_error_rad =
      max_error_px *
      (0.5 / PixelsPerRadian(camera1.model, camera1.params.data()) +
       0.5 / PixelsPerRadian(camera2.model, camera2.params.data()));
  if (!IsEligible(pair)) return result;
  for (size_t i = 0; i < pair.matches->size(); ++i) {
    const auto [idx1, idx2] = (*pair.matches)[i];
    const auto& ray1 = (*pair.view1.rays)[idx1];
    const auto& ray2 = (*pair.view2.rays)[idx2];
    if (!ray1 || !ray2) continue;
    result.matches.rays.Add(*ray1, *ray2);
    result.match_idxs.push_back(i);
  }
  return result;
}

std::optional<Rigid3> EstimateMotion(const std::vector<UnitImagePair>& pairs,
                                     const std::vector<PairRays>& rays,
                                     const TwoViewGeometryOptions& options,
                                     Random* random) {
  std::vector<UnitMatches> matches;
  std::vector<PairPose> guesses;
  for (size_t p = 0; p < pairs.size(); ++p) {
    matches.push_back(rays[p].matches);
    const auto& pose = pairs[p].single.relative_pose;
    if (!IsEligible(pairs[p]) || !pose || !pose->translation_direction) {
      continue;
    }
    guesses.push_back(
        {p, {pose->cam2_from_cam1, *pose->translation_direction}});
  }
  RansacOptions ransac;
  ransac.confidence = options.confidence;
  ransac.max_num_trials = std::min(*options.max_num_trials, kMaxNumTrials);
  return EstimateUnitPose(matches, guesses, ransac, random);
}

// Indices into UnitImagePair::matches.
std::vector<size_t> FindMatchInliers(const PairRays& rays,
                                     const Rigid3& motion) {
  const Mask is_inlier = FindUnitInliers(rays.matches, motion);
  std::vector<size_t> inliers;
  for (size_t i = 0; i < is_inlier.size(); ++i) {
    if (is_inlier[i]) inliers.push_back(rays.match_idxs[i]);
  }
  return inliers;
}

bool Supports(const UnitImagePair& pair, size_t num_inliers,
              const TwoViewGeometryOptions& two_view,
              const RigVerificationOptions& rig) {
  return num_inliers >= static_cast<size_t>(rig.min_num_unit_inliers) &&
         static_cast<double>(num_inliers) >=
             two_view.min_inlier_ratio * pair.matches->size();
}

bool IsAccepted(const std::vector<UnitImagePair>& pairs,
                const std::vector<std::vector<size_t>>& inliers,
                const TwoViewGeometryOptions& two_view,
                const RigVerificationOptions& rig) {
  size_t num_pairs = 0, num_inliers = 0;
  for (size_t p = 0; p < pairs.size(); ++p) {
    if (!Supports(pairs[p], inliers[p].size(), two_view, rig)) continue;
    ++num_pairs;
    num_inliers += inliers[p].size();
  }
  return num_pairs >= 2 &&
         num_inliers >= static_cast<size_t>(two_view.min_num_inliers);
}

// The new geometry of a pair under an accepted motion; nullopt: unchanged.
std::optional<ImagePair> ApplyMotion(const UnitImagePair& pair,
                                     const Rigid3& motion,
                                     const std::vector<size_t>& inliers,
                                     bool supports) {
  const ImagePair& single = pair.single;
  if (single.config == TwoViewConfig::kPanoramic &&
      inliers.size() >= kMinRotationInlierRatio * single.matches.size()) {
    return std::nullopt;
  }
  ImagePair result;
  result.config = TwoViewConfig::kDegenerate;
  if (!supports) {
    if (single.matches.empty()) return std::nullopt;
    return result;
  }
  Rigid3 pose = pair.cam2_from_unit2 * motion * pair.cam1_from_unit1.Inverse();
  const double length = pose.translation.norm();
  if (!(length > 0.0)) return std::nullopt;
  pose.translation /= length;
  result.config = TwoViewConfig::kCalibrated;
  result.relative_pose = RelativePose{pose.rotation, pose.translation};
  result.E = EssentialFromPose(pose);
  for (const size_t i : inliers) result.matches.push_back((*pair.matches)[i]);
  return result;
}

}  // namespace

std::vector<std::optional<ImagePair>> VerifyUnits(
    const std::vector<UnitImagePair>& pairs,
    const std::optional<Rigid3>& unit2_from_unit1,
    const TwoViewGeometryOptions& two_view, const RigVerificationOptions& rig,
    Random random) {
  std::vector<std::optional<ImagePair>> results(pairs.size());
  std::vector<PairRays> rays;
  for (const UnitImagePair& pair : pairs) {
    rays.push_back(CollectRays(pair, two_view.max_error));
  }
  const std::optional<Rigid3> motion =
      unit2_from_unit1 ? unit2_from_unit1
                       : EstimateMotion(pairs, rays, two_view, &random);
  if (!motion) return results;
  std::vector<std::vector<size_t>> inliers;
  for (const PairRays& pair_rays : rays) {
    inliers.push_back(FindMatchInliers(pair_rays, *motion));
  }
  if (!IsAccepted(pairs, inliers, two_view, rig)) return results;
  for (size_t p = 0; p < pairs.size(); ++p) {
    if (!IsEligible(pairs[p])) continue;
    results[p] =
        ApplyMotion(pairs[p], *motion, inliers[p],
                    Supports(pairs[p], inliers[p].size(), two_view, rig));
  }
  return results;
}

}  // namespace mgsfm
