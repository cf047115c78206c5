// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/features/feature_extraction.h"

namespace mgsfm {

struct FeatureImportOptions {
  Option<std::string> import_path{"import_path", "", Required(),
                                  "Read the keypoints and descriptors of each "
                                  "image from this HDF5 file of hloc."};
  Option<std::string> matches_path{
      "matches_path", "",
      "Read matches of these features from this HDF5 file of hloc. They are "
      "raw: run geometric_verifier next."};
  Option<std::string> image_path{
      "image_path", "",
      "Read size, focal length and GPS position of images from this folder. By "
      "default, sizes come from the feature file, and focal lengths are "
      "guesses."};
  ImageReaderOptions reader;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(import_path, matches_path, image_path);
    visit.Group("ImageReader", reader);
  }
};

struct FeatureImportSummary {
  size_t num_images = 0;   // in the file
  size_t num_present = 0;  // with features already in the database
  size_t num_features = 0;
  size_t num_pairs = 0;  // with matches
  size_t num_matches = 0;
};

// Adds images, cameras, features and matches of other programs to a database,
// in one transaction. Images with features in the database keep them; the
// number of keypoints must equal the number in the file. Matches of the file
// replace those of the database. Throws Error, naming file and image or pair,
// for bad input; the database is then unchanged.
FeatureImportSummary ImportFeatures(const FeatureImportOptions& options,
                                    FeatureDatabase* database,
                                    const Context& context);

}  // namespace mgsfm
