// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "database/database_merging.h"
#include "io/test_database.h"
#include "mgsfm/database/feature_database.h"
#include "support/temp_dir.h"

namespace mgsfm {

// Databases to merge, in a folder of their own.
class DatabaseMerging : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }

  FeatureDatabase Open(const std::string& name) const {
    return {Path(name), FeatureDatabase::OpenMode::kExisting};
  }

  // Not of all images.
  static std::optional<Eigen::Vector3d> GravityOf(ImageId id) {
    if (id.value() % 2 == 0) return std::nullopt;
    return Eigen::Vector3d(0.1 * id.value(), 1.0, 0.0);
  }

  // Stereo images of a sequence with everything that a database can hold.
  DatabaseContents MakeDatabase(const std::string& name,
                                const std::string& sequence) const {
    std::vector<std::string> names;
    for (const char* file :
         {"/cam0/1.jpg", "/cam1/1.jpg", "/cam0/2.jpg", "/cam1/2.jpg"}) {
      names.push_back(sequence + file);
    }
    DatabaseContents contents = MakeContents(names);
    const CameraId left = contents.images[0].camera_id;
    const CameraId right = contents.images[1].camera_id;
    contents.rigs = {{RigId(3),
                      left,
                      {{left, Rigid3()},
                       {right, Rigid3{ExpSO3({0.0, 0.1, 0.0}), {1, 2, 3}}}}}};
    contents.frames = {
        {FrameId(4),
         RigId(3),
         {{left, contents.images[0].id}, {right, contents.images[1].id}}},
        {FrameId(9),
         RigId(3),
         {{left, contents.images[2].id}, {right, contents.images[3].id}}}};
    WriteDatabase(Path(name), contents, DatabaseSchema::k312);
    FeatureDatabase database = Open(name);
    for (const ImageRow& image : contents.images) {
      DescriptorMatrix descriptors(image.keypoints_px.size(), 128);
      descriptors.setConstant(static_cast<uint8_t>(image.id.value()));
      database.WriteDescriptors(image.id, descriptors);
      database.WritePosePrior({image.id,
                               PosePriorRow::CoordinateSystem::kWgs84,
                               {47.0, 8.0, 1.0 * image.id.value()},
                               Eigen::Matrix3d::Identity(),
                               GravityOf(image.id)});
    }
    return contents;
  }

  // a.db with the second camera elsewhere in the rig.
  void MakeDifferentRig() const {
    std::filesystem::copy_file(
        Path("a.db"), Path("b.db"),
        std::filesystem::copy_options::overwrite_existing);
    FeatureDatabase database = Open("b.db");
    DatabaseContents contents = database.ReadStructure(Context());
    contents.rigs[0].sensors[1].sensor_from_rig->translation.x() += 1.0;
    database.WriteRigsAndFrames(contents.rigs, contents.frames);
  }

  void Merge(const std::string& merged) const {
    MergeDatabases({{Path("a.db")}, {Path("b.db")}}, Path(merged), Context());
  }

  const TempDir dir_;
};

}  // namespace mgsfm
