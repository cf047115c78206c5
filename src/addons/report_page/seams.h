// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <utility>

#include "report_page/page_model.h"

namespace mgsfm {

// The places of the seams of the report as pairs of frames [before, after].
// Each side of a seam consists of stretches of frames, and a seam lies where
// stretches of different sides follow each other.
std::set<std::pair<int, int>> SeamPlaces(const PageModel& model);

}  // namespace mgsfm
