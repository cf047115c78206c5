// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/rig_solver.h"

#include <optional>

#include "rig_solver/ceres_backend.h"
#include "rig_solver/levenberg_marquardt.h"
#include "rig_solver/residuals.h"
#include "rig_solver/rig_equations.h"

namespace mgsfm {
namespace {

template <class Observation>
struct ResidualOf;
template <>
struct ResidualOf<PixelObservation> {
  using Type = PixelResidual;
};
template <>
struct ResidualOf<RayObservation> {
  using Type = RayResidual;
};

}  // namespace

template <class Observation>
struct RigSolver<Observation>::Impl {
  using Residual = typename ResidualOf<Observation>::Type;

  Impl(const RigProblem<Observation>& the_problem,
       const RigSolverOptions& the_options, const Context& the_context)
      : problem(the_problem), options(the_options), context(the_context) {
    if (options.backend == SolverBackend::kNative) {
      equations.emplace(problem, options.reduced_solver, context);
    }
  }

  const RigProblem<Observation>& problem;
  const RigSolverOptions options;
  const Context context;
  std::optional<RigEquations<Residual>> equations;
};

template <class Observation>
RigSolver<Observation>::RigSolver(const RigProblem<Observation>& problem,
                                  const RigSolverOptions& options,
                                  const Context& context)
    : impl_(std::make_unique<Impl>(problem, options, context)) {}

template <class Observation>
RigSolver<Observation>::~RigSolver() = default;

template <class Observation>
SolveSummary RigSolver<Observation>::Solve(int max_num_iterations,
                                           RigState* state) {
  if (!impl_->equations) {
    return SolveByCeres<typename Impl::Residual>(impl_->problem, impl_->options,
                                                 max_num_iterations,
                                                 impl_->context, state);
  }
  impl_->equations->SetState(*state);
  SolveSummary summary = MinimizeByLevenbergMarquardt(
      impl_->options, max_num_iterations, impl_->context, &*impl_->equations);
  if (summary.IsUsable()) impl_->equations->GetState(state);
  return summary;
}

template class RigSolver<PixelObservation>;
template class RigSolver<RayObservation>;

}  // namespace mgsfm
