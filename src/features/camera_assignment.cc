// SPDX-License-Identifier: BSD-3-Clause
#include "features/camera_assignment.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "base/file_reading.h"
#include "base/grouped_warnings.h"
#include "base/text.h"
#include "base/text_streams.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// "." for images that are in no folder.
std::string FolderOf(const std::string& image_name) {
  const size_t slash = image_name.rfind('/');
  return slash == std::string::npos ? "." : image_name.substr(0, slash);
}

std::string SizeText(int width, int height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

const CameraModelInfo& ModelOf(const Camera& camera) {
  return *FindCameraModel(static_cast<int32_t>(camera.model));
}

// Parses a finite number; `what` names it in errors.
double ParseNumber(const std::string& text, const std::string& what) {
  const std::optional<double> number = ParseDouble(text);
  if (!number) throw Error(what + ": '" + text + "' is not a number");
  return *number;
}

void SetParams(const std::vector<std::string>& texts, const std::string& what,
               Camera* camera) {
  const CameraModelInfo& model = ModelOf(*camera);
  if (texts.size() != static_cast<size_t>(model.num_params)) {
    throw Error(what + ": " + std::string(model.name) + " has " +
                std::to_string(model.num_params) + " parameters, not " +
                std::to_string(texts.size()));
  }
  for (const std::string& text : texts) {
    camera->params.push_back(ParseNumber(text, what));
  }
  camera->has_prior_focal_length = true;
}

Camera ParseTemplate(const ImageReaderOptions& options) {
  const CameraModelInfo* model =
      FindCameraModel(std::string_view(*options.camera_model));
  if (model == nullptr) {
    throw Error(
        "ImageReader.camera_model: there is no camera model '" +
        *options.camera_model +
        "'; use PINHOLE, SIMPLE_RADIAL, OPENCV, OPENCV_FISHEYE or another of "
        "COLMAP's models");
  }
  Camera camera{CameraId(0), model->id, 0, 0, {}, false};
  if (options.camera_params->empty()) return camera;
  std::vector<std::string> texts;
  TextInput stream(options.camera_params);
  for (std::string text; std::getline(stream, text, ',');) {
    text.erase(0, text.find_first_not_of(' '));
    text.erase(text.find_last_not_of(' ') + 1);
    texts.push_back(text);
  }
  SetParams(texts, "ImageReader.camera_params", &camera);
  return camera;
}

// `folder MODEL width height params...`; the folder may contain blanks.
std::pair<std::string, Camera> ParseCameraLine(const std::string& line,
                                               const std::string& what) {
  TextInput stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  const auto is_model = [](const std::string& word) {
    return FindCameraModel(std::string_view(word)) != nullptr;
  };
  const auto model = std::find_if(words.begin(), words.end(), is_model);
  if (model == words.begin() || words.end() - model < 3) {
    throw Error(what +
                ": expected `folder MODEL width height params...` with one of "
                "COLMAP's camera models");
  }
  std::string folder = line.substr(0, line.find(" " + *model));
  folder.erase(0, folder.find_first_not_of(" \t"));
  folder.erase(folder.find_last_not_of(" \t/") + 1);
  Camera camera{CameraId(0),
                FindCameraModel(std::string_view(*model))->id,
                static_cast<int>(ParseNumber(model[1], what)),
                static_cast<int>(ParseNumber(model[2], what)),
                {},
                false};
  SetParams(std::vector<std::string>(model + 3, words.end()), what, &camera);
  return {folder, camera};
}

[[noreturn]] void ThrowDuplicateFolder(const std::string& what,
                                       const std::string& folder) {
  throw Error(what + ": duplicate folder '" + folder + "'");
}

std::map<std::string, Camera> ReadCameraFile(const std::string& path) {
  std::map<std::string, Camera> cameras;
  if (path.empty()) return cameras;
  TextInput file(
      ReadFile(path, "'" + path + "' (ImageReader.camera_params_path)"));
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    std::replace(line.begin(), line.end(), '\t', ' ');
    const size_t begin = line.find_first_not_of(" \r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    const std::string what = path + ", line " + std::to_string(number);
    auto [folder, camera] = ParseCameraLine(line, what);
    if (!cameras.emplace(folder, std::move(camera)).second) {
      ThrowDuplicateFolder(what, folder);
    }
  }
  return cameras;
}

[[noreturn]] void ThrowMissingFolder(const std::string& path,
                                     const std::string& folder,
                                     const std::string& image_name) {
  throw Error("'" + path + "' has no line for the folder '" + folder +
              "' of image '" + image_name + "'; add it");
}

// No distortion; the principal point is the image centre.
std::vector<double> DefaultParams(const CameraModelInfo& model, int width,
                                  int height, double focal_length_px) {
  std::vector<double> params(static_cast<size_t>(model.num_params), 0.0);
  for (const int i : model.focal_length_idxs) params[i] = focal_length_px;
  if (model.id == CameraModelId::kEquirectangular) {
    return {static_cast<double>(width), static_cast<double>(height)};
  }
  params[model.principal_point_idxs[0]] = 0.5 * width;
  params[model.principal_point_idxs[1]] = 0.5 * height;
  // In these models zero is singular or does not mean no distortion.
  if (model.id == CameraModelId::kFov) params.back() = 1e-2;
  if (model.id == CameraModelId::kEucm) params.back() = 1.0;
  return params;
}

}  // namespace

