// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/generalized_pose.h"

#include <array>
#include <cmath>
#include <limits>

#include "geometry/absolute_pose.h"
#include "geometry/pose_refinement.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// The size of a minimal sample: each match constrains one of six unknowns. Five
// determine the pose up to the baseline length, the sixth determines the
// length.
constexpr int kSampleSize = PoseVector::RowsAtCompileTime;

Rigid3 CameraMotion(const UnitMatches& pair, const Rigid3& unit2_from_unit1) {
  return pair.cam2_from_unit2 * unit2_from_unit1 *
         pair.cam1_from_unit1.Inverse();
}

bool HasBaseline(const UnitMatches& pair, const Rigid3& unit2_from_unit1,
                 const Rigid3& cam2_from_cam1) {
  const double size = pair.cam1_from_unit1.translation.norm() +
                      pair.cam2_from_unit2.translation.norm() +
                      unit2_from_unit1.translation.norm();
  // Centers coincide if their distance is below this fraction of their
  // distances to the origins of the units.
  return cam2_from_cam1.translation.norm() > 1e-6 * size;
}

// A one-parameter family of poses over the length s of the translation of a
// pair: unit2_from_unit1 = (rotation, offset + s direction).
struct PoseLine {
  Eigen::Quaterniond rotation;
  Eigen::Vector3d offset;
  Eigen::Vector3d direction;

  PoseLine(const UnitMatches& pair, const Rigid3& cam2_from_cam1) {
    const auto unit_pose = [&](double length) {
      return pair.cam2_from_unit2.Inverse() *
             Rigid3{cam2_from_cam1.rotation,
                    length * cam2_from_cam1.translation} *
             pair.cam1_from_unit1;
    };
    const Rigid3 start = unit_pose(0.0);
    rotation = start.rotation;
    offset = start.translation;
    direction = unit_pose(1.0).translation - offset;
  }

  Rigid3 At(double length) const {
    return {rotation, offset + length * direction};
  }

  // The length for which a match satisfies the epipolar constraint, which is
  // linear in the length.
  std::optional<double> LengthOf(const UnitMatches& pair, size_t match) const {
    const Rigid3 start = CameraMotion(pair, At(0.0));
    const Eigen::Vector3d normal =
        (start.rotation * pair.rays.rays1[match]).cross(pair.rays.rays2[match]);
    const double by_length =
        normal.dot(pair.cam2_from_unit2.rotation * direction);
    const double length = -normal.dot(start.translation) / by_length;
    if (!(length > 0.0) || !std::isfinite(length)) return std::nullopt;
    return length;
  }
};

// The error of a match divided by its bound, and the gradient with respect to
// the pose update of the unit. t of the camera pair may have any length.
double SampsonTerms(const UnitMatches& pair, const Rigid3& unit2_from_unit1,
                    const Rigid3& cam2_from_cam1, size_t match,
                    PoseVector* gradient) {
  const Eigen::Vector3d& t = cam2_from_cam1.translation;
  const Eigen::Vector3d& f = pair.rays.rays2[match];
  const Eigen::Vector3d a = cam2_from_cam1.rotation * pair.rays.rays1[match];
  const double ta = t.dot(a), tf = t.dot(f), tt = t.squaredNorm();
  const Eigen::Vector3d normal = a.cross(f);
  const double e = t.dot(normal);
  // Proportional to |t|^2 like e^2, so the length of t cancels.
  const double s = 2.0 * tt - ta * ta - tf * tf - 2.0 * e * e;
  if (!(s > 1e-14 * tt)) {
    gradient->setZero();
    return 0.0;
  }
  const Eigen::Vector3d e_by_turn = a.cross(f.cross(t));
  const Eigen::Vector3d s_by_turn =
      -2.0 * ta * a.cross(t) - 4.0 * e * e_by_turn;
  const Eigen::Vector3d s_by_t =
      4.0 * t - 2.0 * ta * a - 2.0 * tf * f - 4.0 * e * normal;
  const double by_e = 1.0 / (std::sqrt(s) * pair.max_error_rad);
  const double by_s = -0.5 * e / s * by_e;
  const Eigen::Vector3d by_turn = by_e * e_by_turn + by_s * s_by_turn;
  const Eigen::Vector3d by_t = by_e * normal + by_s * s_by_t;
  // The axes are those of the unit. Its rotation rotates the cameras and moves
  // their centers.
  const Eigen::Quaterniond unit_from_cam =
      pair.cam2_from_unit2.rotation.conjugate();
  const Eigen::Vector3d arm =
      unit2_from_unit1.rotation * pair.cam1_from_unit1.Center();
  gradient->head<3>() =
      unit_from_cam * by_turn + arm.cross(unit_from_cam * by_t);
  gradient->tail<3>() = unit_from_cam * by_t;
  return e * by_e;
}

