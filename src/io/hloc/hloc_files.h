// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "hloc/hdf5_file.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// The features of one image. In hloc, the center of the first pixel is (0, 0);
// here, it is (0.5, 0.5).
struct HlocFeatures {
  std::vector<FeatureKeypoint> keypoints;
  // Bytes of float32 as COLMAP 4 stores them, a row per keypoint; empty if
  // there are none.
  DescriptorMatrix descriptors;
  std::optional<std::pair<int, int>> size_px;  // width and height
};

// features.h5 of hloc: for each image a group of its name with the datasets
// keypoints [N, 2], descriptors [D, N] and image_size [2]. Throws Error, naming
// file and image, for other shapes and values that are not finite.
class HlocFeatureFile {
 public:
  explicit HlocFeatureFile(const std::string& path);
  const std::vector<std::string>& image_names() const { return image_names_; }
  HlocFeatures Read(const std::string& image_name) const;

 private:
  [[noreturn]] void Throw(const std::string& image_name,
                          const std::string& problem) const;

  std::unique_ptr<Hdf5File> file_;
  std::vector<std::string> image_names_;
};

// matches.h5 of hloc: for each pair a group name1/name2, with '-' for '/' in
// the names, and the dataset matches0 [N]: per keypoint of image 1, the
// matching keypoint of image 2, or -1. Throws Error, naming file and pair, for
// other shapes, and for image names that are unknown or differ in '-' and '/'
// only.
class HlocMatchFile {
 public:
  HlocMatchFile(const std::string& path,
                const std::vector<std::string>& image_names);
  // Positions in image_names.
  struct Pair {
    int image1 = 0;
    int image2 = 0;
    std::string group;
  };
  const std::vector<Pair>& pairs() const { return pairs_; }
  // Throws Error unless the numbers are valid keypoint indices.
  std::vector<Match> Read(const Pair& pair, size_t num_keypoints1,
                          size_t num_keypoints2) const;

 private:
  std::unique_ptr<Hdf5File> file_;
  std::vector<Pair> pairs_;
};

}  // namespace mgsfm
