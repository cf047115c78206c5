// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {

// "m", or "units" of a ground truth that is not metric.
inline const char* LengthUnitName(const Evaluation& evaluation) {
  return evaluation.is_metric ? "m" : "units";
}

// The names that a plot gives its content.
struct EvaluationLabels {
  std::string reference = "ground truth";
  std::string compared = "model";
  std::string difference = "error";
  std::string length_unit = {};  // "": that of the evaluation
};

// An SVG plot of an evaluation: the estimated and true paths in top view, with
// the true positions of unregistered frames, and the position and rotation
// errors, if there are any, over the traveled distance. Shows only images of
// reference sensors in their order; lines connect consecutive images unless
// they are far apart. The vertical direction is the mean up direction of the
// true cameras.
std::string EvaluationToSvg(const std::vector<ImagePoses>& images,
                            const Evaluation& evaluation,
                            const EvaluationLabels& labels = {});

}  // namespace mgsfm
