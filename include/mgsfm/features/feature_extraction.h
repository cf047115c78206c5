// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/features/sift.h"
#include "mgsfm/io/database/feature_database.h"

namespace mgsfm {

// Which images have a camera (intrinsics) in common: all, those of a folder, or
// none; without a choice those of a folder, which is all if there are no
// folders. A camera is made for the first of its images:
//   - by the line of its folder in the file `camera_params_path`, or by
//     `camera_params`; these count as prior focal lengths, which are trusted;
//   - else by what the image says of itself (EXIF): the focal length as
//     equivalent of 35 mm film (by the diagonal, 43.27 mm), or the focal length
//     and the resolution of the focal plane; also trusted;
//   - else the focal length is default_focal_length_factor times the larger
//     side, which is a guess to be refined.
// The principal point is then the middle of the image, and there is no
// distortion. An image of another size than its camera is refused.
struct ImageReaderOptions {
  bool single_camera = false;
  bool single_camera_per_folder = false;
  bool single_camera_per_image = false;
  std::string camera_model = "SIMPLE_RADIAL";
  std::string camera_params;
  std::string camera_params_path;
  double default_focal_length_factor = 1.2;
  std::string mask_path;
  std::string camera_mask_path;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("single_camera", self.single_camera, AnyValue(), "",
          "All images have one camera.");
    visit("single_camera_per_folder", self.single_camera_per_folder, AnyValue(),
          "", "Each folder of images has a camera; so it is by default.");
    visit("single_camera_per_image", self.single_camera_per_image, AnyValue(),
          "", "Each image has a camera of its own.");
    visit("camera_model", self.camera_model, Required(), "",
          "Of new cameras; one of COLMAP's.");
    visit("camera_params", self.camera_params, AnyValue(), "",
          "Parameters of new cameras, separated by commas, in the order of "
          "COLMAP's model. They count as known.");
    visit("camera_params_path", self.camera_params_path, AnyValue(), "",
          "File with a line `folder MODEL width height params...` for each "
          "folder of images, '.' for that of --image_path itself. Goes before "
          "camera_model and camera_params.");
    visit("default_focal_length_factor", self.default_focal_length_factor,
          GreaterThan(0.0), "of the larger side",
          "Focal length where nothing tells it.");
    visit("mask_path", self.mask_path, AnyValue(), "",
          "Folder of masks: features of cam0/a.jpg are dropped where "
          "cam0/a.jpg.png is black. An image may have none.");
    visit("camera_mask_path", self.camera_mask_path, AnyValue(), "",
          "A mask for all images.");
  }
};

struct FeatureExtractionOptions {
  std::string image_list_path;
  ImageReaderOptions reader;
  SiftOptions sift;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("image_list_path", self.image_list_path, AnyValue(), "",
          "File with the name of an image on each line, as from --image_path; "
          "by default all files there are taken.");
    visit.Group("ImageReader", self.reader);
    visit.Group("SiftExtraction", self.sift);
  }
};

struct FeatureExtractionSummary {
  size_t num_images = 0;   // files that were found, or are in the list
  size_t num_present = 0;  // had features in the database
  size_t num_extracted = 0;
  size_t num_refused = 0;   // with a warning each
  size_t num_features = 0;  // of the extracted
  double seconds = 0.0;
};

// Extracts SIFT features (sift.h) of the images below the folder `image_path`
// and adds them to the database, with cameras, and with positions from GPS as
// pose priors. Images are taken in the order of their names and keep it in the
// database; hidden files are left out. Grey values are what the file holds,
// whatever EXIF says of orientation; images of more than 8 bits are scaled so
// that the brightest pixel is 255.
//
// Images that have features in the database are left alone. New ones are
// written as soon as they and all before them are done, in one transaction, so
// a run that is killed loses only what was being worked on, and the next run
// goes on to the same result. A database that has frames gets a frame for each
// new image, without others in it.
//
// An image that cannot be used (no image, truncated, of another size than its
// camera, with a mask of another size) is refused with a warning that names it.
// Throws Error for bad options, and if no image at all can be used.
FeatureExtractionSummary ExtractFeatures(
    const std::string& image_path, const FeatureExtractionOptions& options,
    FeatureDatabase* database, const Context& context);

}  // namespace mgsfm
