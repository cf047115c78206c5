// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "imaging/image_run.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"

namespace mgsfm {

// Kinds of images that hold several views.
enum class CombinedImages {
  kPanorama,     // equirectangular, twice as wide as high
  kDualFisheye,  // two square images of fisheyes, side by side
};

template <>
struct EnumTable<CombinedImages> {
  static constexpr std::pair<std::string_view, CombinedImages> kNames[] = {
      {"panorama", CombinedImages::kPanorama},
      {"dual_fisheye", CombinedImages::kDualFisheye}};
};

struct SplittingOptions {
  Option<double> field_of_view_deg{
      "field_of_view", 90.0, Between(90.0, 140.0), "deg",
      "Set the field of view of each of the six views of a panorama; they "
      "overlap beyond 90."};
  Option<int> max_image_size{
      "max_image_size", 1600, AtLeast(16), "px",
      "Limit the width of the views of a panorama. Full resolution is the "
      "width of the panorama divided by 3.14."};
  Option<double> fisheye_field_of_view_deg{
      "fisheye_field_of_view", 190.0, Between(100.0, 240.0), "deg",
      "State the field of view of each lens of a dual fisheye. It determines "
      "the initial focal length."};
  Option<int> jpeg_quality{"jpeg_quality", 95, Between(1, 100),
                           "Set the quality of JPEG images; 100 is best."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(field_of_view_deg, max_image_size, fisheye_field_of_view_deg,
          jpeg_quality);
  }
};

// Splits images, given by names relative to image_path, into images of rigs:
//
// - A panorama in a folder `pano` becomes views in `pano_front`, `pano_right`,
//   `pano_left`, `pano_up`, `pano_down` and `pano_back`, or `front`, ... if it
//   is in no folder, with known intrinsics and relative poses.
// - Both halves of an image of two fisheyes go to `pano_left` and
//   `pano_right`.
// - Images of other folders, which are not twice as wide as high, are copied;
//   those beside a folder of panoramas belong to the same rig.
//
// For panoramas, rig_config_path provides the poses of the image folders in
// their rig. The views of a folder without a pose have unknown poses, except in
// the first panorama folder of a rig.
//
// Writes to output_path: images; masks if there are any (see WriteViews); for
// panoramas also rig_config.json and cameras.txt with the intrinsics, which
// come from camera_params_path for other folders. Continues an interrupted run
// with the same settings. Files that are not images, and images that differ in
// size from the first one of their folder, are skipped with a warning.
//
// Throws Error if no image has the shape of the kind, if rig_config_path names
// none of the folders, and for the reasons of WriteViews and ContinueOrBegin.
struct SplittingInput {
  std::filesystem::path image_path;
  std::vector<std::string> names;
  MaskPaths mask_paths;
  std::filesystem::path camera_params_path;  // empty: none
  std::filesystem::path output_path;
  std::filesystem::path rig_config_path = {};  // empty: none
};

ImageRunSummary SplitImages(const SplittingInput& input, CombinedImages kind,
                            const SplittingOptions& options,
                            const Context& context);

}  // namespace mgsfm
