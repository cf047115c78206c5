// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>

#include "base/file_reading.h"
#include "calibration/formats.h"
#include "calibration/lens_models.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

constexpr const char* kMatrix = "camera_intrinsic";

bool IsSensor(const YamlValue& value) {
  return value.IsMap() && value.Has(kMatrix) && value.Has("rotation") &&
         value.Has("translation");
}

// base_from_cam as a quaternion w, x, y, z and a translation.
Rigid3 PoseOf(const YamlValue& rotation, const YamlValue& translation) {
  const std::vector<double> q = rotation.Numbers(4);
  const std::vector<double> t = translation.Numbers(3);
  const Eigen::Quaterniond quaternion(q[0], q[1], q[2], q[3]);
  const Rigid3 pose = PoseOfFile(quaternion, {t[0], t[1], t[2]});
  if (const auto problem = WhyImplausible(pose)) {
    rotation.Throw(*problem + "; correct it");
  }
  return pose;
}

// Names of sensors by their token.
std::map<std::string, std::string> ReadChannels(
    const std::filesystem::path& path) {
  std::map<std::string, std::string> channels;
  if (!std::filesystem::exists(path)) return channels;
  const YamlValue table(path.string(), ReadFile(path));
  for (const auto& [key, row] : table.Items()) {
    channels[row["token"].Text()] = row["channel"].Text();
  }
  return channels;
}

CalibratedCamera ReadSensor(const std::string& name, const YamlValue& value) {
  CalibratedCamera camera;
  camera.names = {name};
  camera.place = value.Place();
  SetMatrixAndLens(value[kMatrix].Numbers(9), 3, PinholeLens(), &camera);
  camera.cam_from_base =
      PoseOf(value["rotation"], value["translation"]).Inverse();
  return camera;
}

}  // namespace

bool IsNuScenes(const YamlValue& file) {
  const auto items = file.Items();
  return std::any_of(items.begin(), items.end(),
                     [](const auto& item) { return IsSensor(item.second); });
}

std::vector<CalibratedCamera> ReadNuScenes(const YamlValue& file,
                                           const std::filesystem::path& path) {
  const auto channels = ReadChannels(path.parent_path() / "sensor.json");
  std::vector<CalibratedCamera> cameras;
  for (const auto& [key, value] : file.Items()) {
    if (!IsSensor(value)) continue;
    const bool is_camera = !value[kMatrix].Items().empty();
    if (!is_camera) continue;  // lidar and radar have an empty matrix
    std::string name = key;
    if (const auto channel = value.Find("channel")) {
      name = channel->Text();
    } else if (file.IsSequence()) {
      const auto found = channels.find(value["sensor_token"].Text());
      if (found == channels.end()) {
        value.Throw(
            "is a sensor without name; put the table sensor.json beside the "
            "file, or add the key 'channel'");
      }
      name = found->second;
    }
    cameras.push_back(ReadSensor(name, value));
  }
  return cameras;
}

bool IsArgoverse(const YamlValue& file) { return file.Has("camera_data_"); }

std::vector<CalibratedCamera> ReadArgoverse(const YamlValue& file) {
  const std::string prefix = "image_raw_";
  std::vector<CalibratedCamera> cameras;
  for (const auto& [key, item] : file["camera_data_"].Items()) {
    CalibratedCamera camera;
    std::string name = item["key"].Text();
    if (name.compare(0, prefix.size(), prefix) == 0) {
      name.erase(0, prefix.size());
    }
    camera.names = {name};
    camera.place = item["key"].Place();
    const YamlValue value = item["value"];
    const auto number = [&value](const char* of) { return value[of].Number(); };
    // k1, k2, k3
    const auto k = value["distortion_coefficients_"].Numbers(3);
    SetLens({number("focal_length_x_px_"),
             number("focal_length_y_px_"),
             number("focal_center_x_px_"),
             number("focal_center_y_px_"),
             "plumb_bob",
             {k[0], k[1], 0.0, 0.0, k[2]}},
            &camera);
    const YamlValue pose = value["vehicle_SE3_camera_"];
    camera.cam_from_base =
        PoseOf(pose["rotation"]["coefficients"], pose["translation"]).Inverse();
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

}  // namespace mgsfm
