// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/matching/rig_verification.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "geometry/epipolar.h"
#include "geometry/generalized_pose.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// Of the matches that agree with the rotation of a panoramic pair.
constexpr double kMinShareOfRotation = 0.5;
constexpr int kMaxNumTrials = 1000;

bool TakesPart(const UnitImagePair& pair) {
  return pair.view1.camera->has_prior_focal_length &&
         pair.view2.camera->has_prior_focal_length &&
         pair.single.config != TwoViewConfig::kWatermark;
}

class UnitVerifier {
 public:
  UnitVerifier(std::vector<UnitImagePair> pairs,
               const TwoViewGeometryOptions& two_view,
               const RigVerificationOptions& rig)
      : pairs_(std::move(pairs)), two_view_(two_view), rig_(rig) {
    results_.resize(pairs_.size());
    for (const UnitImagePair& pair : pairs_) Gather(pair);
  }

  void Verify(const std::optional<Rigid3>& known, Random* random) {
    const std::optional<Rigid3> motion = known ? known : Estimate(random);
    if (!motion) return;
    std::vector<std::vector<size_t>> inliers;
    for (size_t p = 0; p < pairs_.size(); ++p) {
      inliers.push_back(Inliers(p, *motion));
    }
    if (!Counts(inliers)) return;
    for (size_t p = 0; p < pairs_.size(); ++p) {
      if (TakesPart(pairs_[p])) Judge(p, *motion, inliers[p]);
    }
  }

  std::vector<std::optional<ImagePair>> Results() {
    return std::move(results_);
  }

 private:
  void Gather(const UnitImagePair& pair) {
    UnitMatches matches{pair.cam1_from_unit1, pair.cam2_from_unit2, {}, 0.0};
    const Camera& camera1 = *pair.view1.camera;
    const Camera& camera2 = *pair.view2.camera;
    matches.max_error_rad =
        two_view_.max_error *
        (0.5 / PixelsPerRadian(camera1.model, camera1.params.data()) +
         0.5 / PixelsPerRadian(camera2.model, camera2.params.data()));
    std::vector<size_t> positions;
    for (size_t i = 0; TakesPart(pair) && i < pair.matches->size(); ++i) {
      const auto [idx1, idx2] = (*pair.matches)[i];
      if (!pair.view1.rays->is_valid[idx1] ||
          !pair.view2.rays->is_valid[idx2]) {
        continue;
      }
      matches.rays.Add(pair.view1.rays->rays[idx1],
                       pair.view2.rays->rays[idx2]);
      positions.push_back(i);
    }
    matches_.push_back(std::move(matches));
    positions_.push_back(std::move(positions));
  }

  std::optional<Rigid3> Estimate(Random* random) const {
    std::vector<PairPose> guesses;
    for (size_t p = 0; p < pairs_.size(); ++p) {
      const auto& pose = pairs_[p].single.relative_pose;
      if (!TakesPart(pairs_[p]) || !pose || !pose->translation_direction) {
        continue;
      }
      guesses.push_back(
          {p, {pose->cam2_from_cam1, *pose->translation_direction}});
    }
    RansacOptions ransac;
    ransac.confidence = two_view_.confidence;
    ransac.max_num_trials = std::min(two_view_.max_num_trials, kMaxNumTrials);
    return EstimateUnitPose(matches_, guesses, ransac, random);
  }

  // Positions among the matches of the pair.
  std::vector<size_t> Inliers(size_t p, const Rigid3& motion) const {
    const Mask is_inlier = FindUnitInliers(matches_[p], motion);
    std::vector<size_t> inliers;
    for (size_t i = 0; i < is_inlier.size(); ++i) {
      if (is_inlier[i]) inliers.push_back(positions_[p][i]);
    }
    return inliers;
  }

  bool Agrees(size_t p, size_t num_inliers) const {
    return num_inliers >= static_cast<size_t>(rig_.min_num_unit_inliers) &&
           static_cast<double>(num_inliers) >=
               two_view_.min_inlier_ratio * pairs_[p].matches->size();
  }

  bool Counts(const std::vector<std::vector<size_t>>& inliers) const {
    size_t num_pairs = 0, num_inliers = 0;
    for (size_t p = 0; p < pairs_.size(); ++p) {
      if (!Agrees(p, inliers[p].size())) continue;
      ++num_pairs;
      num_inliers += inliers[p].size();
    }
    return num_pairs >= 2 &&
           num_inliers >= static_cast<size_t>(two_view_.min_num_inliers);
  }

  void Judge(size_t p, const Rigid3& motion,
             const std::vector<size_t>& inliers) {
    const UnitImagePair& pair = pairs_[p];
    const ImagePair& single = pair.single;
    if (single.config == TwoViewConfig::kPanoramic &&
        inliers.size() >= kMinShareOfRotation * single.matches.size()) {
      return;
    }
    ImagePair result;
    result.config = TwoViewConfig::kDegenerate;
    if (!Agrees(p, inliers.size())) {
      if (!single.matches.empty()) results_[p] = std::move(result);
      return;
    }
    Rigid3 pose =
        pair.cam2_from_unit2 * motion * pair.cam1_from_unit1.Inverse();
    const double length = pose.translation.norm();
    if (!(length > 0.0)) return;
    pose.translation /= length;
    result.config = TwoViewConfig::kCalibrated;
    result.relative_pose = RelativePose{pose.rotation, pose.translation};
    result.E = EssentialFromPose(pose);
    for (const size_t i : inliers) result.matches.push_back((*pair.matches)[i]);
    results_[p] = std::move(result);
  }

  std::vector<UnitImagePair> pairs_;
  const TwoViewGeometryOptions& two_view_;
  const RigVerificationOptions& rig_;
  std::vector<UnitMatches> matches_;               // of each pair
  std::vector<std::vector<size_t>> positions_;     // of them in its matches
  std::vector<std::optional<ImagePair>> results_;  // where they change
};

}  // namespace

std::vector<std::optional<ImagePair>> VerifyUnits(
    std::vector<UnitImagePair> pairs,
    const std::optional<Rigid3>& unit2_from_unit1,
    const TwoViewGeometryOptions& two_view, const RigVerificationOptions& rig,
    Random random) {
  UnitVerifier verifier(std::move(pairs), two_view, rig);
  verifier.Verify(unit2_from_unit1, &random);
  return verifier.Results();
}

}  // namespace mgsfm
