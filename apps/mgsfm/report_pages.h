// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/mapper/mapper.h"

namespace mgsfm {

// Writes a page report.html into the folder of each model of a run, which must
// be complete. Returns the page of the first model, or "". Logs a warning
// instead of failing, also if it is interrupted.
std::string WriteReportPages(const std::filesystem::path& output_path,
                             const std::string& image_path,
                             const MapperInput& input,
                             const MapperResult& result,
                             const std::string& report_json,
                             const Context& context);

}  // namespace mgsfm
