// SPDX-License-Identifier: BSD-3-Clause
#include "view_graph/pair_estimation.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "geometry/epipolar.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm::internal {
namespace {

// Matches within this multiple of the maximum error refine the initial pose: at
// a match, the error of the pose adds to that of the match. Half and twice the
// value increase errors by 4 and 2 % (docs/results/constants.md).
constexpr double kRelaxation = 2.0;
// Fundamental matrices fit distorted pixels, so that their poses are off by
// more than the maximum error: by 12 px at a default of 4 px.
constexpr double kRelaxationOfDistortion = 3.0;
// Scales of the loss relative to the maximum error: initially
// (docs/results/constants.md compares half and twice the value), and the lower
// bound for exact (simulated) matches.
constexpr double kInitialLossScale = 0.25;
// Maximum ratio of the median errors of rotation and pose. It is 1.7 without
// parallax: the ratio of the medians of the norm of two normal variables (1.18)
// and of one (0.67). A larger ratio means that parallax biases the rotation.
constexpr double kMaxMedianRatio = 2.5;
// A rotation and a direction have five unknowns.
constexpr size_t kMinNumMatchesOfPose = 5;

bool IsSet(const std::optional<Eigen::Matrix3d>& matrix) {
  return matrix && matrix->allFinite() && matrix->norm() > 0.0;
}

PoseRefinementOptions FirstRefinement(double max_error_rad) {
  PoseRefinementOptions refinement;
  // Most pairs converge in fewer iterations.
  refinement.max_num_iterations = 15;
  refinement.loss_scale_rad = kInitialLossScale * max_error_rad;
  refinement.relative_cost_tolerance = 1e-2;
  return refinement;
}

// The pinhole camera at the center of a lens.
Eigen::Matrix3d CentralMatrix(const Camera& camera) {
  const CameraModelInfo& info = InfoOf(camera.model);
  Eigen::Matrix3d K = Eigen::Matrix3d::Identity();
  for (int k = 0; k < 2; ++k) {
    const std::vector<int>& focal = info.focal_length_idxs;
    if (!focal.empty()) {
      K(k, k) = camera.params[k == 0 ? focal.front() : focal.back()];
    }
    if (info.principal_point_idxs.size() == 2) {
      K(k, 2) = camera.params[info.principal_point_idxs[k]];
    }
  }
  return K;
}

Rigid3 ToRigid3(const RelativePose& pose) {
  return {pose.cam2_from_cam1, *pose.translation_direction};
}

RelativePose ToRelativePose(const Rigid3& cam2_from_cam1) {
  const double norm = cam2_from_cam1.translation.norm();
  if (norm == 0.0) return {cam2_from_cam1.rotation, std::nullopt};
  return {cam2_from_cam1.rotation, cam2_from_cam1.translation / norm};
}

double MedianError(const RayMatches& matches, const Rigid3& pose) {
  return Median(SampsonAngles(matches, pose));
}

double MedianRotationError(const RayMatches& matches,
                           const Eigen::Quaterniond& rotation) {
  std::vector<double> errors(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    errors[i] = (rotation * matches.rays1[i] - matches.rays2[i]).norm() *
                std::sqrt(0.5);
  }
  return Median(std::move(errors));
}

PoseScore Score(const RayMatches& matches, const RelativePose& pose,
                double max_error) {
  return pose.translation_direction
             ? ScoreRelativePose(matches, ToRigid3(pose), max_error)
             : ScoreRotation(matches, pose.cam2_from_cam1, max_error);
}

Mask InliersOf(const RayMatches& matches, const RelativePose& pose,
               double max_error) {
  return pose.translation_direction
             ? FindInliers(matches, ToRigid3(pose), max_error)
             : FindRotationInliers(matches, pose.cam2_from_cam1, max_error);
}

// The pose; without a direction, the direction is estimated from the inliers.
Rigid3 WithDirection(const RelativePose& pose, const RayMatches& inliers,
                     double max_error) {
  if (pose.translation_direction) return ToRigid3(pose);
  const Eigen::Quaterniond& rotation = pose.cam2_from_cam1;
  const Rigid3 forward{rotation, FitDirection(inliers, rotation)};
  const Rigid3 backward{rotation, -forward.translation};
  return ScoreRelativePose(inliers, forward, max_error).cost <=
                 ScoreRelativePose(inliers, backward, max_error).cost
             ? forward
             : backward;
}

// The matches of a pair whose keypoints have rays.
struct MatchedRays {
  RayMatches rays;
  std::vector<size_t> match_idxs;  // in pair.matches
};

MatchedRays GatherRays(const ImagePair& pair, const Bearings& bearings) {
  MatchedRays result;
  result.rays.Reserve(pair.matches.size());
  result.match_idxs.reserve(pair.matches.size());
  for (size_t i = 0; i < pair.matches.size(); ++i) {
    const int keypoint1 = static_cast<int>(pair.matches[i].keypoint_idx1);
    const int keypoint2 = static_cast<int>(pair.matches[i].keypoint_idx2);
    if (!bearings.HasRay(pair.image_idx1, keypoint1) ||
        !bearings.HasRay(pair.image_idx2, keypoint2)) {
      continue;
    }
    result.rays.Add(bearings.Ray(pair.image_idx1, keypoint1),
                    bearings.Ray(pair.image_idx2, keypoint2));
    result.match_idxs.push_back(i);
  }
  return result;
}

PairEstimate Dropped() {
  return {PairOutcome::kDroppedFewInliers, {}, 0.0, {}};
}

class PairEstimator {
 public:
  PairEstimator(const Scene& scene, const Bearings& bearings,
                const ImagePair& pair, const ViewGraphOptions& options)
      : pair_(pair),
        options_(options),
        camera1_(scene.cameras[scene.images[pair.image_idx1].camera_idx]),
        camera2_(scene.cameras[scene.images[pair.image_idx2].camera_idx]),
        radians_per_pixel_(0.5 / PixelsPerRadian(camera1_) +
                           0.5 / PixelsPerRadian(camera2_)),
        max_error_(options.max_error_px * radians_per_pixel_),
        matched_(GatherRays(pair, bearings)) {}

