// SPDX-License-Identifier: BSD-3-Clause
#include "early_checks.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>
#include <utility>

#include "base/file_reading.h"
#include "base/text_tools.h"
#include "files/image_limits.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"
#include "models/rows_to_scene.h"
#include "named_model.h"
#include "priors/trajectory_positions.h"
#include "rigs/image_timestamps.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

std::optional<ImageSize> SizeOf(const fs::path& path) {
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return std::nullopt;
  return ReadImageSize(ReadFile(path, "", kMaxImageHeaderBytes));
}

Camera CameraOf(CameraId id, const ImageSize& size) {
  const auto width = static_cast<double>(size.width);
  const auto height = static_cast<double>(size.height);
  return {id,
          CameraModelId::kSimplePinhole,
          static_cast<int>(size.width),
          static_cast<int>(size.height),
          {std::max(width, height), 0.5 * width, 0.5 * height},
          false};
}

// One camera per folder, with the size of its first image. Files before it are
// no images and will be rejected.
DatabaseContents RowsOf(const std::string& image_path,
                        const std::vector<std::string>& names) {
  DatabaseContents rows;
  rows.path = image_path;
  std::map<std::string, CameraId> camera_of_folder;
  for (const std::string& name : names) {
    const std::string folder = FolderOfName(name);
    if (camera_of_folder.count(folder) == 0) {
      const auto size = SizeOf(fs::path(image_path) / name);
      if (!size) continue;
      const CameraId id(static_cast<uint32_t>(rows.cameras.size() + 1));
      rows.cameras.push_back(CameraOf(id, *size));
      camera_of_folder.emplace(folder, id);
    }
    rows.images.push_back(
        {ImageId(static_cast<uint32_t>(rows.images.size() + 1)),
         name,
         camera_of_folder.at(folder),
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
  DatabaseContents rows = RowsOf(image_path, names);
  if (rows.images.empty()) return;
  (void)BuildSceneOfRows("image folder", std::move(rows), loading, Context());
}

void CheckValuesOfImages(const std::vector<std::string>& names,
                         const std::string& image_timestamps_path,
                         const PosePriorOptions& priors) {
  Scene scene;
  for (const std::string& name : names) {
    const auto id = static_cast<uint32_t>(scene.images.size() + 1);
    scene.images.push_back({ImageId(id), name, 0, 0, 0, {}});
  }
  if (!image_timestamps_path.empty()) {
    CheckImageTimes(image_timestamps_path, names);
  }
  // Trajectories need the frames, too.
  const std::string& positions = priors.ref_images_path;
  if (!positions.empty() &&
      DetectPositionFormat(positions) == PositionFileFormat::kNamed) {
    (void)ReadPositionPriors(scene, "", priors);
  }
  if (!priors.gravity_path->empty()) (void)ReadGravity(scene, "", priors);
}

}  // namespace mgsfm
