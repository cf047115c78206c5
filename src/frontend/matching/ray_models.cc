// SPDX-License-Identifier: BSD-3-Clause
#include "matching/ray_models.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "geometry/decompositions.h"

namespace mgsfm {
namespace {

// Reweighting steps of the local optimization; each uses the inliers and
// weights of the previous model. One and four find the inliers within 0.6 %
// (docs/results/constants.md).
constexpr int kNumLocalSteps = 2;
// Lower bound of the denominators of Sampson errors, which are of order one for
// F of unit norm, except at an epipole.
constexpr double kMinDenominator = 1e-14;

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

// Row-major, like the coefficients of EpipolarRow.
Eigen::Matrix3d ToMatrix(const Vector9d& m) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(
      m.data());
}

// The unit vector x that minimizes x^T A x.
Vector9d SmallestEigenvector(const Matrix9d& A) {
  return Eigen::SelfAdjointEigenSolver<Matrix9d>(A).eigenvectors().col(0);
}

Vector9d EpipolarRow(const Eigen::Vector3d& ray1, const Eigen::Vector3d& ray2) {
  Vector9d row;
  row << ray2.x() * ray1, ray2.y() * ray1, ray2.z() * ray1;
  return row;
}

// Numerator and denominator of r^2 = e^2 / s.
struct FundamentalTerms {
  double e;
  double s;

  FundamentalTerms(const Eigen::Matrix3d& F, const Eigen::Vector3d& ray1,
                   const Eigen::Vector3d& ray2) {
    const Eigen::Vector3d line2 = F * ray1;
    e = ray2.dot(line2);
    s = line2.squaredNorm() + (F.transpose() * ray2).squaredNorm() -
        2.0 * e * e;
  }
  double SquaredError() const { return e * e / std::max(s, kMinDenominator); }
};

// Real roots of c[0] + c[1] x + c[2] x^2 + c[3] x^3 (Press et al.: Numerical
// Recipes, 5.6); none if the polynomial is not cubic. Returns their number.
int SolveCubic(const std::array<double, 4>& c, std::array<double, 3>* roots) {
  const double scale = std::abs(c[0]) + std::abs(c[1]) + std::abs(c[2]);
  if (std::abs(c[3]) <= 1e-12 * scale || c[3] == 0.0) return 0;
  const double a = c[2] / c[3], b = c[1] / c[3], d = c[0] / c[3];
  const double q = (a * a - 3.0 * b) / 9.0;
  const double r = (2.0 * a * a * a - 9.0 * a * b + 27.0 * d) / 54.0;
  if (r * r < q * q * q) {
    const double angle = std::acos(r / std::sqrt(q * q * q));
    constexpr double kThird = 2.0943951023931953;  // 2 pi / 3
    for (int k = 0; k < 3; ++k) {
      (*roots)[k] =
          -2.0 * std::sqrt(q) * std::cos(angle / 3.0 + k * kThird) - a / 3.0;
    }
    return 3;
  }
  const double u =
      -std::copysign(std::cbrt(std::abs(r) + std::sqrt(r * r - q * q * q)), r);
  (*roots)[0] = u + (u == 0.0 ? 0.0 : q / u) - a / 3.0;
  return 1;
}

struct FundamentalProblem {
  using Model = Eigen::Matrix3d;
  static constexpr int kSampleSize = 7;

  const RayMatches& matches;
  double max_squared_error;

  // The squared error of match i, as a function of i.
  auto SquaredErrorOf(const Model& F) const {
    return [this, &F](size_t i) {
      return FundamentalTerms(F, matches.rays1[i], matches.rays2[i])
          .SquaredError();
    };
  }

