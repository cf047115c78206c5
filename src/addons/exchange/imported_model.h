// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "mgsfm/models/model_io.h"

namespace mgsfm {

// The words and lines of a text file. All functions throw Error, naming the
// file and the line, what was expected there, and what was found.
class ImportText {
 public:
  explicit ImportText(const std::filesystem::path& path);

  // The next words, across lines.
  double Number(const char* expected);
  uint64_t Count(const char* expected);
  uint8_t Color(const char* expected);

  // The rest of the current line, without the blanks around it.
  std::string_view RestOfLine();
  // The next line that is not blank, without the blanks around it; empty at the
  // end of the file.
  std::string_view NextLine();

  const std::filesystem::path& path() const { return path_; }
  [[noreturn]] void Throw(const std::string& problem) const;
  [[noreturn]] void ThrowUnexpected(const char* expected,
                                    std::string_view found) const;

 private:
  std::string_view Word(const char* expected);

  std::filesystem::path path_;
  std::string text_;
  size_t position_ = 0;
  int line_ = 1;
};

// The id of all imported cameras until MakeModel numbers them.
constexpr CameraId kUnnumbered{1};

// An image as other programs describe it, with intrinsics of its own.
struct ImportedImage {
  std::string name;
  Rigid3 cam_from_world;
  Camera camera;
};

struct ImportedObservation {
  size_t image_place = 0;  // in ImportedModel::images
  Eigen::Vector2d pixel;
};

struct ImportedPoint {
  Eigen::Vector3d point_in_world = Eigen::Vector3d::Zero();
  Eigen::Matrix<uint8_t, 3, 1> color = Eigen::Matrix<uint8_t, 3, 1>::Zero();
  std::vector<ImportedObservation> track;
};

struct ImportedModel {
  std::vector<ImportedImage> images;
  std::vector<ImportedPoint> points;
};

// A model in the types of COLMAP. Images of one folder with equal intrinsics
// share a camera. The keypoints of an image are its observations, in the order
// of the points. Throws Error, naming `path`, if there is no image, if two have
// the same name, and for values that no model may have.
Model MakeModel(ImportedModel imported, const std::filesystem::path& path);

// A camera with one focal length and radial distortion, of the simplest camera
// model that has it.
Camera MakeRadialCamera(double focal_length_px,
                        const Eigen::Vector2d& principal_point_px, double k1,
                        double k2, const Eigen::Vector2i& size_px);

// The size of an image from its file; nullopt if it cannot be read.
std::optional<Eigen::Vector2i> FindSizeOfImage(
    const std::filesystem::path& file);

// The same of an image in a folder. Throws Error, naming the image and
// `path`, the file that lacks the size, if image_path is empty or has no such
// image.
Eigen::Vector2i ReadSizeOfImage(const std::filesystem::path& image_path,
                                const std::string& image_name,
                                const std::filesystem::path& path);

}  // namespace mgsfm
