// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "arrays.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm::python {

struct Intrinsics {
  CameraModelId model;
  std::vector<double> params;
};

// Throws Error for an unknown model or a wrong number of parameters.
Intrinsics ReadIntrinsics(const std::string& model,
                          const ArrayIn<double>& params);

}  // namespace mgsfm::python
