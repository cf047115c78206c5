// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/radial_camera.h"

#include <algorithm>
#include <cmath>

#include "base/format.h"
#include "mgsfm/base/error.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {
namespace {

// Rounding of focal lengths that are meant to be equal.
constexpr double kSameFocalLength = 1e-9;

[[noreturn]] void Throw(const Scene& scene, int camera_idx,
                        const std::string& format, const std::string& problem) {
  throw Error(CameraLabel(scene, camera_idx) + " " + problem + ", which " +
              format +
              " cannot represent; undistort the images first, or choose "
              "another output_type");
}

RadialCamera ToRadialCamera(const ExportInput& input, int camera_idx,
                            const std::string& format,
                            int max_num_coefficients) {
  const Camera& camera = input.model.cameras[camera_idx];
  const CameraModelInfo& info =
      *FindCameraModel(static_cast<int32_t>(camera.model));
  const bool is_radial = camera.model == CameraModelId::kSimplePinhole ||
                         camera.model == CameraModelId::kPinhole ||
                         camera.model == CameraModelId::kSimpleRadial ||
                         camera.model == CameraModelId::kRadial;
  if (!is_radial) {
    Throw(input.scene, camera_idx, format,
          "is of the model " + std::string(info.name));
  }
  const double first = camera.params[info.focal_length_idxs.front()];
  const double last = camera.params[info.focal_length_idxs.back()];
  if (std::abs(first - last) > kSameFocalLength * first) {
    Throw(input.scene, camera_idx, format, "has two focal lengths");
  }
  RadialCamera radial{first,
                      {camera.params[info.principal_point_idxs[0]],
                       camera.params[info.principal_point_idxs[1]]}};
  const std::vector<int>& extra = info.extra_params_idxs;
  if (!extra.empty()) radial.k1 = camera.params[extra[0]];
  if (extra.size() > 1) radial.k2 = camera.params[extra[1]];
  if (max_num_coefficients < 2 && radial.k2 != 0.0) {
    Throw(input.scene, camera_idx, format,
          "has two coefficients of distortion");
  }
  return radial;
}

}  // namespace

Eigen::Vector2d CenterOfImage(const Camera& camera) {
  return {0.5 * camera.width_px, 0.5 * camera.height_px};
}

std::vector<std::string> MovedPrincipalPoints(const ExportInput& input) {
  constexpr double kRounding_px = 1e-6;
  std::vector<std::string> messages;
  for (size_t i = 0; i < input.model.cameras.size(); ++i) {
    const Camera& camera = input.model.cameras[i];
    const std::vector<int>& idxs =
        FindCameraModel(static_cast<int32_t>(camera.model))
            ->principal_point_idxs;
    const Eigen::Vector2d offset =
        Eigen::Vector2d(camera.params[idxs[0]], camera.params[idxs[1]]) -
        CenterOfImage(camera);
    if (offset.cwiseAbs().maxCoeff() <= kRounding_px) continue;
    messages.push_back(
        CameraLabel(input.scene, static_cast<int>(i)) +
        Formatted(" has its principal point %+.1f, %+.1f px from the center "
                  "of the image, where this format puts it; pixels are "
                  "shifted by as much, and their rays are right; write bin "
                  "or txt for the pixels of the images",
                  offset.x(), offset.y()));
  }
  return messages;
}

std::vector<RadialCamera> ToRadialCameras(const ExportInput& input,
                                          const std::string& format,
                                          int max_num_coefficients) {
  CheckFormat(input.scene, ModelFormat::kText);
  std::vector<RadialCamera> cameras;
  for (const Image& image : input.scene.images) {
    const int camera_idx = input.scene.sensors[image.sensor_idx].camera_idx;
    cameras.push_back(
        ToRadialCamera(input, camera_idx, format, max_num_coefficients));
  }
  return cameras;
}

ImageOrder OrderImagesById(const ExportInput& input) {
  const std::vector<Image>& images = input.scene.images;
  ImageOrder order{{}, std::vector<int>(images.size(), -1)};
  for (size_t i = 0; i < images.size(); ++i) {
    if (input.model.IsRegistered(input.scene, static_cast<int>(i))) {
      order.image_idxs.push_back(static_cast<int>(i));
    }
  }
  std::sort(order.image_idxs.begin(), order.image_idxs.end(),
            [&](int a, int b) { return images[a].id < images[b].id; });
  for (size_t k = 0; k < order.image_idxs.size(); ++k) {
    order.place_of_image[order.image_idxs[k]] = static_cast<int>(k);
  }
  return order;
}

}  // namespace mgsfm
