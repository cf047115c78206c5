// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/rig_motions.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "base/parallel.h"
#include "base/random.h"
#include "geometry/absolute_pose.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "moving_objects/motion_candidates.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using FramePair = FramePairIndex::FramePair;

// The static scene, one vehicle and one more object. With one or six, mean
// errors change by at most 2 % (docs/results/constants.md).
constexpr size_t kMaxNumMotions = 3;
// Three matches determine a motion. Each of the others agrees by chance with a
// probability of about 1e-3.
constexpr size_t kMinNumAgreeing = 8;
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
// Loss scale relative to the bound, as in RANSAC (geometry/absolute_pose.h).
constexpr double kRefinementLossScale = 0.5;
// Depths agree within a factor of 1.5, however certain both are.
const double kLogDepthTolerance = std::log(1.5);

// The points of the keypoints of image 1 of a pair and their rays in image 2,
// or vice versa.
CameraPoints CorrespondencesOf(const FrameMatches& input, const ImagePair& pair,
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
  for (const Match& match : pair.matches) {
    int source = static_cast<int>(match.keypoint_idx1);
    int target = static_cast<int>(match.keypoint_idx2);
    if (is_reversed) std::swap(source, target);
    if (!depths.IsKnown(from, source) || !input.bearings.HasRay(to, target)) {
      continue;
    }
    const Vector3d in_source =
        *depths.distances[from][source] * input.bearings.Ray(from, source);
    points.points.push_back(rig_from_source * in_source);
    points.rays.push_back(input.bearings.Ray(to, target));
    points.depth_sigmas.emplace_back(depths.RelativeSigma(from, source) *
                                     (rig_from_source.rotation * in_source));
  }
  return points;
}

size_t CountRays(const std::vector<CameraPoints>& cameras) {
  size_t num_rays = 0;
  for (const CameraPoints& camera : cameras) num_rays += camera.size();
  return num_rays;
}

// The points of one frame and their rays in the other one.
struct Correspondences {
  std::vector<CameraPoints> cameras;
  bool has_later_points = false;

  // The pose determined by correspondences is the pose of the other frame.
  Rigid3 ToMotion(const Rigid3& pose) const {
    return has_later_points ? pose.Inverse() : pose;
  }
};

Correspondences Collect(const FrameMatches& input, bool has_later_points,
                        double max_error_px) {
  Correspondences collected{{}, has_later_points};
  for (const size_t i : input.pair_idxs) {
    const ImagePair& pair = input.view_graph.pairs[i];
    const bool is_first_earlier =
        input.scene.images[pair.image_idx1].frame_idx ==
        input.earlier_frame_idx;
    CameraPoints points = CorrespondencesOf(
        input, pair, is_first_earlier == has_later_points, max_error_px);
    if (points.size() > 0) collected.cameras.push_back(std::move(points));
  }
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
  std::vector<double> distances;
  for (const Vector3d& point : points) {
    distances.push_back((point - center).norm());
  }
  return Median(std::move(distances));
}

