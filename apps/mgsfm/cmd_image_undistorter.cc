// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/format.h"
#include "base/grouped_warnings.h"
#include "base/parallel.h"
#include "base/text_tools.h"
#include "cmd_images.h"
#include "command.h"
#include "commands.h"
#include "exchange/ply.h"
#include "files/file_operations.h"
#include "files/staged_output.h"
#include "imaging/image_run.h"
#include "imaging/layouts.h"
#include "mapper_run.h"
#include "mgsfm/imaging/undistorted_model.h"
#include "mgsfm/imaging/views.h"
#include "model_file.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

enum class UndistortionLayout {
  kColmap,
  kMvs,
  kGaussianSplatting,
  kNerfstudio
};

}  // namespace

template <>
struct EnumTable<UndistortionLayout> {
  static constexpr std::pair<std::string_view, UndistortionLayout> kNames[] = {
      {"COLMAP", UndistortionLayout::kColmap},
      {"colmap", UndistortionLayout::kColmap},
      {"mvs", UndistortionLayout::kMvs},
      {"gaussian_splatting", UndistortionLayout::kGaussianSplatting},
      {"nerfstudio", UndistortionLayout::kNerfstudio}};
};

namespace {

struct ImageUndistorterOptions {
  Option<std::string> image_path{
      "image_path", "", Required(),
      "Undistort the images of the model in this folder."};
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Read the model in this folder."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write images, masks and the model into this folder. Images of an "
      "interrupted run with the same settings are kept."};
  Option<UndistortionLayout> output_type{
      "output_type", UndistortionLayout::kColmap,
      "Choose the layout of the output. COLMAP: folders images and sparse. "
      "mvs: also COLMAP's folder stereo. gaussian_splatting: images without "
      "subfolders, sparse/0, centered principal points. nerfstudio: images "
      "without subfolders, transforms.json."};
  Option<std::string> mask_path{"mask_path", "",
                                "Undistort the masks in this folder, too, such "
                                "as cam0/a.jpg.png for cam0/a.jpg."};
  Option<std::string> camera_mask_path{
      "camera_mask_path", "",
      "Undistort the masks of cameras, too: cam0.png in this folder for all "
      "images below cam0, or a file for all images."};
  Option<int> jpeg_quality{"jpeg_quality", 95, Between(1, 100),
                           "Set the quality of JPEG images; 100 is best."};
  ViewOptions views;
  ModelRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(image_path, input_path, output_path, output_type, mask_path,
          camera_mask_path, jpeg_quality, views, rigs);
  }
};

const char* ModelFolder(UndistortionLayout layout) {
  switch (layout) {
    case UndistortionLayout::kGaussianSplatting:
      return "sparse/0";
    case UndistortionLayout::kNerfstudio:
      return "colmap/sparse/0";
    case UndistortionLayout::kColmap:
    case UndistortionLayout::kMvs:
      break;
  }
  return "sparse";
}

// Trainers drop the folders of cameras where they scale images or find masks.
ViewNaming NamingOf(UndistortionLayout layout) {
  return layout == UndistortionLayout::kGaussianSplatting ||
                 layout == UndistortionLayout::kNerfstudio
             ? ViewNaming::kFlat
             : ViewNaming::kFolders;
}

std::string CanonicalOrEmpty(const std::string& path) {
  if (path.empty()) return "";
  return fs::weakly_canonical(fs::absolute(path)).string();
}

// ------------------------------------------------------------------- settings

Json ToJson(const Camera& camera) {
  return {{"model", InfoOf(camera.model).name},
          {"width", camera.width_px},
          {"height", camera.height_px},
          {"params", camera.params}};
}

// Everything that images depend on, so that a run continues another only if it
// would write the same images.
std::string Settings(const ImageUndistorterOptions& options,
                     const Reconstruction& model,
                     const std::vector<std::vector<View>>& views_of_camera,
                     bool writes_masks) {
  Json cameras = Json::array();
  for (size_t i = 0; i < model.cameras.size(); ++i) {
    Json views = Json::array();
    for (const View& view : views_of_camera[i]) {
      views.push_back({{"name", view.name},
                       {"camera", ToJson(view.camera)},
                       {"max_view_angle_rad", view.max_view_angle_rad}});
    }
    cameras.push_back(
        {{"camera", ToJson(model.cameras[i])}, {"views", std::move(views)}});
  }
  const Json settings = {
      {"image_path", CanonicalOrEmpty(options.image_path)},
      {"mask_path", CanonicalOrEmpty(options.mask_path)},
      {"camera_mask_path", CanonicalOrEmpty(options.camera_mask_path)},
      {"has_flat_names", NamingOf(options.output_type) == ViewNaming::kFlat},
      {"has_masks", writes_masks},
      {"jpeg_quality", *options.jpeg_quality},
      {"cameras", std::move(cameras)}};
  return settings.dump(1) + "\n";
}

// ---------------------------------------------------------------------- steps

std::vector<std::vector<View>> PlanAllViews(const Reconstruction& model,
                                            ViewOptions options,
                                            UndistortionLayout layout,
                                            const Context& context) {
  if (layout == UndistortionLayout::kGaussianSplatting) {
    options.center_principal_point = true;
  }
  std::vector<std::vector<View>> views(model.cameras.size());
  ParallelFor(
      views.size(), context.num_threads,
      [&](size_t i) { views[i] = PlanViews(model.cameras[i], options); }, 1);
  return views;
}

