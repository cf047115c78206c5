// SPDX-License-Identifier: BSD-3-Clause
#include "base/memory.h"
#include "command.h"
#include "commands.h"
#include "live_view.h"
#include "mapper_run.h"
#include "partition_run.h"

namespace mgsfm {
namespace {

struct MapperCommandOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "COLMAP database with verified matches. It is only read."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Folder for the models 0, 1, ... and report.json. Those of an earlier "
      "run are replaced when the new ones are complete; other files stay."};
  Option<std::string> image_path{
      "image_path", "",
      "Folder of the images, to color the points. Without it, all points are "
      "black."};
  Option<std::string> input_path{
      "input_path", "",
      "Folder of a model to extend: adds the frames of the database that it "
      "lacks."};
  Option<std::string> image_list_path{
      "image_list_path", "",
      "File with one image name per line; uses only these images and those of "
      "the model to extend."};
  Option<ModelFormat> output_format{"output_format", ModelFormat::kBinary,
                                    "Format of the models: binary or text."};
  Option<bool> write_report{
      "write_report", true,
      "Write report.html, a page to inspect a model, into its folder."};
  Option<int> max_memory_mib{
      "max_memory", 0, AtLeast(0), "MiB",
      "End with a message before the reconstruction if it would need more "
      "memory. 0: no limit."};
  Option<std::string> figures{"figures", "",
                              "Folder for the trajectory, the rig, the "
                              "residual maps and the view graph "
                              "of each model, as SVG files."};
  Option<std::string> fixed_region_mask_path{
      "fixed_region_mask_path", "",
      "New folder for masks of the image regions that move along with the rig, "
      "such as a hull or an operator, one per image as ImageReader.mask_path "
      "reads them. Only if there are such regions."};
  LiveViewOptions live;
  SceneLoadingOptions loading;
  PosePriorOptions priors;
  BaselineOptions baseline;
  RigSplitOptions rig_split;
  PartitionOptions partition;
  MapperOptions mapper;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, output_path, image_path, input_path, image_list_path,
          output_format, write_report, figures, fixed_region_mask_path, live,
          max_memory_mib, partition, loading, priors, baseline, mapper);
    visit.Group("Mapper", mapper.extension);
    visit.Group("Mapper", rig_split);
  }
};

int RunMapperCommand(const MapperCommandOptions& options,
                     const Context& context) {
  if (options.max_memory_mib > 0) ReturnLargeBlocks();
  const auto live = LiveView::Start(options.live, options.output_path, context);
  const MapperRun run{options.database_path,
                      options.output_path,
                      options.image_path,
                      options.output_format,
                      options.loading,
                      options.priors,
                      options.mapper,
                      OptionsToJsonOf(options),
                      options.input_path,
                      options.image_list_path,
                      options.baseline,
                      options.rig_split,
                      options.write_report,
                      options.figures,
                      live.get(),
                      options.max_memory_mib,
                      options.fixed_region_mask_path};
  if (options.partition.num_clusters > 0) {
    return PartitionDatabase(run, options.partition, context);
  }
  return MapDatabase(run, live ? live->Watch(context) : context);
}

}  // namespace

Command MapperCommand() {
  return MakeCommand("mapper",
                     "Reconstructs models from the matches of a database.",
                     RunMapperCommand);
}

}  // namespace mgsfm
