// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/triangulation.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Bounds the cost for long tracks. If half of the rays are inliers, a pair of
// inliers is missed with probability 0.75^60 < 1e-7.
constexpr int kMaxNumHypotheses = 60;

Vector3d Mean(const std::vector<Vector3d>& vectors) {
  Vector3d sum = Vector3d::Zero();
  for (const Vector3d& v : vectors) sum += v;
  return sum / static_cast<double>(vectors.size());
}

// Normal equations of sum_k w_k |ray_k x (p - center_k)|^2.
struct PointEquations {
  Matrix3d lhs = Matrix3d::Zero();
  Vector3d rhs = Vector3d::Zero();
  double sum_weights = 0.0;

  void Add(double weight, const Vector3d& center, const Vector3d& ray) {
    const Matrix3d projector =
        weight * (Matrix3d::Identity() - ray * ray.transpose());
    lhs += projector;
    rhs += projector * center;
    sum_weights += weight;
  }

  std::optional<Vector3d> Solve() const {
    const Matrix3d scaled = lhs / sum_weights;
    // For a matrix with trace 2 the determinant is about the smallest
    // eigenvalue, which is a^2 / 4 for two lines at a small angle a; a = 1e-6
    // rad here.
    if (!(scaled.determinant() > 0.25e-12)) return std::nullopt;
    const Vector3d point = scaled.ldlt().solve(rhs / sum_weights);
    if (!point.allFinite()) return std::nullopt;
    return point;
  }
};

int NumInFront(const std::vector<Vector3d>& centers,
               const std::vector<Vector3d>& rays, const Vector3d& point) {
  int num_in_front = 0;
  for (size_t k = 0; k < rays.size(); ++k) {
    num_in_front += rays[k].dot(point - centers[k]) > 0.0;
  }
  return num_in_front;
}

// Squared chord between the ray and the unit vector to the point: monotonic in
// the angle on [0, pi], at most 4.
double SquaredChord(const Vector3d& center, const Vector3d& ray,
                    const Vector3d& point) {
  const Vector3d to_point = point - center;
  const double distance = to_point.norm();
  if (!(distance > 0.0)) return 4.0;
  return (to_point / distance - ray).squaredNorm();
}

class RobustTriangulator {
 public:
  RobustTriangulator(const std::vector<Vector3d>& centers,
                     const std::vector<Vector3d>& rays,
                     const RobustTriangulationOptions& options)
      : centers_(centers),
        rays_(rays),
        options_(options),
        max_chord2_(std::pow(
            2.0 * std::sin(0.5 * std::min(options.max_error_rad, kPi)), 2)) {}

  std::optional<RobustTriangulation> Run() {
    TryAllHypotheses();
    if (best_score_ >= max_chord2_ * rays_.size()) return std::nullopt;
    for (int i = 0; i < 3; ++i) Refine();
    return Finish();
  }

 private:
  void TryAllHypotheses() {
    const size_t size = rays_.size();
    if (size * (size - 1) / 2 <= kMaxNumHypotheses) {
      for (size_t i = 0; i < size; ++i) {
        for (size_t j = i + 1; j < size; ++j) TryHypothesis(i, j);
      }
      return;
    }
    Random random(size);
    for (int trial = 0; trial < kMaxNumHypotheses; ++trial) {
      const size_t i = random.Index(static_cast<uint32_t>(size));
      const size_t j = random.Index(static_cast<uint32_t>(size - 1));
      TryHypothesis(i, j < i ? j : j + 1);
    }
  }

  void TryHypothesis(size_t i, size_t j) {
    TakeIfBetter(
        TriangulateTwoRays(centers_[i], rays_[i], centers_[j], rays_[j]));
  }

  void TakeIfBetter(const std::optional<Vector3d>& point) {
    if (!point) return;
    const double score = Score(*point);
    if (score < best_score_) {
      best_score_ = score;
      best_point_ = *point;
    }
  }

  double Score(const Vector3d& point) const {
    double score = 0.0;
    for (size_t k = 0; k < rays_.size(); ++k) {
      score +=
          std::min(SquaredChord(centers_[k], rays_[k], point), max_chord2_);
    }
    return score;
  }

  // One least-squares step on the angles of the inliers of the best point.
  void Refine() {
    PointEquations equations;
    for (size_t k = 0; k < rays_.size(); ++k) {
      if (SquaredChord(centers_[k], rays_[k], best_point_) >= max_chord2_) {
        continue;
      }
      equations.Add(1.0 / (best_point_ - centers_[k]).squaredNorm(),
                    centers_[k], rays_[k]);
    }
    TakeIfBetter(equations.Solve());
  }

  std::optional<RobustTriangulation> Finish() const {
    RobustTriangulation result;
    result.point = best_point_;
    result.is_inlier.resize(rays_.size());
    std::vector<Vector3d> inlier_centers;
    for (size_t k = 0; k < rays_.size(); ++k) {
      result.is_inlier[k] =
          SquaredChord(centers_[k], rays_[k], best_point_) < max_chord2_;
      if (result.is_inlier[k]) inlier_centers.push_back(centers_[k]);
    }
    result.num_inliers = static_cast<int>(inlier_centers.size());
    const double min_angle_rad = options_.min_angle_rad;
    if (result.num_inliers < 2 ||
        (min_angle_rad > 0.0 &&
         MaxTriangulationAngle(inlier_centers, best_point_, min_angle_rad) <
             min_angle_rad)) {
      return std::nullopt;
    }
    return result;
  }

