// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <utility>

#include "mgsfm/base/options.h"

namespace mgsfm {

enum class CleanedRows { kAll, kImages, kFeatures, kMatches };

template <>
struct EnumTable<CleanedRows> {
  static constexpr std::pair<std::string_view, CleanedRows> kNames[] = {
      {"all", CleanedRows::kAll},
      {"images", CleanedRows::kImages},
      {"features", CleanedRows::kFeatures},
      {"matches", CleanedRows::kMatches}};
};

// Deletes rows of a database in one transaction, and whatever refers to them:
// matches with two-view geometries; features with matches; images with
// features, frames and priors; all with rigs and cameras. Throws Error if the
// file is not a COLMAP database or is in use.
void CleanDatabase(const std::string& path, CleanedRows rows);

}  // namespace mgsfm
