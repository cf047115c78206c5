// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/features/feature_extraction.h"

namespace mgsfm {

// Extracts the features of images, or of a share of them, into a database on
// disk. Throws Error for bad input, after removing a database that it created
// and left empty.
void ExtractInto(const std::string& database_path,
                 const std::string& image_path,
                 const FeatureExtractionOptions& options,
                 const std::optional<Share>& share, const Context& context);

}  // namespace mgsfm
