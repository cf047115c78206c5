// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "mgsfm/features/sift.h"

namespace mgsfm {

// What an image says of itself (EXIF).
struct ImageTags {
  std::optional<double> focal_length_px;
  // Latitude and longitude in degrees, altitude in metres, 0 if not told.
  std::optional<Eigen::Vector3d> position_wgs84;
};

// `file` is the content of an image file of that size; nothing for what is
// damaged or makes no sense.
ImageTags ReadTags(const std::vector<uint8_t>& file, int width, int height);

struct ImageFile {
  GrayImage gray;
  ImageTags tags;
};

// These throw Error without a name: "is truncated; ...".
ImageFile ReadImageFile(const std::filesystem::path& path);
// Nullopt if there is no such file.
std::optional<GrayImage> ReadMask(const std::filesystem::path& path);

// While it lives, the libraries that decode images use one thread each and
// write no messages of their own.
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
