// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/report_page/report_page.h"

namespace mgsfm {

// Writes the figures of a model (mgsfm/report_page/figures.h) as NAME.svg
// into a folder, which is made if necessary. Throws Error if a file
// cannot be written.
void WriteFigures(const std::filesystem::path& folder,
                  const ReportPageInput& page, const Context& context);

// The same for each model of a run, in the folders 0, 1, ... of `folder`. The
// models are complete by then, so that a failure is only a warning.
void WriteFiguresOfModels(const std::filesystem::path& folder,
                          const MapperInput& input, const MapperResult& result,
                          const std::string& report_json,
                          const Context& context);

}  // namespace mgsfm
