// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/file_reading.h"
#include "base/text.h"
#include "geometry/rigid_matrix.h"
#include "io/exchange/import_formats.h"
#include "io/exchange/imported_model.h"
#include "io/exchange/ply.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

// A frame of the file, whose fields override those of all frames.
class TransformsFrame {
 public:
  TransformsFrame(const Json& all, const Json& frame, size_t number,
                  const fs::path& path)
      : all_(all), frame_(frame), number_(number), path_(path) {
    if (!frame.is_object()) Throw("is not an object");
  }

  std::optional<double> FindNumber(const char* field) const {
    const Json* value = Find(field);
    if (value == nullptr) return std::nullopt;
    if (!value->is_number() || !std::isfinite(value->get<double>())) {
      Throw(std::string(field) + " is not a finite number");
    }
    return value->get<double>();
  }
  double Number(const char* field, double otherwise) const {
    return FindNumber(field).value_or(otherwise);
  }
  std::string Text(const char* field, const char* otherwise) const {
    const Json* value = Find(field);
    if (value == nullptr && otherwise != nullptr) return otherwise;
    if (value == nullptr || !value->is_string()) {
      Throw(std::string(field) + " is missing or no text");
    }
    return value->get<std::string>();
  }
  const Json* Find(const char* field) const {
    for (const Json* json : {&frame_, &all_}) {
      const auto found = json->find(field);
      if (found != json->end()) return &*found;
    }
    return nullptr;
  }
  [[noreturn]] void Throw(const std::string& problem) const {
    const auto name =
        frame_.is_object() ? frame_.find("file_path") : frame_.end();
    std::string label = "frame " + std::to_string(number_);
    if (name != frame_.end() && name->is_string()) {
      label += " ('" + Printable(name->get<std::string>()) + "')";
    }
    throw Error("'" + path_.string() + "', " + label + ": " + problem +
                "; correct the file, or write it again");
  }

 private:
  const Json& all_;
  const Json& frame_;
  size_t number_;  // from 0
  const fs::path& path_;
};

Rigid3 ReadPose(const TransformsFrame& frame) {
  const Json* rows = frame.Find("transform_matrix");
  RigidMatrix world_from_gl;
  const bool has_rows =
      rows != nullptr && rows->is_array() && rows->size() >= 3;
  if (!has_rows) frame.Throw("transform_matrix has no three rows");
  for (int i = 0; i < 3; ++i) {
    const Json& row = (*rows)[static_cast<size_t>(i)];
    if (!row.is_array() || row.size() != 4) {
      frame.Throw("a row of transform_matrix has no four numbers");
    }
    for (int k = 0; k < 4; ++k) {
      const Json& value = row[static_cast<size_t>(k)];
      if (!value.is_number()) {
        frame.Throw("an element of transform_matrix is not a number");
      }
      world_from_gl(i, k) = value.get<double>();
    }
  }
  // OpenGL: y up, z backward.
  world_from_gl.col(1) *= -1.0;
  world_from_gl.col(2) *= -1.0;
  const std::optional<Rigid3> world_from_cam = RigidFromMatrix(world_from_gl);
  if (!world_from_cam) {
    frame.Throw("transform_matrix has no rotation matrix");
  }
  return world_from_cam->Inverse();
}

int Pixels(const TransformsFrame& frame, const char* field, double value) {
  constexpr double kMaxSize = 1e9;  // fits an int; no image is that large
  if (!(value >= 1.0) || !(value <= kMaxSize) || value != std::floor(value)) {
    frame.Throw(std::string(field) + " is not a number of pixels");
  }
  return static_cast<int>(value);
}

Eigen::Vector2i ReadSize(const TransformsFrame& frame, const std::string& name,
                         const ImportInput& input) {
  const auto width = frame.FindNumber("w"), height = frame.FindNumber("h");
  if (!width || !height) {
    return ReadSizeOfImage(input.image_path, name, input.path);
  }
  return {Pixels(frame, "w", *width), Pixels(frame, "h", *height)};
}

double ReadFocalLength(const TransformsFrame& frame, int width_px) {
  if (const auto focal_length_px = frame.FindNumber("fl_x")) {
    return *focal_length_px;
  }
  const auto angle_rad = frame.FindNumber("camera_angle_x");
  if (!angle_rad) frame.Throw("fl_x and camera_angle_x are missing");
  return 0.5 * width_px / std::tan(0.5 * *angle_rad);
}

