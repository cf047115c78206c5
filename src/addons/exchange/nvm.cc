// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "exchange/exported_names.h"
#include "exchange/formats.h"
#include "exchange/radial_camera.h"

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
bool IsRepeated(const std::vector<Observation>& track, size_t i) {
  return i > 0 && track[i].image_idx == track[i - 1].image_idx;
}

// Without a principal point in the file, only pixels that move with it to the
// center of the image keep their rays.
std::string PointLine(const ExportInput& input, const ImageOrder& order,
                      const std::vector<RadialCamera>& cameras,
                      const Point3D& point) {
  std::string line, observations;
  for (const double value : point.point_in_world) line += Digits(value) + ' ';
  for (const uint8_t value : point.color) line += std::to_string(value) + ' ';
  int num_observations = 0;
  for (size_t i = 0; i < point.track.size(); ++i) {
    if (IsRepeated(point.track, i)) continue;
    const Observation& o = point.track[i];
    const Image& image = input.scene.images[o.image_idx];
    const int camera_idx = input.scene.sensors[image.sensor_idx].camera_idx;
    const Eigen::Vector2d pixel =
        image.keypoints_px[o.keypoint_idx].cast<double>() -
        cameras[o.image_idx].principal_point_px +
        CenterOfImage(input.model.cameras[camera_idx]);
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
    text += PointLine(input, order, cameras, point);
  }
  return {{"", std::move(text)}};
}

std::vector<std::string> LossesInNvm(const ExportInput& input) {
  std::vector<std::string> messages = MovedPrincipalPoints(input);
  size_t num_repeated = 0;
  for (const Point3D& point : input.model.points) {
    for (size_t i = 0; i < point.track.size(); ++i) {
      num_repeated += IsRepeated(point.track, i) ? 1 : 0;
    }
  }
  if (num_repeated > 0) {
    messages.push_back(std::to_string(num_repeated) +
                       " observations are left out, as NVM has one of a point "
                       "in each image");
  }
  return messages;
}

}  // namespace mgsfm
