// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"

namespace mgsfm {

enum class SolverBackend {
  kNative,  // ours
  kCeres,   // Ceres (SPARSE_SCHUR) with the same derivatives, as reference
};

// Why an iterative solver terminated.
enum class Termination {
  kConverged,      // a stopping criterion of the solver is satisfied
  kMaxIterations,  // usable, but not converged
  kFailure,        // numerical failure; the estimate must not be used
};

template <>
struct EnumTable<Termination> {
  static constexpr std::pair<std::string_view, Termination> kNames[] = {
      {"converged", Termination::kConverged},
      {"max_iterations", Termination::kMaxIterations},
      {"failure", Termination::kFailure}};
};

// Common summary of the iterative solvers.
struct SolveSummary {
  Termination termination = Termination::kFailure;
  int num_iterations = 0;
  double initial_cost = 0.0;
  double final_cost = 0.0;
  std::string message;

  bool IsUsable() const { return termination != Termination::kFailure; }

  auto Fields() const {
    return Named("termination", termination, "num_iterations", num_iterations,
                 "initial_cost", initial_cost, "final_cost", final_cost,
                 "message", message);
  }
};

}  // namespace mgsfm
