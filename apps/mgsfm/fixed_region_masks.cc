// SPDX-License-Identifier: BSD-3-Clause
#include "fixed_region_masks.h"

#include <exception>
#include <map>
#include <string>

#include "files/file_operations.h"
#include "files/mask_folder.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

namespace fs = std::filesystem;

namespace {

size_t WriteMasks(const fs::path& folder, const Scene& scene,
                  const MapperResult& result) {
  std::map<int, const FixedRegion*> of_sensor;
  for (const FixedRegion& region : result.fixed_regions) {
    of_sensor[region.sensor_idx] = &region;
  }
  std::map<std::pair<int, int>, std::string> files;  // per sensor and camera
  size_t num_masks = 0;
  for (const Image& image : scene.images) {
    const auto found = of_sensor.find(image.sensor_idx);
    if (found == of_sensor.end()) continue;
    const FixedRegion& region = *found->second;
    std::string& file = files[{image.sensor_idx, image.camera_idx}];
    if (file.empty()) {
      const Camera& camera = scene.cameras[image.camera_idx];
      file = EncodeMask({region.num_rows, region.num_columns, region.is_fixed},
                        camera.width_px, camera.height_px);
    }
    const fs::path path = MaskPathOf(folder, image.name);
    fs::create_directories(path.parent_path());
    ReplaceFile(path, file);
    ++num_masks;
  }
  return num_masks;
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
                           const MapperResult& result, const Context& context) {
  if (result.fixed_regions.empty()) {
    context.Info("no masks: no image shows what moves along with the rig");
    return;
  }
  try {
    const size_t num_masks = WriteMasks(folder, scene, result);
    context.Info("masks of " + std::to_string(num_masks) + " images: give '" +
                 folder.string() + "' to ImageReader.mask_path");
  } catch (const std::exception& error) {
    context.Warning("the models are complete, but the masks in '" +
                    folder.string() + "' were not written: " + error.what());
  }
}

}  // namespace mgsfm
