// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/iteration_callback.h>

#include "mgsfm/base/context.h"

namespace mgsfm {

// Ends a solve of Ceres when the context is cancelled. The caller then throws
// by Context::CheckInterrupted().
class StopWhenCancelled : public ceres::IterationCallback {
 public:
  explicit StopWhenCancelled(const Context& context) : context_(context) {}

  ceres::CallbackReturnType operator()(
      const ceres::IterationSummary&) override {
    return context_.is_cancelled && context_.is_cancelled()
               ? ceres::SOLVER_ABORT
               : ceres::SOLVER_CONTINUE;
  }

 private:
  const Context& context_;
};

}  // namespace mgsfm