PoseEquations Linearize(const std::vector<UnitMatches>& pairs,
                        const Rigid3& unit2_from_unit1) {
  PoseEquations equations;
  PoseVector gradient;
  for (const UnitMatches& pair : pairs) {
    const Rigid3 motion = CameraMotion(pair, unit2_from_unit1);
    if (!HasBaseline(pair, unit2_from_unit1, motion)) continue;
    for (size_t i = 0; i < pair.rays.size(); ++i) {
      const double r =
          SampsonTerms(pair, unit2_from_unit1, motion, i, &gradient);
      const double x = 1.0 + r * r / (kInlierLossScale * kInlierLossScale);
      equations.hessian.noalias() += gradient / x * gradient.transpose();
      equations.gradient += r / x * gradient;
      equations.cost += 0.5 * kInlierLossScale * kInlierLossScale * std::log(x);
    }
  }
  return equations;
}

size_t NumMatches(const std::vector<UnitMatches>& pairs) {
  size_t num_matches = 0;
  for (const UnitMatches& pair : pairs) num_matches += pair.rays.size();
  return num_matches;
}

std::vector<UnitMatches> InliersOf(const std::vector<UnitMatches>& pairs,
                                   const Rigid3& unit2_from_unit1) {
  std::vector<UnitMatches> inliers;
  for (const UnitMatches& pair : pairs) {
    UnitMatches kept{
        pair.cam1_from_unit1, pair.cam2_from_unit2, {}, pair.max_error_rad};
    const Mask is_inlier = FindUnitInliers(pair, unit2_from_unit1);
    for (size_t i = 0; i < is_inlier.size(); ++i) {
      if (is_inlier[i]) kept.rays.Add(pair.rays.rays1[i], pair.rays.rays2[i]);
    }
    inliers.push_back(std::move(kept));
  }
  return inliers;
}

class UnitPoseRansac {
 public:
  UnitPoseRansac(const std::vector<UnitMatches>& pairs, Random* random)
      : pairs_(pairs), num_matches_(NumMatches(pairs)), random_(random) {}

  std::optional<Rigid3> Run(const std::vector<PairPose>& guesses,
                            const RansacOptions& options) {
    for (const PairPose& guess : guesses) Guess(guess);
    int num_trials = options.max_num_trials;
    // If more than half are inliers, no other pose can have more.
    for (int trial = 0; trial < num_trials && InlierRatio() < 0.5; ++trial) {
      if (Sample()) {
        num_trials = RequiredNumTrials(options, InlierRatio(), kSampleSize);
      }
    }
    return best_;
  }

 private:
  double InlierRatio() const {
    return static_cast<double>(score_.num_inliers) / num_matches_;
  }

  // Draws one of all matches except those of pair `other_than`.
  struct Drawn {
    size_t pair;
    size_t match;
  };
  std::optional<Drawn> Draw(size_t other_than) {
    size_t num_matches = num_matches_;
    if (other_than < pairs_.size())
      num_matches -= pairs_[other_than].rays.size();
    if (num_matches == 0) return std::nullopt;
    size_t match = random_->Index(static_cast<uint32_t>(num_matches));
    for (size_t p = 0; p < pairs_.size(); ++p) {
      if (p == other_than) continue;
      if (match < pairs_[p].rays.size()) return Drawn{p, match};
      match -= pairs_[p].rays.size();
    }
    return std::nullopt;
  }

  // Returns whether the pose is the best so far.
  bool Try(const Rigid3& unit2_from_unit1) {
    const PoseScore score = ScoreUnitPose(pairs_, unit2_from_unit1);
    if (!(score.cost < score_.cost)) return false;
    best_ = unit2_from_unit1;
    score_ = score;
    return true;
  }

  bool TryOnLine(const PoseLine& line, size_t pair) {
    const auto drawn = Draw(pair);
    if (!drawn) return false;
    const auto length = line.LengthOf(pairs_[drawn->pair], drawn->match);
    return length && Try(line.At(*length));
  }

