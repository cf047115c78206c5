// SPDX-License-Identifier: BSD-3-Clause
#include "files/mask_folder.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <set>
#include <system_error>

#include "files/image_writing.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

namespace fs = std::filesystem;

fs::path MaskPathOf(const fs::path& mask_path, const std::string& image_name) {
  return mask_path / (image_name + ".png");
}

void RemoveMasks(const fs::path& image_path, const fs::path& mask_path,
                 std::vector<std::string>* names) {
  if (mask_path.empty()) return;
  std::error_code ignored;
  const fs::path below =
      fs::weakly_canonical(mask_path, ignored)
          .lexically_relative(fs::weakly_canonical(image_path, ignored));
  if (below.empty() || *below.begin() == "..") return;
  const std::string prefix = below == "." ? "" : below.string() + '/';
  const std::set<std::string> all(names->begin(), names->end());
  const auto is_mask = [&](const std::string& name) {
    if (name.compare(0, prefix.size(), prefix) != 0) return false;
    // A folder of its own holds masks only.
    return !prefix.empty() || (fs::path(name).extension() == ".png" &&
                               all.count(name.substr(0, name.size() - 4)) > 0);
  };
  names->erase(std::remove_if(names->begin(), names->end(), is_mask),
               names->end());
}

void CheckMasks(const fs::path& mask_path,
                const std::vector<std::string>& image_names,
                const std::string& option, const Context& context) {
  if (mask_path.empty() || image_names.empty()) return;
  const std::string folder = "'" + mask_path.string() + "' (" + option + ")";
  std::error_code ignored;
  if (!fs::is_directory(mask_path, ignored)) {
    throw Error(folder +
                " is not a folder; give the one with a mask per image");
  }
  size_t num_missing = 0;
  std::string example;
  for (const std::string& name : image_names) {
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

void UselessMasks::Warn(const fs::path& masks, const Context& context) const {
  const auto warn = [&](size_t count, const char* problem) {
    if (count == 0) return;
    context.Warning(std::to_string(count) + " of " +
                    std::to_string(num_masks_) + " masks in '" +
                    masks.string() + "' " + problem);
  };
  warn(num_empty_, "hide nothing; make pixels black (0) to hide them");
  warn(num_full_,
       "hide the whole image; black (0) hides, so that masks of the opposite "
       "meaning must be inverted");
}

}  // namespace mgsfm
