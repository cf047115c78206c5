// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "report_page/page_model.h"

namespace mgsfm {

// The paths of the frames and the points from above as an SVG file, "" without
// a frame. Frames of one rig and folder form a path; it is broken where frames
// are farther apart than ten times the median distance. The vertical direction
// is the mean upward axis of the reference cameras, or the axis of least extent
// if they point everywhere.
std::string TrajectoryChart(const PageModel& model);

}  // namespace mgsfm