void LogViews(const Scene& scene,
              const std::vector<std::vector<View>>& views_of_camera,
              const Context& context) {
  // Limits the log, not the output.
  constexpr size_t kMaxNumCameras = 20;
  for (size_t i = 0; i < std::min(kMaxNumCameras, views_of_camera.size());
       ++i) {
    std::string line = CameraLabel(scene, static_cast<int>(i)) + ": ";
    const std::vector<View>& views = views_of_camera[i];
    for (const View& view : views) {
      if (!view.name.empty()) line += view.name + " ";
    }
    const Camera& camera = views.front().camera;
    context.Info(line + (views.size() > 1 ? "of " : "") +
                 SizeText(camera.width_px, camera.height_px) + " px");
  }
}

bool NeedsMasks(const ImageUndistorterOptions& options,
                const Reconstruction& model,
                const std::vector<std::vector<View>>& views_of_camera) {
  if (!options.mask_path->empty() || !options.camera_mask_path->empty()) {
    return true;
  }
  for (size_t i = 0; i < views_of_camera.size(); ++i) {
    for (const View& view : views_of_camera[i]) {
      if (HasBlankPixels(model.cameras[i], view)) return true;
    }
  }
  return false;
}

std::vector<ImageTask> MakeTasks(const Scene& original,
                                 const UndistortedModel& undistorted) {
  std::map<int, ImageTask> tasks;  // by image
  for (size_t i = 0; i < undistorted.sources.size(); ++i) {
    const UndistortedModel::Source& source = undistorted.sources[i];
    const Image& image = original.images[source.image_idx];
    ImageTask& task = tasks[source.image_idx];
    task.name = image.name;
    task.camera_idx = image.camera_idx;
    task.view_names.resize(
        std::max(task.view_names.size(), size_t(source.view_idx) + 1));
    task.view_names[source.view_idx] = undistorted.scene.images[i].name;
  }
  std::vector<ImageTask> list;
  for (auto& [image_idx, task] : tasks) list.push_back(std::move(task));
  return list;
}

// Warns of images without points: their poses come from other images of their
// frames, so no point shows whether they see the scene.
void WarnOfImagesWithoutPoints(const SceneModel& model,
                               const Context& context) {
  Mask has_point(model.scene.images.size(), false);
  for (const Point3D& point : model.reconstruction.points) {
    for (const Observation& o : point.track) has_point[o.image_idx] = true;
  }
  GroupedWarnings warnings;
  for (size_t i = 0; i < has_point.size(); ++i) {
    if (has_point[i] || model.reconstruction.points.empty()) continue;
    warnings.Add("image '" + model.scene.images[i].name +
                 "' sees no point of the model, so that it may be black or "
                 "show something else; look at it before a training, or remove "
                 "it with image_deleter");
  }
  warnings.Log(context);
}

void WriteLayoutFiles(const ImageUndistorterOptions& options, bool has_masks,
                      const UndistortedModel& model) {
  const fs::path output_path = *options.output_path;
  if (options.output_type == UndistortionLayout::kMvs) {
    WriteStereoFolder(output_path / "stereo", model.scene);
  } else if (options.output_type == UndistortionLayout::kNerfstudio) {
    ReplaceFile(output_path / "sparse_pc.ply",
                PointsToPly(model.reconstruction));
    ReplaceFile(
        output_path / "transforms.json",
        NerfstudioTransforms(model.scene, model.reconstruction, has_masks));
  }
}

int RunImageUndistorter(const ImageUndistorterOptions& options,
                        const Context& context) {
  CheckImagePath(options.image_path);
  const MaskPaths mask_paths = {*options.mask_path, *options.camera_mask_path};
  CheckIsApart(*options.output_path, *options.image_path, mask_paths);
  const ModelFile tool_model =
      ReadModelFile(options.input_path, options.rigs, context);
  const SceneModel& input = tool_model.model;
  const std::vector<std::vector<View>> views_of_camera = PlanAllViews(
      input.reconstruction, options.views, options.output_type, context);
  UndistortedModel model =
      UndistortModel(input.scene, input.reconstruction, views_of_camera,
                     NamingOf(options.output_type), context);
  LogViews(input.scene, views_of_camera, context);
  WarnOfImagesWithoutPoints(input, context);
  const bool has_masks =
      NeedsMasks(options, input.reconstruction, views_of_camera);

  const fs::path output_path = *options.output_path;
  const std::vector<ImageTask> tasks = MakeTasks(input.scene, model);
  CheckImagesExist(tasks, *options.image_path);
  CheckMasksOf(tasks, mask_paths, context);
  ContinueOrBegin(output_path, Settings(options, input.reconstruction,
                                        views_of_camera, has_masks));
  StagedOutput output(output_path / ModelFolder(options.output_type),
                      OutputKind::kModel);
  const ImageRunSummary summary =
      WriteViews(tasks, input.reconstruction.cameras, views_of_camera,
                 {*options.image_path, mask_paths, output_path, has_masks,
                  options.jpeg_quality},
                 context);
  WriteLayoutFiles(options, has_masks, model);
  const size_t num_images = model.scene.images.size();
  WriteModelFile({{std::move(model.scene), std::move(model.reconstruction)},
                  tool_model.origin_wgs84},
                 ModelFormat::kBinary, context, &output);
  context.Info("undistorted " + Describe(summary) +
               Formatted("; %zu images in the result", num_images));
  return kExitSuccess;
}

}  // namespace

Command ImageUndistorterCommand() {
  return MakeResumableCommand("image_undistorter",
                              "Makes pinhole images and their model, for dense "
                              "matching and Gaussian splatting.",
                              RunImageUndistorter);
}

}  // namespace mgsfm