  PairEstimate Estimate(Random* random) {
    TryViewGraphPoses();
    if (!HasEnoughInliers(RequiredInitialInlierRatio())) Reestimate(random);
    if (!HasEnoughInliers(options_.min_inlier_ratio)) return Dropped();
    const std::optional<Refined> refined = Refine(pose_);
    if (!refined) return Dropped();
    PairEstimate estimate = Result(*refined);
    const std::optional<Rigid3> twin =
        PlanarTwin(refined->inliers, refined->pose, max_error_);
    if (!estimate.IsKept() || !twin) return estimate;
    const std::optional<Refined> refined_twin = Refine(ToRelativePose(*twin));
    if (!refined_twin) return estimate;
    PairEstimate other = Result(*refined_twin);
    if (!other.IsKept()) return estimate;
    if (other.cost < estimate.cost) std::swap(estimate, other);
    if (ExplainsAlmostAll(other, estimate)) {
      estimate.twin = std::move(other.pair);
    }
    return estimate;
  }

 private:
  void Try(const RelativePose& pose, PairOutcome source) {
    const PoseScore score = Score(matched_.rays, pose, max_error_);
    if (score.cost < score_.cost) {
      pose_ = pose;
      score_ = score;
      source_ = source;
    }
  }

  void TryEssential(const Eigen::Matrix3d& essential) {
    for (const Rigid3& pose : DecomposeEssential(essential)) {
      Try(ToRelativePose(pose), PairOutcome::kDecomposed);
    }
  }

  // Estimated lenses change, so pairs have no pose of their own. For most
  // pairs, the fundamental matrix provides a start without sampling.
  void TryDistorted() {
    const bool is_estimated =
        !camera1_.has_prior_focal_length || !camera2_.has_prior_focal_length;
    if (!is_estimated || pair_.relative_pose || !IsSet(pair_.F)) return;
    const double max_error = kRelaxationOfDistortion * max_error_;
    std::optional<Rigid3> best;
    double least = std::numeric_limits<double>::infinity();
    for (const Rigid3& pose :
         DecomposeEssential(CentralMatrix(camera2_).transpose() * *pair_.F *
                            CentralMatrix(camera1_))) {
      const double cost =
          ScoreRelativePose(matched_.rays, pose, max_error).cost;
      if (cost >= least) continue;
      least = cost;
      best = pose;
    }
    if (!best) return;
    RefineRelativePose(matched_.rays, FirstRefinement(max_error), &*best);
    Try(ToRelativePose(*best), PairOutcome::kDecomposed);
    is_of_distorted_ = true;
  }

