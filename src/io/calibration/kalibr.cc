// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>

#include "base/natural_order.h"
#include "io/calibration/formats.h"
#include "io/calibration/lens_models.h"

namespace mgsfm {
namespace {

// The part of "/sensors/cam0/image_raw" that names the camera.
std::optional<std::string> CameraOfTopic(std::string topic) {
  const std::vector<std::string> generic = {"camera", "compressed", "rgb"};
  while (!topic.empty()) {
    const size_t slash = topic.rfind('/');
    const std::string part =
        topic.substr(slash == std::string::npos ? 0 : slash + 1);
    topic.erase(slash == std::string::npos ? 0 : slash);
    const bool is_generic =
        part.empty() || part.compare(0, 5, "image") == 0 ||
        std::find(generic.begin(), generic.end(), part) != generic.end();
    if (!is_generic) return part;
  }
  return std::nullopt;
}

std::string DistortionModel(const YamlValue& value) {
  const auto model = value.Find("distortion_model");
  return model ? model->Text() : "none";
}

void ReadLens(const YamlValue& value, CalibratedCamera* camera) {
  const std::string projection = value["camera_model"].Text();
  const YamlValue intrinsics = value["intrinsics"];
  if (projection == "eucm") {
    const std::vector<double> n = intrinsics.Numbers(6);
    camera->model = CameraModelId::kEucm;
    camera->params = {n[2], n[3], n[4] + 0.5, n[5] + 0.5, n[0], n[1]};
    return;
  }
  if (projection == "ds") {
    const std::vector<double> n = intrinsics.Numbers(6);
    SetUnifiedLens({n[2], n[3], n[4], n[5], n[0], n[1], {}}, camera);
    return;
  }
  if (projection == "omni") {
    const std::vector<double> n = intrinsics.Numbers(5);
    const std::string distortion = DistortionModel(value);
    if (distortion == "radtan" || distortion == "none") {
      SetUnifiedLens(
          {n[1], n[2], n[3], n[4], n[0], 0.0,
           distortion == "none" ? std::vector<double>()
                                : value["distortion_coeffs"].Numbers()},
          camera);
    } else {
      SetUnknownLens("omni with " + distortion, camera);
    }
    return;
  }
  if (projection != "pinhole") {
    SetUnknownLens(projection, camera);
    return;
  }
  const std::vector<double> n = intrinsics.Numbers(4);
  PinholeLens lens{n[0], n[1], n[2], n[3], DistortionModel(value), {}};
  if (lens.distortion_model != "none") {
    lens.distortion = value["distortion_coeffs"].Numbers();
  }
  SetLens(lens, camera);
}

}  // namespace

bool IsKalibr(const YamlValue& file) {
  if (!file.IsMap()) return false;
  const auto items = file.Items();
  return std::any_of(items.begin(), items.end(), [](const auto& item) {
    return item.second.Has("camera_model") && item.second.Has("intrinsics");
  });
}

std::vector<CalibratedCamera> ReadKalibr(const YamlValue& file) {
  auto items = file.Items();
  std::stable_sort(items.begin(), items.end(),
                   [](const auto& a, const auto& b) {
                     return IsNaturallyBefore(a.first, b.first);
                   });
  std::vector<CalibratedCamera> cameras;
  std::optional<Rigid3> cam_from_first = Rigid3();
  bool has_imu = true;
  for (const auto& [name, value] : items) {
    if (value.IsMap()) has_imu &= value.Has("T_cam_imu");
  }
  for (const auto& [name, value] : items) {
    if (!value.IsMap()) continue;
    CalibratedCamera camera;
    if (const auto topic = value.Find("rostopic")) {
      if (const auto part = CameraOfTopic(topic->Text())) {
        camera.names.push_back(*part);
      }
    }
    camera.names.push_back(name);
    camera.place = value.Place();
    if (const auto size = value.Find("resolution")) {
      camera.size_px = size->ImageSize();
    }
    ReadLens(value, &camera);
    const auto from_before = value.Find("T_cn_cnm1");
    if (!cameras.empty()) {
      cam_from_first =
          from_before && cam_from_first
              ? std::make_optional(from_before->Pose() * *cam_from_first)
              : std::nullopt;
    }
    camera.cam_from_base = has_imu ? value["T_cam_imu"].Pose() : cam_from_first;
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

}  // namespace mgsfm
