// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "exchange/imported_model.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// The points of a model with their colors as a PLY file, binary,
// little-endian.
std::string PointsToPly(const Reconstruction& model);

// Points of a PLY file, ASCII or binary little-endian, whose first element is
// `vertex`, with x, y, z and, if it has them, red, green, blue. Throws Error,
// naming the file, for other files and truncated ones.
std::vector<ImportedPoint> ReadPly(const std::filesystem::path& path);

}  // namespace mgsfm
