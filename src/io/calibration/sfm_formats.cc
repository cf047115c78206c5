// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>

#include "base/file_reading.h"
#include "base/ranges.h"
#include "base/text_lines.h"
#include "calibration/calibration.h"
#include "calibration/lens_models.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

Eigen::Vector3d Vector(const YamlValue& value) {
  const std::vector<double> numbers = value.Numbers(3);
  return {numbers[0], numbers[1], numbers[2]};
}

// The coefficients that the camera has; missing ones are 0.
std::vector<double> Coefficients(const YamlValue& camera,
                                 const std::vector<std::string>& keys) {
  std::vector<double> values;
  for (const std::string& key : keys) {
    const auto value = camera.Find(key);
    values.push_back(value ? value->Number() : 0.0);
  }
  return values;
}

// Sets the lens of a camera of camera_models.json, whose unit is the larger
// side of the image, from its middle.
void SetOpenSfmLens(const YamlValue& value, CalibratedCamera* camera) {
  const int width = value["width"].Size(), height = value["height"].Size();
  camera->size_px.emplace(width, height);
  const double unit = std::max(width, height);
  const std::string type = value["projection_type"].Text();
  if (type == "spherical" || type == "equirectangular") {
    camera->model = CameraModelId::kEquirectangular;
    camera->params = {static_cast<double>(width), static_cast<double>(height)};
    return;
  }
  PinholeLens lens;
  const bool has_one_focal = value.Has("focal");
  lens.fx = unit * value[has_one_focal ? "focal" : "focal_x"].Number();
  lens.fy = unit * value[has_one_focal ? "focal" : "focal_y"].Number();
  const std::vector<double> center = Coefficients(value, {"c_x", "c_y"});
  lens.cx = unit * center[0] + 0.5 * (width - 1);
  lens.cy = unit * center[1] + 0.5 * (height - 1);
  if (type == "perspective" || type == "simple_radial" || type == "radial" ||
      type == "brown") {
    lens.distortion_model = "radtan";
    lens.distortion = Coefficients(value, {"k1", "k2", "p1", "p2", "k3"});
  } else if (type == "fisheye" || type == "fisheye_opencv") {
    lens.distortion_model = "equidistant";
    lens.distortion = Coefficients(value, {"k1", "k2", "k3", "k4"});
  } else {
    return SetUnknownLens(type, camera);
  }
  SetLens(lens, camera);
}

}  // namespace

FoundCameras ReadOpenSfm(const YamlValue& file, const fs::path& path) {
  if (!file.IsMap()) return std::nullopt;
  const auto items = file.Items();
  const bool is_rig = !items.empty() && AllOf(items, [](const auto& item) {
    return item.second.Has("rotation") && item.second.Has("translation") &&
           item.second.Has("camera");
  });
  if (!is_rig) return std::nullopt;
  std::map<std::string, YamlValue> models;
  for (const char* name :
       {"camera_models.json", "camera_models_overrides.json"}) {
    const fs::path models_path = path.parent_path() / name;
    if (!fs::exists(models_path)) continue;
    const YamlValue table(models_path.string(), ReadFile(models_path));
    for (const auto& [id, model] : table.Items()) {
      models.insert_or_assign(id, model);
    }
  }
  std::vector<CalibratedCamera> cameras;
  for (const auto& [name, value] : items) {
    CalibratedCamera camera;
    camera.names = {name};
    camera.place = value.Place();
    camera.cam_from_base =
        Rigid3{ExpSO3(Vector(value["rotation"])), Vector(value["translation"])};
    const auto model = models.find(value["camera"].Text());
    if (model != models.end()) SetOpenSfmLens(model->second, &camera);
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

namespace {

std::vector<double> NumbersAfter(const TextLines& lines,
                                 const std::vector<std::string>& words,
                                 size_t begin) {
  std::vector<double> numbers;
  for (size_t i = begin; i < words.size(); ++i) {
    numbers.push_back(lines.Number(words[i]));
  }
  return numbers;
}

// Sets model, size and parameters, which are COLMAP's.
void SetKaptureLens(const TextLines& lines,
                    const std::vector<std::string>& words,
                    CalibratedCamera* camera) {
  if (words.size() < 6) lines.Throw("has a camera without model and size");
  const std::vector<double> numbers = NumbersAfter(lines, words, 4);
  const auto to_size = [&](double number) {
    const bool is_size = number >= 1.0 && number <= 1e6;
    if (!is_size) lines.Throw("has an impossible image size; correct it");
    return static_cast<int>(number);
  };
  camera->size_px.emplace(to_size(numbers[0]), to_size(numbers[1]));
  if (words[3] == "UNKNOWN_CAMERA") return;
  const CameraModelInfo* model = FindCameraModel(words[3]);
  if (model == nullptr) return SetUnknownLens(words[3], camera);
  camera->model = model->id;
  camera->params.assign(numbers.begin() + 2, numbers.end());
  if (static_cast<int>(camera->params.size()) == model->num_params) return;
  lines.Throw("has " + std::to_string(camera->params.size()) +
              " parameters of the model " + words[3] + ", which has " +
              std::to_string(model->num_params));
}

// The poses of rigs.txt beside the sensors, by sensor.
std::map<std::string, Rigid3> ReadKaptureRigs(const fs::path& path) {
  std::map<std::string, Rigid3> poses;
  if (!fs::exists(path)) return poses;
  std::string rig;
  TextLines lines(path);
  while (lines.NextContent()) {
    const std::vector<std::string> words = SplitFields(lines.line(), ',');
    if (words.size() != 9) {
      lines.Throw("expected 'rig, sensor, qw, qx, qy, qz, tx, ty, tz'");
    }
    if (rig.empty()) rig = words[0];
    if (words[0] != rig) {
      lines.Throw("has a second rig '" + words[0] +
                  "'; keep the rig of your recording only");
    }
    const std::vector<double> n = NumbersAfter(lines, words, 2);
    const Eigen::Quaterniond rotation(n[0], n[1], n[2], n[3]);
    if (rotation.norm() < 0.5) lines.Throw("has no rotation; correct it");
    poses[words[1]] = {rotation.normalized(), {n[4], n[5], n[6]}};
  }
  return poses;
}

}  // namespace

FoundCameras ReadKapture(const std::string& text, const fs::path& path) {
  if (text.compare(0, 16, "# kapture format") != 0) return std::nullopt;
  const auto poses = ReadKaptureRigs(path.parent_path() / "rigs.txt");
  std::vector<CalibratedCamera> cameras;
  TextLines lines = TextLines::Of(text, "'" + path.string() + "'");
  while (lines.NextContent()) {
    const std::vector<std::string> words = SplitFields(lines.line(), ',');
    if (words.size() < 3 || words[2] != "camera") continue;
    CalibratedCamera camera;
    camera.names = {words[0]};
    camera.place = lines.Place();
    SetKaptureLens(lines, words, &camera);
    const auto pose = poses.find(words[0]);
    if (pose != poses.end()) camera.cam_from_base = pose->second;
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

}  // namespace mgsfm
