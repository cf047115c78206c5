// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <functional>
#include <set>
#include <system_error>

#include "io/database_pair_id.h"
#include "io/sqlite_database.h"
#include "mgsfm/base/error.h"
#include "mgsfm/io/database.h"

namespace mgsfm {
namespace {

// The tables of COLMAP, in the order and with the columns it makes them.
constexpr char kCommonTables[] = R"(
CREATE TABLE cameras (
  camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  model INTEGER NOT NULL,
  width INTEGER NOT NULL,
  height INTEGER NOT NULL,
  params BLOB,
  prior_focal_length INTEGER NOT NULL);
CREATE TABLE images (
  image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  name TEXT NOT NULL UNIQUE,
  camera_id INTEGER NOT NULL,
  $PRIOR_COLUMNS
  CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
  FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
CREATE TABLE keypoints (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL,
  cols INTEGER NOT NULL,
  data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE descriptors (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL,
  cols INTEGER NOT NULL,
  data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE matches (
  pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL,
  cols INTEGER NOT NULL,
  data BLOB);
CREATE TABLE two_view_geometries (
  pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL,
  cols INTEGER NOT NULL,
  data BLOB,
  config INTEGER NOT NULL,
  F BLOB,
  E BLOB,
  H BLOB,
  qvec BLOB,
  tvec BLOB);
)";

constexpr char kPriorColumns38[] =
    "prior_qw REAL, prior_qx REAL, prior_qy REAL, prior_qz REAL, "
    "prior_tx REAL, prior_ty REAL, prior_tz REAL,";

constexpr char kTables312[] = R"(
CREATE TABLE pose_priors (
  image_id INTEGER PRIMARY KEY NOT NULL,
  position BLOB,
  coordinate_system INTEGER NOT NULL,
  position_covariance BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE rigs (
  rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  ref_sensor_id INTEGER NOT NULL,
  ref_sensor_type INTEGER NOT NULL);
CREATE UNIQUE INDEX rig_ref_sensor_assignment
  ON rigs(ref_sensor_id, ref_sensor_type);
CREATE TABLE rig_sensors (
  rig_id INTEGER NOT NULL,
  sensor_id INTEGER NOT NULL,
  sensor_type INTEGER NOT NULL,
  sensor_from_rig BLOB,
  FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX rig_sensor_assignment
  ON rig_sensors(sensor_id, sensor_type);
CREATE TABLE frames (
  frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  rig_id INTEGER NOT NULL,
  FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE frame_data (
  frame_id INTEGER NOT NULL,
  data_id INTEGER NOT NULL,
  sensor_id INTEGER NOT NULL,
  sensor_type INTEGER NOT NULL,
  FOREIGN KEY(frame_id) REFERENCES frames(frame_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX frame_sensor_assignment
  ON frame_data(data_id, sensor_type);
)";

constexpr int64_t kCameraSensorType = 0;

void CreateTables(DatabaseSchema schema, SqliteDatabase* database) {
  const bool has_rigs = schema == DatabaseSchema::k312;
  std::string tables = kCommonTables;
  const std::string placeholder = "$PRIOR_COLUMNS";
  tables.replace(tables.find(placeholder), placeholder.size(),
                 has_rigs ? "" : kPriorColumns38);
  database->Execute(tables);
  if (has_rigs) database->Execute(kTables312);
  database->Execute(has_rigs ? "PRAGMA user_version = 3900"
                             : "PRAGMA user_version = 3800");
}

void WriteCameras(const DatabaseContents& contents, SqliteDatabase* database) {
  SqliteStatement row =
      database->Prepare("INSERT INTO cameras VALUES (?1, ?2, ?3, ?4, ?5, ?6)");
  for (const Camera& camera : contents.cameras) {
    row.BindInt(1, camera.id.value());
    row.BindInt(2, static_cast<int64_t>(camera.model));
    row.BindInt(3, camera.width_px);
    row.BindInt(4, camera.height_px);
    row.BindBlob(5, camera.params.data(),
                 camera.params.size() * sizeof(double));
    row.BindInt(6, camera.has_prior_focal_length ? 1 : 0);
    row.Run();
  }
}

void WriteImages(const DatabaseContents& contents, SqliteDatabase* database) {
  SqliteStatement image_row = database->Prepare(
      "INSERT INTO images (image_id, name, camera_id) VALUES (?1, ?2, ?3)");
  SqliteStatement keypoints_row =
      database->Prepare("INSERT INTO keypoints VALUES (?1, ?2, 2, ?3)");
  for (const ImageRow& image : contents.images) {
    image_row.BindInt(1, image.id.value());
    image_row.BindText(2, image.name);
    image_row.BindInt(3, image.camera_id.value());
    image_row.Run();
    keypoints_row.BindInt(1, image.id.value());
    keypoints_row.BindInt(2, static_cast<int64_t>(image.keypoints_px.size()));
    keypoints_row.BindBlob(3, image.keypoints_px.data(),
                           image.keypoints_px.size() * sizeof(Eigen::Vector2f));
    keypoints_row.Run();
  }
}

// Versions before 4.0 demand a matrix and a pose: zeros and the identity stand
// for none.
void WriteTwoViewGeometry(const TwoViewGeometryRow& pair,
                          SqliteStatement* row) {
  using RowMajorMatrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  RowMajorMatrix matrices[3];
  int parameter = 5;
  for (const auto* matrix : {&pair.F, &pair.E, &pair.H}) {
    RowMajorMatrix& values = matrices[parameter - 5];
    values = matrix->value_or(Eigen::Matrix3d::Zero());
    row->BindBlob(parameter, values.data(), 9 * sizeof(double));
    ++parameter;
  }
  const Rigid3 pose = pair.cam2_from_cam1.value_or(Rigid3());
  const Eigen::Vector4d qvec(pose.rotation.w(), pose.rotation.x(),
                             pose.rotation.y(), pose.rotation.z());
  row->BindBlob(8, qvec.data(), 4 * sizeof(double));
  row->BindBlob(9, pose.translation.data(), 3 * sizeof(double));
  row->Run();
}

void WritePairs(const DatabaseContents& contents, SqliteDatabase* database) {
  SqliteStatement matches_row =
      database->Prepare("INSERT INTO matches VALUES (?1, ?2, 2, ?3)");
  SqliteStatement geometry_row = database->Prepare(
      "INSERT INTO two_view_geometries "
      "VALUES (?1, ?2, 2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)");
  for (const TwoViewGeometryRow& pair : contents.pairs) {
    MGSFM_CHECK_LT(pair.image_id1.value(), pair.image_id2.value());
    for (SqliteStatement* row : {&matches_row, &geometry_row}) {
      row->BindInt(1, PairId(pair.image_id1.value(), pair.image_id2.value()));
      row->BindInt(2, static_cast<int64_t>(pair.matches.size()));
      row->BindBlob(3, pair.matches.data(),
                    pair.matches.size() * sizeof(Match));
    }
    matches_row.Run();
    geometry_row.BindInt(4, static_cast<int64_t>(pair.config));
    WriteTwoViewGeometry(pair, &geometry_row);
  }
}

void WriteRigs(const DatabaseContents& contents, SqliteDatabase* database) {
  SqliteStatement rig_row =
      database->Prepare("INSERT INTO rigs VALUES (?1, ?2, ?3)");
  SqliteStatement sensor_row =
      database->Prepare("INSERT INTO rig_sensors VALUES (?1, ?2, ?3, ?4)");
  for (const RigRow& rig : contents.rigs) {
    MGSFM_CHECK(rig.ref_camera_id.has_value());
    rig_row.BindInt(1, rig.id.value());
    rig_row.BindInt(2, rig.ref_camera_id->value());
    rig_row.BindInt(3, kCameraSensorType);
    rig_row.Run();
    for (const RigSensorRow& sensor : rig.sensors) {
      if (sensor.camera_id == *rig.ref_camera_id) continue;
      sensor_row.BindInt(1, rig.id.value());
      sensor_row.BindInt(2, sensor.camera_id.value());
      sensor_row.BindInt(3, kCameraSensorType);
      double numbers[7];
      sensor_row.BindNull(4);
      if (sensor.sensor_from_rig) {
        const Rigid3& pose = *sensor.sensor_from_rig;
        numbers[0] = pose.rotation.w();
        Eigen::Map<Eigen::Vector3d>(numbers + 1) = pose.rotation.vec();
        Eigen::Map<Eigen::Vector3d>(numbers + 4) = pose.translation;
        sensor_row.BindBlob(4, numbers, sizeof(numbers));
      }
      sensor_row.Run();
    }
  }
}

void WriteFrames(const DatabaseContents& contents, SqliteDatabase* database) {
  SqliteStatement frame_row =
      database->Prepare("INSERT INTO frames VALUES (?1, ?2)");
  SqliteStatement data_row =
      database->Prepare("INSERT INTO frame_data VALUES (?1, ?2, ?3, ?4)");
  for (const FrameRow& frame : contents.frames) {
    frame_row.BindInt(1, frame.id.value());
    frame_row.BindInt(2, frame.rig_id.value());
    frame_row.Run();
    for (const FrameDataRow& data : frame.data) {
      data_row.BindInt(1, frame.id.value());
      data_row.BindInt(2, data.image_id.value());
      data_row.BindInt(3, data.camera_id.value());
      data_row.BindInt(4, kCameraSensorType);
      data_row.Run();
    }
  }
}

void WriteAll(const std::string& path, const DatabaseContents& contents,
              DatabaseSchema schema) {
  SqliteDatabase database = SqliteDatabase::Create(path);
  // A file that a crash leaves half written is of no use, so no care is taken.
  database.Execute("PRAGMA synchronous = OFF");
  database.Execute("BEGIN");
  CreateTables(schema, &database);
  WriteCameras(contents, &database);
  if (schema == DatabaseSchema::k312) WriteRigs(contents, &database);
  WriteImages(contents, &database);
  if (schema == DatabaseSchema::k312) WriteFrames(contents, &database);
  WritePairs(contents, &database);
  database.Execute("COMMIT");
}

// The id of the camera that stands for each sensor in the rig tables: that of
// its intrinsics or, where another sensor has taken it, of a copy.
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

TwoViewGeometryRow MakePairRow(const Scene& scene, const ImagePair& pair) {
  TwoViewGeometryRow row{scene.images[pair.image_idx1].id,
                         scene.images[pair.image_idx2].id,
                         pair.config,
                         pair.F,
                         pair.E,
                         pair.H,
                         {},
                         pair.matches};
  if (pair.relative_pose) {
    row.cam2_from_cam1 =
        Rigid3{pair.relative_pose->cam2_from_cam1,
               pair.relative_pose->translation_direction.value_or(
                   Eigen::Vector3d::Zero())};
  }
  if (row.image_id2 < row.image_id1) SwapImages(&row);
  return row;
}

template <class Row>
void SortById(std::vector<Row>* rows) {
  std::sort(rows->begin(), rows->end(),
            [](const Row& a, const Row& b) { return a.id < b.id; });
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
    contents.pairs.push_back(MakePairRow(scene, pair));
  }
  SortById(&contents.cameras);
  SortById(&contents.images);
  SortById(&contents.rigs);
  SortById(&contents.frames);
  return contents;
}

}  // namespace mgsfm
