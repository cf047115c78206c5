// SPDX-License-Identifier: BSD-3-Clause
#include "imaging/image_splitting.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "base/file_reading.h"
#include "base/grouped_warnings.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "base/text_tools.h"
#include "files/file_operations.h"
#include "files/image_reading.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/imaging/undistorted_model.h"
#include "mgsfm/imaging/views.h"
#include "mgsfm/rigs/rig_config.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// The images of one folder, which have one size.
struct ImageFolder {
  std::string path;
  Camera camera;
  bool is_combined = false;
  std::vector<View> views;
};

struct Plan {
  std::vector<ImageFolder> folders;  // sorted by path
  std::vector<ImageTask> tasks;      // camera_idx is that of the folder
};

std::optional<ImageSize> SizeOfFile(const fs::path& path) {
  return ReadImageSize(ReadFile(path, "", kMaxImageHeaderBytes));
}

// ------------------------------------------------------------------- views

// Crops are pinhole images with the principal point of the whole image.
View Crop(Camera pinhole, const std::string& name, int x_px, int width_px) {
  pinhole.width_px = width_px;
  pinhole.params[2] -= x_px;
  return {name, Eigen::Quaterniond::Identity(), std::move(pinhole), kPi};
}

ImageFolder PlanPanoramas(const std::string& path, int width_px, int height_px,
                          const SplittingOptions& options) {
  Camera camera{CameraId(1), CameraModelId::kEquirectangular,   width_px,
                height_px,   {1.0 * width_px, 1.0 * height_px}, true};
  ViewOptions view_options;
  view_options.field_of_view_deg = *options.field_of_view_deg;
  view_options.max_image_size = *options.max_image_size;
  std::vector<View> views = PlanViews(camera, view_options);
  return {path, std::move(camera), true, std::move(views)};
}

ImageFolder PlanFolder(const std::string& path, const ImageSize& size,
                       CombinedImages kind, const SplittingOptions& options) {
  const bool is_combined = size.width == 2 * size.height;
  const auto width_px = static_cast<int>(size.width);
  const auto height_px = static_cast<int>(size.height);
  if (is_combined && kind == CombinedImages::kPanorama) {
    return PlanPanoramas(path, width_px, height_px, options);
  }
  const double focal_px = width_px;
  const Camera camera{CameraId(1),
                      CameraModelId::kPinhole,
                      width_px,
                      height_px,
                      {focal_px, focal_px, 0.5 * width_px, 0.5 * height_px},
                      false};
  if (!is_combined) {
    return {path, camera, false, {Crop(camera, "", 0, width_px)}};
  }
  return {path,
          camera,
          true,
          {Crop(camera, "left", 0, height_px),
           Crop(camera, "right", height_px, height_px)}};
}

// -------------------------------------------------------------------- plan

Plan MakePlan(const SplittingInput& input, CombinedImages kind,
              const SplittingOptions& options, const Context& context) {
  Plan plan;
  GroupedWarnings warnings;
  std::map<std::string, int> folder_of_path;
  for (const std::string& name : input.names) {
    const auto size = SizeOfFile(input.image_path / name);
    if (!size) {
      warnings.Add("'" + name + "' is skipped because it is not an image");
      continue;
    }
    const auto [found, is_new] = folder_of_path.emplace(
        FolderOfName(name), static_cast<int>(plan.folders.size()));
    if (is_new) {
      plan.folders.push_back(PlanFolder(found->first, *size, kind, options));
    }
    const ImageFolder& folder = plan.folders[found->second];
    if (size->width != folder.camera.width_px ||
        size->height != folder.camera.height_px) {
      warnings.Add("image '" + name +
                   "' is skipped because it differs in size from others of its "
                   "folder");
      continue;
    }
    plan.tasks.push_back(
        {name, found->second, Transformed(folder.views, [&](const View& view) {
           return NameOfView(name, view.name);
         })});
  }
  warnings.Log(context);
  return plan;
}

