// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/rig_motions.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "base/ranges.h"
#include "geometry/absolute_pose.h"
#include "geometry/epipolar.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// The static scene, one vehicle and one more object. With one or six, mean
// errors change by at most 2 % (docs/results/constants.md).
constexpr size_t kMaxNumMotions = 3;
// Share of the correspondences of a motion that no motion before it explains.
// Half or twice the value changes mean errors by at most 2 %
// (docs/results/constants.md).
constexpr double kMinOwnShare = 0.05;
// A smaller remainder consists of mismatches and depth errors: on recorded
// drives without vehicles, the first motion leaves a tenth.
constexpr double kMinRemainingShare = 0.1;
// Finds a motion that 30 % of the correspondences support with a probability of
// 0.9997.
constexpr int kMaxNumTrials = 300;
// Bounds of the refinement before its last round, in units of max_error_px. An
// interpolated motion is wrong by about a degree.
constexpr double kRefinementBounds[] = {8.0, 4.0, 2.0, 1.0};
// Depths agree within a factor of 1.5, however certain both are.
const double kLogDepthTolerance = std::log(1.5);

// The points of the keypoints of image 1 of a pair and their rays in image 2,
// or vice versa.
CameraPoints CorrespondencesOf(const FrameMatches& input, const ImagePair& pair,
                               const std::vector<Match>& matches,
                               bool is_reversed, double max_error_px) {
  const Scene& scene = input.scene;
  const FrameDepths& depths = input.depths;
  const int from = is_reversed ? pair.image_idx2 : pair.image_idx1;
  const int to = is_reversed ? pair.image_idx1 : pair.image_idx2;
  const auto& source_from_rig =
      depths.cam_from_rig[scene.images[from].sensor_idx];
  const auto& cam_from_rig = depths.cam_from_rig[scene.images[to].sensor_idx];
  CameraPoints points;
  if (!cam_from_rig || !source_from_rig) return points;
  points.cam_from_unit = *cam_from_rig;
  points.max_error_rad = ErrorRad(scene, to, max_error_px);
  const Rigid3 rig_from_source = source_from_rig->Inverse();
  for (const Match& match : matches) {
    int source = static_cast<int>(match.keypoint_idx1);
    int target = static_cast<int>(match.keypoint_idx2);
    if (is_reversed) std::swap(source, target);
    const KeypointDepth* depth = depths.Find(from, source);
    if (depth == nullptr || !input.bearings.HasRay(to, target)) continue;
    const Vector3d in_source =
        depth->distance * input.bearings.Ray(from, source);
    points.points.push_back(rig_from_source * in_source);
    points.rays.push_back(input.bearings.Ray(to, target));
    points.depth_sigmas.emplace_back(depth->relative_sigma *
                                     (rig_from_source.rotation * in_source));
  }
  return points;
}

size_t CountRays(const std::vector<CameraPoints>& cameras) {
  size_t num_rays = 0;
  for (const CameraPoints& camera : cameras) num_rays += camera.size();
  return num_rays;
}

// The points of one frame and their rays in the other one, first those of
// verified matches.
struct Correspondences {
  std::vector<CameraPoints> cameras;
  bool has_later_points = false;
  size_t num_verified = 0;

  // The pose determined by correspondences is the pose of the other frame.
  Rigid3 ToMotion(const Rigid3& pose) const {
    return has_later_points ? pose.Inverse() : pose;
  }
};

Correspondences Collect(const FrameMatches& input, bool has_later_points,
                        double max_error_px) {
  Correspondences collected{{}, has_later_points};
  const auto collect = [&](std::vector<Match> ImagePair::*matches) {
    for (const size_t i : input.pair_idxs) {
      const ImagePair& pair = input.view_graph.pairs[i];
      const bool is_first_earlier =
          input.scene.images[pair.image_idx1].frame_idx ==
          input.earlier_frame_idx;
      CameraPoints points =
          CorrespondencesOf(input, pair, pair.*matches,
                            is_first_earlier == has_later_points, max_error_px);
      if (points.size() > 0) collected.cameras.push_back(std::move(points));
    }
  };
  collect(&ImagePair::matches);
  collected.num_verified = CountRays(collected.cameras);
  collect(&ImagePair::outliers);
  return collected;
}

// The correspondences with the points of the frame that has more of them.
Correspondences CollectMost(const FrameMatches& input, double max_error_px) {
  Correspondences earlier = Collect(input, false, max_error_px);
  Correspondences later = Collect(input, true, max_error_px);
  return CountRays(later.cameras) > CountRays(earlier.cameras)
             ? std::move(later)
             : std::move(earlier);
}