  // Scores all poses given by the geometry in the view graph.
  void TryViewGraphPoses() {
    if (pair_.relative_pose) Try(*pair_.relative_pose, PairOutcome::kFromRow);
    if (IsSet(pair_.E)) TryEssential(*pair_.E);
    const auto K1 = CalibrationMatrix(camera1_);
    const auto K2 = CalibrationMatrix(camera2_);
    if (!K1 || !K2) {
      TryDistorted();
      return;
    }
    if (IsSet(pair_.F)) TryEssential(K2->transpose() * *pair_.F * *K1);
    if (IsSet(pair_.H)) {
      // A homography is a rotation if its singular values differ by at most
      // this ratio.
      for (const PlanarMotion& motion :
           DecomposeHomography(K2->inverse() * *pair_.H * *K1, 1e-4)) {
        Try(ToRelativePose(motion.cam2_from_cam1), PairOutcome::kDecomposed);
      }
    }
  }

  // A rotation must explain almost all matches; otherwise the pair may have a
  // translation. The same holds for a pose from the fundamental matrix of
  // distorted pixels, which may be a local minimum.
  double RequiredInitialInlierRatio() const {
    return pose_.translation_direction && !is_of_distorted_
               ? options_.min_row_inlier_ratio
               : 1.0 - options_.min_parallax_ratio;
  }

  bool HasEnoughInliers(double ratio) const {
    return HasEnoughInliers(score_, ratio);
  }
  bool HasEnoughInliers(const PoseScore& score, double ratio) const {
    return score.num_inliers >= options_.min_num_inliers &&
           score.num_inliers >= ratio * matched_.rays.size();
  }

  // A pure rotation is tried first: it needs few trials, and if it explains the
  // pair, five-point samples are degenerate.
  void Reestimate(Random* random) {
    RansacOptions ransac;
    ransac.max_error_rad = max_error_;
    // A sample of two inliers at an inlier ratio of 0.2 is found with
    // probability 1 - (1 - 0.2^2)^200 = 0.9997.
    ransac.max_num_trials = std::min(options_.max_num_trials, 200);
    if (const auto rotation = EstimateRotation(matched_.rays, ransac, random)) {
      Try({*rotation, std::nullopt}, PairOutcome::kReestimated);
    }
    if (HasEnoughInliers(RequiredInitialInlierRatio())) return;
    ransac.max_num_trials = options_.max_num_trials;
    if (const auto pose = EstimateRelativePose(matched_.rays, ransac, random)) {
      Try(ToRelativePose(*pose), PairOutcome::kReestimated);
    }
  }

  // A pose and the matches that refined it.
  struct Refined {
    Rigid3 pose;
    RayMatches inliers;
    PoseRefinementOptions refinement;
  };

  // nullopt if fewer matches agree than a pose needs.
  std::optional<Refined> Refine(const RelativePose& start) const {
    RayMatches inliers;
    inliers.Reserve(matched_.rays.size());
    const Mask is_inlier =
        InliersOf(matched_.rays, start, kRelaxation * max_error_);
    for (size_t i = 0; i < matched_.rays.size(); ++i) {
      if (is_inlier[i]) {
        inliers.Add(matched_.rays.rays1[i], matched_.rays.rays2[i]);
      }
    }
    if (inliers.size() < kMinNumMatchesOfPose) return std::nullopt;
    Rigid3 pose = WithDirection(start, inliers, max_error_);
    PoseRefinementOptions refinement = FirstRefinement(max_error_);
    RefineRelativePose(inliers, refinement, &pose);
    // Actual errors are often far below the threshold.
    refinement.loss_scale_rad = std::max(
        options_.loss_scale * MedianError(inliers, pose), 1e-3 * max_error_);
    refinement.relative_cost_tolerance = 1e-5;
    RefineRelativePose(inliers, refinement, &pose);
    return Refined{pose, std::move(inliers), refinement};
  }

