// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/eval/evaluation.h"

namespace mgsfm {

// A picture of an evaluation, as SVG: from above, the path of the model over
// the true one, with true places of frames that are not registered; below it
// the errors of position and rotation over the distance driven. Only images of
// reference sensors are drawn, in the order they are in, joined by lines unless
// they are far apart. "Above" is where the true cameras on average have it.
std::string EvaluationToSvg(const std::vector<ImagePoses>& images,
                            const Evaluation& evaluation);

}  // namespace mgsfm
