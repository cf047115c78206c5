// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "features/sift.h"

namespace mgsfm {

// Metadata of an image (EXIF).
struct ImageTags {
  std::optional<double> focal_length_px;
  // Latitude and longitude in degrees, altitude in metres. As in COLMAP, a
  // missing altitude is 0.
  std::optional<Eigen::Vector3d> position_wgs84;
};

// Reads the metadata of an image file with the content `file`. Damaged or
// implausible values are nullopt.
ImageTags ReadTags(const std::vector<uint8_t>& file, int width, int height);

struct ImageFile {
  GrayImage gray;
  ImageTags tags;
};

// Both throw Error with a message that continues the name of the file: "is
// truncated; ...".
ImageFile ReadImageFile(const std::filesystem::path& path);
// nullopt if there is no such file.
std::optional<GrayImage> ReadMask(const std::filesystem::path& path);

// During its lifetime, the libraries that decode images use one thread and
// print no messages.
class QuietImageLibraries {
 public:
  QuietImageLibraries();
  ~QuietImageLibraries();
  QuietImageLibraries(const QuietImageLibraries&) = delete;
  QuietImageLibraries& operator=(const QuietImageLibraries&) = delete;

 private:
  int num_threads_;
  int log_level_;
};

}  // namespace mgsfm
