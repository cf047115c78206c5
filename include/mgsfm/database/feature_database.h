// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/ids.h"
#include "mgsfm/database/database.h"
#include "mgsfm/database/shard.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// A keypoint in COLMAP's format: its position, and the matrix that maps the
// unit circle to the region it describes.
struct FeatureKeypoint {
  float x_px = 0.0f;
  float y_px = 0.0f;
  float a11 = 1.0f;
  float a12 = 0.0f;
  float a21 = 0.0f;
  float a22 = 1.0f;

  // A circle whose radius is `scale_px`, turned by the angle from x to y.
  static FeatureKeypoint FromScale(float x_px, float y_px, float scale_px,
                                   float orientation_rad);
  // The mean length of the columns, and the direction of the first column.
  float ScalePx() const;
  float OrientationRad() const;
};

// One row per keypoint, with 128 columns for SIFT.
using DescriptorMatrix =
    Eigen::Matrix<uint8_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Measured position of the camera center of an image, and direction of gravity.
struct PosePriorRow {
  enum class CoordinateSystem : int {
    kUndefined = -1,
    kWgs84 = 0,  // latitude and longitude in degrees, altitude in meters
    kCartesian = 1,
  };
  ImageId image_id{0};
  CoordinateSystem coordinate_system = CoordinateSystem::kUndefined;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  std::optional<Eigen::Matrix3d> covariance;
  // In the camera frame, of any length. Only COLMAP 4 has a column for it.
  std::optional<Eigen::Vector3d> gravity = {};
};

// A pair with a row, and the number of matches in it, which may be zero.
struct PairCount {
  ImageId image_id1{0};  // < image_id2
  ImageId image_id2{0};
  size_t num_matches = 0;
};

// A COLMAP database to which the steps before reconstruction add features,
// matches, two-view geometries, rigs and frames. Each step skips existing rows,
// so a step that was killed continues where it stopped.
//
// A new database has the tables of COLMAP 3.8 and those that 3.9 to 3.13 add to
// them when they open such a file (pose_priors, rigs, frames), with
// user_version 3900. COLMAP 3.8 opens it, because it requires the prior_*
// columns of `images` and ignores unknown tables. Every later version opens it,
// too (4.x after its usual migration). An existing database of any version from
// 3.8 to 4.2 keeps its layout. The first write adds missing tables. Without a
// write, the file is unchanged, and no new file is created.
//
// The object locks the database against other programs (ReadDatabase still
// works, but releases the lock if it is called in the same process). Every
// write is a transaction unless DatabaseTransaction groups several. Not
// thread-safe. Every failure throws Error with the path and a remedy: not a
// database, not writable, in use by another program, disk full, a damaged row
// (named).
class FeatureDatabase {
 public:
  enum class OpenMode {
    kExisting,  // Error if there is no file
    kOrCreate,
    // No locks are taken: any number of processes may read at the same time,
    // and none may write. Functions that write throw ContractError.
    kReadOnly,
  };
  FeatureDatabase(const std::string& path, OpenMode mode);
  ~FeatureDatabase();
  FeatureDatabase(FeatureDatabase&&) noexcept;
  FeatureDatabase& operator=(FeatureDatabase&&) noexcept;

  const std::string& path() const;
  // Throws Error if another process has written a database that is open
  // kReadOnly.
  void CheckUnchanged() const;

  // ------------------------------------------------------------ reading

  // Cameras, images without keypoints, rigs and frames; no pairs. Enough for
  // LoadScene. May have no images.
  [[nodiscard]] DatabaseContents ReadStructure(const Context& context) const;

  // Return whether the row exists; it may have no keypoint or match.
  bool HasKeypoints(ImageId image_id) const;
  bool HasDescriptors(ImageId image_id) const;
  bool HasMatches(ImageId image_id1, ImageId image_id2) const;
  bool HasTwoViewGeometry(ImageId image_id1, ImageId image_id2) const;

  // All images and pairs that have a row, sorted.
  std::vector<ImageId> ImagesWithKeypoints() const;
  std::vector<ImageId> ImagesWithDescriptors() const;
  std::vector<std::pair<ImageId, size_t>> CountKeypoints() const;
  std::vector<PairCount> CountMatches() const;
  std::vector<PairCount> CountInlierMatches() const;  // of two-view geometries

  // Empty if the image has no row. Missing columns get default values.
  std::vector<FeatureKeypoint> ReadKeypoints(ImageId image_id) const;
  DescriptorMatrix ReadDescriptors(ImageId image_id) const;
  // Matches follow the order of the arguments: keypoint_idx1 is in image_id1.
  std::vector<Match> ReadMatches(ImageId image_id1, ImageId image_id2) const;
  // Follows the order of the arguments, too; nullopt without a row.
  std::optional<TwoViewGeometryRow> ReadTwoViewGeometry(
      ImageId image_id1, ImageId image_id2) const;
  // Sorted by image. Positions that are not finite are skipped; a database of
  // COLMAP 3.8 does not store the coordinate system.
  std::vector<PosePriorRow> ReadPosePriors() const;

  // ------------------------------------------------------------ writing

  // Assign a new id unless one is given, which must be free; the id in `camera`
  // is ignored.
  CameraId AddCamera(const Camera& camera,
                     std::optional<CameraId> id = std::nullopt);
  void UpdateCamera(const Camera& camera);
  ImageId AddImage(const std::string& name, CameraId camera_id,
                   std::optional<ImageId> id = std::nullopt);
  void SetImageCamera(ImageId image_id, CameraId camera_id);

  // These replace an existing row.
  void WriteKeypoints(ImageId image_id,
                      const std::vector<FeatureKeypoint>& keypoints);
  void WriteDescriptors(ImageId image_id, const DescriptorMatrix& descriptors);
  void WritePosePrior(const PosePriorRow& prior);
  // keypoint_idx1 is in image_id1; either image may have the smaller id.
  void WriteMatches(ImageId image_id1, ImageId image_id2,
                    const std::vector<Match>& matches);
  // Either image may have the smaller id.
  void WriteTwoViewGeometry(const TwoViewGeometryRow& pair);

  // Adds a frame with this image only, in the rig of the camera, which is
  // created if missing.
  void AddSingleImageFrame(ImageId image_id, CameraId camera_id);
  // Replace all rigs and all frames.
  void WriteRigsAndFrames(const std::vector<RigRow>& rigs,
                          const std::vector<FrameRow>& frames);

  // ------------------------------------------------------------- shards

  // nullopt if the database is not a shard.
  std::optional<ShardManifest> ReadShard() const;
  void WriteShard(const ShardManifest& manifest);
  // The first image of each camera whose intrinsics an image of another shard
  // defines.
  std::map<CameraId, std::string> ReadShardCameras() const;
  void WriteShardCamera(CameraId camera_id, const std::string& image_name);

  // ------------------------------------------------------------ removing

  // Remove all rows, e.g. to match or verify again with other options.
  void DeleteMatches();
  void DeleteTwoViewGeometries();

 private:
  friend class DatabaseTransaction;
  class Impl;
  std::unique_ptr<Impl> impl_;
};

// Writes within its lifetime happen together at Commit(), or not at all. They
// cannot be nested.
class DatabaseTransaction {
 public:
  explicit DatabaseTransaction(FeatureDatabase* database);
  ~DatabaseTransaction();
  DatabaseTransaction(const DatabaseTransaction&) = delete;
  DatabaseTransaction& operator=(const DatabaseTransaction&) = delete;
  void Commit();

 private:
  FeatureDatabase* database_;
  bool is_open_ = true;
};

}  // namespace mgsfm