  // x F1 + (1 - x) F2 with determinant 0; F1 and F2 span the kernel.
  int Solve(const std::array<size_t, 7>& sample,
            std::array<Model, 3>* models) const {
    Eigen::Matrix<double, 7, 9> rows;
    for (int i = 0; i < 7; ++i) {
      rows.row(i) =
          EpipolarRow(matches.rays1[sample[i]], matches.rays2[sample[i]])
              .transpose();
    }
    const Eigen::FullPivLU<Eigen::Matrix<double, 7, 9>> lu(rows);
    if (lu.dimensionOfKernel() != 2) return 0;
    const Eigen::Matrix<double, 9, Eigen::Dynamic> kernel = lu.kernel();
    const Eigen::Matrix3d F1 = ToMatrix(kernel.col(0).normalized());
    const Eigen::Matrix3d F2 = ToMatrix(kernel.col(1).normalized());
    // Interpolate the cubic det(x) from det(0), det(1), det(-1) and its leading
    // coefficient det(F1 - F2).
    const auto det = [&](double x) -> double {
      return (x * F1 + (1.0 - x) * F2).determinant();
    };
    const double at_0 = det(0.0), at_1 = det(1.0), at_m1 = det(-1.0);
    const double c3 = (F1 - F2).determinant();
    const double c2 = 0.5 * (at_1 + at_m1) - at_0;
    const double c1 = 0.5 * (at_1 - at_m1) - c3;
    std::array<double, 3> roots;
    const int num_roots = SolveCubic({at_0, c1, c2, c3}, &roots);
    for (int k = 0; k < num_roots; ++k) {
      (*models)[k] = (roots[k] * F1 + (1.0 - roots[k]) * F2).normalized();
    }
    return num_roots;
  }

  // Least squares of e / sqrt(s) with s of the previous step, then projection
  // to rank 2.
  std::optional<Model> Refine(const Model& start) const {
    Model F = start;
    for (int step = 0; step < kNumLocalSteps; ++step) {
      Matrix9d A = Matrix9d::Zero();
      int num_inliers = 0;
      for (size_t i = 0; i < matches.size(); ++i) {
        const FundamentalTerms terms(F, matches.rays1[i], matches.rays2[i]);
        if (terms.SquaredError() > max_squared_error) continue;
        const Vector9d row = EpipolarRow(matches.rays1[i], matches.rays2[i]);
        A.selfadjointView<Eigen::Lower>().rankUpdate(
            row, 1.0 / std::max(terms.s, kMinDenominator));
        ++num_inliers;
      }
      if (num_inliers < 8) return std::nullopt;
      auto [U, V, values] = Svd3(ToMatrix(SmallestEigenvector(A)));
      values.z() = 0.0;
      F = U * values.asDiagonal() * V.transpose();
    }
    return F;
  }
};

struct HomographyProblem {
  using Model = Eigen::Matrix3d;
  static constexpr int kSampleSize = 4;

  const RayMatches& matches;
  double max_squared_error;

  auto SquaredErrorOf(const Model& H) const {
    return [this, test = HomographyTest(H)](size_t i) {
      return test.SquaredError(matches.rays1[i], matches.rays2[i]);
    };
  }

  // In each image, the basis of three rays in which the fourth is (1, 1, 1).
  int Solve(const std::array<size_t, 4>& sample,
            std::array<Model, 3>* models) const {
    const auto basis = [&](const std::vector<Eigen::Vector3d>& rays) {
      Eigen::Matrix3d m;
      for (int k = 0; k < 3; ++k) m.col(k) = rays[sample[k]];
      return Eigen::Matrix3d(m * (m.inverse() * rays[sample[3]]).asDiagonal());
    };
    const Eigen::Matrix3d H =
        basis(matches.rays2) * basis(matches.rays1).inverse();
    const double norm = H.norm();
    if (!std::isfinite(norm) || norm == 0.0) return 0;
    (*models)[0] = H / norm;
    return 1;
  }

  std::optional<Model> Refine(const Model& start) const {
    Model H = start;
    for (int step = 0; step < kNumLocalSteps; ++step) {
      const HomographyTest test(H);
      Matrix9d A = Matrix9d::Zero();
      int num_inliers = 0;
      for (size_t i = 0; i < matches.size(); ++i) {
        const Eigen::Vector3d& ray1 = matches.rays1[i];
        const Eigen::Vector3d& ray2 = matches.rays2[i];
        if (test.SquaredError(ray1, ray2) > max_squared_error) continue;
        AddEquations(ray1, ray2, 1.0 / (H * ray1).squaredNorm(), &A);
        ++num_inliers;
      }
      if (num_inliers < 5) return std::nullopt;
      H = ToMatrix(SmallestEigenvector(A));
      if (Orientation(H) < 0.0) H = -H;
    }
    return H;
  }

