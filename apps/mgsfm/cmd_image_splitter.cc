// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "image_run_summary.h"
#include "imaging/image_splitting.h"
#include "mapper_run.h"
#include "mgsfm/features/feature_extraction.h"

namespace mgsfm {
namespace {

struct ImageSplitterOptions {
  Option<std::string> image_path{
      "image_path", "", Required(),
      "Read the images of this folder and its subfolders."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write images and, for panoramas, cameras.txt and rig_config.json into "
      "this folder. Images of an interrupted run with the same settings are "
      "kept."};
  Option<CombinedImages> image_type{
      "image_type", CombinedImages::kPanorama,
      "Choose the kind of images. panorama: equirectangular images, split into "
      "six perspective views. dual_fisheye: two square fisheye images side by "
      "side, split into left and right."};
  Option<std::string> image_list_path{
      "image_list_path", "",
      "Use only the images that this file names, one per line, relative to the "
      "image folder. By default, all images of the folder are used."};
  Option<std::string> mask_path{"mask_path", "",
                                "Split the masks in this folder, too, such as "
                                "pano/a.jpg.png for pano/a.jpg."};
  Option<std::string> camera_params_path{
      "camera_params_path", "",
      "Read the intrinsics of ordinary cameras beside the panoramas from this "
      "file, in the format of ImageReader.camera_params_path."};
  Option<std::string> rig_config_path{
      "rig_config_path", "",
      "Read the known poses of the folders of panoramas, and of ordinary "
      "cameras, in their rig from this rig_config.json. Without it, the poses "
      "of the views of all but the first panorama are estimated."};
  SplittingOptions splitting;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(image_path, output_path, image_type, image_list_path, mask_path,
          camera_params_path, rig_config_path, splitting);
  }
};

int RunImageSplitter(const ImageSplitterOptions& options,
                     const Context& context) {
  CheckImagePath(options.image_path);
  const ImageRunSummary summary =
      SplitImages({*options.image_path,
                   ListImages(options.image_path, options.image_list_path,
                              options.mask_path),
                   *options.mask_path, *options.camera_params_path,
                   *options.output_path, *options.rig_config_path},
                  options.image_type, options.splitting, context);
  context.Info("split " + Describe(summary));
  return kExitSuccess;
}

}  // namespace

Command ImageSplitterCommand() {
  return MakeResumableCommand(
      "image_splitter",
      "Splits panoramas and dual fisheye images into the images of rigs.",
      RunImageSplitter);
}

}  // namespace mgsfm
