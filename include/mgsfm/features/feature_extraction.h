// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/database/feature_database.h"

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
  Option<bool> single_camera{"single_camera", false,
                             "Use the same camera for all images."};
  Option<bool> single_camera_per_folder{
      "single_camera_per_folder", false,
      "Use the same camera for all images in a folder. This is the default."};
  Option<bool> single_camera_per_image{
      "single_camera_per_image", false,
      "Use a different camera for each image. Set it if images in one folder "
      "differ in size, zoom or focus."};
  Option<std::string> camera_model{
      "camera_model", "SIMPLE_RADIAL", Required(),
      "Set the COLMAP camera model of new cameras."};
  Option<std::string> camera_params{
      "camera_params", "",
      "Set the camera parameters, separated by commas, in the order of "
      "COLMAP's model. They are trusted."};
  Option<std::string> camera_params_path{
      "camera_params_path", "",
      "Read the intrinsics of each folder of images from this file with lines "
      "`folder MODEL width height params...`; '.' is the image folder itself. "
      "It takes precedence over camera_model and camera_params."};
  Option<double> default_focal_length_factor{
      "default_focal_length_factor", 1.2, GreaterThan(0.0),
      "of the larger side",
      "Set the initial focal length, as a factor of the larger image side, if "
      "there is neither a parameter nor an EXIF tag."};
  Option<int> max_num_pixels{"max_num_pixels", 200'000'000, Between(1, 1 << 30),
                             "px",
                             "Reject images with more pixels before they are "
                             "decoded, which takes up to 8 bytes per pixel."};
  Option<std::string> mask_path{
      "mask_path", "",
      "Drop features where the mask is black: cam0/a.jpg.png in this folder is "
      "the mask of the image cam0/a.jpg."};
  Option<std::string> camera_mask_path{
      "camera_mask_path", "",
      "Drop features where the mask of the camera is black, for example on the "
      "vehicle that carries it: cam0.png in this folder is the mask of all "
      "images below cam0. A file is the mask of all images."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(single_camera, single_camera_per_folder, single_camera_per_image,
          camera_model, camera_params, camera_params_path,
          default_focal_length_factor, max_num_pixels, mask_path,
          camera_mask_path);
  }
};

// Names are COLMAP's; the detector is described in
// src/frontend/features/sift.h.
struct SiftOptions {
  Option<int> max_image_size{
      "max_image_size", 3200, AtLeast(16), "px",
      "Downscale images whose width or height is larger. Keypoints are in "
      "pixels of the original image."};
  Option<int> max_num_features{
      "max_num_features", 8192, AtLeast(1), "features",
      "Keep at most this many features per image, those of the largest scale. "
      "Decrease it to match faster."};
  Option<int> num_octaves{"num_octaves", 4, Between(1, 16), "octaves",
                          "Set the number of octaves; the first one is the "
                          "image at twice its size."};
  Option<int> octave_resolution{"octave_resolution", 3, Between(1, 10),
                                "levels",
                                "Set the number of levels per octave."};
  Option<double> peak_threshold{
      "peak_threshold", 0.02 / 3.0, GreaterThan(0.0),
      "Set the peak threshold of detection, in gray values from 0 to 1. "
      "Decrease it for images of low contrast."};
  Option<double> edge_threshold{"edge_threshold", 10.0, GreaterThan(1.0),
                                "Set the edge threshold of detection, the "
                                "maximum ratio of the principal curvatures."};
  Option<int> max_num_orientations{
      "max_num_orientations", 2, Between(1, 4),
      "Limit the number of orientations per keypoint."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(max_image_size, max_num_features, num_octaves, octave_resolution,
          peak_threshold, edge_threshold, max_num_orientations);
  }
};

struct FeatureExtractionOptions {
  Option<std::string> image_list_path{
      "image_list_path", "",
      "Use only the images listed in this file, one per line, relative to the "
      "image folder. By default, all images of the folder are used."};
  ImageReaderOptions reader;
  SiftOptions sift;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(image_list_path);
    visit.Group("ImageReader", reader);
    visit.Group("SiftExtraction", sift);
  }
};

struct FeatureExtractionSummary {
  size_t num_images = 0;   // in the folder, list or share
  size_t num_present = 0;  // with features already in the database
  size_t num_extracted = 0;
  size_t num_rejected = 0;  // one warning each
  size_t num_features = 0;  // of the extracted images
  double seconds = 0.0;
};

// The names of the files below the folder `image_path`, or those in the file
// `list_path` unless that is empty: sorted, without duplicates. Links to
// folders are followed; hidden files are ignored, and so are masks in
// `image_path`. Throws Error if there is none.
[[nodiscard]] std::vector<std::string> ListImages(
    const std::string& image_path, const std::string& list_path,
    const std::string& mask_path = "",
    const std::string& camera_mask_path = "");

// Extracts SIFT features of the images below the folder `image_path` and adds
// them to the database, together with cameras and with GPS positions as pose
// priors. Images are processed in the order of their names; hidden files are
// ignored. The EXIF orientation is ignored; images of more than 8 bits are
// scaled such that the brightest pixel is 255.
//
// Images with features in the database are skipped. Each image is written in a
// transaction as soon as it and all images before it are done, so an
// interrupted run loses only the images in progress, and the next run yields
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

// Extracts the features of one share of the images into a database of its own,
// a shard, with the same result as for all images: if an image of another share
// defines a camera, that image is read, too. A share may be empty. Throws Error
// if the database is a different shard or not a shard.
FeatureExtractionSummary ExtractFeatureShard(
    const std::string& image_path, const FeatureExtractionOptions& options,
    const Share& share, FeatureDatabase* database, const Context& context);

}  // namespace mgsfm
