// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdio>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "frontend/matching/simulated_pair.h"
#include "frontend/matching/test_descriptors.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/models/scene_loading.h"

namespace mgsfm {

// Points with descriptors, observed by two parallel cameras of a rig that
// drives around a square. It faces a wall along each side and passes the first
// side again after the fourth.
class FeatureWorld {
 public:
  static constexpr int kFramesPerSide = 6;
  static constexpr double kSpacing = 2.0;

  explicit FeatureWorld(uint64_t seed) : random_(seed) {
    for (int side = 0; side < 4; ++side) {
      descriptors_.push_back(RandomDescriptors(kPointsPerSide, &random_));
      std::vector<Eigen::Vector3d>& points = points_.emplace_back();
      for (size_t i = 0; i < kPointsPerSide; ++i) {
        points.emplace_back(random_.Uniform(-6.0, 16.0),
                            random_.Uniform(-4.0, 4.0),
                            random_.Uniform(6.0, 14.0));
      }
    }
  }

  // Position of the camera along its side: x to the right, z to the wall.
  static Eigen::Vector3d Center(int sensor, int frame) {
    return {kSpacing * (frame % kFramesPerSide) + 0.5 * sensor,
            frame / kFramesPerSide >= 4 ? 0.3 : 0.0, 0.0};
  }
  static int Side(int frame) { return frame / kFramesPerSide % 4; }

  static std::string ImageName(int sensor, int frame) {
    char name[32];
    std::snprintf(name, sizeof(name), "cam%d/%04d.png", sensor, frame);
    return name;
  }

  // Adds the images of the frames, with ids ascending or descending by name.
  void Write(FeatureDatabase* database, int num_frames,
             bool ids_descend = false) {
    std::vector<std::pair<int, int>> images;
    for (int sensor = 0; sensor < 2; ++sensor) {
      for (int frame = 0; frame < num_frames; ++frame) {
        images.emplace_back(sensor, frame);
      }
    }
    if (ids_descend) std::reverse(images.begin(), images.end());
    const CameraId camera_id = database->AddCamera(camera_);
    for (const auto& [sensor, frame] : images) {
      const ImageId id =
          database->AddImage(ImageName(sensor, frame), camera_id);
      WriteFeatures(database, id, sensor, frame);
    }
  }

 private:
  static constexpr size_t kPointsPerSide = 260;

  void WriteFeatures(FeatureDatabase* database, ImageId id, int sensor,
                     int frame) {
    // Independent of the order of images.
    Random random(17, static_cast<uint64_t>(2 * frame + sensor));
    const int side = Side(frame);
    std::vector<FeatureKeypoint> keypoints;
    TestDescriptors descriptors;
    for (size_t i = 0; i < kPointsPerSide; ++i) {
      const Eigen::Vector3d point = points_[side][i] - Center(sensor, frame);
      const auto pixel =
          ProjectToPixel(camera_.model, camera_.params.data(), point);
      if (!pixel || !IsInImage(camera_, *pixel)) continue;
      keypoints.push_back(FeatureKeypoint::FromScale(
          static_cast<float>(pixel->x() + 0.3 * random.Normal()),
          static_cast<float>(pixel->y() + 0.3 * random.Normal()),
          static_cast<float>(30.0 / point.z()), 0.1f * (i % 60)));
      descriptors.AddNoisyCopy(descriptors_[side].View().Row(i), 4.0, &random);
    }
    DescriptorMatrix matrix(keypoints.size(), DescriptorView::kDim);
    std::copy(descriptors.values.begin(), descriptors.values.end(),
              matrix.data());
    database->WriteKeypoints(id, keypoints);
    database->WriteDescriptors(id, matrix);
  }

  Random random_;
  const Camera camera_ =
      MakeCamera(CameraModelId::kPinhole, 640, 480, {500, 500, 320, 240});
  std::vector<std::vector<Eigen::Vector3d>> points_;
  std::vector<TestDescriptors> descriptors_;
};

inline Scene LoadSceneOf(const FeatureDatabase& database) {
  return LoadScene(database.ReadStructure({}), {}, {}).scene;
}

using NamePair = std::pair<std::string, std::string>;  // sorted

// The two-view geometries of a database, by names, 1 before 2.
inline std::map<NamePair, TwoViewGeometryRow> ReadGeometries(
    const FeatureDatabase& database) {
  std::map<ImageId, std::string> names;
  for (const ImageRow& image : database.ReadStructure({}).images) {
    names.emplace(image.id, image.name);
  }
  std::map<NamePair, TwoViewGeometryRow> geometries;
  for (const PairCount& row : database.CountInlierMatches()) {
    ImageId id1 = row.image_id1, id2 = row.image_id2;
    if (names.at(id2) < names.at(id1)) std::swap(id1, id2);
    auto geometry = *database.ReadTwoViewGeometry(id1, id2);
    std::sort(geometry.matches.begin(), geometry.matches.end(),
              [](const Match& a, const Match& b) {
                return a.keypoint_idx1 < b.keypoint_idx1;
              });
    geometries.emplace(NamePair(names.at(id1), names.at(id2)),
                       std::move(geometry));
  }
  return geometries;
}

// Equal up to ids.
inline bool AreEqual(const std::map<NamePair, TwoViewGeometryRow>& a,
                     const std::map<NamePair, TwoViewGeometryRow>& b) {
  if (a.size() != b.size()) return false;
  for (const auto& [names, row] : a) {
    const auto other = b.find(names);
    if (other == b.end() || row.config != other->second.config ||
        row.matches.size() != other->second.matches.size() ||
        row.cam2_from_cam1.has_value() !=
            other->second.cam2_from_cam1.has_value()) {
      return false;
    }
    for (size_t i = 0; i < row.matches.size(); ++i) {
      if (row.matches[i].keypoint_idx1 !=
              other->second.matches[i].keypoint_idx1 ||
          row.matches[i].keypoint_idx2 !=
              other->second.matches[i].keypoint_idx2) {
        return false;
      }
    }
    if (row.cam2_from_cam1 && (row.cam2_from_cam1->translation -
                               other->second.cam2_from_cam1->translation)
                                      .norm() > 1e-9) {
      return false;
    }
  }
  return true;
}

}  // namespace mgsfm
