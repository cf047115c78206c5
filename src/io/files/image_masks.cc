// SPDX-License-Identifier: BSD-3-Clause
#include "files/image_masks.h"

#include <opencv2/imgcodecs.hpp>
#include <set>
#include <system_error>

#include "base/file_reading.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "files/image_reading.h"
#include "files/image_writing.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

namespace fs = std::filesystem;

fs::path MaskPathOf(const fs::path& mask_path, const std::string& name) {
  return mask_path / (name + ".png");
}

namespace {

// The path below the image folder; nullopt outside it.
std::optional<std::string> PathBelow(const fs::path& path,
                                     const fs::path& image_path) {
  if (path.empty()) return std::nullopt;
  std::error_code ignored;
  const fs::path below =
      fs::weakly_canonical(path, ignored)
          .lexically_relative(fs::weakly_canonical(image_path, ignored));
  if (below.empty() || *below.begin() == "..") return std::nullopt;
  return below == "." ? "" : below.string();
}

// A mask as CV_8U: 0 hides, 255 shows, also for masks of more than 8 bits.
// Throws Error; its message continues the file name: "is truncated; ...".
cv::Mat ReadMask(const fs::path& path, int64_t max_num_pixels) {
  const DecodedImage mask =
      DecodeImage(ReadFile(path, "is a file that"),
                  cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH |
                      cv::IMREAD_IGNORE_ORIENTATION,
                  max_num_pixels);
  return mask.pixels != 0;
}

// The first PNG file below the folder that is neither a mask in use nor an
// image; empty if there is none.
std::string FindMisnamedMask(const fs::path& folder,
                             const std::set<fs::path>& used,
                             const std::vector<std::string>& image_names) {
  const std::set<std::string> images(image_names.begin(), image_names.end());
  std::string first;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder, error), end;
       !error && it != end; it.increment(error)) {
    const std::string name = it->path().lexically_relative(folder).string();
    if (it->path().extension() != ".png" || used.count(it->path()) > 0 ||
        images.count(name) > 0) {
      continue;
    }
    if (first.empty() || name < first) first = name;
  }
  return first;
}

}  // namespace

void RemoveMasks(const fs::path& image_path, const MaskPaths& mask_paths,
                 std::vector<std::string>* names) {
  const auto of_images = PathBelow(mask_paths.of_images, image_path);
  const auto of_cameras = PathBelow(mask_paths.of_cameras, image_path);
  if (!of_images && !of_cameras) return;
  const std::set<std::string> all(names->begin(), names->end());
  const auto is_mask = [&](const std::string& name) {
    // A folder of its own holds masks only.
    for (const auto& path : {of_images, of_cameras}) {
      if (!path || path->empty()) continue;
      if (name.compare(0, path->size() + 1, *path + '/') == 0) return true;
    }
    if (of_cameras == name) return true;
    if (fs::path(name).extension() != ".png") return false;
    // Masks in the image folder are beside the images that they hide.
    const std::string hidden = name.substr(0, name.size() - 4);
    const auto inside = all.lower_bound(hidden + '/');
    const bool is_of_folder =
        inside != all.end() &&
        inside->compare(0, hidden.size() + 1, hidden + '/') == 0;
    return (of_images == "" && all.count(hidden) > 0) ||
           (of_cameras == "" && is_of_folder);
  };
  EraseIf(names, is_mask);
}

void ImageMasks::Check(const std::vector<std::string>& image_names,
                       const std::string& group, const Context& context) const {
  if (image_names.empty()) return;
  if (!paths_.of_images.empty()) {
    CheckFolderOfImages(image_names, group + "mask_path", context);
  }
  if (paths_.of_cameras.empty()) return;
  const std::string option = group + "camera_mask_path";
  std::error_code ignored;
  if (fs::is_directory(paths_.of_cameras, ignored)) {
    CheckFolderOfCameras(image_names, option, context);
  }
  std::set<fs::path> masks;
  for (const std::string& name : image_names) masks.insert(CameraMaskOf(name));
  masks.erase(fs::path());
  Counts counts;
  for (const fs::path& mask : masks) {
    try {
      if (!fs::is_regular_file(mask, ignored)) {
        throw Error("is neither a file nor a folder; check the path");
      }
      counts.Add(ReadMask(mask, max_num_pixels_));
    } catch (const Error& error) {
      throw Error("mask '" + mask.string() + "' (" + option + ") " +
                  error.what());
    }
  }
  counts.Warn(paths_.of_cameras, context);
}

