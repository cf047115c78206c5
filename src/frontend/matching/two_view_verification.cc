// SPDX-License-Identifier: BSD-3-Clause
#include "matching/two_view_verification.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "base/ranges.h"
#include "geometry/epipolar.h"
#include "matching/ray_models.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// A sample of two inliers at an inlier ratio of 0.2 is found with probability
// 1 - (1 - 0.2^2)^200 = 0.9997.
constexpr int kMaxNumRotationTrials = 200;
// Minimum ratio of rotation inliers to homography inliers of a PANORAMIC pair.
// Without parallax, it is at least 1 up to noise, because the tolerance of
// rotations is sqrt(2) times larger. docs/results/constants.md compares 0.8 to
// 1.
constexpr double kMinRotationRatio = 0.95;
// Refinement of the pose on its inliers stops early: it decides which matches
// are inliers, and the mapper refines the pose again.
constexpr int kNumRefinementIterations = 10;
constexpr double kRefinementCostTolerance = 1e-4;
// Number of inliers on which a homography is estimated. The standard error of
// an inlier ratio of 0.8 from 256 samples is 0.025.
constexpr size_t kMaxNumHomographyMatches = 256;

bool IsPinhole(const Camera& camera) {
  return camera.model == CameraModelId::kSimplePinhole ||
         camera.model == CameraModelId::kPinhole;
}

// A pinhole with moderate distortion, for which F in pixels nearly holds.
bool IsPerspective(const Camera& camera) {
  return Contains(
      std::array{CameraModelId::kSimplePinhole, CameraModelId::kPinhole,
                 CameraModelId::kSimpleRadial, CameraModelId::kRadial,
                 CameraModelId::kOpenCV, CameraModelId::kFullOpenCV},
      camera.model);
}

}  // namespace

Eigen::Matrix3d LinearPart(const Camera& camera) {
  Eigen::Matrix3d K = Eigen::Matrix3d::Identity();
  if (!IsPerspective(camera)) return K;
  const CameraModelInfo& info = InfoOf(camera.model);
  K(0, 0) = camera.params[info.focal_length_idxs.front()];
  K(1, 1) = camera.params[info.focal_length_idxs.back()];
  K(0, 2) = camera.params[info.principal_point_idxs.front()];
  K(1, 2) = camera.params[info.principal_point_idxs.back()];
  return K;
}

Eigen::Vector3d LinearRay(const Eigen::Matrix3d& inverse_K,
                          const Eigen::Vector2f& keypoint_px) {
  return (inverse_K * keypoint_px.cast<double>().homogeneous()).normalized();
}

namespace {

// Conversion from rays, f2^T F f1 = 0 and f2 ~ H f1, to pixels.
Eigen::Matrix3d FundamentalInPixels(const Eigen::Matrix3d& F,
                                    const Eigen::Matrix3d& K1,
                                    const Eigen::Matrix3d& K2) {
  return (K2.inverse().transpose() * F * K1.inverse()).normalized();
}
Eigen::Matrix3d HomographyInPixels(const Eigen::Matrix3d& H,
                                   const Eigen::Matrix3d& K1,
                                   const Eigen::Matrix3d& K2) {
  return (K2 * H * K1.inverse()).normalized();
}

bool IsCalibrated(const Camera& camera1, const Camera& camera2) {
  const bool is_trusted =
      camera1.has_prior_focal_length && camera2.has_prior_focal_length;
  return is_trusted || !IsPerspective(camera1) || !IsPerspective(camera2);
}

bool IsRotationEnough(const std::vector<size_t>& rotation_inliers,
                      const std::vector<size_t>& homography_inliers) {
  return rotation_inliers.size() >=
         kMinRotationRatio * homography_inliers.size();
}

// The rays of a pair's matches, and those that agree with a model.
struct MatchedRays {
  RayMatches rays;
  std::vector<size_t> match_idxs;  // of the rays among all matches
  double max_error_rad = 0.0;

