// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <filesystem>
#include <map>
#include <string>

#include "geometry/so3.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {

// Poses of the images in a folder, by the rest of their names.
inline std::map<std::string, Rigid3> PosesBelow(
    const std::string& folder, const std::filesystem::path& model) {
  std::map<std::string, Rigid3> poses;
  for (const ModelImage& image : ReadModelPoses(model).images) {
    if (image.name.compare(0, folder.size(), folder) != 0) continue;
    poses[image.name.substr(folder.size())] = image.cam_from_world;
  }
  return poses;
}

// All images of one camera agree with the first true ones, in order of names.
// Positions are compared after a similarity alignment, rotations from the first
// image to the last.
inline void ExpectSamePath(const std::map<std::string, Rigid3>& poses,
                           const std::map<std::string, Rigid3>& truth,
                           double max_error_m, double max_error_deg) {
  ASSERT_GE(poses.size(), 3u);
  ASSERT_LE(poses.size(), truth.size());
  const auto size = static_cast<Eigen::Index>(poses.size());
  Eigen::Matrix3Xd centers(3, size), true_centers(3, size);
  auto true_pose = truth.begin();
  auto last_true_pose = truth.begin();
  Eigen::Index i = 0;
  for (const auto& [name, pose] : poses) {
    centers.col(i) = pose.Center();
    true_centers.col(i++) = true_pose->second.Center();
    last_true_pose = true_pose++;
  }
  const Eigen::Matrix4d align = Eigen::umeyama(centers, true_centers);
  const double error_m = ((align.topLeftCorner<3, 3>() * centers).colwise() +
                          align.topRightCorner<3, 1>() - true_centers)
                             .colwise()
                             .norm()
                             .maxCoeff();
  EXPECT_LT(error_m, max_error_m);
  const Eigen::Quaterniond turn = poses.rbegin()->second.rotation *
                                  poses.begin()->second.rotation.conjugate();
  const Eigen::Quaterniond true_turn =
      last_true_pose->second.rotation *
      truth.begin()->second.rotation.conjugate();
  EXPECT_LT(RadToDeg(AngleBetween(turn, true_turn)), max_error_deg);
}

}  // namespace mgsfm
