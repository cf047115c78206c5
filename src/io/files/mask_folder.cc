// SPDX-License-Identifier: BSD-3-Clause
#include "files/mask_folder.h"

#include <opencv2/core.hpp>
#include <system_error>

#include "files/image_writing.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

namespace fs = std::filesystem;

fs::path MaskPathOf(const fs::path& mask_path, const std::string& image_name) {
  return mask_path / (image_name + ".png");
}

void CheckMasks(const fs::path& mask_path,
                const std::vector<std::string>& image_names,
                const std::string& option, const Context& context) {
  if (mask_path.empty() || image_names.empty()) return;
  const std::string folder = "'" + mask_path.string() + "' (" + option + ")";
  size_t num_missing = 0;
  std::string example;
  for (const std::string& name : image_names) {
    std::error_code ignored;
    if (fs::exists(MaskPathOf(mask_path, name), ignored)) continue;
    if (num_missing++ == 0) example = name;
  }
  if (num_missing == 0) return;
  const std::string remedy =
      "'" + example + "'; name its mask '" + example + ".png'";
  if (num_missing == image_names.size()) {
    throw Error("no image has a mask in " + folder + ", such as " + remedy);
  }
  context.Warning(std::to_string(num_missing) + " of " +
                  std::to_string(image_names.size()) +
                  " images have no mask in " + folder + ", such as " + remedy);
}

std::string EncodeMask(const HiddenCells& cells, int width_px, int height_px) {
  cv::Mat mask(height_px, width_px, CV_8UC1);
  for (int y = 0; y < height_px; ++y) {
    const auto row =
        static_cast<size_t>((y + 0.5) / height_px * cells.num_rows);
    for (int x = 0; x < width_px; ++x) {
      const auto column =
          static_cast<size_t>((x + 0.5) / width_px * cells.num_columns);
      mask.at<uint8_t>(y, x) =
          cells.is_hidden[row * cells.num_columns + column] ? 0 : 255;
    }
  }
  return EncodeImage(".png", mask);
}

void EmptyMasks::Warn(const fs::path& mask_path, const Context& context) const {
  if (num_empty_ == 0) return;
  context.Warning(std::to_string(num_empty_) + " of " +
                  std::to_string(num_masks_) + " masks in '" +
                  mask_path.string() +
                  "' hide nothing; make pixels black (0) to hide them");
}

}  // namespace mgsfm
