// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/io/database/feature_database.h"

namespace mgsfm {

// Assignment of cameras (intrinsics) to images. One camera is shared by all
// images, by the images of a folder (the default) or by none. It is created for
// the first of its images, from
//   1. the line of its folder in `camera_params_path`, or `camera_params`;
//   2. otherwise the EXIF tags: the 35 mm equivalent focal length (relative to
//      the diagonal of 43.27 mm), or focal length and focal plane resolution;
//   3. otherwise default_focal_length_factor times the larger side.
// Focal lengths of 1 and 2 are priors and are trusted; 3 is a guess to be
// refined. In cases 2 and 3 the principal point is the image center and there
// is no distortion. An image whose size differs from its camera is rejected.
struct ImageReaderOptions {
  bool single_camera = false;
  bool single_camera_per_folder = false;
  bool single_camera_per_image = false;
  std::string camera_model = "SIMPLE_RADIAL";
  std::string camera_params;
  std::string camera_params_path;
  double default_focal_length_factor = 1.2;
  int max_num_pixels = 200'000'000;
  std::string mask_path;
  std::string camera_mask_path;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("single_camera", self.single_camera, AnyValue(), "",
          "Whether to use the same camera for all images.");
    visit("single_camera_per_folder", self.single_camera_per_folder, AnyValue(),
          "",
          "Whether to use the same camera for all images in the same folder. "
          "This is the default.");
    visit("single_camera_per_image", self.single_camera_per_image, AnyValue(),
          "",
          "Whether to use a different camera for each image. Set it if images "
          "in one folder differ in size, zoom or focus.");
    visit("camera_model", self.camera_model, Required(), "",
          "Name of the COLMAP camera model of new cameras.");
    visit("camera_params", self.camera_params, AnyValue(), "",
          "Manual specification of camera parameters, separated by commas, in "
          "the order of COLMAP's model. They are trusted.");
    visit("camera_params_path", self.camera_params_path, AnyValue(), "",
          "File with a line `folder MODEL width height params...` per folder "
          "of images; '.' is the image folder itself. Takes precedence over "
          "camera_model and camera_params.");
    visit("default_focal_length_factor", self.default_focal_length_factor,
          GreaterThan(0.0), "of the larger side",
          "Initial focal length if there is neither a parameter nor an EXIF "
          "tag, as a factor of the larger image side.");
    visit("max_num_pixels", self.max_num_pixels, Between(1, 1 << 30), "px",
          "Images with more pixels are rejected before they are decoded, which "
          "takes up to 8 bytes per pixel.");
    visit("mask_path", self.mask_path, AnyValue(), "",
          "Folder of masks. Features are not kept where the mask "
          "cam0/a.jpg.png of image cam0/a.jpg is black.");
    visit("camera_mask_path", self.camera_mask_path, AnyValue(), "",
          "Mask for all images. Use it to mask out a vehicle that its cameras "
          "see.");
  }
};

// Names are COLMAP's; the detector is described in src/features/sift.h.
struct SiftOptions {
  int max_image_size = 3200;
  int max_num_features = 8192;
  int num_octaves = 4;
  int octave_resolution = 3;
  double peak_threshold = 0.02 / 3.0;
  double edge_threshold = 10.0;
  int max_num_orientations = 2;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("max_image_size", self.max_image_size, AtLeast(16), "px",
          "Maximum image width or height; larger images are downscaled. "
          "Keypoints are in pixels of the original image.");
    visit("max_num_features", self.max_num_features, AtLeast(1), "features",
          "Maximum number of features per image; those of larger scale are "
          "kept. Decrease it to match faster.");
    visit("num_octaves", self.num_octaves, Between(1, 16), "octaves",
          "Number of octaves; the first one is the image at twice its size.");
    visit("octave_resolution", self.octave_resolution, Between(1, 10), "levels",
          "Number of levels per octave.");
    visit("peak_threshold", self.peak_threshold, GreaterThan(0.0), "",
          "Peak threshold for detection, in gray values from 0 to 1. Decrease "
          "it for images of low contrast.");
    visit("edge_threshold", self.edge_threshold, GreaterThan(1.0), "",
          "Edge threshold for detection: maximum ratio of the principal "
          "curvatures.");
    visit("max_num_orientations", self.max_num_orientations, Between(1, 4), "",
          "Maximum number of orientations per keypoint.");
  }
};

struct FeatureExtractionOptions {
  std::string image_list_path;
  ImageReaderOptions reader;
  SiftOptions sift;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("image_list_path", self.image_list_path, AnyValue(), "",
          "File with one image name per line, relative to the image folder. "
          "By default all images of the folder are used.");
    visit.Group("ImageReader", self.reader);
    visit.Group("SiftExtraction", self.sift);
  }
};

struct FeatureExtractionSummary {
  size_t num_images = 0;   // found in the folder, or listed
  size_t num_present = 0;  // of these, with features in the database before
  size_t num_extracted = 0;
  size_t num_rejected = 0;  // one warning each
  size_t num_features = 0;  // of the extracted images
  double seconds = 0.0;
};

// The names of the files below the folder `image_path`, or those in the file
// `list_path` unless that is empty: sorted, without duplicates. Links to
// folders are followed; hidden files are ignored. Throws Error if there is
// none.
[[nodiscard]] std::vector<std::string> ListImages(const std::string& image_path,
                                                  const std::string& list_path);

// Extracts SIFT features of the images below the folder `image_path` and adds
// them to the database, together with cameras and with GPS positions as pose
// priors. Images are processed in the order of their names; hidden files are
// ignored. The EXIF orientation is ignored; images of more than 8 bits are
// scaled such that the brightest pixel is 255.
//
// Images with features in the database are skipped. Each image is written in a
// transaction as soon as it and all images before it are done, so an
// interrupted run loses only the images in progress and the next run leads to
// the same result. If the database has frames, each new image gets a frame of
// its own.
//
// An image that cannot be used (not an image, truncated, too large, differs in
// size from its camera or mask) is rejected with a warning that names it.
// Throws Error for bad options, and if no image can be used.
//
// Cost: up to 200 bytes of memory per pixel and thread, bounded by half of the
// memory of the machine.
FeatureExtractionSummary ExtractFeatures(
    const std::string& image_path, const FeatureExtractionOptions& options,
    FeatureDatabase* database, const Context& context);

}  // namespace mgsfm
