// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>
#include <filesystem>
#include <optional>

namespace mgsfm {

// The folder of real images and trajectories, which are not part of the
// project: the environment variable MGSFM_SHARED_DATA, or shared/data next to
// the sources. nullopt if it does not exist; tests then skip:
//
//   const auto data = FindSharedData("kitti06_stereo");
//   if (!data) GTEST_SKIP() << "no kitti06_stereo; see shared_data.h";
inline std::optional<std::filesystem::path> FindSharedData(
    const std::filesystem::path& name) {
  const char* folder = std::getenv("MGSFM_SHARED_DATA");
  const std::filesystem::path root =
      folder != nullptr
          ? std::filesystem::path(folder)
          : std::filesystem::path(MGSFM_SOURCE_DIR).parent_path() / "shared" /
                "data";
  std::error_code ignored;
  if (!std::filesystem::exists(root / name, ignored)) return std::nullopt;
  return root / name;
}

}  // namespace mgsfm
