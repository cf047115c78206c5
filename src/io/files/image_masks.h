// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {

// Where the user keeps masks, which hide black pixels (0). A pixel is hidden
// if the mask of its image or that of its camera hides it.
struct MaskPaths {
  // A folder with a mask per image, or empty.
  std::filesystem::path of_images;
  // A mask of all images, or a folder with a mask per folder of images, or
  // empty.
  std::filesystem::path of_cameras;

  bool empty() const { return of_images.empty() && of_cameras.empty(); }
};

// The path of the mask of an image or of the images in a folder, for all
// commands: a/b.jpg.png in the mask folder for a/b.jpg, a/b.png for a/b.
std::filesystem::path MaskPathOf(const std::filesystem::path& mask_path,
                                 const std::string& name);

// Removes the masks from the names of the files below a folder of images that
// also has masks in it.
void RemoveMasks(const std::filesystem::path& image_path,
                 const MaskPaths& mask_paths, std::vector<std::string>* names);

// The masks of images, for all commands. Reading is thread-safe.
class ImageMasks {
 public:
  ImageMasks(MaskPaths paths, int64_t max_num_pixels)
      : paths_(std::move(paths)), max_num_pixels_(max_num_pixels) {}

  // Throws Error if no image has a mask or the mask of a camera is damaged, and
  // warns of images and folders without a mask and of useless masks of cameras,
  // before any mask is used. `group` is that of the options, for messages.
  void Check(const std::vector<std::string>& image_names,
             const std::string& group, const Context& context) const;

  // The pixels that the masks of an image show, 255, and hide, 0; empty if it
  // has no mask. Throws Error, whose message continues the name of the image,
  // if a mask is damaged or differs in size.
  cv::Mat Read(const std::string& image_name,
               std::optional<cv::Size> size = std::nullopt) const;

  // Warns of masks of images, of those read, that hide nothing or all.
  void WarnOfUselessMasks(const Context& context) const;

 private:
  struct Counts {
    void Add(const cv::Mat& mask);
    void Warn(const std::filesystem::path& masks, const Context& context) const;

    std::atomic<size_t> num_masks{0};
    std::atomic<size_t> num_empty{0};
    std::atomic<size_t> num_full{0};
  };
  void CheckFolderOfImages(const std::vector<std::string>& image_names,
                           const std::string& option,
                           const Context& context) const;
  void CheckFolderOfCameras(const std::vector<std::string>& image_names,
                            const std::string& option,
                            const Context& context) const;
  // The mask of the camera of an image: of its folder, or of the nearest one
  // around it. Empty if there is none.
  std::filesystem::path CameraMaskOf(const std::string& image_name) const;

  const MaskPaths paths_;
  const int64_t max_num_pixels_;
  mutable Counts counts_;  // of masks of images
};

// The PNG file of a mask that hides some of the equal cells of an image, row by
// row.
struct HiddenCells {
  int num_rows = 0;
  int num_columns = 0;
  Mask is_hidden;
};
std::string EncodeMask(const HiddenCells& cells, int width_px, int height_px);

}  // namespace mgsfm
