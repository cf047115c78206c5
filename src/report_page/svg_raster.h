// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// Draws what SvgDrawing writes (src/eval/svg.h) as a PNG file with
// `pixels_per_unit`. Fonts are those of OpenCV, so that the result does not
// depend on the machine; they have ASCII characters only, others become '?'.
std::string RasterizeSvg(const std::string& svg, double pixels_per_unit);

}  // namespace mgsfm
