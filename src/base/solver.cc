// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/solver.h"

namespace mgsfm {

std::string_view TerminationName(Termination termination) {
  switch (termination) {
    case Termination::kConverged:
      return "converged";
    case Termination::kMaxIterations:
      return "max_iterations";
    case Termination::kFailure:
      return "failure";
  }
  return "failure";
}

}  // namespace mgsfm
