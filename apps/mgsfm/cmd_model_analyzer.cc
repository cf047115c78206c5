// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>

#include "command.h"
#include "commands.h"
#include "tool_model.h"

namespace mgsfm {
namespace {

struct ModelAnalyzerOptions {
  Option<std::string> path{"path", "", Required(), "Folder of the model."};
  ToolRigOptions rigs;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(path, rigs);
  }
};

// The lines of COLMAP; every image and frame of a model on disk is registered.
void Print(const ModelStatistics& s) {
  std::printf("Rigs: %zu\nCameras: %zu\n", s.num_rigs, s.num_cameras);
  std::printf("Frames: %zu\nRegistered frames: %zu\n", s.num_frames,
              s.num_frames);
  std::printf("Images: %zu\nRegistered images: %zu\n", s.num_images,
              s.num_images);
  std::printf("Points: %zu\nObservations: %zu\n", s.num_points,
              s.num_observations);
  std::printf("Mean track length: %f\n", s.mean_track_length);
  std::printf("Mean observations per image: %f\n",
              s.mean_observations_per_image);
  if (s.mean_reprojection_error_px) {
    std::printf("Mean reprojection error: %fpx\n",
                *s.mean_reprojection_error_px);
  } else {
    std::printf("Mean reprojection error: unknown\n");
  }
}

// The baselines are in the unit of the model.
void PrintRigs(const SceneModel& model) {
  for (size_t i = 0; i < model.scene.rigs.size(); ++i) {
    const Rig& rig = model.scene.rigs[i];
    if (rig.sensor_idxs.size() < 2) continue;
    int num_frames = 0;
    for (const Frame& frame : model.scene.frames) {
      num_frames += frame.rig_idx == static_cast<int>(i) ? 1 : 0;
    }
    std::printf("Rig %u: %zu cameras, %d frames\n", rig.id.value(),
                rig.sensor_idxs.size(), num_frames);
    for (const int sensor_idx : rig.sensor_idxs) {
      const auto& pose = model.reconstruction.sensor_from_rig[sensor_idx];
      int num_images = 0;
      for (const Image& image : model.scene.images) {
        num_images += image.sensor_idx == sensor_idx ? 1 : 0;
      }
      std::printf("  %s: %d images, ",
                  model.scene.sensors[sensor_idx].name.c_str(), num_images);
      if (sensor_idx == rig.ref_sensor_idx) {
        std::printf("reference\n");
      } else if (pose) {
        std::printf("%.6g from the reference\n", pose->translation.norm());
      } else {
        std::printf("pose in the rig unknown\n");
      }
    }
  }
}

int RunModelAnalyzer(const ModelAnalyzerOptions& options,
                     const Context& context) {
  const ToolModel input = ReadToolModel(options.path, options.rigs, context);
  Print(AnalyzeModel(input.model));
  PrintRigs(input.model);
  return kExitSuccess;
}

}  // namespace

Command ModelAnalyzerCommand() {
  return MakeCommand("model_analyzer", "Prints statistics of a model.",
                     RunModelAnalyzer);
}

}  // namespace mgsfm