  // Whether the rotation explains almost all inliers of the pose.
  bool HasLowParallax(const Rigid3& pose,
                      const Eigen::Quaterniond& rotation) const {
    const double min_parallax = options_.min_parallax_px * radians_per_pixel_;
    const Mask is_inlier = FindInliers(matched_.rays, pose, max_error_);
    const Eigen::Matrix3d R = rotation.toRotationMatrix();
    int num_inliers = 0, num_with_parallax = 0;
    for (size_t i = 0; i < matched_.rays.size(); ++i) {
      if (!is_inlier[i]) continue;
      const Eigen::Vector3d a = R * matched_.rays.rays1[i];
      ++num_inliers;
      num_with_parallax += (a - matched_.rays.rays2[i]).squaredNorm() >
                           min_parallax * min_parallax;
    }
    return num_with_parallax <= options_.min_parallax_ratio * num_inliers;
  }

  // Fits a rotation without translation to the same matches, and decides which
  // of them the matches support.
  PairEstimate Result(const Refined& refined) const {
    const auto& [refined_pose, inliers, refinement] = refined;
    Eigen::Quaterniond rotation = refined_pose.rotation;
    RefineRotation(inliers, refinement, &rotation);
    RelativePose pose = ToRelativePose(refined_pose);
    const bool has_direction = !HasLowParallax(refined_pose, rotation);
    if (!has_direction &&
        MedianRotationError(inliers, rotation) <=
            kMaxMedianRatio * MedianError(inliers, refined_pose)) {
      pose = {rotation, std::nullopt};
    }

    const PoseScore score = Score(matched_.rays, pose, max_error_);
    if (!HasEnoughInliers(score, options_.min_inlier_ratio)) return Dropped();
    PairEstimate result{source_, {}, score.cost, {}};
    result.pair.image_idx1 = pair_.image_idx1;
    result.pair.image_idx2 = pair_.image_idx2;
    result.pair.config = pair_.config;
    result.pair.relative_pose = pose;
    if (!has_direction) {
      result.pair.relative_pose->translation_direction.reset();
    }
    result.pair.matches.reserve(score.num_inliers);
    const Mask is_inlier = InliersOf(matched_.rays, pose, max_error_);
    for (size_t i = 0; i < matched_.rays.size(); ++i) {
      if (is_inlier[i]) {
        result.pair.matches.push_back(pair_.matches[matched_.match_idxs[i]]);
      }
    }
    return result;
  }

  bool ExplainsAlmostAll(const PairEstimate& estimate,
                         const PairEstimate& other) const {
    return static_cast<double>(estimate.pair.matches.size()) >=
           (1.0 - options_.min_parallax_ratio) *
               static_cast<double>(other.pair.matches.size());
  }

  const ImagePair& pair_;
  const ViewGraphOptions& options_;
  const Camera& camera1_;
  const Camera& camera2_;
  const double radians_per_pixel_;
  const double max_error_;  // in radians
  const MatchedRays matched_;
  RelativePose pose_{Eigen::Quaterniond::Identity(), std::nullopt};
  PoseScore score_{std::numeric_limits<double>::infinity(), 0};
  PairOutcome source_ = PairOutcome::kReestimated;
  bool is_of_distorted_ = false;
};

}  // namespace

std::optional<Eigen::Matrix3d> CalibrationMatrix(const Camera& camera) {
  const std::vector<double>& p = camera.params;
  Eigen::Matrix3d K = Eigen::Matrix3d::Identity();
  if (camera.model == CameraModelId::kSimplePinhole) {
    K(0, 0) = K(1, 1) = p[0];
    K.topRightCorner<2, 1>() << p[1], p[2];
  } else if (camera.model == CameraModelId::kPinhole) {
    K(0, 0) = p[0];
    K(1, 1) = p[1];
    K.topRightCorner<2, 1>() << p[2], p[3];
  } else {
    return std::nullopt;
  }
  return K;
}

PairEstimate EstimatePair(const Scene& scene, const Bearings& bearings,
                          const ImagePair& pair,
                          const ViewGraphOptions& options, Random random) {
  if (pair.config == TwoViewConfig::kDegenerate ||
      pair.config == TwoViewConfig::kWatermark) {
    return {PairOutcome::kDroppedConfig, {}, 0.0, {}};
  }
  return PairEstimator(scene, bearings, pair, options).Estimate(&random);
}

}  // namespace mgsfm::internal
