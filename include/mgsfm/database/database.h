// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/ids.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// The rows of a COLMAP database (3.8 to 4.2) that reconstruction needs, under
// the ids of the database, sorted by id. The reader checks each row, and that
// images, pairs, rig sensors and frames refer to existing rows. LoadScene
// checks that rigs and frames agree.

struct ImageRow {
  ImageId id;
  std::string name;
  CameraId camera_id;
  std::vector<Eigen::Vector2f> keypoints_px;
};

// image_id1 < image_id2; matrices, pose and matches map from image 1 to 2.
// Values that the database marks as unset (absent, all zero, or the identity
// pose without translation) and unusable ones (not finite, a singular H) are
// nullopt.
struct TwoViewGeometryRow {
  ImageId image_id1;
  ImageId image_id2;
  TwoViewConfig config = TwoViewConfig::kUndefined;
  std::optional<Eigen::Matrix3d> F = {}, E = {}, H = {};
  std::optional<Rigid3> cam2_from_cam1 = {};
  std::vector<Match> matches = {};
  std::vector<Match> outliers = {};  // the others of the table `matches`
};

// The same row without the geometry, which takes 300 bytes.
struct MatchesRow {
  ImageId image_id1;
  ImageId image_id2;
  std::vector<Match> matches;
};

// A camera mounted in a rig. Sensors that are not cameras are ignored.
struct RigSensorRow {
  CameraId camera_id;
  std::optional<Rigid3> sensor_from_rig;  // identity for the reference
};

struct RigRow {
  RigId id;
  std::optional<CameraId> ref_camera_id;  // absent if it is not a camera
  std::vector<RigSensorRow> sensors;      // with the reference
};

struct FrameDataRow {
  CameraId camera_id;
  ImageId image_id;
};

struct FrameRow {
  FrameId id;
  RigId rig_id;
  std::vector<FrameDataRow> data;
};

// Swaps the two images of a pair: inverts or transposes the maps from 1 to 2
// and exchanges the columns of the matches. Afterwards, image_id1 > image_id2.
void SwapImages(TwoViewGeometryRow* pair);
void SwapImages(std::vector<Match>* matches);

// The row of a pair of which image 1 has `image_id1`.
TwoViewGeometryRow MakePairRow(ImageId image_id1, ImageId image_id2,
                               const ImagePair& pair);

struct DatabaseContents {
  std::string path;  // named in messages
  std::vector<Camera> cameras;
  std::vector<ImageRow> images;
  std::vector<TwoViewGeometryRow> pairs;
  std::vector<MatchesRow> matches;  // of a selection, instead of `pairs`
  std::vector<RigRow> rigs;         // empty before COLMAP 3.12
  std::vector<FrameRow> frames;     // empty before COLMAP 3.12
  // The selection excludes some images, so a camera of a rig may have none.
  bool is_selection = false;

  // Whether a rig has several cameras, or a frame several images.
  bool HasRigs() const;
};

// The part of a database to read. Memory is proportional to this part.
struct DatabaseSelection {
  // Names that the database does not have are ignored. Empty: all images.
  std::set<std::string> image_names;
  bool has_keypoints = true;  // with the outliers of pairs
  // Otherwise, the verified matches of pairs are read into `matches`.
  bool has_geometries = true;
  // Whether the pair of two image names is read. Empty: all pairs.
  std::function<bool(const std::string&, const std::string&)> has_pair = {};
};

// Reads a database of any schema from COLMAP 3.8 to 4.2, recognized by its
// tables and columns. Creates no lock, journal or shared-memory file, so a
// read-only folder suffices. If a write-ahead log (or a rollback journal of an
// interrupted writer) holds changes, reads a copy of both in the folder for
// temporary files ($TMPDIR). Throws Error for a file that is not a database,
// lacks a table, has no image or has a damaged row (named), and if another
// program changes the database during the read.
[[nodiscard]] DatabaseContents ReadDatabase(
    const std::string& path, const Context& context,
    const DatabaseSelection& selection = {});

// The names of all images in the order of their ids.
[[nodiscard]] std::vector<std::string> ReadImageNames(const std::string& path);

enum class DatabaseSchema {
  k38,   // COLMAP 3.8 and 3.9; rigs and frames are not written
  k312,  // COLMAP 3.12 and 3.13
};

// Writes a new database that this and every later version of COLMAP opens.
// The table `matches` also has the outliers; there are no descriptors. Throws
// Error if the file exists; a failure leaves no file.
void WriteDatabase(const std::string& path, const DatabaseContents& contents,
                   DatabaseSchema schema);

// The rows of a scene, under its ids. Sensors that share a camera get separate
// cameras in the rig tables, as COLMAP's rigs require; their images keep the
// shared camera.
[[nodiscard]] DatabaseContents MakeDatabaseContents(
    const Scene& scene, const ViewGraph& view_graph);

}  // namespace mgsfm
