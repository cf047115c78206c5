// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <set>
#include <system_error>

#include "base/ranges.h"
#include "database/database_rows.h"
#include "database/sqlite_database.h"
#include "mgsfm/database/database.h"

namespace mgsfm {
namespace {

void WriteCameras(const DatabaseContents& contents, SqliteDatabase* database) {
  SqliteStatement row =
      database->Prepare("INSERT INTO cameras VALUES (?6, ?1, ?2, ?3, ?4, ?5)");
  for (const Camera& camera : contents.cameras) {
    RunWithCamera(camera, camera.id, &row);
  }
}

void WriteImages(const DatabaseContents& contents, SqliteDatabase* database) {
  SqliteStatement image_row = database->Prepare(
      "INSERT INTO images (image_id, name, camera_id) VALUES (?1, ?2, ?3)");
  SqliteStatement keypoints_row =
      database->Prepare("INSERT INTO keypoints VALUES (?1, ?2, 2, ?3)");
  for (const ImageRow& image : contents.images) {
    image_row.Run(image.id, image.name, image.camera_id);
    keypoints_row.Run(image.id, image.keypoints_px.size(),
                      BlobOf(image.keypoints_px));
  }
}

void WritePairs(const DatabaseContents& contents, SqliteDatabase* database) {
  SqliteStatement matches_row =
      database->Prepare("INSERT INTO matches VALUES (?1, ?2, 2, ?3)");
  SqliteStatement geometry_row = database->Prepare(
      "INSERT INTO two_view_geometries "
      "VALUES (?1, ?2, 2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)");
  for (const TwoViewGeometryRow& pair : contents.pairs) {
    std::vector<Match> raw = pair.matches;
    raw.insert(raw.end(), pair.outliers.begin(), pair.outliers.end());
    matches_row.Run(PairId(pair.image_id1.value(), pair.image_id2.value()),
                    raw.size(), BlobOf(raw));
    WriteTwoViewGeometryRow(pair, /*none_is_null=*/false, &geometry_row);
  }
}

void WriteAll(const std::string& path, const DatabaseContents& contents,
              DatabaseSchema schema) {
  SqliteDatabase database = SqliteDatabase::Create(path);
  // A file left half-written by a crash is useless, so sync is unnecessary.
  database.Execute("PRAGMA synchronous = OFF");
  database.Execute("BEGIN");
  const bool has_rigs = schema == DatabaseSchema::k312;
  CreateTables(has_rigs ? TableLayout::k312 : TableLayout::k38, &database);
  WriteCameras(contents, &database);
  if (has_rigs) WriteRigRows(contents.rigs, &database);
  WriteImages(contents, &database);
  if (has_rigs) WriteFrameRows(contents.frames, &database);
  WritePairs(contents, &database);
  database.Execute("COMMIT");
}

// The id of the camera that represents each sensor in the rig tables: the
// camera with its intrinsics or, if another sensor has taken it, a copy.
std::vector<CameraId> CamerasOfSensors(const Scene& scene,
                                       std::vector<Camera>* cameras) {
  uint32_t max_id = 0;
  for (const Camera& camera : *cameras) {
    max_id = std::max(max_id, camera.id.value());
  }
  std::vector<CameraId> camera_ids;
  std::set<int> taken;
  for (const Sensor& sensor : scene.sensors) {
    Camera camera = scene.cameras[sensor.camera_idx];
    if (!taken.insert(sensor.camera_idx).second) {
      camera.id = CameraId(++max_id);
      cameras->push_back(camera);
    }
    camera_ids.push_back(camera.id);
  }
  return camera_ids;
}

}  // namespace

void WriteDatabase(const std::string& path, const DatabaseContents& contents,
                   DatabaseSchema schema) {
  if (std::filesystem::exists(path)) {
    ThrowDatabaseError(path, "exists already; name a new file");
  }
  try {
    WriteAll(path, contents, schema);
  } catch (...) {
    std::error_code ignored;
    std::filesystem::remove(path, ignored);
    throw;
  }
}

TwoViewGeometryRow MakePairRow(ImageId image_id1, ImageId image_id2,
                               const ImagePair& pair) {
  TwoViewGeometryRow row{image_id1, image_id2,    pair.config,
                         pair.F,    pair.E,       pair.H,
                         {},        pair.matches, pair.outliers};
  // COLMAP's format cannot omit a translation; zero means no direction.
  if (pair.relative_pose) {
    row.cam2_from_cam1 =
        Rigid3{pair.relative_pose->cam2_from_cam1,
               pair.relative_pose->translation_direction.value_or(
                   Eigen::Vector3d::Zero())};
  }
  if (image_id2 < image_id1) SwapImages(&row);
  return row;
}

DatabaseContents MakeDatabaseContents(const Scene& scene,
                                      const ViewGraph& view_graph) {
  DatabaseContents contents;
  contents.cameras = scene.cameras;
  const std::vector<CameraId> camera_ids =
      CamerasOfSensors(scene, &contents.cameras);
  for (const Image& image : scene.images) {
    contents.images.push_back({image.id, image.name,
                               scene.cameras[image.camera_idx].id,
                               image.keypoints_px});
  }
  for (const Rig& rig : scene.rigs) {
    RigRow row{rig.id, camera_ids[rig.ref_sensor_idx], {}};
    for (const int sensor_idx : rig.sensor_idxs) {
      row.sensors.push_back(
          {camera_ids[sensor_idx], scene.sensors[sensor_idx].sensor_from_rig});
    }
    contents.rigs.push_back(std::move(row));
  }
  for (const Frame& frame : scene.frames) {
    FrameRow row{frame.id, scene.rigs[frame.rig_idx].id, {}};
    for (const int image_idx : frame.image_idxs) {
      const Image& image = scene.images[image_idx];
      row.data.push_back({camera_ids[image.sensor_idx], image.id});
    }
    contents.frames.push_back(std::move(row));
  }
  for (const ImagePair& pair : view_graph.pairs) {
    contents.pairs.push_back(MakePairRow(scene.images[pair.image_idx1].id,
                                         scene.images[pair.image_idx2].id,
                                         pair));
  }
  SortBy(&contents.cameras, &Camera::id);
  SortBy(&contents.images, &ImageRow::id);
  SortBy(&contents.rigs, &RigRow::id);
  SortBy(&contents.frames, &FrameRow::id);
  return contents;
}

}  // namespace mgsfm
