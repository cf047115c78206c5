// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/file_reading.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "exchange/import_formats.h"
#include "exchange/imported_model.h"
#include "exchange/ply.h"
#include "files/json_reading.h"
#include "geometry/rigid_matrix.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

// A frame of the file, whose fields override those of all frames.
class TransformsFrame {
 public:
  TransformsFrame(const Json& all, const Json& frame, size_t number,
                  const fs::path& path, std::string* contradiction)
      : all_(all),
        frame_(frame),
        number_(number),
        path_(path),
        contradiction_(contradiction) {
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
    throw Error(Place() + ": " + problem +
                "; correct the file, or write it again");
  }
  // Two fields contradict each other, of which one has precedence. Only the
  // first contradiction of a file is kept.
  void Contradict(const std::string& problem) const {
    if (contradiction_->empty()) *contradiction_ = Place() + ": " + problem;
  }

 private:
  std::string Place() const {
    const auto name =
        frame_.is_object() ? frame_.find("file_path") : frame_.end();
    std::string label = "frame " + std::to_string(number_);
    if (name != frame_.end() && name->is_string()) {
      label += " ('" + Printable(name->get<std::string>()) + "')";
    }
    return "'" + path_.string() + "', " + label;
  }

  const Json& all_;
  const Json& frame_;
  size_t number_;  // from 0
  const fs::path& path_;
  std::string* contradiction_;
};

Rigid3 ReadPose(const TransformsFrame& frame) {
  const Json* rows = frame.Find("transform_matrix");
  const bool has_rows = rows != nullptr && rows->is_array() &&
                        (rows->size() == 3 || rows->size() == 4);
  if (!has_rows) frame.Throw("transform_matrix has no three or four rows");
  std::vector<double> numbers;
  for (const Json& row : *rows) {
    if (!row.is_array() || row.size() != 4) {
      frame.Throw("a row of transform_matrix has no four numbers");
    }
    for (const Json& value : row) {
      if (!value.is_number()) {
        frame.Throw("an element of transform_matrix is not a number");
      }
      numbers.push_back(value.get<double>());
    }
  }
  const std::optional<Rigid3> world_from_gl = RigidFromNumbers(numbers);
  if (!world_from_gl) {
    frame.Throw(
        "transform_matrix has no rotation matrix, or its fourth row is not "
        "0 0 0 1, as in a transposed matrix");
  }
  // OpenGL: y up, z backward.
  const Rigid3 gl_from_cam{Eigen::Quaterniond(0.0, 1.0, 0.0, 0.0),
                           Eigen::Vector3d::Zero()};
  return (*world_from_gl * gl_from_cam).Inverse();
}

std::string Text(double value) {
  return FormatDouble(value, std::chars_format::general, 6);
}

int Pixels(const TransformsFrame& frame, const char* field, double value) {
  constexpr double kMaxSize = 1e9;  // fits an int; no image is that large
  if (!(value >= 1.0) || !(value <= kMaxSize) || value != std::floor(value)) {
    frame.Throw(std::string(field) + " is not a number of pixels");
  }
  return static_cast<int>(value);
}

// nerfstudio names images from the folder of the file, COLMAP from the folder
// of images.
constexpr std::string_view kImageFolder = "images/";

std::vector<fs::path> PossibleFiles(const ImportInput& input,
                                    const std::string& name) {
  std::vector<fs::path> files;
  if (!input.image_path.empty()) {
    files.push_back(input.image_path / name);
    if (name.rfind(kImageFolder, 0) == 0) {
      files.push_back(input.image_path / name.substr(kImageFolder.size()));
    }
  }
  files.push_back(input.path.parent_path() / name);
  return files;
}

