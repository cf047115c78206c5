// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <map>
#include <utility>
#include <vector>

#include "command.h"
#include "commands.h"
#include "files/staged_output.h"
#include "math/graph_partition.h"
#include "mgsfm/base/error.h"
#include "mgsfm/rigs/rig_config.h"
#include "tool_model.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct ModelSplitterOptions {
  Option<std::string> input_path{"input_path", "", Required(),
                                 "Split the model in this folder."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write the models 0, 1, ... into this folder."};
  Option<int> num_clusters{"num_clusters", 2, AtLeast(2), "clusters",
                           "Split into this many models. There are fewer if "
                           "cuts would cross weak places."};
  Option<int> num_overlap_frames{
      "num_overlap_frames", 10, AtLeast(3), "frames",
      "Let both models share this many frames on either side of a cut."};
  Option<ModelFormat> output_format{"output_format", ModelFormat::kBinary,
                                    "Write models in binary or text format."};
  ToolRigOptions rigs;

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
    std::sort(frames.begin(), frames.end());
    frames.erase(std::unique(frames.begin(), frames.end()), frames.end());
    for (size_t i = 0; i < frames.size(); ++i) {
      for (size_t k = i + 1; k < frames.size(); ++k) {
        ++num_points[{frames[i], frames[k]}];
      }
    }
  }
  std::vector<GraphEdge> edges;
  for (const auto& [frames, number] : num_points) {
    edges.push_back({frames.first, frames.second, static_cast<double>(number)});
  }
  return edges;
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
      ReadToolModel(options.input_path, options.rigs, context).model;
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
    WriteModel(folder, part.scene, part.reconstruction, options.output_format,
               context);
    WriteRigConfig((folder / "rig_config.json").string(), part.scene,
                   part.reconstruction);
    context.Info("model " + std::to_string(i) + ": " + DescribeSize(part));
  }
  context.CheckInterrupted();
  output.Commit();
  return kExitSuccess;
}

}  // namespace

Command ModelSplitterCommand() {
  return MakeCommand("model_splitter",
                     "Splits a model into overlapping ones of whole frames.",
                     RunModelSplitter);
}

}  // namespace mgsfm