  template <class Test>
  std::vector<size_t> Inliers(const Test& is_inlier) const {
    std::vector<size_t> inliers;
    for (size_t i = 0; i < rays.size(); ++i) {
      if (is_inlier(rays.rays1[i], rays.rays2[i])) inliers.push_back(i);
    }
    return inliers;
  }

  std::vector<size_t> InliersOf(const Rigid3& pose) const {
    return Inliers([&](const auto& ray1, const auto& ray2) {
      return IsInlier(pose, ray1, ray2, max_error_rad);
    });
  }

  std::vector<size_t> InliersOf(const Eigen::Quaterniond& rotation) const {
    return Inliers([&](const auto& ray1, const auto& ray2) {
      return IsRotationInlier(rotation, ray1, ray2, max_error_rad);
    });
  }

  RayMatches Select(const std::vector<size_t>& inliers) const {
    RayMatches selected;
    selected.Reserve(inliers.size());
    for (const size_t i : inliers) selected.Add(rays.rays1[i], rays.rays2[i]);
    return selected;
  }
};

// Uncalibrated: rays that ignore distortion. Calibrated: only matches whose
// keypoints both have a ray.
MatchedRays GatherRays(const VerificationView& view1,
                       const VerificationView& view2,
                       const std::vector<Match>& matches, double max_error_rad,
                       bool is_calibrated) {
  const Eigen::Matrix3d inverse_K1 = LinearPart(*view1.camera).inverse();
  const Eigen::Matrix3d inverse_K2 = LinearPart(*view2.camera).inverse();
  MatchedRays result;
  result.max_error_rad = max_error_rad;
  result.rays.Reserve(matches.size());
  result.match_idxs.reserve(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    const auto [idx1, idx2] = matches[i];
    if (!is_calibrated) {
      result.rays.Add(LinearRay(inverse_K1, (*view1.keypoints_px)[idx1]),
                      LinearRay(inverse_K2, (*view2.keypoints_px)[idx2]));
    } else if ((*view1.rays)[idx1] && (*view2.rays)[idx2]) {
      result.rays.Add(*(*view1.rays)[idx1], *(*view2.rays)[idx2]);
    } else {
      continue;
    }
    result.match_idxs.push_back(i);
  }
  return result;
}

// Refines the pose on its inliers; keeps the result if it has as many.
void RefinePose(const MatchedRays& rays, Rigid3* pose,
                std::vector<size_t>* inliers) {
  PoseRefinementOptions refinement;
  refinement.loss_scale_rad = 0.25 * rays.max_error_rad;
  refinement.max_num_iterations = kNumRefinementIterations;
  refinement.relative_cost_tolerance = kRefinementCostTolerance;
  Rigid3 refined = *pose;
  if (!RefineRelativePose(rays.Select(*inliers), refinement, &refined)
           .IsUsable()) {
    return;
  }
  std::vector<size_t> refined_inliers = rays.InliersOf(refined);
  if (refined_inliers.size() < inliers->size()) return;
  *pose = refined;
  *inliers = std::move(refined_inliers);
}

class PairVerifier {
 public:
  PairVerifier(const VerificationView& view1, const VerificationView& view2,
               const std::vector<Match>& matches,
               const TwoViewGeometryOptions& options, Random* random)
      : view1_(view1),
        view2_(view2),
        matches_(matches),
        options_(options),
        random_(random),
        K1_(LinearPart(*view1.camera)),
        K2_(LinearPart(*view2.camera)),
        is_calibrated_(IsCalibrated(*view1.camera, *view2.camera)),
        rays_(GatherRays(
            view1, view2, matches,
            options.max_error * RadiansPerPixel(*view1.camera, *view2.camera),
            is_calibrated_)) {
    ransac_.max_error_rad = rays_.max_error_rad;
    ransac_.confidence = options.confidence;
  }

  ImagePair Verify() {
    pair_.config = TwoViewConfig::kDegenerate;
    if (HasEnough(rays_.rays.size())) {
      LimitTrials();
      is_calibrated_ ? VerifyCalibrated() : VerifyUncalibrated();
    }
    if (pair_.config != TwoViewConfig::kDegenerate &&
        options_.detect_watermark &&
        IsWatermark(view1_, view2_, pair_.matches, options_, random_)) {
      pair_.config = TwoViewConfig::kWatermark;
    }
    return std::move(pair_);
  }

