// SPDX-License-Identifier: BSD-3-Clause
#include "fixed_region_masks.h"

#include <exception>
#include <map>
#include <string>
#include <system_error>
#include <utility>

#include "base/text_tools.h"
#include "files/file_operations.h"
#include "files/image_masks.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Images of one sensor and camera have the same fixed regions and size.
using MaskKey = std::pair<int, int>;

MaskKey MaskKeyOf(const Image& image) {
  return {image.sensor_idx, image.camera_idx};
}

// The mask of each folder of images, as ImageReader.camera_mask_path looks it
// up; empty if some image would find another mask than its own.
std::map<std::string, MaskKey> FindMaskOfFolders(
    const Scene& scene, const std::map<MaskKey, std::string>& files) {
  std::map<std::string, MaskKey> of_folder;
  for (const Image& image : scene.images) {
    if (files.count(MaskKeyOf(image)) == 0) continue;
    const std::string folder = FolderOfName(image.name);
    if (folder.empty()) return {};
    of_folder.emplace(folder, MaskKeyOf(image));
  }
  for (const Image& image : scene.images) {
    std::string folder = FolderOfName(image.name);
    while (!folder.empty() && of_folder.count(folder) == 0) {
      folder = FolderOfName(folder);
    }
    const bool is_found = !folder.empty();
    const bool is_needed = files.count(MaskKeyOf(image)) > 0;
    if (is_found != is_needed ||
        (is_found && of_folder.at(folder) != MaskKeyOf(image))) {
      return {};
    }
  }
  return of_folder;
}

std::map<MaskKey, std::string> EncodeMasks(
    const Scene& scene, const std::vector<FixedRegion>& regions) {
  std::map<int, const FixedRegion*> of_sensor;
  for (const FixedRegion& region : regions) {
    of_sensor[region.sensor_idx] = &region;
  }
  std::map<MaskKey, std::string> files;
  for (const Image& image : scene.images) {
    const auto found = of_sensor.find(image.sensor_idx);
    if (found == of_sensor.end() || files.count(MaskKeyOf(image)) > 0) continue;
    const FixedRegion& region = *found->second;
    const Camera& camera = scene.cameras[image.camera_idx];
    files[MaskKeyOf(image)] =
        EncodeMask({region.num_rows, region.num_columns, region.is_fixed},
                   camera.width_px, camera.height_px);
  }
  return files;
}

void WriteMask(const fs::path& path, const std::string& file) {
  fs::create_directories(path.parent_path());
  ReplaceFile(path, file);
}

// Returns what was written and the option that reads it.
std::string WriteMasks(const fs::path& folder, const Scene& scene,
                       const std::vector<FixedRegion>& regions) {
  const std::map<MaskKey, std::string> files = EncodeMasks(scene, regions);
  const std::map<std::string, MaskKey> of_folder =
      FindMaskOfFolders(scene, files);
  for (const auto& [image_folder, key] : of_folder) {
    WriteMask(MaskPathOf(folder, image_folder), files.at(key));
  }
  const std::string give = ": give '" + folder.string() + "' to ImageReader.";
  if (!of_folder.empty()) {
    return "masks of the cameras of " + std::to_string(of_folder.size()) +
           " folders" + give + "camera_mask_path";
  }
  size_t num_masks = 0;
  for (const Image& image : scene.images) {
    const auto found = files.find(MaskKeyOf(image));
    if (found == files.end()) continue;
    WriteMask(MaskPathOf(folder, image.name), found->second);
    ++num_masks;
  }
  return "masks of " + std::to_string(num_masks) + " images" + give +
         "mask_path";
}

}  // namespace

void CheckFixedRegionFolder(const fs::path& folder) {
  std::error_code error;
  if (folder.empty() || !fs::exists(folder, error)) return;
  if (fs::is_directory(folder, error) && fs::is_empty(folder, error)) return;
  throw Error("fixed_region_mask_path '" + folder.string() +
              "' is not an empty folder; name a new one");
}

void WriteFixedRegionMasks(const fs::path& folder, const Scene& scene,
                           const std::vector<FixedRegion>& regions,
                           const Context& context) {
  if (regions.empty()) {
    context.Info("no masks: no image shows what moves along with the rig");
    return;
  }
  try {
    context.Info(WriteMasks(folder, scene, regions));
  } catch (const std::exception& error) {
    context.Warning("the models are complete, but the masks in '" +
                    folder.string() + "' were not written: " + error.what());
  }
}

}  // namespace mgsfm