  void OptimizeLocally() {
    const std::vector<UnitMatches> inliers = InliersOf(pairs_, *best_);
    Rigid3 refined = *best_;
    if (RefineUnitPose(inliers, &refined).IsUsable()) Try(refined);
  }

  void Guess(const PairPose& guess) {
    const PoseLine line(pairs_[guess.pair], guess.cam2_from_cam1);
    bool is_better = false;
    // Each length is computed from another match. At an inlier ratio of 0.2,
    // one of 20 is correct with probability 1 - 0.8^20 = 0.99.
    for (int i = 0; i < 20; ++i) {
      is_better = TryOnLine(line, guess.pair) || is_better;
    }
    if (is_better) OptimizeLocally();
  }

  // Returns whether a better pose was found.
  bool Sample() {
    const auto drawn = Draw(pairs_.size());
    if (!drawn || pairs_[drawn->pair].rays.size() < 5) return false;
    const RayMatches& rays = pairs_[drawn->pair].rays;
    const auto sample = DrawSample<5>(rays.size(), random_);
    std::array<Eigen::Vector3d, 5> rays1, rays2;
    for (size_t i = 0; i < 5; ++i) {
      rays1[i] = rays.rays1[sample[i]];
      rays2[i] = rays.rays2[sample[i]];
    }
    std::array<Eigen::Matrix3d, 10> essentials;
    const int num_essentials = SolveFivePoint(rays1, rays2, &essentials);
    bool is_better = false;
    for (int i = 0; i < num_essentials; ++i) {
      for (const Rigid3& pose : DecomposeEssential(essentials[i])) {
        const auto is_in_front = [&](size_t k) {
          return IsInFront(pose, rays1[k], rays2[k],
                           pairs_[drawn->pair].max_error_rad);
        };
        if (!is_in_front(0) || !is_in_front(1) || !is_in_front(2)) continue;
        is_better =
            TryOnLine(PoseLine(pairs_[drawn->pair], pose), drawn->pair) ||
            is_better;
      }
    }
    if (is_better) OptimizeLocally();
    return is_better;
  }

  const std::vector<UnitMatches>& pairs_;
  const size_t num_matches_;
  Random* random_;
  std::optional<Rigid3> best_;
  PoseScore score_{std::numeric_limits<double>::infinity(), 0};
};

}  // namespace

PoseScore ScoreUnitPose(const std::vector<UnitMatches>& pairs,
                        const Rigid3& unit2_from_unit1) {
  PoseScore total;
  for (const UnitMatches& pair : pairs) {
    Rigid3 motion = CameraMotion(pair, unit2_from_unit1);
    PoseScore score;
    if (HasBaseline(pair, unit2_from_unit1, motion)) {
      motion.translation.normalize();
      score = ScoreRelativePose(pair.rays, motion, pair.max_error_rad);
    } else {
      score = ScoreRotation(pair.rays, motion.rotation, pair.max_error_rad);
    }
    total.cost += score.cost / (pair.max_error_rad * pair.max_error_rad);
    total.num_inliers += score.num_inliers;
  }
  return total;
}

Mask FindUnitInliers(const UnitMatches& pair, const Rigid3& unit2_from_unit1) {
  Rigid3 motion = CameraMotion(pair, unit2_from_unit1);
  if (!HasBaseline(pair, unit2_from_unit1, motion)) {
    return FindRotationInliers(pair.rays, motion.rotation, pair.max_error_rad);
  }
  motion.translation.normalize();
  return FindInliers(pair.rays, motion, pair.max_error_rad);
}

SolveSummary RefineUnitPose(const std::vector<UnitMatches>& pairs,
                            Rigid3* unit2_from_unit1) {
  SolveSummary summary;
  if (NumMatches(pairs) < kSampleSize) {
    summary.message = "too few matches";
    return summary;
  }
  return MinimizeOverPose(
      PoseStepOptions(),
      [&](const Rigid3& pose) { return Linearize(pairs, pose); },
      unit2_from_unit1);
}

std::optional<Rigid3> EstimateUnitPose(const std::vector<UnitMatches>& pairs,
                                       const std::vector<PairPose>& guesses,
                                       const RansacOptions& options,
                                       Random* random) {
  return UnitPoseRansac(pairs, random).Run(guesses, options);
}

}  // namespace mgsfm