  const std::vector<Vector3d>& centers_;
  const std::vector<Vector3d>& rays_;
  const RobustTriangulationOptions options_;
  const double max_chord2_;
  Vector3d best_point_ = Vector3d::Zero();
  double best_score_ = std::numeric_limits<double>::infinity();
};

std::vector<Vector3d> Shifted(const std::vector<Vector3d>& centers,
                              const Vector3d& origin) {
  std::vector<Vector3d> shifted(centers);
  for (Vector3d& center : shifted) center -= origin;
  return shifted;
}

std::optional<Vector3d> SolveLeastSquares(const std::vector<Vector3d>& centers,
                                          const std::vector<Vector3d>& rays) {
  PointEquations equations;
  for (size_t k = 0; k < rays.size(); ++k) {
    equations.Add(1.0, centers[k], rays[k]);
  }
  return equations.Solve();
}

}  // namespace

std::optional<Vector3d> TriangulateMidpoint(
    const std::vector<Vector3d>& centers, const std::vector<Vector3d>& rays) {
  MGSFM_CHECK_EQ(centers.size(), rays.size());
  if (rays.size() < 2) return std::nullopt;
  const Vector3d origin = Mean(centers);
  const auto point = SolveLeastSquares(Shifted(centers, origin), rays);
  if (!point) return std::nullopt;
  return origin + *point;
}

std::optional<Vector3d> TriangulateTwoRays(const Vector3d& center1,
                                           const Vector3d& ray1,
                                           const Vector3d& center2,
                                           const Vector3d& ray2) {
  // End points of the common perpendicular: center + depth * ray on both lines.
  const Vector3d baseline = center2 - center1;
  const Vector3d normal = ray1.cross(ray2);
  const double sin2 = normal.squaredNorm();
  if (!(sin2 > 1e-12)) return std::nullopt;
  const double depth1 = baseline.cross(ray2).dot(normal) / sin2;
  const double depth2 = baseline.cross(ray1).dot(normal) / sin2;
  if (!(depth1 > 0.0) || !(depth2 > 0.0)) return std::nullopt;
  return center1 + 0.5 * (depth1 * ray1 + baseline + depth2 * ray2);
}

std::optional<Vector3d> TriangulateL1(const std::vector<Vector3d>& centers,
                                      const std::vector<Vector3d>& rays) {
  MGSFM_CHECK_EQ(centers.size(), rays.size());
  if (rays.size() < 2) return std::nullopt;
  // The smoothing decreases by a factor of 5 from 1e-2 to kMinSine in 6 steps;
  // the others let the reweighting converge.
  constexpr double kMinSine = 1e-6;  // regularizes the norm at zero
  const Vector3d origin = Mean(centers);
  const std::vector<Vector3d> local = Shifted(centers, origin);
  auto point = SolveLeastSquares(local, rays);
  double smoothing = 1e-2;
  for (int i = 0; point && i < 50; ++i) {
    PointEquations equations;
    for (size_t k = 0; k < rays.size(); ++k) {
      const Vector3d to_point = *point - local[k];
      const double distance = to_point.norm();
      if (!(distance > 0.0)) continue;
      const double sine = rays[k].cross(to_point).norm() / distance;
      equations.Add(1.0 / (distance * distance * std::max(sine, smoothing)),
                    local[k], rays[k]);
    }
    const auto next = equations.Solve();
    if (!next) break;
    const double step = (*next - *point).norm();
    point = next;
    if (smoothing <= kMinSine && step <= 1e-8 * point->norm()) break;
    smoothing = std::max(0.2 * smoothing, kMinSine);
  }
  if (!point ||
      2 * NumInFront(local, rays, *point) <= static_cast<int>(rays.size())) {
    return std::nullopt;
  }
  return origin + *point;
}

std::optional<RobustTriangulation> TriangulateRobust(
    const std::vector<Vector3d>& centers, const std::vector<Vector3d>& rays,
    const RobustTriangulationOptions& options) {
  MGSFM_CHECK_EQ(centers.size(), rays.size());
  if (rays.size() < 2) return std::nullopt;
  const Vector3d origin = Mean(centers);
  const std::vector<Vector3d> local = Shifted(centers, origin);
  auto result = RobustTriangulator(local, rays, options).Run();
  if (result) result->point += origin;
  return result;
}

double AngularError(const Vector3d& center, const Vector3d& ray,
                    const Vector3d& point) {
  const Vector3d to_point = point - center;
  if (!(to_point.squaredNorm() > 0.0)) return kPi;
  return AngleBetween(ray, to_point);
}

double MaxTriangulationAngle(const std::vector<Vector3d>& centers,
                             const Vector3d& point, double enough_rad) {
  std::vector<Vector3d> directions;
  directions.reserve(centers.size());
  for (const Vector3d& center : centers) {
    const Vector3d direction = center - point;
    const double distance = direction.norm();
    if (distance > 0.0) directions.push_back(direction / distance);
  }
  // The chord between unit vectors increases with the angle.
  const double enough_chord = 2.0 * std::sin(0.5 * std::min(enough_rad, kPi));
  const double enough_chord2 = enough_chord * enough_chord;
  double max_chord2 = 0.0;
  for (size_t i = 1; i < directions.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      max_chord2 =
          std::max(max_chord2, (directions[i] - directions[j]).squaredNorm());
    }
    if (max_chord2 >= enough_chord2) break;
  }
  return 2.0 * std::asin(std::min(1.0, 0.5 * std::sqrt(max_chord2)));
}

}  // namespace mgsfm
