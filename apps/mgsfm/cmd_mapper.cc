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
  Option<std::string> database_path{"database_path", "", Required(),
                                    "Read the verified matches of this COLMAP "
                                    "database. The database is not changed."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write the models 0, 1, ... and report.json into this folder. Models of "
      "an earlier run are replaced when the new ones are complete; other files "
      "stay."};
  Option<std::string> image_path{"image_path", "",
                                 "Color the points by the images in this "
                                 "folder. Without it, all points are black."};
  Option<std::string> input_path{"input_path", "",
                                 "Extend the model in this folder with the "
                                 "frames of the database that it lacks."};
  Option<std::string> image_list_path{
      "image_list_path", "",
      "Use only the images listed in this file, one per line, and the images "
      "of the model to extend."};
  Option<ModelFormat> output_format{"output_format", ModelFormat::kBinary,
                                    "Write models in binary or text format."};
  Option<bool> write_report{
      "write_report", true,
      "Write report.html, a page to inspect a model, into its folder."};
  Option<int> max_memory_mib{"max_memory", 0, AtLeast(0), "MiB",
                             "Stop with a message before the reconstruction if "
                             "it would need more memory. 0: no limit."};
  Option<std::string> fixed_region_mask_path{
      "fixed_region_mask_path", "",
      "Write masks of the image regions that move along with the rig, such as "
      "a hull or an operator, into this new folder: one per folder of images, "
      "as ImageReader.camera_mask_path reads them, or one per image, for "
      "ImageReader.mask_path, if cameras share folders. Without such regions, "
      "nothing is written."};
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
          output_format, write_report, fixed_region_mask_path, live,
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
                      OptionsToJsonOf(MapperCommandOptions()),
                      options.input_path,
                      options.image_list_path,
                      options.baseline,
                      options.rig_split,
                      options.write_report,
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