 private:
  bool HasEnough(size_t num_inliers) const {
    return num_inliers >= static_cast<size_t>(options_.min_num_inliers) &&
           num_inliers >= options_.min_inlier_ratio * matches_.size();
  }

  // Pairs with a smaller inlier ratio are rejected anyway.
  void LimitTrials() {
    const double num_matches = static_cast<double>(matches_.size());
    const double min_ratio_of_matches =
        std::max(*options_.min_inlier_ratio,
                 options_.min_num_inliers / std::max(1.0, num_matches));
    const double min_ratio =
        std::min(1.0, min_ratio_of_matches * num_matches /
                          static_cast<double>(rays_.rays.size()));
    const int sample_size = is_calibrated_ ? 5 : 7;
    ransac_.max_num_trials = options_.max_num_trials;
    ransac_.max_num_trials = RequiredNumTrials(ransac_, min_ratio, sample_size);
  }

  void Accept(TwoViewConfig config, const std::vector<size_t>& inliers) {
    pair_.config = config;
    pair_.matches.reserve(inliers.size());
    for (const size_t i : inliers) {
      pair_.matches.push_back(matches_[rays_.match_idxs[i]]);
    }
  }

  std::optional<Eigen::Quaterniond> EstimateRotationOnly() {
    RansacOptions ransac = ransac_;
    ransac.max_num_trials =
        std::min(ransac_.max_num_trials, kMaxNumRotationTrials);
    return EstimateRotation(rays_.rays, ransac, random_);
  }

  // The homography is estimated on inliers only, so few trials find one with
  // the required ratio.
  std::vector<size_t> InliersOfHomography(const std::vector<size_t>& inliers,
                                          std::optional<Eigen::Matrix3d>* H) {
    RansacOptions ransac = ransac_;
    ransac.max_num_trials =
        RequiredNumTrials(ransac_, options_.max_H_inlier_ratio, 4);
    *H = EstimateHomography(
        rays_.Select(EvenlySpaced(inliers, kMaxNumHomographyMatches)), ransac,
        random_);
    if (!*H) return {};
    const HomographyTest test(**H);
    return rays_.Inliers([&](const auto& ray1, const auto& ray2) {
      return test.SquaredError(ray1, ray2) <=
             rays_.max_error_rad * rays_.max_error_rad;
    });
  }

  bool Explains(const std::vector<size_t>& homography_inliers,
                const std::vector<size_t>& inliers) const {
    return homography_inliers.size() >
           options_.max_H_inlier_ratio * inliers.size();
  }

  void VerifyCalibrated() {
    std::vector<size_t> inliers;
    auto pose = EstimateRelativePose(rays_.rays, ransac_, random_);
    if (pose) {
      inliers = rays_.InliersOf(*pose);
      RefinePose(rays_, &*pose, &inliers);
    }
    // Without parallax, five-point samples are degenerate.
    std::optional<Eigen::Quaterniond> rotation;
    if (!HasEnough(inliers.size())) {
      rotation = EstimateRotationOnly();
      if (!rotation) return;
      pose.reset();
      inliers = rays_.InliersOf(*rotation);
      if (!HasEnough(inliers.size())) return;
    }
    std::optional<Eigen::Matrix3d> H;
    const std::vector<size_t> homography_inliers =
        InliersOfHomography(inliers, &H);
    const bool has_homography = Explains(homography_inliers, inliers);
    if (has_homography && !rotation) rotation = EstimateRotationOnly();
    if (rotation && (!pose || IsRotationEnough(rays_.InliersOf(*rotation),
                                               homography_inliers))) {
      Accept(TwoViewConfig::kPanoramic, inliers);
      pair_.relative_pose = RelativePose{*rotation, std::nullopt};
    } else {
      Accept(
          has_homography ? TwoViewConfig::kPlanar : TwoViewConfig::kCalibrated,
          inliers);
      pair_.relative_pose = RelativePose{pose->rotation, pose->translation};
      pair_.E = EssentialFromPose(*pose);
    }
    if (!IsPinhole(*view1_.camera) || !IsPinhole(*view2_.camera)) return;
    if (pair_.E) pair_.F = FundamentalInPixels(*pair_.E, K1_, K2_);
    if (has_homography) pair_.H = HomographyInPixels(*H, K1_, K2_);
  }