// Measures the reach of each motion by the points that agree with it alone.
void MeasureReach(const Correspondences& all, StepHypotheses* motions) {
  if (motions->size() < 2) return;
  std::vector<Vector3d> points;
  for (const CameraPoints& camera : all.cameras) {
    points.insert(points.end(), camera.points.begin(), camera.points.end());
  }
  std::vector<std::vector<double>> errors;
  for (const MotionHypothesis& motion : *motions) {
    errors.push_back(AbsolutePoseErrors(
        all.cameras, all.ToMotion(motion.later_from_earlier)));
  }
  for (size_t h = 0; h < motions->size(); ++h) {
    std::vector<Vector3d> own;
    for (size_t k = 0; k < points.size(); ++k) {
      const auto num_agreeing = std::count_if(
          errors.begin(), errors.end(),
          [k](const auto& errors_of) { return errors_of[k] <= 1.0; });
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
                     const Vector3d& ray_b, double distance_a,
                     double relative_sigma, double tolerance_rad) {
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

// The matches that agree with either of two motions.
struct AgreementCounts {
  size_t num_both = 0, num_only1 = 0, num_only2 = 0;

  void Add(bool agrees1, bool agrees2) {
    num_both += agrees1 && agrees2 ? 1 : 0;
    num_only1 += agrees1 && !agrees2 ? 1 : 0;
    num_only2 += agrees2 && !agrees1 ? 1 : 0;
  }
  static double Share(size_t num_only, size_t num_all) {
    return num_only < kMinNumAgreeing
               ? 0.0
               : static_cast<double>(num_only) / static_cast<double>(num_all);
  }
  // The smaller fraction of either motion, and the fraction of the first
  // motion.
  double Exclusion() const {
    return Share(std::min(num_only1, num_only2),
                 num_both + num_only1 + num_only2);
  }
  double Unexplained() const { return Share(num_only1, num_both + num_only1); }
};

// The hypotheses of all steps by a function of two frames.
template <typename Function>
SequenceHypotheses ForEachStep(const MotionProblem& problem, int num_threads,
                               const Function& find) {
  SequenceHypotheses hypotheses;
  for (const std::vector<int>& sequence : problem.index.order()->sequences()) {
    hypotheses.emplace_back(std::max<size_t>(sequence.size(), 1) - 1);
    ParallelFor(hypotheses.back().size(), num_threads, [&](size_t k) {
      hypotheses.back()[k] = find(sequence[k], sequence[k + 1]);
    });
  }
  return hypotheses;
}

// The motion of the rig by the relative pose of two images of one sensor, from
// the earlier to the later frame. Without a length, its distance is free. Lever
// arms are short against the distance to the scene: the error of the rotation
// does not move the center by them.
MotionHypothesis RigMotionOf(const MotionProblem& problem,
                             const ImagePair& pair,
                             const std::optional<BaselineLength>& length) {
  const Image& image1 = problem.scene.images[pair.image_idx1];
  const Image& image2 = problem.scene.images[pair.image_idx2];
  const Rigid3& sensor_from_rig =
      *problem.depths.cam_from_rig[image1.sensor_idx];
  const bool is_reversed =
      problem.index.order()->IsBefore(image2.frame_idx, image1.frame_idx);
  const auto& pair_direction = pair.relative_pose->translation_direction;
  const Vector3d direction = pair_direction.value_or(Vector3d::Zero());
  const auto motion_of = [&](const Vector3d& translation) {
    const Rigid3 motion =
        sensor_from_rig.Inverse() *
        Rigid3{pair.relative_pose->cam2_from_cam1, translation} *
        sensor_from_rig;
    return is_reversed ? motion.Inverse() : motion;
  };
  MotionHypothesis hypothesis;
  hypothesis.later_from_earlier =
      motion_of((length ? length->value : 0.0) * direction);
  if (!length) {
    hypothesis.free_direction =
        motion_of(direction).Center() - motion_of(Vector3d::Zero()).Center();
  }
  Matrix3d& center_covariance = hypothesis.center_covariance;
  if (!pair_direction) {
    // Shorter motions are not visible.
    center_covariance = problem.noise_displacement *
                        problem.noise_displacement * Matrix3d::Identity();
    return hypothesis;
  }
  const MeasuredMotion of_pair =
      MeasuredMotionOf({pair.relative_pose->cam2_from_cam1, direction},
                       CovarianceOf(problem, pair), is_reversed);
  const Matrix3d rig_from_sensor =
      sensor_from_rig.rotation.conjugate().toRotationMatrix();
  hypothesis.rotation_covariance = rig_from_sensor *
                                   of_pair.rotation_covariance *
                                   rig_from_sensor.transpose();
  center_covariance =
      rig_from_sensor * of_pair.center_covariance * rig_from_sensor.transpose();
  if (length) {
    center_covariance = (length->value * length->value * center_covariance +
                         length->sigma * length->sigma * Matrix3d::Identity())
                            .eval();
  }
  return hypothesis;
}

// The motions of one step by its pairs of equal sensors. Without `lengths`,
// their distances are free; with them, pairs of unknown length are left out.
StepHypotheses MotionsOfPairs(const MotionProblem& problem,
                              const BaselineLengths* lengths,
                              const FramePair& frames) {
  StepHypotheses step;
  double num_matches = 0.0;
  for (const size_t i : frames.pair_idxs) {
    const ImagePair& pair = problem.view_graph.pairs[i];
    const int sensor_idx = problem.scene.images[pair.image_idx1].sensor_idx;
    if (!pair.relative_pose || !problem.depths.cam_from_rig[sensor_idx] ||
        (lengths && !(*lengths)[i]) ||
        sensor_idx != problem.scene.images[pair.image_idx2].sensor_idx) {
      continue;
    }
    step.push_back(
        RigMotionOf(problem, pair, lengths ? (*lengths)[i] : std::nullopt));
    step.back().share = static_cast<double>(pair.matches.size());
    num_matches += step.back().share;
  }
  for (MotionHypothesis& hypothesis : step) {
    hypothesis.share /= num_matches;
    hypothesis.own_share = hypothesis.share;
  }
  return step;
}

}  // namespace

StepHypotheses FindRigMotions(const FrameMatches& matches, double max_error_px,
                              Random random) {
  const Correspondences all = CollectMost(matches, max_error_px);
  const auto num_all = static_cast<double>(CountRays(all.cameras));
  RansacOptions ransac;
  ransac.max_num_trials = kMaxNumTrials;
  StepHypotheses motions;
  std::vector<CameraPoints> remaining = all.cameras;
  while (motions.size() < kMaxNumMotions &&
         static_cast<double>(CountRays(remaining)) >=
             std::max<double>(kMinNumAgreeing, kMinRemainingShare * num_all)) {
    const auto pose = EstimateAbsolutePose(remaining, ransac, &random);
    if (!pose) break;
    const int num_own = ScoreAbsolutePose(remaining, *pose).num_inliers;
    if (num_own < static_cast<int>(kMinNumAgreeing) ||
        num_own < kMinOwnShare * num_all) {
      break;
    }
    motions.push_back(
        {MeasureMotion(all, *pose),
         ScoreAbsolutePose(all.cameras, *pose).num_inliers / num_all,
         num_own / num_all});
    KeepRays(*pose, 1.0, /*keep_agreeing=*/false, &remaining);
  }
  MeasureReach(all, &motions);
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
    minimize(near, kRefinementLossScale * bound, &pose);
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
  const bool is_known1 = depths.IsKnown(pair.image_idx1, k1);
  const bool is_known2 = depths.IsKnown(pair.image_idx2, k2);
  if (is_known1 && !AgreesWithDepth(cam2_from_cam1, ray1, ray2,
                                    *depths.distances[pair.image_idx1][k1],
                                    depths.RelativeSigma(pair.image_idx1, k1),
                                    tolerance_rad)) {
    return MatchVerdict::kContradicts;
  }
  if (is_known2 && !AgreesWithDepth(cam2_from_cam1.Inverse(), ray2, ray1,
                                    *depths.distances[pair.image_idx2][k2],
                                    depths.RelativeSigma(pair.image_idx2, k2),
                                    tolerance_rad)) {
    return MatchVerdict::kContradicts;
  }
  return is_known1 || is_known2 ? MatchVerdict::kAgrees
                                : MatchVerdict::kIsOnEpipolarLine;
}

std::optional<Rigid3> RelativePoseBy(const MotionProblem& problem,
                                     const ImagePair& pair,
                                     int earlier_frame_idx,
                                     const Rigid3& later_from_earlier) {
  const Image& image1 = problem.scene.images[pair.image_idx1];
  const Image& image2 = problem.scene.images[pair.image_idx2];
  const auto& cam1_from_rig = problem.depths.cam_from_rig[image1.sensor_idx];
  const auto& cam2_from_rig = problem.depths.cam_from_rig[image2.sensor_idx];
  if (!cam1_from_rig || !cam2_from_rig) return std::nullopt;
  return *cam2_from_rig *
         (image1.frame_idx == earlier_frame_idx
              ? later_from_earlier
              : later_from_earlier.Inverse()) *
         cam1_from_rig->Inverse();
}

double ToleranceOf(const MotionProblem& problem, const ImagePair& pair) {
  return ErrorRad(problem.scene, pair.image_idx1, 0.5 * problem.max_error_px) +
         ErrorRad(problem.scene, pair.image_idx2, 0.5 * problem.max_error_px);
}

MotionExclusion ExclusionOf(const MotionProblem& problem, int earlier_frame_idx,
                            int later_frame_idx, const Rigid3& motion1,
                            const Rigid3& motion2) {
  const FramePair* frames =
      problem.matches_index.Find(earlier_frame_idx, later_frame_idx);
  if (frames == nullptr) return {};
  AgreementCounts with_depth, without_depth;
  for (const size_t i : frames->pair_idxs) {
    const ImagePair& pair = problem.matches.pairs[i];
    if (problem.scene.images[pair.image_idx1].sensor_idx !=
        problem.scene.images[pair.image_idx2].sensor_idx) {
      continue;
    }
    const auto pose1 =
        RelativePoseBy(problem, pair, earlier_frame_idx, motion1);
    const auto pose2 =
        RelativePoseBy(problem, pair, earlier_frame_idx, motion2);
    if (!pose1 || !pose2) continue;
    const double tolerance_rad = ToleranceOf(problem, pair);
    const auto agrees = [&](const Match& match, const Rigid3& pose) {
      return CompareWithMotion(problem.bearings, problem.depths, pair, match,
                               pose,
                               tolerance_rad) != MatchVerdict::kContradicts;
    };
    for (const Match& match : pair.matches) {
      const bool has_depth =
          problem.depths.IsKnown(pair.image_idx1,
                                 static_cast<int>(match.keypoint_idx1)) ||
          problem.depths.IsKnown(pair.image_idx2,
                                 static_cast<int>(match.keypoint_idx2));
      (has_depth ? with_depth : without_depth)
          .Add(agrees(match, *pose1), agrees(match, *pose2));
    }
  }
  return {std::max(with_depth.Exclusion(), without_depth.Exclusion()),
          std::max(with_depth.Unexplained(), without_depth.Unexplained())};
}

Eigen::Matrix<double, 6, 6> CovarianceOf(const MotionProblem& problem,
                                         const ImagePair& pair) {
  const Rigid3 pose{pair.relative_pose->cam2_from_cam1,
                    *pair.relative_pose->translation_direction};
  RayMatches rays;
  ForEachRays(problem.bearings, pair,
              [&](const Match&, const Vector3d& ray1, const Vector3d& ray2) {
                rays.Add(ray1, ray2);
              });
  PoseRefinementOptions options;
  options.loss_scale_rad =
      rays.size() == 0 ? 1.0
                       : std::max(RobustSigma<1>(SampsonAngles(rays, pose)),
                                  std::numeric_limits<double>::epsilon());
  return RelativePoseCovariance(rays, options, pose);
}

SequenceHypotheses FindHypothesesByPairs(const MotionProblem& problem,
                                         const BaselineLengths& lengths,
                                         const Context& context) {
  return ForEachStep(problem, context.num_threads, [&](int earlier, int later) {
    const FramePair* frames = problem.index.Find(earlier, later);
    return frames == nullptr ? StepHypotheses()
                             : MotionsOfPairs(problem, &lengths, *frames);
  });
}

SequenceHypotheses FindHypothesesByDepths(const MotionProblem& problem,
                                          const Context& context) {
  return ForEachStep(problem, context.num_threads, [&](int earlier, int later) {
    StepHypotheses step;
    if (const FramePair* frames = problem.matches_index.Find(earlier, later)) {
      step = FindRigMotions(
          problem.MatchesOf(earlier, *frames),
          kDepthErrorFactor * problem.max_error_px,
          Random(context.random_seed, static_cast<uint64_t>(earlier)));
    }
    if (const FramePair* frames = problem.index.Find(earlier, later)) {
      const StepHypotheses free = MotionsOfPairs(problem, nullptr, *frames);
      step.insert(step.end(), free.begin(), free.end());
    }
    return step;
  });
}

}  // namespace mgsfm
