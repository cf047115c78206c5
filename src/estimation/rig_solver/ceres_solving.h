// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <ceres/version.h>

#define MGSFM_CERES_HAS_MANIFOLDS \
  (CERES_VERSION_MAJOR > 2 ||     \
   (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR >= 1))

#if MGSFM_CERES_HAS_MANIFOLDS
#include <ceres/manifold.h>
#else
#include <ceres/local_parameterization.h>
#endif

#include <algorithm>

#include "math/robust_loss.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/solver.h"

namespace mgsfm {

// Manifolds of Ceres 2.1 and later. Ceres 2.0 calls them local
// parameterizations, with different function names.
#if MGSFM_CERES_HAS_MANIFOLDS

using CeresManifold = ceres::Manifold;
using CeresSubsetManifold = ceres::SubsetManifold;
using CeresQuaternionManifold = ceres::EigenQuaternionManifold;

inline void SetManifold(double* block, CeresManifold* manifold,
                        ceres::Problem* problem) {
  problem->SetManifold(block, manifold);
}

#else

class CeresManifold : public ceres::LocalParameterization {
 public:
  virtual int AmbientSize() const = 0;
  virtual int TangentSize() const = 0;
  virtual bool PlusJacobian(const double* x, double* jacobian) const = 0;
  virtual bool Minus(const double* y, const double* x,
                     double* y_minus_x) const = 0;
  virtual bool MinusJacobian(const double* x, double* jacobian) const = 0;

 private:
  int GlobalSize() const final { return AmbientSize(); }
  int LocalSize() const final { return TangentSize(); }
  bool ComputeJacobian(const double* x, double* jacobian) const final {
    return PlusJacobian(x, jacobian);
  }
};
using CeresSubsetManifold = ceres::SubsetParameterization;
using CeresQuaternionManifold = ceres::EigenQuaternionParameterization;

inline void SetManifold(double* block, ceres::LocalParameterization* manifold,
                        ceres::Problem* problem) {
  problem->SetParameterization(block, manifold);
}

#endif

// Ends a Ceres solve when the context is canceled. The caller then throws in
// Context::CheckInterrupted().
class StopWhenCanceled : public ceres::IterationCallback {
 public:
  explicit StopWhenCanceled(const Context& context) : context_(context) {}

  ceres::CallbackReturnType operator()(
      const ceres::IterationSummary&) override {
    return context_.is_canceled && context_.is_canceled()
               ? ceres::SOLVER_ABORT
               : ceres::SOLVER_CONTINUE;
  }

 private:
  const Context& context_;
};

// The losses of the library, with a scale that may change between solves.
class CeresLoss : public ceres::LossFunction {
 public:
  explicit CeresLoss(const RobustLoss& loss) : loss_(loss) {}
  void SetScale(double scale) { loss_.scale = scale; }
  void Evaluate(double s, double out[3]) const override {
    const LossValue value = loss_.Evaluate(s);
    out[0] = value.rho;
    out[1] = value.d1;
    out[2] = value.d2;
  }

 private:
  RobustLoss loss_;
};

// kFailure if the solution is not usable.
inline SolveSummary SummarizeCeres(const ceres::Solver::Summary& result) {
  SolveSummary summary;
  // The first iteration that Ceres lists is the initial state.
  summary.num_iterations =
      std::max(0, static_cast<int>(result.iterations.size()) - 1);
  summary.initial_cost = result.initial_cost;
  summary.final_cost = result.final_cost;
  summary.message = result.message;
  if (!result.IsSolutionUsable()) return summary;
  summary.termination = result.termination_type == ceres::CONVERGENCE
                            ? Termination::kConverged
                            : Termination::kMaxIterations;
  return summary;
}

}  // namespace mgsfm
