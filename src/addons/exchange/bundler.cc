// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "exchange/exported_names.h"
#include "exchange/formats.h"
#include "exchange/radial_camera.h"

namespace mgsfm {
namespace {

std::string Row(const Eigen::Vector3d& values) {
  return Digits(values.x()) + ' ' + Digits(values.y()) + ' ' +
         Digits(values.z()) + '\n';
}

// Bundler's cameras look along -z, with y up.
std::string CameraLines(const RadialCamera& camera, const Rigid3& pose) {
  const Eigen::Matrix3d flip = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
  const Eigen::Matrix3d rotation = flip * pose.rotation.toRotationMatrix();
  std::string lines = Digits(camera.focal_length_px) + ' ' + Digits(camera.k1) +
                      ' ' + Digits(camera.k2) + '\n';
  for (int row = 0; row < 3; ++row) lines += Row(rotation.row(row));
  return lines + Row(flip * pose.translation);
}

// Pixels there: y up.
std::string PointLines(const ExportInput& input, const ImageOrder& order,
                       const std::vector<RadialCamera>& cameras,
                       const Point3D& point) {
  std::string lines = Row(point.point_in_world);
  for (int i = 0; i < 3; ++i) {
    lines += std::to_string(point.color[i]) + (i < 2 ? ' ' : '\n');
  }
  lines += std::to_string(point.track.size());
  for (const Observation& o : point.track) {
    const Eigen::Vector2d pixel = input.scene.images[o.image_idx]
                                      .keypoints_px[o.keypoint_idx]
                                      .cast<double>() -
                                  cameras[o.image_idx].principal_point_px;
    lines += ' ' + std::to_string(order.place_of_image[o.image_idx]) + ' ' +
             std::to_string(o.keypoint_idx) + ' ' + Digits(pixel.x()) + ' ' +
             Digits(-pixel.y());
  }
  return lines + '\n';
}

}  // namespace

std::vector<ExportedFile> WriteBundler(const ExportInput& input) {
  const std::vector<RadialCamera> cameras =
      ToRadialCameras(input, "Bundler", 2);
  const ImageOrder order = OrderImagesById(input);
  std::string text = "# Bundle file v0.3\n" +
                     std::to_string(order.image_idxs.size()) + ' ' +
                     std::to_string(input.model.points.size()) + '\n';
  std::string list;
  for (const int image_idx : order.image_idxs) {
    text += CameraLines(cameras[image_idx],
                        *input.model.CamFromWorld(input.scene, image_idx));
    list += input.scene.images[image_idx].name + '\n';
  }
  for (const Point3D& point : input.model.points) {
    text += PointLines(input, order, cameras, point);
  }
  return {{".bundle.out", std::move(text)}, {".list.txt", std::move(list)}};
}

std::vector<std::string> LossesInBundler(const ExportInput& input) {
  return MovedPrincipalPoints(input);
}

}  // namespace mgsfm
