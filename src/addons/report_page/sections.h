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

}  // namespace mgsfm
