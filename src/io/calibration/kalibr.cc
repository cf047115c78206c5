// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>

#include "base/natural_order.h"
#include "calibration/formats.h"
#include "calibration/lens_models.h"
#include "scene/value_check.h"

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

namespace {

// The pose by T_cam_imu relative to that by T_cn_cnm1. Kalibr writes both from
// one estimate.
void CheckPosesAgree(const YamlValue& value, const Rigid3& by_imu,
                     const Rigid3& by_chain) {
  const std::optional<std::string> difference = WhyDifferent(by_imu, by_chain);
  if (!difference) return;
  value.Throw(
      "has a pose by T_cam_imu that differs from the one by T_cn_cnm1 " +
      *difference + "; remove the wrong one");
}

// nullopt where the chain of T_cn_cnm1 is broken.
using Poses = std::vector<std::optional<Rigid3>>;

// The base is the first camera; without a whole chain of T_cn_cnm1, it is the
// inertial sensor if all cameras have T_cam_imu.
Poses ReadPoses(const std::vector<YamlValue>& values) {
  Poses by_chain, by_imu;
  bool has_imu = true;
  for (const YamlValue& value : values) {
    const auto from_imu = value.Find("T_cam_imu");
    const auto from_before = value.Find("T_cn_cnm1");
    by_imu.push_back(from_imu ? std::make_optional(from_imu->Pose())
                              : std::nullopt);
    has_imu &= from_imu.has_value();
    const size_t i = by_chain.size();
    if (i == 0) {
      by_chain.emplace_back(Rigid3());
      continue;
    }
    by_chain.push_back(
        from_before && by_chain[i - 1]
            ? std::make_optional(from_before->Pose() * *by_chain[i - 1])
            : std::nullopt);
    if (from_before && by_imu[i] && by_imu[i - 1]) {
      CheckPosesAgree(value, *by_imu[i] * by_imu[i - 1]->Inverse(),
                      from_before->Pose());
    }
  }
  const bool has_chain = !by_chain.empty() && by_chain.back().has_value();
  return has_imu && !has_chain ? by_imu : by_chain;
}

}  // namespace

std::vector<CalibratedCamera> ReadKalibr(const YamlValue& file) {
  auto items = file.Items();
  std::stable_sort(items.begin(), items.end(),
                   [](const auto& a, const auto& b) {
                     return IsNaturallyBefore(a.first, b.first);
                   });
  std::vector<CalibratedCamera> cameras;
  std::vector<YamlValue> values;
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
    if (const auto shift = value.Find("timeshift_cam_imu")) {
      camera.time_shift_s = shift->Number();
    }
    values.push_back(value);
    cameras.push_back(std::move(camera));
  }
  const Poses poses = ReadPoses(values);
  for (size_t i = 0; i < cameras.size(); ++i) {
    cameras[i].cam_from_base = poses[i];
  }
  return cameras;
}

}  // namespace mgsfm
