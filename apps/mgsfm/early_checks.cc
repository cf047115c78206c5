// SPDX-License-Identifier: BSD-3-Clause
#include "early_checks.h"

#include <filesystem>
#include <map>
#include <utility>

#include "base/file_reading.h"
#include "base/text_tools.h"
#include "io/files/image_reading.h"
#include "io/models/rows_to_scene.h"
#include "mgsfm/base/error.h"
#include "named_model.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// The size of an image; of one that cannot be read, any.
ImageSize SizeOf(const fs::path& path) {
  constexpr size_t kHeaderBytes = 1 << 20;
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return {1, 1};
  return ReadImageSize(ReadFile(path, "", kHeaderBytes))
      .value_or(ImageSize{1, 1});
}

// One camera per folder, with the size of its first image.
DatabaseContents RowsOf(const std::string& image_path,
                        const std::vector<std::string>& names) {
  DatabaseContents rows;
  rows.path = image_path;
  std::map<std::string, CameraId> camera_of_folder;
  for (const std::string& name : names) {
    const CameraId next(static_cast<uint32_t>(camera_of_folder.size() + 1));
    const auto [camera, is_new] =
        camera_of_folder.emplace(FolderOfName(name), next);
    if (is_new) {
      const ImageSize size = SizeOf(fs::path(image_path) / name);
      rows.cameras.push_back({next,
                              CameraModelId::kSimplePinhole,
                              static_cast<int>(size.width),
                              static_cast<int>(size.height),
                              {1.0, 0.5, 0.5},
                              false});
    }
    rows.images.push_back(
        {ImageId(static_cast<uint32_t>(rows.images.size() + 1)),
         name,
         camera->second,
         {}});
  }
  return rows;
}

}  // namespace

void CheckPathsExist(const std::vector<NamedPath>& paths) {
  for (const NamedPath& path : paths) {
    std::error_code ignored;
    if (path.value.empty() || fs::exists(path.value, ignored)) continue;
    for (const std::string& item : SplitList(path.value)) {
      if (fs::exists(item, ignored)) continue;
      throw Error("'" + item + "' (--" + path.option +
                  ") does not exist; check the path");
    }
  }
}

void CheckRigsOfImages(const std::string& image_path,
                       const std::vector<std::string>& names,
                       const SceneLoadingOptions& loading) {
  const std::string& rule = loading.rig_name_rule;
  const bool has_rule = rule != "auto" && rule != "none";
  if (!has_rule && !loading.HasKnownRig()) return;
  if (loading.PairsFramesByTime()) return;
  (void)BuildSceneOfRows("image folder", RowsOf(image_path, names), loading,
                         Context());
}

}  // namespace mgsfm
