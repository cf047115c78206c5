// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <map>
#include <ostream>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "base/text.h"
#include "base/text_streams.h"
#include "base/text_tools.h"
#include "command.h"
#include "commands.h"
#include "database/database_reader.h"
#include "files/staged_output.h"
#include "geometry/geodetic.h"
#include "math/graph_partition.h"
#include "mgsfm/base/error.h"
#include "model_file.h"

namespace mgsfm {
namespace {

struct ModelAnalyzerOptions {
  Option<std::string> path{"path", "",
                           "Analyze the model in this folder, as in COLMAP."};
  Option<std::string> input_path{
      "input_path", "",
      "Analyze the model in this folder, as in all other commands."};
  ModelRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(path, input_path, rigs);
  }
};

// The lines of COLMAP's analyzer; every image and frame of a model on disk is
// registered.
void Describe(const ModelStatistics& s, std::ostream& text) {
  text << std::fixed << "Rigs: " << s.num_rigs << "\nCameras: " << s.num_cameras
       << "\nFrames: " << s.num_frames
       << "\nRegistered frames: " << s.num_frames
       << "\nImages: " << s.num_images
       << "\nRegistered images: " << s.num_images
       << "\nPoints: " << s.num_points
       << "\nObservations: " << s.num_observations
       << "\nMean track length: " << s.mean_track_length
       << "\nMean observations per image: " << s.mean_observations_per_image
       << "\nMean reprojection error: ";
  if (s.mean_reprojection_error_px) {
    text << *s.mean_reprojection_error_px << "px\n";
  } else {
    text << "unknown\n";
  }
  text << std::defaultfloat;
}

void DescribeSensor(const SceneModel& model, int sensor_idx, bool is_reference,
                    std::ostream& text) {
  const auto num_images = CountIf(model.scene.images, [&](const Image& image) {
    return image.sensor_idx == sensor_idx;
  });
  text << "  " << model.scene.sensors[sensor_idx].name << ": " << num_images
       << " images, ";
  const auto& pose = model.reconstruction.sensor_from_rig[sensor_idx];
  if (is_reference) {
    text << "reference\n";
  } else if (pose) {
    text << pose->translation.norm() << " from the reference\n";
  } else {
    text << "pose in the rig unknown\n";
  }
}

// The baselines are in the unit of the model.
void DescribeRigs(const SceneModel& model, std::ostream& text) {
  for (size_t i = 0; i < model.scene.rigs.size(); ++i) {
    const Rig& rig = model.scene.rigs[i];
    if (rig.sensor_idxs.size() < 2) continue;
    const auto num_frames =
        CountIf(model.scene.frames, [&](const Frame& frame) {
          return frame.rig_idx == static_cast<int>(i);
        });
    text << "Rig " << rig.id.value() << ": " << rig.sensor_idxs.size()
         << " cameras, " << num_frames << " frames\n";
    for (const int sensor_idx : rig.sensor_idxs) {
      DescribeSensor(model, sensor_idx, sensor_idx == rig.ref_sensor_idx, text);
    }
  }
}

CommandResult RunModelAnalyzer(const ModelAnalyzerOptions& options,
                               const Context& context) {
  if (options.path->empty() == options.input_path->empty()) {
    throw Error("set either --path or --input_path, the folder of the model");
  }
  const ModelFile input =
      ReadModelFile(options.path->empty() ? options.input_path : options.path,
                    options.rigs, context);
  TextOutput text;
  Describe(AnalyzeModel(input.model), text);
  DescribeRigs(input.model, text);
  return {kExitSuccess, text.str()};
}

struct ModelCropperOptions : ModelEditOptions {
  ModelCropperOptions()
      : ModelEditOptions("Crop the model in this folder.",
                         "Write the cropped model into this folder.") {}

  Option<std::string> boundary{
      "boundary", "", Required(),
      "Keep the points in the box x1,y1,z1,x2,y2,z2 in the world of the model, "
      "or between two quantiles of the points along each axis, such as "
      "0.01,0.99."};
  Option<bool> boundary_is_gps{
      "boundary_is_gps", false,
      "Interpret the corners of the box as latitude,longitude,altitude. The "
      "model must have a geo_origin.json."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, boundary, boundary_is_gps, output_format,
          rigs);
  }
};

