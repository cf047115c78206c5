// SPDX-License-Identifier: BSD-3-Clause
#include <utility>

#include "base/format.h"
#include "command.h"
#include "commands.h"
#include "files/staged_output.h"
#include "join_run.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/error.h"
#include "model_file.h"

namespace mgsfm {
namespace {

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

int RunModelMerger(const ModelMergerOptions& options, const Context& context) {
  if (options.graph) return JoinClusters(options, context);
  if (options.input_path1->empty() || options.input_path2->empty()) {
    throw Error(
        "give two models with --input_path1 and --input_path2, or "
        "sub-maps with --graph and --input_path");
  }
  StagedOutput output(*options.output_path, OutputKind::kModel);
  ModelFile first = ReadModelFile(options.input_path1, options.rigs, context);
  ModelFile second = ReadModelFile(options.input_path2, options.rigs, context);
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
  WriteModelFile(first, options.output_format, context, &output);
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
