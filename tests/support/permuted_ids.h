// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/database/database.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

// Permutes the ids of cameras and images, which also changes the order of
// images within pairs.
inline DatabaseContents WithPermutedIds(const DatabaseContents& contents) {
  Random random(7);
  std::vector<uint32_t> new_ids(contents.images.size());
  std::iota(new_ids.begin(), new_ids.end(), 1000u);
  for (size_t i = new_ids.size() - 1; i > 0; --i) {
    std::swap(new_ids[i], new_ids[random.Index(static_cast<uint32_t>(i + 1))]);
  }
  std::map<ImageId, ImageId> image_ids;
  for (size_t i = 0; i < new_ids.size(); ++i) {
    image_ids.emplace(contents.images[i].id, ImageId(new_ids[i]));
  }
  const auto new_camera_id = [](CameraId id) {
    return CameraId(500 - id.value());
  };
  DatabaseContents permuted = contents;
  permuted.rigs.clear();
  permuted.frames.clear();
  for (Camera& camera : permuted.cameras) camera.id = new_camera_id(camera.id);
  for (ImageRow& image : permuted.images) {
    image.id = image_ids.at(image.id);
    image.camera_id = new_camera_id(image.camera_id);
  }
  for (TwoViewGeometryRow& pair : permuted.pairs) {
    pair.image_id1 = image_ids.at(pair.image_id1);
    pair.image_id2 = image_ids.at(pair.image_id2);
    if (pair.image_id1 < pair.image_id2) continue;
    std::swap(pair.image_id1, pair.image_id2);
    if (pair.E) pair.E = pair.E->transpose().eval();
    if (pair.cam2_from_cam1) {
      pair.cam2_from_cam1 = pair.cam2_from_cam1->Inverse();
    }
    for (Match& match : pair.matches) {
      std::swap(match.keypoint_idx1, match.keypoint_idx2);
    }
  }
  std::reverse(permuted.pairs.begin(), permuted.pairs.end());
  std::reverse(permuted.images.begin(), permuted.images.end());
  std::reverse(permuted.cameras.begin(), permuted.cameras.end());
  return permuted;
}

// The largest difference of all lengths and angles (rad) of two models of one
// scene in the same gauge.
inline double MaxPoseDifference(const Reconstruction& a,
                                const Reconstruction& b) {
  double difference = 0.0;
  const auto compare = [&](const std::vector<std::optional<Rigid3>>& poses_a,
                           const std::vector<std::optional<Rigid3>>& poses_b) {
    for (size_t i = 0; i < poses_a.size(); ++i) {
      ASSERT_EQ(poses_a[i].has_value(), poses_b[i].has_value());
      if (!poses_a[i]) continue;
      difference =
          std::max({difference,
                    (poses_a[i]->translation - poses_b[i]->translation).norm(),
                    AngleBetween(poses_a[i]->rotation, poses_b[i]->rotation)});
    }
  };
  compare(a.rig_from_world, b.rig_from_world);
  compare(a.sensor_from_rig, b.sensor_from_rig);
  return difference;
}

}  // namespace mgsfm
