// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <cmath>
#include <limits>

#include "geometry/decompositions.h"
#include "geometry/epipolar.h"
#include "geometry/epipolar_terms.h"
#include "geometry/pose_refinement.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using internal::EpipolarPose;
using internal::EpipolarTerms;
using Basis = Eigen::Matrix<double, 3, 2>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;
using Vector5d = Eigen::Matrix<double, 5, 1>;

// Orthonormal columns normal to the unit vector t.
Basis TangentBasis(const Eigen::Vector3d& t) {
  Basis basis;
  basis.col(0) = t.unitOrthogonal();
  basis.col(1) = t.cross(basis.col(0));
  return basis;
}

// Sampson error and its gradient w.r.t. the perturbation of the pose.
double SampsonTerms(const EpipolarPose& pose, const Basis& basis,
                    const Eigen::Vector3d& ray1, const Eigen::Vector3d& ray2,
                    Vector5d* gradient) {
  const EpipolarTerms m(pose, ray1, ray2);
  if (!m.IsDefined()) {
    gradient->setZero();
    return 0.0;
  }
  const double inv_s = 1.0 / m.s;
  const double inv_sqrt_s = std::sqrt(inv_s);
  const double r = m.e * inv_sqrt_s;
  // r = e s^(-1/2), and s contains -2 e^2.
  const double by_e = inv_sqrt_s * (1.0 + 2.0 * r * r);
  const double by_s = r * inv_s;
  const Eigen::Vector3d& t = pose.direction;
  const Eigen::Vector3d e_by_rotation = m.ta * ray2 - m.a.dot(ray2) * t;
  gradient->head<3>() = by_e * e_by_rotation + (by_s * m.ta) * m.a.cross(t);
  gradient->tail<2>() = basis.transpose() * (by_e * m.a.cross(ray2) +
                                             by_s * (m.ta * m.a + m.tf * ray2));
  return r;
}

template <int kDim>
struct NormalEquations {
  Eigen::Matrix<double, kDim, kDim> hessian =
      Eigen::Matrix<double, kDim, kDim>::Zero();
  Eigen::Matrix<double, kDim, 1> gradient =
      Eigen::Matrix<double, kDim, 1>::Zero();
  double cost = 0.0;

  Eigen::Matrix<double, kDim, 1> Step(double damping) const {
    Eigen::Matrix<double, kDim, kDim> damped = hessian;
    const double floor = 1e-6 * hessian.diagonal().maxCoeff() + 1e-300;
    damped.diagonal() +=
        damping * (hessian.diagonal().array() + floor).matrix();
    return -damped.ldlt().solve(gradient);
  }
};

// Excludes coordinates from the step.
void Fix(int first, int size, NormalEquations<5>* equations) {
  equations->hessian.middleRows(first, size).setZero();
  equations->hessian.middleCols(first, size).setZero();
  equations->hessian.diagonal().segment(first, size).setOnes();
  equations->gradient.segment(first, size).setZero();
}

NormalEquations<5> LinearizePose(const RayMatches& matches,
                                 const Rigid3& cam2_from_cam1,
                                 const PoseRefinementOptions& options) {
  const EpipolarPose pose{cam2_from_cam1.rotation.toRotationMatrix(),
                          cam2_from_cam1.translation};
  const internal::PoseSums sums = internal::SumSampsonTerms(
      matches, pose, TangentBasis(pose.direction), options.loss_scale_rad);
  NormalEquations<5> equations{sums.hessian, sums.gradient, sums.cost};
  if (options.is_rotation_fixed) Fix(0, 3, &equations);
  if (options.is_direction_fixed) Fix(3, 2, &equations);
  return equations;
}

NormalEquations<3> LinearizeRotation(const RayMatches& matches,
                                     const Eigen::Quaterniond& cam2_from_cam1,
                                     double loss_scale) {
  const Eigen::Matrix3d rotation = cam2_from_cam1.toRotationMatrix();
  const double inv_squared_scale = 0.5 / (loss_scale * loss_scale);
  NormalEquations<3> equations;
  LogSum log_sum;
  for (size_t i = 0; i < matches.size(); ++i) {
    const Eigen::Vector3d a = rotation * matches.rays1[i];
    const Eigen::Vector3d& f = matches.rays2[i];
    const double x = 1.0 + (a - f).squaredNorm() * inv_squared_scale;
    const double half_weight = 0.5 / x;
    equations.hessian.noalias() -= (half_weight * a) * a.transpose();
    equations.hessian.diagonal().array() += half_weight;
    equations.gradient -= half_weight * a.cross(f);
    log_sum.Add(x);
  }
  equations.cost = 0.5 * loss_scale * loss_scale * log_sum.Total();
  return equations;
}