Eigen::Vector2i ReadSize(const TransformsFrame& frame, const std::string& name,
                         const ImportInput& input) {
  const auto width = frame.FindNumber("w"), height = frame.FindNumber("h");
  if (!width || !height) {
    return ReadSizeOfImage(input.image_path, name, input.path);
  }
  Eigen::Vector2i size(Pixels(frame, "w", *width), Pixels(frame, "h", *height));
  for (const fs::path& file : PossibleFiles(input, name)) {
    const auto of_file = FindSizeOfImage(file);
    if (!of_file) continue;
    if (*of_file != size) {
      frame.Throw("w and h are " + SizeText(size.x(), size.y()) +
                  ", but the image '" + file.string() + "' has " +
                  SizeText(of_file->x(), of_file->y()) + " pixels");
    }
    break;
  }
  return size;
}

// The focal length in pixels by the field of view; nullopt without one.
std::optional<double> FocalLengthOfAngle(const TransformsFrame& frame,
                                         const char* field, int side_px) {
  const auto angle_rad = frame.FindNumber(field);
  if (!angle_rad) return std::nullopt;
  if (!(*angle_rad > 0.0) || !(*angle_rad < kPi)) {
    frame.Throw(std::string(field) + " is " + Text(*angle_rad) +
                ", no field of view in radians; give a number from 0 to pi");
  }
  return 0.5 * side_px / std::tan(0.5 * *angle_rad);
}

// A focal length in pixels takes precedence over an angle of view. Angles
// describe perspective images.
double ReadFocalLength(const TransformsFrame& frame, char axis, int side_px,
                       bool is_fisheye, std::optional<double> otherwise) {
  constexpr double kMaxMismatch = 1.01;
  const std::string in_pixels = std::string("fl_") + axis;
  const std::string as_angle = std::string("camera_angle_") + axis;
  const auto focal_length_px = frame.FindNumber(in_pixels.c_str());
  const auto by_angle =
      is_fisheye ? std::nullopt
                 : FocalLengthOfAngle(frame, as_angle.c_str(), side_px);
  if (focal_length_px && by_angle) {
    const double ratio = *focal_length_px / *by_angle;
    if (std::max(ratio, 1.0 / ratio) > kMaxMismatch) {
      frame.Contradict(in_pixels + " is " + Text(*focal_length_px) + ", but " +
                       as_angle + " is that of " + Text(*by_angle) +
                       " pixels; the former is used");
    }
  }
  for (const auto& value : {focal_length_px, by_angle, otherwise}) {
    if (value) return *value;
  }
  frame.Throw(in_pixels + (is_fisheye ? " is missing, which fisheyes need"
                                      : " and " + as_angle + " are missing"));
}

// nerfstudio names the model, instant-ngp has a flag. Without either, images
// are perspective.
std::string ReadModel(const TransformsFrame& frame) {
  const Json* flag = frame.Find("is_fisheye");
  if (flag != nullptr && !flag->is_boolean()) {
    frame.Throw("is_fisheye is not true or false");
  }
  const bool is_fisheye = flag != nullptr && flag->get<bool>();
  std::string model =
      frame.Text("camera_model", is_fisheye ? "OPENCV_FISHEYE" : "OPENCV");
  if (is_fisheye && model != "OPENCV_FISHEYE") {
    frame.Throw("is_fisheye contradicts the camera_model '" + Printable(model) +
                "'; remove the wrong one");
  }
  return model;
}

// Appends the distortion of perspective images to fx, fy, cx, cy.
void SetDistortion(const TransformsFrame& frame, Camera* camera) {
  std::vector<double> coefficients;
  for (const char* name : {"k1", "k2", "k3", "k4", "p1", "p2"}) {
    coefficients.push_back(frame.Number(name, 0.0));
  }
  const auto& c = coefficients;
  const double k1 = c[0], k2 = c[1], k3 = c[2], k4 = c[3];
  if (k4 != 0.0) {
    frame.Throw("COLMAP has no camera model with a fourth radial coefficient");
  }
  if (AllOf(coefficients, [](double value) { return value == 0.0; })) return;
  camera->model =
      k3 != 0.0 ? CameraModelId::kFullOpenCV : CameraModelId::kOpenCV;
  std::vector<double>& params = camera->params;
  params.insert(params.end(), {k1, k2, c[4], c[5]});
  if (k3 != 0.0) params.insert(params.end(), {k3, 0.0, 0.0, 0.0});
}

