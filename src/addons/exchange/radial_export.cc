// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <string>
#include <vector>

#include "base/format.h"
#include "base/ranges.h"
#include "exchange/exchange_formats.h"
#include "exchange/formats.h"
#include "mgsfm/base/error.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {
namespace {

// A camera with one focal length and radial distortion.
struct RadialCamera {
  double focal_length_px = 0.0;
  Eigen::Vector2d principal_point_px = Eigen::Vector2d::Zero();
  double k1 = 0.0;
  double k2 = 0.0;
};

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
  const CameraModelInfo& info = InfoOf(camera.model);
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
  RadialCamera radial{first, PrincipalPoint(camera)};
  const std::vector<int>& extra = info.extra_params_idxs;
  if (!extra.empty()) radial.k1 = camera.params[extra[0]];
  if (extra.size() > 1) radial.k2 = camera.params[extra[1]];
  if (max_num_coefficients < 2 && radial.k2 != 0.0) {
    Throw(input.scene, camera_idx, format,
          "has two coefficients of distortion");
  }
  return radial;
}

// The principal point of formats that store none.
Eigen::Vector2d CenterOfImage(const Camera& camera) {
  return {0.5 * camera.width_px, 0.5 * camera.height_px};
}

// Per image. Throws Error, naming the camera and `format`, for other models,
// two focal lengths, or more than `max_num_coefficients`, and for image names
// with blanks.
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

// Registered images in the order of their ids, and the place of each there.
struct ImageOrder {
  std::vector<int> image_idxs;
  std::vector<int> place_of_image;  // -1: not registered
};

ImageOrder OrderImagesById(const ExportInput& input) {
  const std::vector<Image>& images = input.scene.images;
  ImageOrder order{{}, std::vector<int>(images.size(), -1)};
  for (size_t i = 0; i < images.size(); ++i) {
    if (input.model.IsRegistered(input.scene, static_cast<int>(i))) {
      order.image_idxs.push_back(static_cast<int>(i));
    }
  }
  SortBy(&order.image_idxs, [&](int a) { return images[a].id; });
  for (size_t k = 0; k < order.image_idxs.size(); ++k) {
    order.place_of_image[order.image_idxs[k]] = static_cast<int>(k);
  }
  return order;
}

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

// A message for each camera whose principal point is not the center.
std::vector<std::string> MovedPrincipalPoints(const ExportInput& input) {
  constexpr double kRounding_px = 1e-6;
  std::vector<std::string> messages;
  for (size_t i = 0; i < input.model.cameras.size(); ++i) {
    const Camera& camera = input.model.cameras[i];
    const Eigen::Vector2d offset =
        PrincipalPoint(camera) - CenterOfImage(camera);
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

}  // namespace

std::vector<ExchangeFormat> RadialFormats() {
  return {{"nvm", WriteNvm, LossesInNvm},
          {"bundler", WriteBundler, MovedPrincipalPoints}};
}

}  // namespace mgsfm