// Appends the distortion of perspective images to fx, fy, cx, cy.
void SetDistortion(const TransformsFrame& frame, Camera* camera) {
  double k[4], p[2];
  for (int i = 0; i < 4; ++i) {
    k[i] = frame.Number(("k" + std::to_string(i + 1)).c_str(), 0.0);
  }
  for (int i = 0; i < 2; ++i) {
    p[i] = frame.Number(("p" + std::to_string(i + 1)).c_str(), 0.0);
  }
  if (k[3] != 0.0) {
    frame.Throw("COLMAP has no camera model with a fourth radial coefficient");
  }
  std::vector<double>& params = camera->params;
  const bool has_third = k[2] != 0.0;
  if (!has_third && k[0] == 0.0 && k[1] == 0.0 && p[0] == 0.0 && p[1] == 0.0) {
    return;
  }
  camera->model =
      has_third ? CameraModelId::kFullOpenCV : CameraModelId::kOpenCV;
  params.insert(params.end(), {k[0], k[1], p[0], p[1]});
  if (has_third) params.insert(params.end(), {k[2], 0.0, 0.0, 0.0});
}

Camera ReadCamera(const TransformsFrame& frame, const Eigen::Vector2i& size) {
  Camera camera{kUnnumbered, CameraModelId::kPinhole, size.x(), size.y(), {}};
  const std::string model = frame.Text("camera_model", "OPENCV");
  if (model == "EQUIRECTANGULAR") {
    camera.model = CameraModelId::kEquirectangular;
    camera.params = {static_cast<double>(size.x()),
                     static_cast<double>(size.y())};
    return camera;
  }
  const double fx = ReadFocalLength(frame, size.x());
  camera.params = {fx, frame.Number("fl_y", fx),
                   frame.Number("cx", 0.5 * size.x()),
                   frame.Number("cy", 0.5 * size.y())};
  if (model == "OPENCV_FISHEYE") {
    camera.model = CameraModelId::kOpenCVFisheye;
    for (const char* name : {"k1", "k2", "k3", "k4"}) {
      camera.params.push_back(frame.Number(name, 0.0));
    }
    return camera;
  }
  for (const char* name : {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL",
                           "SIMPLE_RADIAL", "PERSPECTIVE"}) {
    if (model != name) continue;
    SetDistortion(frame, &camera);
    return camera;
  }
  frame.Throw("the camera_model '" + Printable(model) + "' is not known");
}

Json ReadJson(const fs::path& path) {
  const Json json = Json::parse(ReadFile(path), nullptr, false);
  const bool has_frames =
      json.is_object() && json.contains("frames") && json["frames"].is_array();
  if (!has_frames) {
    throw Error("'" + path.string() +
                "' is not a transforms.json: it is not JSON, or has no list "
                "'frames'; write it again");
  }
  return json;
}

// nerfstudio names images from the folder of the file, COLMAP from the folder
// of images.
void RemoveCommonFolder(std::vector<ImportedImage>* images) {
  constexpr char kFolder[] = "images/";
  for (const ImportedImage& image : *images) {
    if (image.name.rfind(kFolder, 0) != 0) return;
  }
  for (ImportedImage& image : *images) image.name.erase(0, sizeof(kFolder) - 1);
}

}  // namespace

Model ReadNerfstudio(const ImportInput& input, const Context& context) {
  const Json json = ReadJson(input.path);
  ImportedModel model;
  for (const Json& item : json["frames"]) {
    context.CheckInterrupted();
    const TransformsFrame frame(json, item, model.images.size(), input.path);
    std::string name = frame.Text("file_path", nullptr);
    if (name.rfind("./", 0) == 0) name.erase(0, 2);
    const Rigid3 pose = ReadPose(frame);
    model.images.push_back(
        {name, pose, ReadCamera(frame, ReadSize(frame, name, input))});
  }
  RemoveCommonFolder(&model.images);
  const auto points = json.find("ply_file_path");
  if (points != json.end() && points->is_string()) {
    model.points =
        ReadPly(input.path.parent_path() / points->get<std::string>());
  }
  return MakeModel(std::move(model), input.path);
}

}  // namespace mgsfm
