// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace mgsfm {

// Preconditioned conjugate gradients (Hestenes and Stiefel 1952): solves A x =
// b for a symmetric positive definite A, starting at zero. multiply(x, &y) sets
// y = A x, precondition(r, &z) sets z = M^-1 r. Stops when sqrt(r^T M^-1 r) has
// decreased by the factor `tolerance`, or after max_num_iterations. Returns
// whether the result is finite, and b - A x in `residual`.
template <class Multiply, class Precondition>
bool SolveByConjugateGradient(const Eigen::VectorXd& b, double tolerance,
                              int max_num_iterations, const Multiply& multiply,
                              const Precondition& precondition,
                              Eigen::VectorXd* x, Eigen::VectorXd* residual) {
  Eigen::VectorXd& r = *residual;
  Eigen::VectorXd z(b.size()), Ap(b.size());
  x->setZero(b.size());
  r = b;
  precondition(r, &z);
  Eigen::VectorXd p = z;
  double rz = r.dot(z);
  const double target = tolerance * tolerance * rz;
  for (int i = 0; i < max_num_iterations && rz > target; ++i) {
    multiply(p, &Ap);
    const double curvature = p.dot(Ap);
    if (!(curvature > 0.0)) break;
    const double alpha = rz / curvature;
    *x += alpha * p;
    r -= alpha * Ap;
    precondition(r, &z);
    const double next = r.dot(z);
    p = z + next / rz * p;
    rz = next;
  }
  return x->allFinite();
}

}  // namespace mgsfm
