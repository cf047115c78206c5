// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/features/feature_extraction.h"
#include "mgsfm/io/database/database.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Which camera each image has, and the cameras themselves; see
// ImageReaderOptions.
class CameraAssignment {
 public:
  // `structure` tells the cameras of images that are in the database already.
  // Throws Error for bad options and for a bad file of cameras, which must have
  // all folders of `image_names`.
  CameraAssignment(const ImageReaderOptions& options,
                   const DatabaseContents& structure,
                   const std::vector<std::string>& image_names,
                   const Context& context);

  struct Result {
    Camera camera;
    bool is_new = false;  // Add must tell its id, if it is used
    std::string problem;  // why the image does not fit it, else ""
  };
  Result Find(const std::string& image_name, int width, int height,
              std::optional<double> focal_length_px) const;
  void Add(const std::string& image_name, const Camera& camera);

 private:
  enum class Mode { kSingle, kPerFolder, kPerImage };
  // Images with equal keys share a camera.
  std::string KeyOf(const std::string& image_name) const;
  Camera MakeCamera(const std::string& image_name, int width, int height,
                    std::optional<double> focal_length_px) const;
  void CheckFolders(const std::vector<std::string>& image_names,
                    const Context& context) const;

  ImageReaderOptions options_;
  Mode mode_ = Mode::kPerFolder;
  Camera template_{CameraId(0), CameraModelId::kSimpleRadial, 0, 0, {}, false};
  std::map<std::string, Camera> camera_of_folder_;  // in the file
  std::map<std::string, Camera> camera_of_image_;   // in the database
  std::map<std::string, Camera> camera_of_key_;
};

}  // namespace mgsfm