std::string Settings(const SplittingInput& input, const Plan& plan,
                     CombinedImages kind, const SplittingOptions& options) {
  nlohmann::ordered_json folders = nlohmann::ordered_json::array();
  for (const ImageFolder& folder : plan.folders) {
    folders.push_back({{"folder", folder.path},
                       {"width", folder.camera.width_px},
                       {"height", folder.camera.height_px}});
  }
  const auto canonical = [](const fs::path& path) {
    return path.empty() ? ""
                        : fs::weakly_canonical(fs::absolute(path)).string();
  };
  const nlohmann::ordered_json settings = {
      {"image_path", canonical(input.image_path)},
      {"mask_path", canonical(input.mask_paths.of_images)},
      {"camera_mask_path", canonical(input.mask_paths.of_cameras)},
      {"kind", EnumName(kind)},
      {"field_of_view_deg", *options.field_of_view_deg},
      {"max_image_size_px", *options.max_image_size},
      {"jpeg_quality", *options.jpeg_quality},
      {"folders", std::move(folders)}};
  return settings.dump(1) + "\n";
}

// ------------------------------------------------------------------- rigs

// "a/pano_front/" for the view "front" of images in "a/pano".
std::string PrefixOfView(const std::string& folder, const std::string& view) {
  return FolderOfName(NameOfView(folder.empty() ? "x" : folder + "/x", view)) +
         "/";
}

// The poses of image folders in their rig, by folder path.
using FolderPoses = std::map<std::string, Rigid3>;

FolderPoses ReadFolderPoses(const fs::path& path, const Plan& plan) {
  FolderPoses poses;
  if (path.empty()) return poses;
  std::string names;
  for (const RigConfig& rig : ReadRigConfig(path.string())) {
    for (const RigConfigCamera& camera : rig.cameras) {
      names += " '" + camera.image_prefix + "'";
      for (const ImageFolder& folder : plan.folders) {
        if (folder.path + "/" != camera.image_prefix || !camera.cam_from_rig) {
          continue;
        }
        poses.emplace(folder.path, *camera.cam_from_rig);
      }
    }
  }
  if (poses.empty()) {
    throw Error("'" + path.string() + "' has the pose of no folder of images:" +
                names + "; name the folders that are split, such as 'pano/'");
  }
  return poses;
}

