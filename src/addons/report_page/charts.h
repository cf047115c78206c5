// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "report_page/html_parts.h"
#include "report_page/page_model.h"

namespace mgsfm {

// Charts of a model as SVG files; "" if there is nothing to draw. Charts of
// sensors show those with the most images.

// Columns of the charts of sensors and of RigChart().
constexpr Columns kHistogramColumns = {12.0, 920.0 / 3.0, 3, 10.0};
constexpr Columns kMapColumns = {12.0, 920.0 / 3.0, 3, 36.0};
constexpr Columns kRigColumns = {10.0, 470.0, 2, 0.0};

// Per sensor, the registered fraction of its images over the frames, as HTML
// that fills the width.
std::string RegistrationBars(const PageModel& model);
// Per sensor, a histogram of reprojection errors.
std::string ErrorHistogramChart(const PageModel& model);
// Per sensor, mean errors and mean residuals over the image plane. Residuals
// that point the same way in a region reveal a wrong camera model.
std::string ErrorMapChart(const PageModel& model);
std::string TrackLengthChart(const PageModel& model);
// The sensors of the largest rigs from above and from behind, with ellipses of
// their uncertainty if the report has it.
std::string RigChart(const PageModel& model);
// A matrix of frames against frames with their common points, the pairs of the
// view graph without any, and the groups of rejected pairs.
std::string ViewGraphChart(const PageModel& model);

// The indices of the sensors that charts show, in their order in the scene.
std::vector<int> ChartSensors(const PageModel& model);

// The paths of the frames and the points from above as an SVG file, "" without
// a frame. Frames of one rig and folder form a path; it is broken where frames
// are farther apart than ten times the median distance. The vertical direction
// is the mean upward axis of the reference cameras, or the axis of least extent
// if they point everywhere.
std::string TrajectoryChart(const PageModel& model);

}  // namespace mgsfm
