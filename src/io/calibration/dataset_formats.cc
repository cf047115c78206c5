// SPDX-License-Identifier: BSD-3-Clause
#include <re2/re2.h>

#include <Eigen/LU>
#include <algorithm>
#include <map>
#include <optional>

#include "base/file_reading.h"
#include "base/format.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "calibration/calibration.h"
#include "calibration/lens_models.h"
#include "files/image_reading.h"
#include "geometry/rigid_matrix.h"
#include "mgsfm/base/error.h"
#include "scene/value_check.h"

namespace mgsfm {

FoundCameras ReadEuroc(const YamlValue& file,
                       const std::filesystem::path& path) {
  if (!file.Has("T_BS")) return std::nullopt;
  std::vector<CalibratedCamera> cameras;
  const auto type = file.Find("sensor_type");
  if (type && type->Text() != "camera") return cameras;  // an inertial sensor
  CalibratedCamera& camera = cameras.emplace_back();
  const bool is_named_by_folder =
      path.stem() == "sensor" && path.has_parent_path();
  camera.names = {is_named_by_folder ? path.parent_path().filename().string()
                                     : path.stem().string()};
  camera.place = file["T_BS"].Place();
  camera.cam_from_base = file["T_BS"].Pose().Inverse();
  camera.size_px = file["resolution"].ImageSize();
  const std::string projection = file["camera_model"].Text();
  if (projection != "pinhole") {
    SetUnknownLens(projection, &camera);
    return cameras;
  }
  const std::vector<double> n = file["intrinsics"].Numbers(4);
  SetLens({n[0], n[1], n[2], n[3], file["distortion_model"].Text(),
           file["distortion_coefficients"].Numbers()},
          &camera);
  return cameras;
}

namespace {

// "NAME: words"; lines without a name are called P0, P1, ...
struct Line {
  std::string place;
  std::string words;
};

using Lines = std::map<std::string, Line>;

Lines ParseLines(const std::string& text, const std::string& path) {
  Lines lines;
  TextLines text_lines = TextLines::Of(text, "'" + path + "'");
  size_t num_unnamed = 0;
  while (text_lines.NextContent()) {
    const std::string_view line = text_lines.line();
    const size_t colon = line.find(':');
    const bool has_name = colon != std::string_view::npos;
    Line parsed{text_lines.Place(),
                std::string(has_name ? line.substr(colon + 1) : line)};
    const std::string name(has_name ? line.substr(0, colon)
                                    : "P" + std::to_string(num_unnamed++));
    if (!lines.emplace(name, std::move(parsed)).second) {
      text_lines.Throw("has '" + Printable(name) +
                       "' again; delete one of the lines");
    }
  }
  return lines;
}

std::vector<double> Numbers(const Line& line, size_t size) {
  std::vector<double> numbers;
  for (const std::string_view word : SplitWords(line.words)) {
    const auto number = ParseDouble(word);
    if (!number) {
      throw Error(line.place + " has '" + Printable(word) +
                  "' where a finite number should be; correct it");
    }
    numbers.push_back(*number);
  }
  if (numbers.size() != size) {
    throw Error(line.place + " has " + std::to_string(numbers.size()) +
                " numbers; give " + std::to_string(size));
  }
  return numbers;
}

Rigid3 PoseOf(const Line& line, const std::optional<Rigid3>& pose) {
  if (pose) return *pose;
  throw Error(line.place + " is not a rigid transform; correct its rotation");
}

// The number k of "Pk", "P_rect_0k"; nullopt for other names.
std::optional<int> CameraNumber(const std::string& name) {
  static const RE2 kPattern(R"(P(?:_rect_)?(\d{1,2}))");
  int number = 0;
  if (!RE2::FullMatch(name, kPattern, &number)) return std::nullopt;
  return number;
}

// P = K [I | t], with respect to the rectified first camera.
CalibratedCamera ReadProjection(const Line& line, int number) {
  CalibratedCamera camera;
  camera.names = {Formatted("image_%02d", number),
                  Formatted("image_%d", number), Formatted("cam%d", number)};
  camera.place = line.place;
  const std::vector<double> p = Numbers(line, 12);
  SetMatrixAndLens(p, 4, PinholeLens(), &camera);
  if (!camera.model) return camera;
  const Eigen::Map<const RigidMatrix> P(p.data());
  const Eigen::Matrix3d K = P.leftCols<3>();
  camera.cam_from_base =
      Rigid3{Eigen::Quaterniond::Identity(), K.inverse() * P.col(3)};
  return camera;
}

// KITTI-360: the pose of the camera before rectification by R_rect.
void SetPoseInVehicle(const Line& vehicle_from_cam, const Line& rectification,
                      CalibratedCamera* camera) {
  const auto cam = Numbers(vehicle_from_cam, 12);
  const auto r = Numbers(rectification, 9);
  const Rigid3 rectified_from_cam =
      PoseOf(rectification, RigidFromRotation(r.data()));
  camera->cam_from_base =
      rectified_from_cam *
      PoseOf(vehicle_from_cam, RigidFromNumbers(cam)).Inverse();
}

// The lines of calib_cam_to_pose.txt beside a calibration; empty without it.
Lines ReadPosesInVehicle(const std::filesystem::path& path) {
  const std::filesystem::path beside =
      path.parent_path() / "calib_cam_to_pose.txt";
  if (!std::filesystem::exists(beside)) return {};
  return ParseLines(ReadFile(beside), beside.string());
}

bool IsProjection(const Line& line) {
  const auto numbers = ParseNumbers(line.words);
  if (!numbers || numbers->size() != 12) return false;
  // Unlike a projection matrix, a pose, which also has 12 numbers, has no entry
  // as large as a focal length.
  const double* n = numbers->data();
  return n[0] > 10.0 && n[4] == 0.0 && n[8] == 0.0 && n[9] == 0.0 &&
         n[10] == 1.0;
}

bool IsKitti(const std::string& text) {
  const bool has_names = text.find("P0:") != std::string::npos ||
                         text.find("P_rect_0") != std::string::npos;
  if (has_names) return true;
  const Lines lines = ParseLines(text, "");
  return !lines.empty() && AllOf(lines, [](const auto& line) {
    return IsProjection(line.second);
  });
}

}  // namespace

FoundCameras ReadKitti(const std::string& text,
                       const std::filesystem::path& path) {
  if (!IsKitti(text)) return std::nullopt;
  const Lines lines = ParseLines(text, path.string());
  const Lines poses = ReadPosesInVehicle(path);
  std::vector<CalibratedCamera> cameras;
  for (const auto& [name, line] : lines) {
    const auto number = CameraNumber(name);
    if (!number) continue;
    CalibratedCamera camera = ReadProjection(line, *number);
    const auto size = lines.find(Formatted("S_rect_%02d", *number));
    if (size != lines.end()) {
      const auto sides = Numbers(size->second, 2);
      if (!(sides[0] >= 1.0 && sides[1] >= 1.0 &&
            std::max(sides[0], sides[1]) <= kMaxImageSide_px)) {
        throw Error(size->second.place + " is not the size of an image");
      }
      camera.size_px.emplace(static_cast<int>(sides[0]),
                             static_cast<int>(sides[1]));
    }
    const auto rectification = lines.find(Formatted("R_rect_%02d", *number));
    const auto pose = poses.find(Formatted("image_%02d", *number));
    if (rectification != lines.end() && pose != poses.end()) {
      SetPoseInVehicle(pose->second, rectification->second, &camera);
    }
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

std::optional<Rigid3> CamFromVehicleOfKitti360(
    const std::filesystem::path& path, const std::string& name) {
  const Lines poses = ReadPosesInVehicle(path);
  const auto pose = poses.find(name);
  if (pose == poses.end()) return std::nullopt;
  const auto matrix = Numbers(pose->second, 12);
  return PoseOf(pose->second, RigidFromNumbers(matrix)).Inverse();
}

namespace {

constexpr const char* kIntrinsics = "camera_intrinsic";

bool IsSensor(const YamlValue& value) {
  return value.IsMap() && value.Has(kIntrinsics) && value.Has("rotation") &&
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

// Sensor names by token.
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
  SetMatrixAndLens(value[kIntrinsics].Numbers(9), 3, PinholeLens(), &camera);
  camera.cam_from_base =
      PoseOf(value["rotation"], value["translation"]).Inverse();
  return camera;
}

}  // namespace

FoundCameras ReadNuScenes(const YamlValue& file,
                          const std::filesystem::path& path) {
  const auto items = file.Items();
  if (NoneOf(items, [](const auto& item) { return IsSensor(item.second); })) {
    return std::nullopt;
  }
  const auto channels = ReadChannels(path.parent_path() / "sensor.json");
  std::vector<CalibratedCamera> cameras;
  for (const auto& [key, value] : items) {
    if (!IsSensor(value)) continue;
    const bool is_camera = !value[kIntrinsics].Items().empty();
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

FoundCameras ReadArgoverse(const YamlValue& file,
                           const std::filesystem::path& /*path*/) {
  if (!file.Has("camera_data_")) return std::nullopt;
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
