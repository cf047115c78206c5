// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>

namespace mgsfm {

// How an iterative solver ended.
enum class Termination {
  kConverged,      // a stopping rule of the solver's header holds
  kMaxIterations,  // usable, but no stopping rule holds yet
  kFailure,        // numerically failed; the estimate must not be used
};

std::string_view TerminationName(Termination termination);

// What every iterative solver reports of itself.
struct SolveSummary {
  Termination termination = Termination::kFailure;
  int num_iterations = 0;
  double initial_cost = 0.0;
  double final_cost = 0.0;
  std::string message;

  bool IsUsable() const { return termination != Termination::kFailure; }
};

}  // namespace mgsfm