Camera ReadCamera(const TransformsFrame& frame, const Eigen::Vector2i& size) {
  Camera camera{kUnnumbered, CameraModelId::kPinhole, size.x(), size.y(), {}};
  const std::string model = ReadModel(frame);
  if (model == "EQUIRECTANGULAR") {
    camera.model = CameraModelId::kEquirectangular;
    camera.params = {static_cast<double>(size.x()),
                     static_cast<double>(size.y())};
    return camera;
  }
  const bool is_fisheye = model == "OPENCV_FISHEYE";
  const double fx =
      ReadFocalLength(frame, 'x', size.x(), is_fisheye, std::nullopt);
  const double fy = ReadFocalLength(frame, 'y', size.y(), is_fisheye, fx);
  camera.params = {fx, fy, frame.Number("cx", 0.5 * size.x()),
                   frame.Number("cy", 0.5 * size.y())};
  if (is_fisheye) {
    camera.model = CameraModelId::kOpenCVFisheye;
    for (const char* name : {"k1", "k2", "k3", "k4"}) {
      camera.params.push_back(frame.Number(name, 0.0));
    }
    for (const char* name : {"p1", "p2"}) {
      if (frame.Number(name, 0.0) == 0.0) continue;
      frame.Throw(
          "COLMAP has no fisheye camera model with tangential "
          "distortion");
    }
    return camera;
  }
  for (const char* name : {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL",
                           "SIMPLE_RADIAL", "PERSPECTIVE"}) {
    if (model != name) continue;
    SetDistortion(frame, &camera);
    if (camera.params.size() > 4 &&
        model.find("PINHOLE") != std::string::npos) {
      frame.Contradict("the camera_model is " + model +
                       ", but there are coefficients of distortion; they are "
                       "used");
    }
    return camera;
  }
  frame.Throw("the camera_model '" + Printable(model) + "' is not known");
}

Json ReadJson(const fs::path& path) {
  Json json =
      ParseJson(ReadFile(path), "'" + path.string() + "' (transforms.json)");
  const bool has_frames =
      json.is_object() && json.contains("frames") && json["frames"].is_array();
  if (!has_frames) {
    throw Error("'" + path.string() +
                "' is not a transforms.json: it has no list 'frames'; write it "
                "again");
  }
  return json;
}

void RemoveCommonFolder(std::vector<ImportedImage>* images) {
  for (const ImportedImage& image : *images) {
    if (image.name.rfind(kImageFolder, 0) != 0) return;
  }
  for (ImportedImage& image : *images) {
    image.name.erase(0, kImageFolder.size());
  }
}

}  // namespace

Model ReadNerfstudio(const ImportInput& input, const Context& context) {
  const Json json = ReadJson(input.path);
  ImportedModel model;
  std::string contradiction;
  for (const Json& item : json["frames"]) {
    context.CheckInterrupted();
    const TransformsFrame frame(json, item, model.images.size(), input.path,
                                &contradiction);
    std::string name = frame.Text("file_path", nullptr);
    if (name.rfind("./", 0) == 0) name.erase(0, 2);
    const Rigid3 pose = ReadPose(frame);
    model.images.push_back(
        {name, pose, ReadCamera(frame, ReadSize(frame, name, input))});
  }
  if (!contradiction.empty()) context.Warning(contradiction);
  RemoveCommonFolder(&model.images);
  const auto points = json.find("ply_file_path");
  if (points != json.end() && points->is_string()) {
    model.points =
        ReadPly(input.path.parent_path() / points->get<std::string>());
  }
  return MakeModel(std::move(model), input.path);
}

}  // namespace mgsfm
