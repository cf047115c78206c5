// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/features/feature_extraction.h"

namespace mgsfm {

// From images to a database on disk, as commands share it. Throws Error for bad
// input; then a database that held nothing before is removed.
void ExtractInto(const std::string& database_path,
                 const std::string& image_path,
                 const FeatureExtractionOptions& options,
                 const Context& context);

}  // namespace mgsfm
