// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"
#include "mgsfm/features/feature_extraction.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Assigns cameras to images; see ImageReaderOptions.
class CameraAssignment {
 public:
  // `structure` holds the cameras of the images in the database. Throws Error
  // for invalid options and for an invalid camera_params_path, which must
  // contain all folders of `image_names`.
  CameraAssignment(const ImageReaderOptions& options,
                   const DatabaseContents& structure,
                   const std::vector<std::string>& image_names,
                   const Context& context);

  struct Result {
    Camera camera;
    bool is_new = false;                 // call Add with its id if it is used
    std::optional<std::string> problem;  // why the image does not fit
  };
  Result Find(const std::string& image_name, int width, int height,
              std::optional<double> focal_length_px) const;
  void Add(const std::string& image_name, const Camera& camera);

  // Images with equal keys share a camera, which the first of them defines.
  std::string KeyOf(const std::string& image_name) const;

 private:
  enum class Mode { kSingle, kPerFolder, kPerImage };
  Camera MakeCamera(const std::string& image_name, int width, int height,
                    std::optional<double> focal_length_px) const;
  void CheckFolders(const std::vector<std::string>& image_names,
                    const Context& context) const;
  // If the options give intrinsics that the database contradicts.
  void WarnOfOtherIntrinsics(const Context& context) const;

  ImageReaderOptions options_;
  Mode mode_ = Mode::kPerFolder;
  Camera template_{CameraId(0), CameraModelId::kSimpleRadial, 0, 0, {}, false};
  std::map<std::string, Camera> camera_of_folder_;  // of camera_params_path
  std::map<std::string, Camera> camera_of_image_;   // of the database
  std::map<std::string, Camera> camera_of_key_;
};

}  // namespace mgsfm