// Levenberg-Marquardt. linearize(x) returns the NormalEquations at x, and
// perturb(x, step) applies a step.
template <class X, class Linearize, class Perturb>
SolveSummary Minimize(const PoseRefinementOptions& options,
                      const Linearize& linearize, const Perturb& perturb,
                      X* x) {
  SolveSummary summary;
  auto equations = linearize(*x);
  summary.initial_cost = summary.final_cost = equations.cost;
  if (!std::isfinite(equations.cost)) {
    summary.message = "the initial cost is not finite";
    return summary;
  }
  summary.termination = Termination::kMaxIterations;
  double damping = 1e-4;
  while (summary.num_iterations < options.max_num_iterations) {
    ++summary.num_iterations;
    const auto step = equations.Step(damping);
    const X candidate = perturb(*x, step);
    const auto candidate_equations = linearize(candidate);
    const double decrease = equations.cost - candidate_equations.cost;
    const bool is_better = decrease >= 0.0;
    if (is_better) {
      *x = candidate;
      equations = candidate_equations;
      // Less damping changes a step by less than 1e-10 of it.
      damping = std::max(0.1 * damping, 1e-10);
    } else {
      damping *= 10.0;
    }
    // Above this damping, no step decreases the cost.
    if (step.norm() <= options.step_tolerance_rad || damping > 1e8 ||
        (is_better &&
         decrease <= options.relative_cost_tolerance * equations.cost)) {
      summary.termination = Termination::kConverged;
      break;
    }
  }
  summary.final_cost = equations.cost;
  return summary;
}

SolveSummary TooFewMatches() {
  SolveSummary summary;
  summary.message = "too few matches";
  return summary;
}

}  // namespace

double SampsonAngle(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
                    const Eigen::Vector3d& ray2,
                    Eigen::Matrix<double, 1, 5>* jacobian) {
  const EpipolarPose pose{cam2_from_cam1.rotation.toRotationMatrix(),
                          cam2_from_cam1.translation.normalized()};
  Vector5d gradient;
  const double r =
      SampsonTerms(pose, TangentBasis(pose.direction), ray1, ray2, &gradient);
  if (jacobian != nullptr) *jacobian = gradient.transpose();
  return r;
}

Rigid3 PerturbRelativePose(const Rigid3& cam2_from_cam1,
                           const Eigen::Matrix<double, 5, 1>& delta) {
  const Eigen::Vector3d t = cam2_from_cam1.translation.normalized();
  const Eigen::Quaterniond rotation =
      ExpSO3(delta.head<3>()) * cam2_from_cam1.rotation;
  return {rotation.normalized(),
          (t + TangentBasis(t) * delta.tail<2>()).normalized()};
}

SolveSummary RefineRelativePose(const RayMatches& matches,
                                const PoseRefinementOptions& options,
                                Rigid3* cam2_from_cam1) {
  if (matches.size() < 5) return TooFewMatches();
  cam2_from_cam1->translation.normalize();
  return Minimize(
      options,
      [&](const Rigid3& pose) { return LinearizePose(matches, pose, options); },
      PerturbRelativePose, cam2_from_cam1);
}

double DirectionSigmaRad(const RayMatches& matches,
                         const PoseRefinementOptions& options,
                         const Rigid3& cam2_from_cam1) {
  const Matrix5d hessian =
      LinearizePose(matches, cam2_from_cam1, options).hessian;
  const Eigen::Matrix<double, 3, 2> mixed = hessian.topRightCorner<3, 2>();
  const Eigen::Matrix2d information =
      hessian.bottomRightCorner<2, 2>() -
      mixed.transpose() *
          hessian.topLeftCorner<3, 3>().completeOrthogonalDecomposition().solve(
              mixed);
  const double least = SymmetricEigen<Eigen::Matrix2d>(information).values[0];
  return least > 0.0 ? options.loss_scale_rad / std::sqrt(least)
                     : std::numeric_limits<double>::infinity();
}

PoseMatrix RelativePoseCovariance(const RayMatches& matches,
                                  const PoseRefinementOptions& options,
                                  const Rigid3& cam2_from_cam1) {
  Matrix5d information =
      LinearizePose(matches, cam2_from_cam1, options).hessian /
      (options.loss_scale_rad * options.loss_scale_rad);
  information.diagonal().array() += 1.0;
  Eigen::Matrix<double, 6, 5> by_delta = Eigen::Matrix<double, 6, 5>::Zero();
  by_delta.topLeftCorner<3, 3>().setIdentity();
  by_delta.bottomRightCorner<3, 2>() =
      TangentBasis(cam2_from_cam1.translation.normalized());
  return by_delta * information.ldlt().solve(by_delta.transpose());
}

SolveSummary RefineRotation(const RayMatches& matches,
                            const PoseRefinementOptions& options,
                            Eigen::Quaterniond* cam2_from_cam1) {
  if (matches.size() < 2) return TooFewMatches();
  return Minimize(
      options,
      [&](const Eigen::Quaterniond& rotation) {
        return LinearizeRotation(matches, rotation, options.loss_scale_rad);
      },
      [](const Eigen::Quaterniond& rotation, const Eigen::Vector3d& step) {
        return (ExpSO3(step) * rotation).normalized();
      },
      cam2_from_cam1);
}

Eigen::Vector3d FitDirection(const RayMatches& matches,
                             const Eigen::Quaterniond& cam2_from_cam1) {
  const Eigen::Matrix3d rotation = cam2_from_cam1.toRotationMatrix();
  Eigen::Matrix3d normals = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < matches.size(); ++i) {
    const Eigen::Vector3d normal =
        (rotation * matches.rays1[i]).cross(matches.rays2[i]);
    normals.noalias() += normal * normal.transpose();
  }
  return SymmetricEigen<Eigen::Matrix3d>(normals).V.col(0);
}

}  // namespace mgsfm