  void VerifyUncalibrated() {
    const auto F = EstimateFundamental(rays_.rays, ransac_, random_);
    std::vector<size_t> inliers;
    if (F) {
      inliers = rays_.Inliers([&](const auto& ray1, const auto& ray2) {
        return IsFundamentalInlier(*F, ray1, ray2, rays_.max_error_rad);
      });
    }
    if (!HasEnough(inliers.size())) return;
    std::optional<Eigen::Matrix3d> H;
    const std::vector<size_t> homography_inliers =
        InliersOfHomography(inliers, &H);
    const bool has_homography = Explains(homography_inliers, inliers);
    Accept(has_homography ? TwoViewConfig::kPlanarOrPanoramic
                          : TwoViewConfig::kUncalibrated,
           inliers);
    pair_.F = FundamentalInPixels(*F, K1_, K2_);
    if (has_homography) pair_.H = HomographyInPixels(*H, K1_, K2_);
  }

  const VerificationView& view1_;
  const VerificationView& view2_;
  const std::vector<Match>& matches_;
  const TwoViewGeometryOptions& options_;
  Random* random_;
  const Eigen::Matrix3d K1_;
  const Eigen::Matrix3d K2_;
  const bool is_calibrated_;
  const MatchedRays rays_;
  RansacOptions ransac_;
  ImagePair pair_;
};

}  // namespace

double RadiansPerPixel(const Camera& camera1, const Camera& camera2) {
  return 0.5 / PixelsPerRadian(camera1) + 0.5 / PixelsPerRadian(camera2);
}

ImagePair VerifyPair(const VerificationView& view1,
                     const VerificationView& view2,
                     const std::vector<Match>& matches,
                     const TwoViewGeometryOptions& options, Random random) {
  return PairVerifier(view1, view2, matches, options, &random).Verify();
}

namespace {

// At the default ratio of 0.7, all 20 samples are outliers with probability
// 0.3^20 < 1e-10.
constexpr int kNumTrials = 20;

bool IsInBorder(const Camera& camera, const Eigen::Vector2f& point,
                double border_size) {
  const double width = camera.width_px, height = camera.height_px;
  const double border = border_size * std::hypot(width, height);
  return point.x() < border || point.y() < border ||
         point.x() > width - border || point.y() > height - border;
}

}  // namespace

bool IsWatermark(const VerificationView& view1, const VerificationView& view2,
                 const std::vector<Match>& inliers,
                 const TwoViewGeometryOptions& options, Random* random) {
  std::vector<Eigen::Vector2f> shifts;
  for (const Match& match : inliers) {
    const Eigen::Vector2f& point1 = (*view1.keypoints_px)[match.keypoint_idx1];
    const Eigen::Vector2f& point2 = (*view2.keypoints_px)[match.keypoint_idx2];
    if (IsInBorder(*view1.camera, point1, options.watermark_border_size) &&
        IsInBorder(*view2.camera, point2, options.watermark_border_size)) {
      shifts.emplace_back(point2 - point1);
    }
  }
  const double min_num_shifts =
      options.watermark_min_inlier_ratio * static_cast<double>(inliers.size());
  if (shifts.empty() || static_cast<double>(shifts.size()) < min_num_shifts) {
    return false;
  }
  for (int trial = 0; trial < kNumTrials; ++trial) {
    const Eigen::Vector2f shift =
        shifts[random->Index(static_cast<uint32_t>(shifts.size()))];
    const auto num_alike = CountIf(shifts, [&](const Eigen::Vector2f& other) {
      return (other - shift).norm() <= options.max_error;
    });
    if (static_cast<double>(num_alike) >= min_num_shifts) return true;
  }
  return false;
}

}  // namespace mgsfm
