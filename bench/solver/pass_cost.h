// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "least_squares/rig_problem.h"
#include "least_squares/rig_structure.h"

namespace mgsfm {

// What an iteration of the native solver on pixel observations computes and
// moves, counted from its formulas: additions, multiplications, divisions and
// roots are one operation each. Left out are the projection by the camera model
// with its derivatives, weights of the loss, the sum of the chunks' systems,
// and the factorisation.
struct PassCost {
  double linearize_flops = 0.0;  // residuals, derivatives, products of images
  double eliminate_flops = 0.0;  // points
  double step_flops = 0.0;       // steps of points, new cost
  // What must come from memory and go there if nothing is left in a cache but
  // the poses and the system of a chunk.
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