  double Orientation(const Model& H) const {
    double sum = 0.0;
    for (size_t i = 0; i < matches.size(); ++i) {
      sum += matches.rays2[i].dot(H * matches.rays1[i]);
    }
    return sum;
  }

  // The two components of H f1 orthogonal to f2 vanish.
  static void AddEquations(const Eigen::Vector3d& ray1,
                           const Eigen::Vector3d& ray2, double weight,
                           Matrix9d* A) {
    const Eigen::Vector3d u = ray2.unitOrthogonal();
    for (const Eigen::Vector3d& normal : {u, Eigen::Vector3d(ray2.cross(u))}) {
      A->selfadjointView<Eigen::Lower>().rankUpdate(EpipolarRow(ray1, normal),
                                                    weight);
    }
  }
};

template <class Problem>
PoseScore ScoreModel(const Problem& problem,
                     const typename Problem::Model& model, double max_cost) {
  const auto squared_error = problem.SquaredErrorOf(model);
  PoseScore score;
  for (size_t i = 0; i < problem.matches.size(); ++i) {
    const double error = squared_error(i);
    const bool is_inlier = error <= problem.max_squared_error;
    score.cost += is_inlier ? error : problem.max_squared_error;
    score.num_inliers += is_inlier ? 1 : 0;
    if (score.cost > max_cost) break;
  }
  return score;
}

template <class Problem>
std::optional<typename Problem::Model> RunRansac(const Problem& problem,
                                                 const RansacOptions& options,
                                                 Random* random) {
  constexpr int kSampleSize = Problem::kSampleSize;
  const size_t size = problem.matches.size();
  if (size <= kSampleSize) return std::nullopt;
  typename Problem::Model best;
  PoseScore best_score{std::numeric_limits<double>::infinity(), 0};
  const auto keep_if_better = [&](const typename Problem::Model& model) {
    const PoseScore score = ScoreModel(problem, model, best_score.cost);
    if (!(score.cost < best_score.cost)) return false;
    best = model;
    best_score = score;
    return true;
  };
  int num_trials = options.max_num_trials;
  std::array<typename Problem::Model, 3> models;
  for (int trial = 0; trial < num_trials; ++trial) {
    const int num_models =
        problem.Solve(DrawSample<kSampleSize>(size, random), &models);
    bool is_better = false;
    for (int k = 0; k < num_models; ++k) {
      is_better = keep_if_better(models[k]) || is_better;
    }
    if (!is_better) continue;
    if (const auto refined = problem.Refine(best)) keep_if_better(*refined);
    num_trials = RequiredNumTrials(
        options, static_cast<double>(best_score.num_inliers) / size,
        kSampleSize);
  }
  if (best_score.num_inliers <= kSampleSize) return std::nullopt;
  return best;
}

}  // namespace

std::optional<Eigen::Matrix3d> EstimateFundamental(const RayMatches& matches,
                                                   const RansacOptions& options,
                                                   Random* random) {
  return RunRansac(FundamentalProblem{matches, options.max_error_rad *
                                                   options.max_error_rad},
                   options, random);
}

bool IsFundamentalInlier(const Eigen::Matrix3d& F, const Eigen::Vector3d& ray1,
                         const Eigen::Vector3d& ray2, double max_error_rad) {
  return FundamentalTerms(F, ray1, ray2).SquaredError() <=
         max_error_rad * max_error_rad;
}

std::optional<Eigen::Matrix3d> EstimateHomography(const RayMatches& matches,
                                                  const RansacOptions& options,
                                                  Random* random) {
  return RunRansac(
      HomographyProblem{matches, options.max_error_rad * options.max_error_rad},
      options, random);
}

HomographyTest::HomographyTest(const Eigen::Matrix3d& H)
    : H_(H), inverse_(H.inverse()) {}

double HomographyTest::SquaredError(const Eigen::Vector3d& ray1,
                                    const Eigen::Vector3d& ray2) const {
  const double forward = ((H_ * ray1).normalized() - ray2).squaredNorm();
  const double backward = ((inverse_ * ray2).normalized() - ray1).squaredNorm();
  // std::max(NaN, x) is NaN: a singular H, whose inverse is not finite, has no
  // inliers.
  return std::max(backward, forward);
}

}  // namespace mgsfm
