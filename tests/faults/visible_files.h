// SPDX-License-Identifier: BSD-3-Clause
// The files of a folder that users see.
#pragma once

#include <filesystem>

#include "cli/program_runs.h"

namespace mgsfm {

constexpr char kDamaged[] = "damaged";

// The features of all images by name. An image that one run leaves out and the
// next one adds gets a different id from that in a run without faults.
std::string FeaturesByName(const std::filesystem::path& path);

// Contents of the files that users see. Databases count by their rows, which
// opening them first restores, or as kDamaged; reports, which hold times, by
// their end.
Files VisibleFiles(const std::filesystem::path& folder);

// Names of files that only one side has or that differ.
std::string Differences(const Files& a, const Files& b);

bool HasHiddenFiles(const std::filesystem::path& folder);

}  // namespace mgsfm
