// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <ostream>

#include "base/text_streams.h"
#include "command.h"
#include "commands.h"
#include "mgsfm/base/error.h"
#include "tool_model.h"

namespace mgsfm {
namespace {

struct ModelAnalyzerOptions {
  Option<std::string> path{"path", "",
                           "Analyze the model in this folder, as in COLMAP."};
  Option<std::string> input_path{
      "input_path", "",
      "Analyze the model in this folder, as in all other commands."};
  ToolRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(path, input_path, rigs);
  }
};

// The lines of COLMAP; every image and frame of a model on disk is registered.
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
  const auto num_images = std::count_if(
      model.scene.images.begin(), model.scene.images.end(),
      [&](const Image& image) { return image.sensor_idx == sensor_idx; });
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
        std::count_if(model.scene.frames.begin(), model.scene.frames.end(),
                      [&](const Frame& frame) {
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
  const ToolModel input =
      ReadToolModel(options.path->empty() ? options.input_path : options.path,
                    options.rigs, context);
  TextOutput text;
  Describe(AnalyzeModel(input.model), text);
  DescribeRigs(input.model, text);
  CommandResult result(kExitSuccess);
  result.text = text.str();
  return result;
}

}  // namespace

Command ModelAnalyzerCommand() {
  return MakeCommand("model_analyzer", "Prints statistics of a model.",
                     RunModelAnalyzer);
}

}  // namespace mgsfm
