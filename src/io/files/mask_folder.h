// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <filesystem>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// The path of the mask of an image, for all commands: a/b.jpg.png in the mask
// folder for a/b.jpg.
std::filesystem::path MaskPathOf(const std::filesystem::path& mask_path,
                                 const std::string& image_name);

// Removes the masks from the names of the files below a folder of images that
// also has the folder of masks in it.
void RemoveMasks(const std::filesystem::path& image_path,
                 const std::filesystem::path& mask_path,
                 std::vector<std::string>* names);

// Throws Error if no image has a mask in the folder, and warns of images
// without a mask, before any mask is used. `option` names the folder in
// messages. An empty path means no folder.
void CheckMasks(const std::filesystem::path& mask_path,
                const std::vector<std::string>& image_names,
                const std::string& option, const Context& context);

// The PNG file of a mask that hides some of the equal cells of an image, row by
// row.
struct HiddenCells {
  int num_rows = 0;
  int num_columns = 0;
  Mask is_hidden;
};
std::string EncodeMask(const HiddenCells& cells, int width_px, int height_px);

// Counts the masks that hide nothing, or all, for one warning each.
// Thread-safe.
class UselessMasks {
 public:
  void Count(bool hides_nothing, bool hides_all) {
    ++num_masks_;
    if (hides_nothing) ++num_empty_;
    if (hides_all) ++num_full_;
  }
  // `masks` names the folder or file.
  void Warn(const std::filesystem::path& masks, const Context& context) const;

 private:
  std::atomic<size_t> num_masks_{0};
  std::atomic<size_t> num_empty_{0};
  std::atomic<size_t> num_full_{0};
};

}  // namespace mgsfm