CameraAssignment::CameraAssignment(const ImageReaderOptions& options,
                                   const DatabaseContents& structure,
                                   const std::vector<std::string>& image_names,
                                   const Context& context)
    : options_(options),
      template_(ParseTemplate(options)),
      camera_of_folder_(ReadCameraFile(options.camera_params_path)) {
  if (options.single_camera + options.single_camera_per_folder +
          options.single_camera_per_image >
      1) {
    throw Error(
        "only one of ImageReader.single_camera, single_camera_per_folder and "
        "single_camera_per_image can be set");
  }
  if (options.single_camera) mode_ = Mode::kSingle;
  if (options.single_camera_per_image) mode_ = Mode::kPerImage;
  if (!camera_of_folder_.empty()) CheckFolders(image_names, context);
  std::map<CameraId, Camera> cameras;
  for (const Camera& camera : structure.cameras) {
    cameras.emplace(camera.id, camera);
  }
  for (const ImageRow& image : structure.images) {
    camera_of_image_.emplace(image.name, cameras.at(image.camera_id));
  }
  for (const auto& [name, camera] : camera_of_image_) {
    camera_of_key_.emplace(KeyOf(name), camera);
  }
}

void CameraAssignment::CheckFolders(const std::vector<std::string>& image_names,
                                    const Context& context) const {
  if (mode_ == Mode::kSingle) {
    throw Error(
        "ImageReader.camera_params_path specifies one camera per folder, "
        "ImageReader.single_camera one for all images; set only one of them");
  }
  std::set<std::string> folders;
  for (const std::string& name : image_names) {
    const std::string folder = FolderOf(name);
    if (camera_of_folder_.count(folder) == 0) {
      ThrowMissingFolder(*options_.camera_params_path, folder, name);
    }
    folders.insert(folder);
  }
  GroupedWarnings warnings;
  for (const auto& [folder, camera] : camera_of_folder_) {
    if (folders.count(folder) > 0) continue;
    warnings.Add("'" + *options_.camera_params_path + "' names the folder '" +
                 folder + "', which has no images");
  }
  warnings.Log(context);
}

std::string CameraAssignment::KeyOf(const std::string& image_name) const {
  switch (mode_) {
    case Mode::kSingle:
      return "";
    case Mode::kPerFolder:
      return FolderOf(image_name);
    default:
      return image_name;
  }
}

Camera CameraAssignment::MakeCamera(
    const std::string& image_name, int width, int height,
    std::optional<double> focal_length_px) const {
  const auto of_folder = camera_of_folder_.find(FolderOf(image_name));
  if (of_folder != camera_of_folder_.end()) return of_folder->second;
  Camera camera = template_;
  camera.width_px = width;
  camera.height_px = height;
  if (!camera.params.empty()) return camera;
  const double default_focal_length_px =
      options_.default_focal_length_factor * std::max(width, height);
  camera.params =
      DefaultParams(ModelOf(camera), width, height,
                    focal_length_px.value_or(default_focal_length_px));
  camera.has_prior_focal_length = focal_length_px.has_value();
  return camera;
}

CameraAssignment::Result CameraAssignment::Find(
    const std::string& image_name, int width, int height,
    std::optional<double> focal_length_px) const {
  const auto of_image = camera_of_image_.find(image_name);
  const auto of_key = camera_of_key_.find(KeyOf(image_name));
  const bool is_new =
      of_image == camera_of_image_.end() && of_key == camera_of_key_.end();
  Result result{template_, is_new, std::nullopt};
  if (of_image != camera_of_image_.end()) {
    result.camera = of_image->second;
  } else if (!is_new) {
    result.camera = of_key->second;
  } else {
    result.camera = MakeCamera(image_name, width, height, focal_length_px);
  }
  const Camera& camera = result.camera;
  if (camera.width_px != width || camera.height_px != height) {
    result.problem = "has " + SizeText(width, height) +
                     " pixels, but its camera has " +
                     SizeText(camera.width_px, camera.height_px) +
                     "; remove it or set ImageReader.single_camera_per_image";
  }
  return result;
}

void CameraAssignment::Add(const std::string& image_name,
                           const Camera& camera) {
  camera_of_key_.emplace(KeyOf(image_name), camera);
}

}  // namespace mgsfm