void ImageMasks::CheckFolderOfImages(
    const std::vector<std::string>& image_names, const std::string& option,
    const Context& context) const {
  const std::string folder =
      "'" + paths_.of_images.string() + "' (" + option + ")";
  std::error_code ignored;
  if (!fs::is_directory(paths_.of_images, ignored)) {
    throw Error(folder +
                " is not a folder; give the one with a mask per image");
  }
  size_t num_missing = 0;
  std::string example;
  for (const std::string& name : image_names) {
    if (fs::exists(MaskPathOf(paths_.of_images, name), ignored)) continue;
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

void ImageMasks::CheckFolderOfCameras(
    const std::vector<std::string>& image_names, const std::string& option,
    const Context& context) const {
  std::set<std::string> folders, missing;
  std::set<fs::path> used;
  for (const std::string& name : image_names) {
    const std::string folder = FolderOfName(name);
    if (!folders.insert(folder).second) continue;
    const fs::path mask = CameraMaskOf(name);
    if (mask.empty()) missing.insert(folder);
    used.insert(mask);
  }
  if (missing.empty()) return;
  const std::string& folder = *missing.rbegin();
  std::string text =
      " in '" + paths_.of_cameras.string() + "' (" + option + "), such as ";
  text += folder.empty()
              ? "the image folder itself; give the file of its mask"
              : "'" + folder + "'; name its mask '" + folder + ".png'";
  const std::string misnamed =
      FindMisnamedMask(paths_.of_cameras, used, image_names);
  if (!misnamed.empty()) {
    text += "; '" + misnamed + "' is named after no folder";
  }
  if (missing.size() == folders.size()) {
    throw Error("no folder of images has a mask" + text);
  }
  context.Warning(std::to_string(missing.size()) + " of " +
                  std::to_string(folders.size()) +
                  " folders of images have no mask" + text);
}

fs::path ImageMasks::CameraMaskOf(const std::string& image_name) const {
  std::error_code ignored;
  if (!fs::is_directory(paths_.of_cameras, ignored)) return paths_.of_cameras;
  for (std::string folder = FolderOfName(image_name); !folder.empty();
       folder = FolderOfName(folder)) {
    fs::path path = MaskPathOf(paths_.of_cameras, folder);
    if (fs::exists(path, ignored)) return path;
  }
  return {};
}

cv::Mat ImageMasks::Read(const std::string& image_name,
                         std::optional<cv::Size> size) const {
  cv::Mat shown;
  const auto add = [&](const fs::path& path) {
    cv::Mat mask;
    try {
      mask = ReadMask(path, max_num_pixels_);
    } catch (const Error& error) {
      throw Error("has a mask '" + path.string() + "' that " + error.what());
    }
    if (!size) size = mask.size();
    if (mask.size() != *size) {
      throw Error("has " + SizeText(size->width, size->height) +
                  " pixels, but its mask '" + path.string() + "' has " +
                  SizeText(mask.cols, mask.rows) +
                  "; use a mask of the size of the image");
    }
    if (shown.empty())
      shown = mask;
    else
      shown &= mask;
    return mask;
  };
  std::error_code ignored;
  if (!paths_.of_images.empty()) {
    const fs::path path = MaskPathOf(paths_.of_images, image_name);
    if (fs::is_regular_file(path, ignored)) counts_.Add(add(path));
  }
  if (!paths_.of_cameras.empty()) {
    const fs::path path = CameraMaskOf(image_name);
    if (!path.empty()) add(path);
  }
  return shown;
}

void ImageMasks::Counts::Add(const cv::Mat& mask) {
  const int num_shown = cv::countNonZero(mask);
  ++num_masks;
  if (num_shown == mask.rows * mask.cols) ++num_empty;
  if (num_shown == 0) ++num_full;
}

void ImageMasks::Counts::Warn(const fs::path& masks,
                              const Context& context) const {
  const auto warn = [&](size_t count, const char* problem) {
    if (count == 0) return;
    context.Warning(std::to_string(count) + " of " + std::to_string(num_masks) +
                    " masks in '" + masks.string() + "' " + problem);
  };
  warn(num_empty, "hide nothing; make pixels black (0) to hide them");
  warn(num_full,
       "hide the whole image; black (0) hides, so that masks of the opposite "
       "meaning must be inverted");
}

void ImageMasks::WarnOfUselessMasks(const Context& context) const {
  counts_.Warn(paths_.of_images, context);
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

}  // namespace mgsfm