// Keeps the rays that agree with a pose within a bound, or only the others.
void KeepRays(const Rigid3& unit_from_world, double bound, bool keep_agreeing,
              std::vector<CameraPoints>* cameras) {
  const std::vector<double> errors =
      AbsolutePoseErrors(*cameras, unit_from_world);
  size_t k = 0;
  for (CameraPoints& camera : *cameras) {
    size_t num_kept = 0;
    for (size_t i = 0; i < camera.size(); ++i, ++k) {
      if ((errors[k] <= bound) != keep_agreeing) continue;
      camera.rays[num_kept] = camera.rays[i];
      camera.depth_sigmas[num_kept] = camera.depth_sigmas[i];
      camera.points[num_kept++] = camera.points[i];
    }
    camera.rays.resize(num_kept);
    camera.points.resize(num_kept);
    camera.depth_sigmas.resize(num_kept);
  }
}

// The motion of a pose, with the noise implied by the median error of its
// inliers.
MeasuredMotion MeasureMotion(const Correspondences& all, const Rigid3& pose) {
  std::vector<CameraPoints> inliers = all.cameras;
  KeepRays(pose, 1.0, /*keep_agreeing=*/true, &inliers);
  const double sigma =
      std::max(RobustSigma<2>(AbsolutePoseErrors(inliers, pose)),
               std::numeric_limits<double>::epsilon());
  return MeasuredMotionOf(pose, AbsolutePoseCovariance(inliers, sigma, pose),
                          all.has_later_points);
}

double MedianDistance(const std::vector<Vector3d>& points,
                      const Vector3d& center) {
  return Median(Transformed(
      points, [&](const Vector3d& point) { return (point - center).norm(); }));
}

// Per motion, the errors of all correspondences.
using MotionErrors = std::vector<std::vector<double>>;

// Outliers of verification that agree with no motion are mismatches.
void CountShares(const Correspondences& all, const MotionErrors& errors,
                 StepHypotheses* motions) {
  const size_t num_all = CountRays(all.cameras);
  std::vector<size_t> num_agreeing(motions->size(), 0);
  std::vector<size_t> num_own(motions->size(), 0);
  size_t num_explained = all.num_verified;
  for (size_t k = 0; k < num_all; ++k) {
    bool is_explained = false;
    for (size_t h = 0; h < motions->size(); ++h) {
      if (errors[h][k] > 1.0) continue;
      ++num_agreeing[h];
      num_own[h] += is_explained ? 0 : 1;
      is_explained = true;
    }
    num_explained += is_explained && k >= all.num_verified ? 1 : 0;
  }
  const auto share = [num_explained](size_t number) {
    return static_cast<double>(number) / static_cast<double>(num_explained);
  };
  for (size_t h = 0; h < motions->size(); ++h) {
    (*motions)[h].share = share(num_agreeing[h]);
    (*motions)[h].own_share = share(num_own[h]);
  }
}

// Measures the reach of each motion by the points that agree with it alone.
void MeasureReach(const Correspondences& all, const MotionErrors& errors,
                  StepHypotheses* motions) {
  if (motions->size() < 2) return;
  const std::vector<Vector3d> points =
      Concatenated(Transformed(all.cameras, &CameraPoints::points));
  for (size_t h = 0; h < motions->size(); ++h) {
    std::vector<Vector3d> own;
    for (size_t k = 0; k < points.size(); ++k) {
      const auto num_agreeing = CountIf(
          errors, [k](const auto& errors_of) { return errors_of[k] <= 1.0; });
      if (errors[h][k] <= 1.0 && num_agreeing == 1) own.push_back(points[k]);
    }
    if (own.size() < kMinNumAgreeing) continue;
    const double reach =
        std::sqrt(MedianDistance(own, Vector3d::Zero()) *
                  MedianDistance(own, MedianOfCoordinates(own)));
    if (reach > 0.0) (*motions)[h].reach = reach;
  }
}

// Without a baseline, the rays must coincide.
bool IsOnEpipolarLine(const Rigid3& cam2_from_cam1, const Vector3d& ray1,
                      const Vector3d& ray2, double tolerance_rad) {
  const double length = cam2_from_cam1.translation.norm();
  if (length == 0.0) {
    return IsRotationInlier(cam2_from_cam1.rotation, ray1, ray2, tolerance_rad);
  }
  return IsInlier(
      {cam2_from_cam1.rotation, cam2_from_cam1.translation / length}, ray1,
      ray2, tolerance_rad);
}

