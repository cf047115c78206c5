// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "features/sift.h"

namespace mgsfm {

// Metadata of an image (EXIF).
struct ImageTags {
  std::optional<double> focal_length_px;
  // Latitude and longitude in degrees, altitude in meters. As in COLMAP, a
  // missing altitude is 0.
  std::optional<Eigen::Vector3d> position_wgs84;
  // DateTimeOriginal with SubSecTimeOriginal, interpreted as UTC.
  std::optional<double> time_s;
};

// Reads the metadata of an image file with the content `file`. Damaged or
// implausible values are nullopt.
ImageTags ReadTags(const std::string& file, int width, int height);

struct ImageFile {
  GrayImage gray;
  ImageTags tags;
  std::string warning;  // of the decoder; empty if there is none
};

// All functions throw Error; its message continues the file name: "is
// truncated; ...".
std::string ReadImageFile(const std::filesystem::path& path);
ImageFile DecodeImageFile(const std::string& file, int64_t max_num_pixels);

}  // namespace mgsfm
