// SPDX-License-Identifier: BSD-3-Clause
#include "features/camera_assignment.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "base/grouped_warnings.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "base/text_tools.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"
#include "scene/intrinsics_check.h"
#include "scene/item_lists.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

// "." for images outside of folders.
std::string FolderOrDot(const std::string& image_name) {
  const std::string folder = FolderOfName(image_name);
  return folder.empty() ? "." : folder;
}

// Parses a finite number; `what` names it in errors.
double ParseNumber(const std::string& text, const std::string& what) {
  const std::optional<double> number = ParseDouble(text);
  if (!number) throw Error(what + ": '" + text + "' is not a number");
  return *number;
}

void SetParams(const std::vector<std::string>& texts, const std::string& what,
               Camera* camera) {
  const CameraModelInfo& model = InfoOf(camera->model);
  if (texts.size() != static_cast<size_t>(model.num_params)) {
    throw Error(what + ": " + std::string(model.name) + " has " +
                std::to_string(model.num_params) + " parameters, not " +
                std::to_string(texts.size()));
  }
  for (const std::string& text : texts) {
    camera->params.push_back(ParseNumber(text, what));
  }
  for (const int i : model.focal_length_idxs) {
    if (camera->params[i] > 0.0) continue;
    throw Error(what + ": the focal length " + texts[static_cast<size_t>(i)] +
                " is not positive; correct it");
  }
  camera->has_prior_focal_length = true;
}

// Also rejects doubtful intrinsics: the user provides the parameters and knows
// the size of the images.
void CheckParams(const Camera& camera, const std::string& what) {
  auto problem = WhyImplausible(camera);
  if (!problem) {
    const auto found = FindIntrinsicsProblem(camera);
    if (found && (found->is_certain || found->is_misread)) {
      problem = found->text;
    }
  }
  if (problem) {
    throw Error(what + ": the camera " + *problem +
                "; give the intrinsics of images of this size");
  }
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
  SetParams(SplitFields(*options.camera_params, ','),
            "ImageReader.camera_params", &camera);
  return camera;
}

int ParseSize(const std::string& text, const std::string& what) {
  const double size_px = ParseNumber(text, what);
  if (!(size_px >= 1.0 && size_px <= kMaxImageSide_px) ||
      size_px != std::floor(size_px)) {
    throw Error(what + ": '" + text + "' is not the size of an image; give " +
                "pixels from 1 to " + std::to_string(kMaxImageSide_px));
  }
  return static_cast<int>(size_px);
}

// `folder MODEL width height params...`; the folder may contain blanks.
std::pair<std::string, Camera> ParseCameraLine(const TextLines& lines) {
  const std::string what = lines.Place();
  const std::vector<std::string_view> found = SplitWords(lines.line());
  const auto model = std::find_if(
      found.begin(), found.end(),
      [](std::string_view word) { return FindCameraModel(word) != nullptr; });
  if (model == found.begin() || found.end() - model < 3) {
    lines.Throw(
        "expected `folder MODEL width height params...` with one of COLMAP's "
        "camera models");
  }
  const auto folder_size =
      static_cast<size_t>(model->data() - lines.line().data());
  std::string folder(TrimBlanks(lines.line().substr(0, folder_size)));
  folder.erase(folder.find_last_not_of('/') + 1);
  const std::vector<std::string> words(model + 1, found.end());
  Camera camera{CameraId(0),
                FindCameraModel(*model)->id,
                ParseSize(words[0], what),
                ParseSize(words[1], what),
                {},
                false};
  SetParams(std::vector<std::string>(words.begin() + 2, words.end()), what,
            &camera);
  CheckParams(camera, what);
  return {folder, camera};
}

std::map<std::string, Camera> ReadCameraFile(const std::string& path) {
  std::map<std::string, Camera> cameras;
  if (path.empty()) return cameras;
  TextLines lines(path, "'" + path + "' (ImageReader.camera_params_path)");
  while (lines.NextContent()) {
    auto [folder, camera] = ParseCameraLine(lines);
    if (!cameras.emplace(folder, std::move(camera)).second) {
      lines.Throw("duplicate folder '" + folder + "'");
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

// No distortion; the principal point is the image center.
std::vector<double> DefaultParams(const CameraModelInfo& model, int width,
                                  int height, double focal_length_px) {
  std::vector<double> params(static_cast<size_t>(model.num_params), 0.0);
  for (const int i : model.focal_length_idxs) params[i] = focal_length_px;
  if (model.id == CameraModelId::kEquirectangular) {
    return {static_cast<double>(width), static_cast<double>(height)};
  }
  params[model.principal_point_idxs[0]] = 0.5 * width;
  params[model.principal_point_idxs[1]] = 0.5 * height;
  // In these models, zero is singular or does not mean zero distortion.
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
  const auto camera_of_id = IndexById(structure.cameras);
  for (const ImageRow& image : structure.images) {
    camera_of_image_.emplace(
        image.name, structure.cameras[camera_of_id.at(image.camera_id)]);
  }
  for (const auto& [name, camera] : camera_of_image_) {
    camera_of_key_.emplace(KeyOf(name), camera);
  }
  WarnOfOtherIntrinsics(context);
}

void CameraAssignment::WarnOfOtherIntrinsics(const Context& context) const {
  size_t num_other = 0;
  std::string example;
  for (const auto& [name, camera] : camera_of_image_) {
    const auto of_folder = camera_of_folder_.find(FolderOrDot(name));
    const Camera& given =
        of_folder != camera_of_folder_.end() ? of_folder->second : template_;
    const bool is_other =
        !given.params.empty() &&
        (given.model != camera.model || given.params != camera.params);
    if (is_other && num_other++ == 0) example = name;
  }
  if (num_other == 0) return;
  context.Warning(
      "the database has other intrinsics of " + std::to_string(num_other) +
      " images than the options of ImageReader give, such as of '" + example +
      "', and keeps them; extract into a new database to use the "
      "given ones");
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
    const std::string folder = FolderOrDot(name);
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
      return FolderOrDot(image_name);
    default:
      return image_name;
  }
}

Camera CameraAssignment::MakeCamera(
    const std::string& image_name, int width, int height,
    std::optional<double> focal_length_px) const {
  const auto of_folder = camera_of_folder_.find(FolderOrDot(image_name));
  if (of_folder != camera_of_folder_.end()) return of_folder->second;
  Camera camera = template_;
  camera.width_px = width;
  camera.height_px = height;
  if (!camera.params.empty()) {
    CheckParams(camera, "ImageReader.camera_params, for image '" + image_name +
                            "' of " + SizeText(width, height) + " pixels");
    return camera;
  }
  const double default_focal_length_px =
      options_.default_focal_length_factor * std::max(width, height);
  camera.params =
      DefaultParams(InfoOf(camera.model), width, height,
                    focal_length_px.value_or(default_focal_length_px));
  camera.has_prior_focal_length = focal_length_px.has_value();
  // Tags of some adapters and editors are wrong by orders of magnitude.
  if (focal_length_px && FindIntrinsicsProblem(camera)) {
    return MakeCamera(image_name, width, height, std::nullopt);
  }
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