std::vector<double> ParseBoundary(const std::string& text) {
  std::vector<double> values;
  bool is_valid = true;
  for (const std::string& item : SplitList(text)) {
    const std::optional<double> value = ParseDouble(item);
    is_valid &= value.has_value();
    values.push_back(value.value_or(0.0));
  }
  const bool are_quantiles =
      values.size() == 2 && values[0] >= 0.0 && values[1] <= 1.0;
  for (size_t i = 0; is_valid && 2 * i < values.size(); ++i) {
    is_valid = values[i] <= values[i + values.size() / 2];
  }
  if (!is_valid || (values.size() != 6 && !are_quantiles)) {
    throw Error("--boundary '" + text +
                "' is neither x1,y1,z1,x2,y2,z2 with x1 <= x2, y1 <= y2 and z1 "
                "<= z2, nor two quantiles between 0 and 1");
  }
  return values;
}

Eigen::AlignedBox3d MakeBox(const ModelCropperOptions& options,
                            const std::vector<double>& boundary,
                            const ModelFile& input) {
  if (boundary.size() == 2) {
    if (input.model.reconstruction.points.empty()) {
      throw Error("'" + *options.input_path +
                  "' has no points, so --boundary cannot be quantiles");
    }
    return BoxOfQuantiles(input.model, boundary[0], boundary[1]);
  }
  const Eigen::Vector3d low(boundary[0], boundary[1], boundary[2]);
  const Eigen::Vector3d high(boundary[3], boundary[4], boundary[5]);
  if (!options.boundary_is_gps) return {low, high};
  if (!input.origin_wgs84) {
    throw Error("'" + *options.input_path +
                "' has no geo_origin.json; align it to GPS with "
                "model_aligner, or do not set --boundary_is_gps");
  }
  Eigen::AlignedBox3d box(EastNorthUp(low, *input.origin_wgs84));
  box.extend(EastNorthUp(high, *input.origin_wgs84));
  return box;
}

int RunModelCropper(const ModelCropperOptions& options,
                    const Context& context) {
  const std::vector<double> boundary = ParseBoundary(options.boundary);
  const std::string size = EditModel(options, context, [&](ModelFile* file) {
    KeepBox(MakeBox(options, boundary, *file), &file->model);
    if (!file->model.reconstruction.points.empty()) return;
    throw Error("no point of '" + *options.input_path +
                "' lies in --boundary; nothing is written");
  });
  context.Info("the cropped model has " + size);
  return kExitSuccess;
}

struct ImageDeleterOptions : ModelEditOptions {
  ImageDeleterOptions()
      : ModelEditOptions(
            "Read the model in this folder.",
            "Write the model without the images into this folder.") {}

  Option<std::string> image_names_path{
      "image_names_path", "",
      "Delete the images listed in this text file, one name per line."};
  Option<std::string> image_ids_path{
      "image_ids_path", "",
      "Delete the images listed in this text file, one id per line."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, image_names_path, image_ids_path,
          output_format, rigs);
  }
};

// Marks the images in a list; `keys` are all names or ids.
void MarkDeleted(const std::string& list_path,
                 const std::vector<std::string>& keys,
                 const std::string& model_path, Mask* keeps_image) {
  if (list_path.empty()) return;
  std::map<std::string, size_t> image_of_key;
  for (size_t i = 0; i < keys.size(); ++i) image_of_key[keys[i]] = i;
  for (const std::string& key : ReadImageList(list_path)) {
    const auto found = image_of_key.find(key);
    if (found == image_of_key.end()) {
      throw Error(std::string("'").append(list_path) + "' lists '" + key +
                  "', which is not an image of '" + model_path +
                  "'; remove the line");
    }
    (*keeps_image)[found->second] = false;
  }
}

int RunImageDeleter(const ImageDeleterOptions& options,
                    const Context& context) {
  if (options.image_names_path->empty() && options.image_ids_path->empty()) {
    throw Error("give --image_names_path or --image_ids_path");
  }
  const std::string& path = options.input_path;
  const std::string size = EditModel(options, context, [&](ModelFile* file) {
    const std::vector<Image>& images = file->model.scene.images;
    const auto names = Transformed(images, &Image::name);
    const auto ids = Transformed(images, [](const Image& image) {
      return std::to_string(image.id.value());
    });
    Mask keeps_image(names.size(), true);
    MarkDeleted(options.image_names_path, names, path, &keeps_image);
    MarkDeleted(options.image_ids_path, ids, path, &keeps_image);
    if (!keeps_image.Any()) {
      throw Error("all images of '" + path +
                  "' are listed; nothing would be left");
    }
    KeepImages(keeps_image, &file->model);
  });
  context.Info("the model has " + size + " left");
  return kExitSuccess;
}

