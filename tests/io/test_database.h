// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

#include "base/random.h"
#include "base/text_tools.h"
#include "geometry/so3.h"
#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"
#include "mgsfm/models/scene_loading.h"
#include "support/error_of.h"

namespace mgsfm {

inline Eigen::Matrix3d RandomMatrix(Random* random) {
  Eigen::Matrix3d matrix;
  for (double& value : matrix.reshaped()) value = random->Uniform(-1.0, 1.0);
  return matrix;
}

// A pair in which all that a row can hold is set.
inline TwoViewGeometryRow RandomPair(const ImageRow& image1,
                                     const ImageRow& image2, Random* random) {
  TwoViewGeometryRow pair{
      image1.id, image2.id, TwoViewConfig::kCalibrated, {}, {}, {}, {}, {}};
  pair.F = RandomMatrix(random);
  pair.E = RandomMatrix(random);
  pair.H = RandomMatrix(random) + 3.0 * Eigen::Matrix3d::Identity();
  pair.cam2_from_cam1 =
      Rigid3{ExpSO3(0.3 * RandomMatrix(random).col(0)),
             RandomMatrix(random).col(0) + Eigen::Vector3d(2.0, 0.0, 0.0)};
  for (uint32_t i = 0; i < 12; ++i) {
    pair.matches.push_back({random->Index(20), random->Index(20)});
  }
  return pair;
}

inline SceneLoadingOptions LoadingBy(const std::string& rig_name_rule,
                                     const std::string& rig_config_path = "") {
  SceneLoadingOptions options;
  options.rig_config_path = rig_config_path;
  options.rig_name_rule = rig_name_rule;
  return options;
}

// A database of images with random keypoints; each is matched with the next two
// in the given order. Images are numbered from 1, and every folder has a camera
// of its own with the same intrinsics.
inline DatabaseContents MakeContents(const std::vector<std::string>& names) {
  DatabaseContents contents;
  contents.path = "test.db";
  std::map<std::string, CameraId> cameras;
  Random random(7);
  for (const std::string& name : names) {
    const auto num_cameras = static_cast<uint32_t>(cameras.size());
    const auto [camera, is_new] =
        cameras.emplace(FolderOfName(name), CameraId(num_cameras + 1));
    if (is_new) {
      contents.cameras.push_back({camera->second,
                                  CameraModelId::kSimpleRadial,
                                  640,
                                  480,
                                  {500.0, 320.0, 240.0, 0.01},
                                  true});
    }
    const auto id = static_cast<uint32_t>(contents.images.size() + 1);
    ImageRow image{ImageId(id), name, camera->second, {}};
    for (int i = 0; i < 20; ++i) {
      image.keypoints_px.emplace_back(random.Uniform(0.0, 640.0),
                                      random.Uniform(0.0, 480.0));
    }
    contents.images.push_back(std::move(image));
  }
  for (size_t i = 0; i < contents.images.size(); ++i) {
    for (size_t j = i + 1; j < std::min(i + 3, contents.images.size()); ++j) {
      contents.pairs.push_back(
          RandomPair(contents.images[i], contents.images[j], &random));
    }
  }
  return contents;
}

// The image of a name, for changes to the rows.
inline ImageRow& FindImage(DatabaseContents* contents,
                           const std::string& name) {
  return *std::find_if(contents->images.begin(), contents->images.end(),
                       [&](const ImageRow& row) { return row.name == name; });
}

// The names of the images in each frame, in the order of frames.
inline std::vector<std::vector<std::string>> NamesOfFrames(const Scene& scene) {
  std::vector<std::vector<std::string>> names;
  for (const Frame& frame : scene.frames) {
    names.emplace_back();
    for (const int image_idx : frame.image_idxs) {
      names.back().push_back(scene.images[image_idx].name);
    }
  }
  return names;
}

inline void ExpectSameMatches(const std::vector<Match>& a,
                              const std::vector<Match>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].keypoint_idx1, b[i].keypoint_idx1);
    EXPECT_EQ(a[i].keypoint_idx2, b[i].keypoint_idx2);
  }
}

}  // namespace mgsfm
