// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "database/sqlite_database.h"
#include "io/test_database.h"
#include "support/temp_dir.h"

namespace mgsfm {

inline const std::vector<std::string> kNames = {"cam0/0.png", "cam0/1.png",
                                                "cam1/0.png", "cam1/1.png"};

// Contents with a rig of two cameras, one of unknown and one of known pose.
inline DatabaseContents ContentsWithRig() {
  DatabaseContents contents = MakeContents(kNames);
  RigRow rig{RigId(4), CameraId(1), {}};
  rig.sensors.push_back({CameraId(1), Rigid3()});
  rig.sensors.push_back({CameraId(2), Rigid3{ExpSO3({0.1, 0.2, 0.3}),
                                             Eigen::Vector3d(1.0, 2.0, 3.0)}});
  contents.rigs.push_back(rig);
  contents.frames.push_back(
      {FrameId(3),
       RigId(4),
       {{CameraId(1), ImageId(1)}, {CameraId(2), ImageId(3)}}});
  contents.frames.push_back(
      {FrameId(5),
       RigId(4),
       {{CameraId(1), ImageId(2)}, {CameraId(2), ImageId(4)}}});
  return contents;
}

inline void ExpectSameImages(const DatabaseContents& a,
                             const DatabaseContents& b) {
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  for (size_t i = 0; i < a.cameras.size(); ++i) {
    EXPECT_EQ(a.cameras[i].id, b.cameras[i].id);
    EXPECT_EQ(a.cameras[i].model, b.cameras[i].model);
    EXPECT_EQ(a.cameras[i].width_px, b.cameras[i].width_px);
    EXPECT_EQ(a.cameras[i].height_px, b.cameras[i].height_px);
    EXPECT_EQ(a.cameras[i].params, b.cameras[i].params);
    EXPECT_EQ(a.cameras[i].has_prior_focal_length,
              b.cameras[i].has_prior_focal_length);
  }
  ASSERT_EQ(a.images.size(), b.images.size());
  for (size_t i = 0; i < a.images.size(); ++i) {
    EXPECT_EQ(a.images[i].id, b.images[i].id);
    EXPECT_EQ(a.images[i].name, b.images[i].name);
    EXPECT_EQ(a.images[i].camera_id, b.images[i].camera_id);
    EXPECT_EQ(a.images[i].keypoints_px, b.images[i].keypoints_px);
  }
}

inline void ExpectSamePose(const Rigid3& a, const Rigid3& b) {
  EXPECT_LT(AngleBetween(a.rotation, b.rotation), 1e-12);
  EXPECT_LT((a.translation - b.translation).norm(), 1e-12);
}

inline void ExpectSamePairs(const DatabaseContents& a,
                            const DatabaseContents& b) {
  ASSERT_EQ(a.pairs.size(), b.pairs.size());
  for (size_t i = 0; i < a.pairs.size(); ++i) {
    EXPECT_EQ(a.pairs[i].image_id1, b.pairs[i].image_id1);
    EXPECT_EQ(a.pairs[i].image_id2, b.pairs[i].image_id2);
    EXPECT_EQ(a.pairs[i].config, b.pairs[i].config);
    EXPECT_EQ(a.pairs[i].F, b.pairs[i].F);
    EXPECT_EQ(a.pairs[i].E, b.pairs[i].E);
    EXPECT_EQ(a.pairs[i].H, b.pairs[i].H);
    ExpectSamePose(a.pairs[i].cam2_from_cam1.value(),
                   b.pairs[i].cam2_from_cam1.value());
    ExpectSameMatches(a.pairs[i].matches, b.pairs[i].matches);
    ExpectSameMatches(a.pairs[i].outliers, b.pairs[i].outliers);
  }
}

// Contents of all files below a folder.
inline std::map<std::string, std::string> FilesIn(
    const std::filesystem::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      files[entry.path().string()] = ReadTextFile(entry.path());
    }
  }
  return files;
}

class DatabaseTest : public testing::Test {
 protected:
  std::string Path(const std::string& name = "database.db") const {
    return (dir_.path() / name).string();
  }
  void Write(DatabaseSchema schema = DatabaseSchema::k38) const {
    WriteDatabase(Path(), ContentsWithRig(), schema);
  }
  // Changes the database as another program might.
  void Execute(const std::string& sql) const {
    SqliteDatabase::OpenReadWrite(Path(), Path()).Execute(sql);
  }
  DatabaseContents Read() const { return ReadDatabase(Path(), Context()); }
  std::string ReadError() const {
    return ErrorOf([this] { (void)Read(); });
  }

  TempDir dir_;
};

}  // namespace mgsfm
