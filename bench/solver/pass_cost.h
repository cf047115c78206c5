// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {

// Operations and memory traffic of an iteration of the native solver on pixel
// observations, counted from its formulas. Additions, multiplications,
// divisions and roots count as one operation. Excludes the projection and its
// derivatives, the loss weights, the sum of the systems of the chunks, and the
// factorization.
struct PassCost {
  double linearize_flops = 0.0;  // residuals, derivatives, products of images
  double eliminate_flops = 0.0;  // points
  double step_flops = 0.0;       // steps of points, new cost
  // Memory traffic if only the poses and the system of a chunk stay in the
  // cache.
  double linearize_bytes = 0.0;
  double step_bytes = 0.0;

  double Flops() const {
    return linearize_flops + eliminate_flops + step_flops;
  }
  double Bytes() const { return linearize_bytes + step_bytes; }
};

PassCost CountPassCost(const RigProblemBase& problem,
                       const RigStructure& structure);

}  // namespace mgsfm