namespace fs = std::filesystem;

struct ModelSplitterOptions {
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Split the model in this folder."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write the models 0, 1, ... into this folder."};
  Option<int> num_clusters{"num_clusters", 2, AtLeast(2), "clusters",
                           "Split into this many models, or fewer if further "
                           "cuts would cross weak seams."};
  Option<int> num_overlap_frames{
      "num_overlap_frames", 10, AtLeast(3), "frames",
      "Let both models share this many frames on either side of a cut."};
  Option<ModelFormat> output_format{"output_format", ModelFormat::kBinary,
                                    "Write models in binary or text format."};
  ModelRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path, output_path, num_clusters, num_overlap_frames,
          output_format, rigs);
  }
};

// Frames are connected by the points that both observe.
std::vector<GraphEdge> EdgesOfPoints(const SceneModel& model) {
  std::map<std::pair<int, int>, int> num_points;
  for (const Point3D& point : model.reconstruction.points) {
    std::vector<int> frames;
    for (const Observation& o : point.track) {
      frames.push_back(model.scene.images[o.image_idx].frame_idx);
    }
    SortUnique(&frames);
    for (size_t i = 0; i < frames.size(); ++i) {
      for (size_t k = i + 1; k < frames.size(); ++k) {
        ++num_points[{frames[i], frames[k]}];
      }
    }
  }
  return Transformed(num_points, [](const auto& entry) {
    const auto& [frames, number] = entry;
    return GraphEdge{frames.first, frames.second, static_cast<double>(number)};
  });
}

SceneModel KeepFrames(const std::vector<int>& frame_idxs, SceneModel model) {
  Mask keeps_image(model.scene.images.size(), false);
  for (const int frame_idx : frame_idxs) {
    for (const int image_idx : model.scene.frames[frame_idx].image_idxs) {
      keeps_image[image_idx] = true;
    }
  }
  KeepImages(keeps_image, &model);
  return model;
}

int RunModelSplitter(const ModelSplitterOptions& options,
                     const Context& context) {
  StagedOutput output(*options.output_path);
  const SceneModel model =
      ReadModelFile(options.input_path, options.rigs, context).model;
  CheckFormat(model.scene, options.output_format);
  GraphPartitionOptions graph_options;
  graph_options.num_parts = options.num_clusters;
  graph_options.num_overlap_nodes = options.num_overlap_frames;
  const GraphPartition partition =
      PartitionGraph(static_cast<int>(model.scene.frames.size()),
                     EdgesOfPoints(model), graph_options);
  if (partition.nodes.empty()) {
    throw Error("the points of '" + *options.input_path +
                "' connect no three frames; give a model with points");
  }
  for (size_t i = 0; i < partition.nodes.size(); ++i) {
    const SceneModel part = KeepFrames(partition.nodes[i], model);
    const fs::path folder = output.StagingDir() / std::to_string(i);
    fs::create_directory(folder);
    WriteModelAndRig(folder, part.scene, part.reconstruction,
                     options.output_format, context);
    context.Info("model " + std::to_string(i) + ": " + DescribeSize(part));
  }
  context.CheckInterrupted();
  output.Commit();
  return kExitSuccess;
}

}  // namespace

Command ModelAnalyzerCommand() {
  return MakeCommand("model_analyzer", "Prints statistics of a model.",
                     RunModelAnalyzer);
}

std::vector<Command> ModelEditCommands() {
  return {
      MakeCommand("model_splitter",
                  "Splits a model into overlapping ones of whole frames.",
                  RunModelSplitter),
      MakeCommand("model_cropper",
                  "Keeps the points in a box and the frames that observe them.",
                  RunModelCropper),
      MakeCommand("image_deleter", "Deletes images from a model.",
                  RunImageDeleter)};
}

}  // namespace mgsfm
