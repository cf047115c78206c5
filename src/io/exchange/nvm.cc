// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "io/exchange/exported_names.h"
#include "io/exchange/formats.h"
#include "io/exchange/radial_camera.h"

namespace mgsfm {
namespace {

// VisualSFM distorts in the opposite direction, hence COLMAP's sign of k1.
std::string ImageLine(const ExportInput& input, int image_idx,
                      const RadialCamera& camera) {
  const Rigid3 pose = *input.model.CamFromWorld(input.scene, image_idx);
  const Eigen::Quaterniond& q = pose.rotation;
  std::string line =
      input.scene.images[image_idx].name + ' ' + Digits(camera.focal_length_px);
  for (const double value : {q.w(), q.x(), q.y(), q.z()}) {
    line += ' ' + Digits(value);
  }
  for (const double value : pose.Center()) line += ' ' + Digits(value);
  return line + ' ' + Digits(camera.k1 == 0.0 ? 0.0 : -camera.k1) + " 0\n";
}

// VisualSFM expects at most one observation of a point in an image.
std::string PointLine(const ExportInput& input, const ImageOrder& order,
                      const Point3D& point) {
  std::string line, observations;
  for (const double value : point.point_in_world) line += Digits(value) + ' ';
  for (const uint8_t value : point.color) line += std::to_string(value) + ' ';
  int num_observations = 0;
  int last_image_idx = -1;
  for (const Observation& o : point.track) {
    if (o.image_idx == last_image_idx) continue;
    last_image_idx = o.image_idx;
    const Eigen::Vector2d pixel = input.scene.images[o.image_idx]
                                      .keypoints_px[o.keypoint_idx]
                                      .cast<double>();
    observations += ' ' + std::to_string(order.place_of_image[o.image_idx]) +
                    ' ' + std::to_string(o.keypoint_idx) + ' ' +
                    Digits(pixel.x()) + ' ' + Digits(pixel.y());
    ++num_observations;
  }
  return line + std::to_string(num_observations) + observations + '\n';
}

}  // namespace

std::vector<ExportedFile> WriteNvm(const ExportInput& input) {
  const std::vector<RadialCamera> cameras = ToRadialCameras(input, "NVM", 1);
  const ImageOrder order = OrderImagesById(input);
  std::string text =
      "NVM_V3 \n \n" + std::to_string(order.image_idxs.size()) + "  \n";
  for (const int image_idx : order.image_idxs) {
    text += ImageLine(input, image_idx, cameras[image_idx]);
  }
  text += '\n' + std::to_string(input.model.points.size()) + '\n';
  for (const Point3D& point : input.model.points) {
    text += PointLine(input, order, point);
  }
  return {{"", std::move(text)}};
}

}  // namespace mgsfm
