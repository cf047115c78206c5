// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "report_page/page_model.h"

namespace mgsfm {

// The sections of the page that need no JavaScript, as HTML. All text from
// files is escaped.

// The outcome, and everything that deserves attention.
std::string SummarySection(const PageModel& model);
// Charts and tables.
std::string DetailSections(const PageModel& model);

// The data of the 3D view: a JSON header, and the arrays it lists, in base64.
// web/src/page_data.js reads them.
struct SceneData {
  std::string header_json;
  std::string arrays_base64;
  bool has_side_files = false;
};

// Uses at most about options.max_bytes for points, tracks and thumbnails
// together with what is always there: poses, names and statistics of images.
// Scenes of very many images are represented by frames at equal steps. Writes
// side files if the options say so and not all points fit.
SceneData MakeSceneData(const PageModel& model,
                        const ReportPageOptions& options,
                        const Context& context);

}  // namespace mgsfm
