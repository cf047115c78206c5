// SPDX-License-Identifier: BSD-3-Clause
#include <utility>

#include "base/format.h"
#include "command.h"
#include "commands.h"
#include "files/staged_output.h"
#include "mgsfm/base/error.h"
#include "sub_map_run.h"
#include "tool_model.h"

namespace mgsfm {
namespace {

struct ModelMergerOptions {
  Option<std::string> input_path1{
      "input_path1", "",
      "Merge the model in this folder with the second one. The result keeps "
      "its world and poses."};
  Option<std::string> input_path2{
      "input_path2", "",
      "Merge the model in this folder, reconstructed from the same database."};
  Option<std::string> output_path{"output_path", "", Required(),
                                  "Write the merged model, or the models 0, 1, "
                                  "... of sub-maps, into this folder."};
  Option<bool> graph{"graph", false,
                     "Join any number of sub-maps, such as the clusters of "
                     "mapper --partition, "
                     "and adjust the result."};
  Option<std::string> input_path{
      "input_path", "",
      "Join the sub-maps in this folder with graph: an output folder of the "
      "mapper for each cluster, named 0, 1, ..."};
  Option<std::string> cluster_path{"cluster_path", "",
                                   "Name the clusters without model by this "
                                   "folder of mapper --partition, with graph."};
  Option<std::string> database_path{
      "database_path", "",
      "Close loops between clusters by the matches of this database, with "
      "graph. It is not changed."};
  Option<bool> refine{"refine", true, "Adjust the joined models of graph."};
  Option<int> max_memory_mib{
      "max_memory", 0, AtLeast(0), "MiB",
      "Adjust the joined models of graph within this memory, by a selection of "
      "their tracks if necessary. 0: no limit."};
  Option<int> min_common_images{
      "min_common_images", 3, AtLeast(3), "images",
      "Require this many common images, or cameras in common frames."};
  Option<double> max_reproj_error{
      "max_reproj_error", 64.0, GreaterThan(0.0), "px",
      "Remove observations with larger errors from the merged model."};
  Option<ModelFormat> output_format{
      "output_format", ModelFormat::kBinary,
      "Write the model in binary or text format."};
  ToolRigOptions rigs;
  JoinOptions join;
  BundleAdjustmentOptions bundle_adjustment;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path1, input_path2, output_path, min_common_images,
          max_reproj_error, output_format, rigs, graph, input_path,
          cluster_path, database_path, refine, max_memory_mib);
    visit.Group("Join", join);
    visit.Group("BundleAdjustment", bundle_adjustment);
  }
};

void LogSummary(const MergeSummary& summary, const Context& context) {
  context.Info(
      Formatted("%d common frames with %d common images, median distance "
                "%.4g, scale %.9g",
                summary.num_common_frames, summary.num_common_images,
                summary.median_distance, summary.first_from_second.scale));
  context.Info(
      Formatted("%d new images, %d points merged, %d contradictory points "
                "dropped",
                summary.num_new_images, summary.num_merged_points,
                summary.num_dropped_points));
}

int JoinGraph(const ModelMergerOptions& options, const Context& context) {
  if (options.input_path->empty()) {
    throw Error("--graph needs the folder of the sub-maps; set --input_path");
  }
  return JoinClusters(
      {options.input_path, options.cluster_path, options.database_path,
       options.output_path, options.refine, options.max_memory_mib,
       options.output_format, options.rigs, options.join,
       options.bundle_adjustment},
      context);
}

int RunModelMerger(const ModelMergerOptions& options, const Context& context) {
  if (options.graph) return JoinGraph(options, context);
  if (options.input_path1->empty() || options.input_path2->empty()) {
    throw Error(
        "give two models with --input_path1 and --input_path2, or "
        "sub-maps with --graph and --input_path");
  }
  StagedOutput output(*options.output_path, OutputKind::kModel);
  ToolModel first = ReadToolModel(options.input_path1, options.rigs, context);
  ToolModel second = ReadToolModel(options.input_path2, options.rigs, context);
  MergeSummary summary;
  try {
    summary = MergeModels(std::move(second.model),
                          {options.min_common_images, options.max_reproj_error},
                          &first.model);
  } catch (const Error& error) {
    throw Error("'" + *options.input_path1 + "' and '" + *options.input_path2 +
                "' cannot be merged: " + error.what());
  }
  CheckFormat(first.model.scene, options.output_format);
  WriteToolModel(first, options.output_format, context, &output);
  LogSummary(summary, context);
  context.Info("the merged model has " + DescribeSize(first.model));
  return kExitSuccess;
}

}  // namespace

Command ModelMergerCommand() {
  return MakeCommand("model_merger",
                     "Merges two models with common images or frames.",
                     RunModelMerger);
}

}  // namespace mgsfm