bool AgreesWithDepth(const Rigid3& b_from_a, const Vector3d& ray_a,
                     const Vector3d& ray_b, const KeypointDepth& depth_a,
                     double tolerance_rad) {
  const auto& [distance_a, relative_sigma] = depth_a;
  const Vector3d turned = b_from_a.rotation * ray_a;
  const Vector3d& t = b_from_a.translation;
  if (IsRayInlier(distance_a * turned + t, relative_sigma * distance_a * turned,
                  ray_b, tolerance_rad)) {
    return true;
  }
  // The distance to the intersection, from the areas of two triangles.
  const double area_by_baseline = t.cross(ray_b).norm();
  const double area = turned.cross(ray_b).norm();
  return area_by_baseline > 0.0 && area > 0.0 &&
         std::abs(std::log(area_by_baseline / area / distance_a)) <
             kLogDepthTolerance;
}

}  // namespace

double ErrorRad(const Scene& scene, int image_idx, double error_px) {
  return error_px /
         PixelsPerRadian(scene.cameras[scene.images[image_idx].camera_idx]);
}

StepHypotheses FindRigMotions(const FrameMatches& matches, double max_error_px,
                              Random random) {
  const Correspondences all = CollectMost(matches, max_error_px);
  const auto num_verified = static_cast<double>(all.num_verified);
  RansacOptions ransac;
  ransac.max_num_trials = kMaxNumTrials;
  StepHypotheses motions;
  MotionErrors errors;
  std::vector<CameraPoints> remaining = all.cameras;
  while (motions.size() < kMaxNumMotions &&
         static_cast<double>(CountRays(remaining)) >=
             std::max<double>(kMinNumAgreeing,
                              kMinRemainingShare * num_verified)) {
    const auto pose = EstimateAbsolutePose(remaining, ransac, &random);
    if (!pose) break;
    const int num_own = ScoreAbsolutePose(remaining, *pose).num_inliers;
    if (num_own < static_cast<int>(kMinNumAgreeing) ||
        num_own < kMinOwnShare * num_verified) {
      break;
    }
    motions.push_back({MeasureMotion(all, *pose)});
    errors.push_back(AbsolutePoseErrors(all.cameras, *pose));
    KeepRays(*pose, 1.0, /*keep_agreeing=*/false, &remaining);
  }
  CountShares(all, errors, &motions);
  MeasureReach(all, errors, &motions);
  return motions;
}

std::optional<MeasuredMotion> RefineRigMotion(
    const FrameMatches& matches, double max_error_px,
    const Rigid3& later_from_earlier) {
  const Correspondences all = CollectMost(matches, max_error_px);
  Rigid3 pose = all.ToMotion(later_from_earlier);
  const auto refine = [&](double bound, auto&& minimize) {
    std::vector<CameraPoints> near = all.cameras;
    KeepRays(pose, bound, /*keep_agreeing=*/true, &near);
    if (CountRays(near) < kMinNumAgreeing) return false;
    minimize(near, kInlierLossScale * bound, &pose);
    return true;
  };
  for (const double bound : kRefinementBounds) {
    if (!refine(bound, ImproveAbsolutePose)) return std::nullopt;
  }
  if (!refine(1.0, RefineAbsolutePose)) return std::nullopt;
  if (ScoreAbsolutePose(all.cameras, pose).num_inliers <
      static_cast<int>(kMinNumAgreeing)) {
    return std::nullopt;
  }
  return MeasureMotion(all, pose);
}

MatchVerdict CompareWithMotion(const Bearings& bearings,
                               const FrameDepths& depths, const ImagePair& pair,
                               const Match& match, const Rigid3& cam2_from_cam1,
                               double tolerance_rad) {
  const auto k1 = static_cast<int>(match.keypoint_idx1);
  const auto k2 = static_cast<int>(match.keypoint_idx2);
  if (!bearings.HasRay(pair.image_idx1, k1) ||
      !bearings.HasRay(pair.image_idx2, k2)) {
    return MatchVerdict::kContradicts;
  }
  const Vector3d& ray1 = bearings.Ray(pair.image_idx1, k1);
  const Vector3d& ray2 = bearings.Ray(pair.image_idx2, k2);
  if (!IsOnEpipolarLine(cam2_from_cam1, ray1, ray2, tolerance_rad)) {
    return MatchVerdict::kContradicts;
  }
  const KeypointDepth* depth1 = depths.Find(pair.image_idx1, k1);
  const KeypointDepth* depth2 = depths.Find(pair.image_idx2, k2);
  if ((depth1 &&
       !AgreesWithDepth(cam2_from_cam1, ray1, ray2, *depth1, tolerance_rad)) ||
      (depth2 && !AgreesWithDepth(cam2_from_cam1.Inverse(), ray2, ray1, *depth2,
                                  tolerance_rad))) {
    return MatchVerdict::kContradicts;
  }
  return depth1 || depth2 ? MatchVerdict::kAgrees
                          : MatchVerdict::kIsOnEpipolarLine;
}

}  // namespace mgsfm
