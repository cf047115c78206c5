// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/report_page/report_page.h"

namespace mgsfm {

// A drawing for a paper or a talk, as an SVG file.
struct Figure {
  std::string name;  // e.g. "trajectory"
  std::string svg;
};

// trajectory: the paths of the rigs and the points from above. errors: the path
// and its errors, with ground truth only. rig: the sensors of the rigs, with
// their uncertainty if the report has it. residuals: errors and mean residuals
// over the image plane of each sensor. view_graph: frames against frames,
// colored by their common points. Figures that have nothing to show are
// omitted. Figures do not depend on the number of threads.
[[nodiscard]] std::vector<Figure> MakeFigures(const ReportPageInput& input,
                                              const Context& context);

}  // namespace mgsfm