// `cam_from_rig` is the pose of the folder in the rig, if known.
std::vector<RigConfigCamera> CamerasOf(
    const ImageFolder& folder, bool is_reference,
    const std::optional<Rigid3>& cam_from_rig) {
  std::vector<RigConfigCamera> cameras;
  for (const View& view : folder.views) {
    RigConfigCamera camera;
    camera.image_prefix = PrefixOfView(folder.path, view.name);
    camera.is_reference = is_reference && cameras.empty();
    if (cam_from_rig) {
      camera.cam_from_rig =
          Rigid3{view.view_from_cam, Eigen::Vector3d::Zero()} * *cam_from_rig;
    }
    if (folder.is_combined) {
      camera.camera_model = view.camera.model;
      camera.camera_params = view.camera.params;
    }
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

// A rig for each folder with subfolders of panoramas. The first subfolder is
// the reference.
std::vector<RigConfig> MakeRigs(const Plan& plan, const FolderPoses& poses) {
  std::map<std::string, std::vector<const ImageFolder*>> panoramas, others;
  for (const ImageFolder& folder : plan.folders) {
    (folder.is_combined ? panoramas : others)[FolderOfName(folder.path)]
        .push_back(&folder);
  }
  std::vector<RigConfig> rigs;
  for (const auto& [parent, folders] : panoramas) {
    RigConfig rig;
    const auto reference = poses.find(folders.front()->path);
    const auto add = [&](const ImageFolder& folder) {
      const bool is_reference = rig.cameras.empty();
      std::optional<Rigid3> cam_from_rig;
      const auto pose = poses.find(folder.path);
      if (is_reference) {
        cam_from_rig = Rigid3();
      } else if (pose != poses.end() && reference != poses.end()) {
        cam_from_rig = pose->second * reference->second.Inverse();
      }
      for (auto& camera : CamerasOf(folder, is_reference, cam_from_rig)) {
        rig.cameras.push_back(std::move(camera));
      }
    };
    for (const ImageFolder* folder : folders) add(*folder);
    for (const ImageFolder* folder : others[parent]) {
      if (!folder->path.empty()) add(*folder);
    }
    rigs.push_back(std::move(rig));
  }
  return rigs;
}

std::string LineOf(const std::string& folder, const Camera& pinhole) {
  std::string line = folder + " PINHOLE " + std::to_string(pinhole.width_px) +
                     " " + std::to_string(pinhole.height_px);
  for (const double param : pinhole.params) {
    line += " " + FormatDouble(param, std::chars_format::general, 17);
  }
  return line + "\n";
}

// Whether a line `folder MODEL ...` belongs to a folder, whose name may have
// blanks.
bool IsLineOf(const std::string& folder, std::string_view line) {
  const std::string begin = folder.empty() ? "." : folder;
  if (line.substr(0, begin.size()) != begin) return false;
  line.remove_prefix(begin.size());
  return line != TrimBlanks(line) &&
         FindCameraModel(TakeWord(&line)) != nullptr;
}

// The lines for the views, and for other folders from camera_params_path.
std::string MakeCameraFile(const SplittingInput& input, const Plan& plan) {
  std::vector<std::string> given;
  if (!input.camera_params_path.empty()) {
    TextLines lines(input.camera_params_path);
    while (lines.NextContent()) given.emplace_back(lines.line());
  }
  std::string file;
  for (const ImageFolder& folder : plan.folders) {
    if (folder.is_combined) {
      for (const View& view : folder.views) {
        const std::string prefix = PrefixOfView(folder.path, view.name);
        file += LineOf(prefix.substr(0, prefix.size() - 1), view.camera);
      }
      continue;
    }
    const auto line = std::find_if(given.begin(), given.end(),
                                   [&](const std::string& candidate) {
                                     return IsLineOf(folder.path, candidate);
                                   });
    if (line == given.end()) {
      throw Error("the images in the folder '" +
                  (folder.path.empty() ? "." : folder.path) +
                  "' are not panoramas, so their intrinsics must be known; add "
                  "a line for the folder to camera_params_path");
    }
    file += *line + "\n";
  }
  return file;
}

}  // namespace

ImageRunSummary SplitImages(const SplittingInput& input, CombinedImages kind,
                            const SplittingOptions& options,
                            const Context& context) {
  CheckIsApart(input.output_path, input.image_path, input.mask_paths);
  const Plan plan = MakePlan(input, kind, options, context);
  if (!AnyOf(plan.folders, &ImageFolder::is_combined)) {
    throw Error("no image in '" + input.image_path.string() +
                "' is twice as wide as high, as images of type " +
                std::string(EnumName(kind)) +
                " are; choose another folder or type");
  }
  const bool is_panorama = kind == CombinedImages::kPanorama;
  const std::string camera_file =
      is_panorama ? MakeCameraFile(input, plan) : "";
  const std::string rigs =
      is_panorama ? RigConfigsToJson(MakeRigs(
                        plan, ReadFolderPoses(input.rig_config_path, plan)))
                  : "";
  CheckMasksOf(plan.tasks, input.mask_paths, context);
  ContinueOrBegin(input.output_path, Settings(input, plan, kind, options));
  const ImageRunSummary summary =
      WriteViews(plan.tasks, Transformed(plan.folders, &ImageFolder::camera),
                 Transformed(plan.folders, &ImageFolder::views),
                 {input.image_path, input.mask_paths, input.output_path,
                  !input.mask_paths.empty(), options.jpeg_quality, true},
                 context);
  if (is_panorama) {
    ReplaceFile(input.output_path / "cameras.txt", camera_file);
    ReplaceFile(input.output_path / "rig_config.json", rigs);
  }
  return summary;
}

}  // namespace mgsfm
