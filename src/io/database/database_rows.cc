// SPDX-License-Identifier: BSD-3-Clause
#include "database/database_rows.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>

#include "base/text_tools.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

// The tables of COLMAP, in its order and with its columns.
constexpr char kCommonTables[] = R"(
CREATE TABLE IF NOT EXISTS cameras (
  camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  model INTEGER NOT NULL,
  width INTEGER NOT NULL,
  height INTEGER NOT NULL,
  params BLOB,
  prior_focal_length INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS images (
  image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  name TEXT NOT NULL UNIQUE,
  camera_id INTEGER NOT NULL,
  $PRIOR_COLUMNS
  CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
  FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX IF NOT EXISTS index_name ON images(name);
CREATE TABLE IF NOT EXISTS keypoints (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL,
  cols INTEGER NOT NULL,
  data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE IF NOT EXISTS descriptors (
  image_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL,
  cols INTEGER NOT NULL,
  data BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE IF NOT EXISTS matches (
  pair_id INTEGER PRIMARY KEY NOT NULL,
  rows INTEGER NOT NULL,
  cols INTEGER NOT NULL,
  data BLOB);
CREATE TABLE IF NOT EXISTS two_view_geometries (
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
CREATE TABLE IF NOT EXISTS pose_priors (
  image_id INTEGER PRIMARY KEY NOT NULL,
  position BLOB,
  coordinate_system INTEGER NOT NULL,
  position_covariance BLOB,
  FOREIGN KEY(image_id) REFERENCES images(image_id) ON DELETE CASCADE);
CREATE TABLE IF NOT EXISTS rigs (
  rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  ref_sensor_id INTEGER NOT NULL,
  ref_sensor_type INTEGER NOT NULL);
CREATE UNIQUE INDEX IF NOT EXISTS rig_ref_sensor_assignment
  ON rigs(ref_sensor_id, ref_sensor_type);
CREATE TABLE IF NOT EXISTS rig_sensors (
  rig_id INTEGER NOT NULL,
  sensor_id INTEGER NOT NULL,
  sensor_type INTEGER NOT NULL,
  sensor_from_rig BLOB,
  FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX IF NOT EXISTS rig_sensor_assignment
  ON rig_sensors(sensor_id, sensor_type);
CREATE TABLE IF NOT EXISTS frames (
  frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL,
  rig_id INTEGER NOT NULL,
  FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE IF NOT EXISTS frame_data (
  frame_id INTEGER NOT NULL,
  data_id INTEGER NOT NULL,
  sensor_id INTEGER NOT NULL,
  sensor_type INTEGER NOT NULL,
  FOREIGN KEY(frame_id) REFERENCES frames(frame_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX IF NOT EXISTS frame_sensor_assignment
  ON frame_data(data_id, sensor_type);
)";

using RowMajorMatrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// Blobs hold little-endian numbers, like all supported machines.
template <class T, int kSize>
std::optional<std::array<T, kSize>> Decode(const BlobView& blob) {
  std::array<T, kSize> values;
  if (blob.size != sizeof(values)) return std::nullopt;
  std::memcpy(values.data(), blob.data, sizeof(values));
  return values;
}

bool AllFinite(const double* values, size_t size) {
  return std::all_of(values, values + size,
                     [](double value) { return std::isfinite(value); });
}

// The number of rows in the blob of a row with rows, cols and data in columns 1
// to 3; `row_size` is 0 for unknown columns. Throws Error for a blob of another
// size; `problem` is as in "the keypoints of image 'a.jpg' are damaged".
size_t NumRows(const SqliteStatement& row, const BlobView& blob,
               size_t row_size, const std::string& problem,
               const char* remedy) {
  const int64_t rows = row.Int(1);
  const bool is_complete = row_size > 0 && rows >= 0 &&
                           blob.size % row_size == 0 &&
                           blob.size / row_size == static_cast<size_t>(rows);
  if (is_complete || (rows == 0 && blob.size == 0)) {
    return static_cast<size_t>(rows);
  }
  ThrowDatabaseError(
      row.path(), problem + ": " + std::to_string(blob.size) + " bytes for " +
                      SizeText(rows, row.Int(2)) + " values" + remedy);
}

std::optional<Eigen::Matrix3d> DecodeMatrix(const SqliteStatement& row,
                                            int column,
                                            const std::string& name) {
  const BlobView blob = row.Blob(column);
  if (blob.size == 0) return std::nullopt;
  const auto values = Decode<double, 9>(blob);
  if (!values) {
    ThrowDatabaseError(row.path(), "the matrix " + name + " is damaged: " +
                                       std::to_string(blob.size) +
                                       " bytes instead of 72" + kMatchAgain);
  }
  const Eigen::Matrix3d matrix =
      Eigen::Map<const RowMajorMatrix>(values->data());
  if (!matrix.allFinite() || matrix.isZero(0.0)) return std::nullopt;
  return matrix;
}

std::optional<Rigid3> DecodeRelativePose(const SqliteStatement& row,
                                         const std::string& name) {
  const BlobView qvec_blob = row.Blob(8);
  const BlobView tvec_blob = row.Blob(9);
  if (qvec_blob.size == 0 && tvec_blob.size == 0) return std::nullopt;
  const auto qvec = Decode<double, 4>(qvec_blob);
  const auto tvec = Decode<double, 3>(tvec_blob);
  if (!qvec || !tvec) {
    ThrowDatabaseError(row.path(),
                       "the relative pose of " + name +
                           " is damaged: " + std::to_string(qvec_blob.size) +
                           " and " + std::to_string(tvec_blob.size) +
                           " bytes instead of 32 and 24" + kMatchAgain);
  }
  const auto pose = PoseFromNumbers(qvec->data(), tvec->data());
  if (const auto problem = pose ? WhyImplausible(*pose) : std::nullopt) {
    ThrowDatabaseError(row.path(), "the relative pose of " + name + ' ' +
                                       *problem + kMatchAgain);
  }
  const bool is_default =
      pose && pose->translation.isZero(0.0) && pose->rotation.vec().isZero(0.0);
  return is_default ? std::nullopt : pose;
}

PosePriorRow DecodePosePrior(const SqliteStatement& row) {
  PosePriorRow prior;
  prior.image_id = ImageId(static_cast<uint32_t>(row.Int(0)));
  const auto position = Decode<double, 3>(row.Blob(1));
  const auto covariance = Decode<double, 9>(row.Blob(2));
  prior.position.setConstant(std::numeric_limits<double>::quiet_NaN());
  if (position) prior.position = Eigen::Vector3d::Map(position->data());
  // COLMAP writes values that are not finite if there is no covariance.
  if (covariance && AllFinite(covariance->data(), covariance->size())) {
    prior.covariance = Eigen::Map<const RowMajorMatrix>(covariance->data());
  }
  prior.coordinate_system =
      static_cast<PosePriorRow::CoordinateSystem>(row.Int(3));
  const auto gravity = Decode<double, 3>(row.Blob(4));
  if (gravity && AllFinite(gravity->data(), gravity->size())) {
    prior.gravity = Eigen::Vector3d::Map(gravity->data());
  }
  return prior;
}

}  // namespace

void CreateTables(TableLayout layout, SqliteDatabase* database) {
  const bool is_new = !database->HasTable("images");
  std::string tables = kCommonTables;
  const std::string placeholder = "$PRIOR_COLUMNS";
  tables.replace(tables.find(placeholder), placeholder.size(),
                 layout == TableLayout::k312 ? "" : kPriorColumns38);
  database->Execute(tables);
  if (layout != TableLayout::k38) database->Execute(kTables312);
  if (!is_new) return;
  database->Execute(layout == TableLayout::k38 ? "PRAGMA user_version = 3800"
                                               : "PRAGMA user_version = 3900");
}

std::optional<Rigid3> PoseFromNumbers(const double* qvec, const double* tvec) {
  const Eigen::Quaterniond rotation(qvec[0], qvec[1], qvec[2], qvec[3]);
  if (!AllFinite(qvec, 4) || !AllFinite(tvec, 3) || !(rotation.norm() > 0.0)) {
    return std::nullopt;
  }
  return PoseOfFile(rotation, {tvec[0], tvec[1], tvec[2]});
}

std::vector<PosePriorRow> ReadPosePriorRows(const SqliteDatabase& database) {
  std::vector<PosePriorRow> rows;
  if (!database.HasTable("pose_priors")) return rows;
  const std::set<std::string> columns = database.Columns("pose_priors");
  const auto column = [&](const std::string& name) {
    return ", " + (columns.count(name) > 0 ? name : "NULL");
  };
  const bool is_version4 = columns.count("corr_data_id") > 0;
  const std::string id = is_version4 ? "corr_data_id" : "image_id";
  SqliteStatement row = database.Prepare(
      "SELECT " + id + ", position" + column("position_covariance") +
      ", coordinate_system" + column("gravity") + " FROM pose_priors" +
      (is_version4
           ? " WHERE corr_sensor_type = " + std::to_string(kCameraSensorType)
           : "") +
      " ORDER BY " + id);
  while (row.Step()) rows.push_back(DecodePosePrior(row));
  return rows;
}

KeypointBlob DecodeKeypoints(const SqliteStatement& row,
                             const std::string& name) {
  const BlobView blob = row.Blob(3);
  const int64_t cols = row.Int(2);
  const bool cols_are_known = cols == 2 || cols == 4 || cols == 6;
  const auto num_cols = static_cast<size_t>(cols_are_known ? cols : 0);
  return {blob.data,
          NumRows(row, blob, num_cols * sizeof(float), name + " are damaged",
                  kExtractAgain),
          num_cols};
}

std::vector<Match> DecodeMatches(const SqliteStatement& row,
                                 const std::string& name) {
  static_assert(sizeof(Match) == 2 * sizeof(uint32_t), "as in the database");
  const BlobView blob = row.Blob(3);
  std::vector<Match> matches(
      NumRows(row, blob, row.Int(2) == 2 ? sizeof(Match) : 0,
              "the matches of " + name + " are damaged", kMatchAgain));
  if (!matches.empty()) std::memcpy(matches.data(), blob.data, blob.size);
  return matches;
}

std::string TwoViewGeometryQuery(const SqliteDatabase& database,
                                 const std::string& table) {
  const std::set<std::string> columns = database.Columns(table);
  std::string sql = "SELECT pair_id, rows, cols, data, config";
  for (const char* column : {"F", "E", "H", "qvec", "tvec"}) {
    sql += columns.count(column) != 0 ? std::string(", ") + column : ", NULL";
  }
  return sql + " FROM " + table;
}

void DecodeTwoViewGeometry(const SqliteStatement& row, const std::string& name,
                           TwoViewGeometryRow* pair) {
  const int64_t config = row.Int(4);
  if (config < 0 || config > static_cast<int>(TwoViewConfig::kCalibratedRig)) {
    ThrowDatabaseError(row.path(), name + " has the unknown configuration " +
                                       std::to_string(config) + kMatchAgain);
  }
  pair->config = static_cast<TwoViewConfig>(config);
  pair->F = DecodeMatrix(row, 5, "F of " + name);
  pair->E = DecodeMatrix(row, 6, "E of " + name);
  pair->H = DecodeMatrix(row, 7, "H of " + name);
  if (pair->H && !pair->H->inverse().allFinite()) pair->H.reset();
  pair->cam2_from_cam1 = DecodeRelativePose(row, name);
  pair->matches = DecodeMatches(row, name);
}

void RunWithCamera(const Camera& camera, std::optional<CameraId> id,
                   SqliteStatement* row) {
  const BlobView params = BlobOf(camera.params);
  const auto run = [&](const auto&... ids) {
    row->Run(camera.model, camera.width_px, camera.height_px, params,
             camera.has_prior_focal_length, ids...);
  };
  id ? run(*id) : run();
}

void WriteTwoViewGeometryRow(const TwoViewGeometryRow& pair, bool none_is_null,
                             SqliteStatement* row) {
  MGSFM_CHECK_LT(pair.image_id1.value(), pair.image_id2.value());
  RowMajorMatrix matrices[3];  // must live until Run()
  std::optional<BlobView> blobs[3], qvec_blob, tvec_blob;
  size_t k = 0;
  for (const auto* matrix : {&pair.F, &pair.E, &pair.H}) {
    matrices[k] = matrix->value_or(Eigen::Matrix3d::Zero());
    if (*matrix || !none_is_null) blobs[k] = BlobOf(matrices[k].data(), 9);
    ++k;
  }
  const Rigid3 pose = pair.cam2_from_cam1.value_or(Rigid3());
  const Eigen::Vector4d qvec(pose.rotation.w(), pose.rotation.x(),
                             pose.rotation.y(), pose.rotation.z());
  if (pair.cam2_from_cam1 || !none_is_null) {
    qvec_blob = BlobOf(qvec.data(), 4);
    tvec_blob = BlobOf(pose.translation.data(), 3);
  }
  row->Run(PairId(pair.image_id1.value(), pair.image_id2.value()),
           pair.matches.size(), BlobOf(pair.matches), pair.config, blobs[0],
           blobs[1], blobs[2], qvec_blob, tvec_blob);
}

void WriteRigRows(const std::vector<RigRow>& rigs, SqliteDatabase* database) {
  SqliteStatement rig_row =
      database->Prepare("INSERT INTO rigs VALUES (?1, ?2, ?3)");
  SqliteStatement sensor_row =
      database->Prepare("INSERT INTO rig_sensors VALUES (?1, ?2, ?3, ?4)");
  for (const RigRow& rig : rigs) {
    if (!rig.ref_camera_id) {
      ThrowDatabaseError(database->path(),
                         "cannot hold rig " + std::to_string(rig.id.value()) +
                             ", whose reference is not a camera" +
                             kConfigureAgain);
    }
    rig_row.Run(rig.id, *rig.ref_camera_id, kCameraSensorType);
    for (const RigSensorRow& sensor : rig.sensors) {
      if (sensor.camera_id == *rig.ref_camera_id) continue;
      Eigen::Matrix<double, 7, 1> numbers;
      std::optional<BlobView> blob;
      if (const auto& pose = sensor.sensor_from_rig) {
        numbers << pose->rotation.w(), pose->rotation.vec(), pose->translation;
        blob = BlobOf(numbers.data(), 7);
      }
      sensor_row.Run(rig.id, sensor.camera_id, kCameraSensorType, blob);
    }
  }
}

void WriteFrameRows(const std::vector<FrameRow>& frames,
                    SqliteDatabase* database) {
  SqliteStatement frame_row =
      database->Prepare("INSERT INTO frames VALUES (?1, ?2)");
  SqliteStatement data_row =
      database->Prepare("INSERT INTO frame_data VALUES (?1, ?2, ?3, ?4)");
  for (const FrameRow& frame : frames) {
    frame_row.Run(frame.id, frame.rig_id);
    for (const FrameDataRow& data : frame.data) {
      data_row.Run(frame.id, data.image_id, data.camera_id, kCameraSensorType);
    }
  }
}

FeatureKeypoint FeatureKeypoint::FromScale(float x_px, float y_px,
                                           float scale_px,
                                           float orientation_rad) {
  const float c = scale_px * std::cos(orientation_rad);
  const float s = scale_px * std::sin(orientation_rad);
  return {x_px, y_px, c, -s, s, c};
}

float FeatureKeypoint::ScalePx() const {
  return 0.5f * (std::hypot(a11, a21) + std::hypot(a12, a22));
}

float FeatureKeypoint::OrientationRad() const { return std::atan2(a21, a11); }

std::vector<FeatureKeypoint> MakeFeatureKeypoints(const KeypointBlob& blob) {
  std::vector<FeatureKeypoint> keypoints(blob.rows);
  for (size_t i = 0; i < blob.rows; ++i) {
    float values[6] = {};
    std::memcpy(values, blob.data + i * blob.cols * sizeof(float),
                blob.cols * sizeof(float));
    keypoints[i].x_px = values[0];
    keypoints[i].y_px = values[1];
    if (blob.cols == 4) {
      keypoints[i] = FeatureKeypoint::FromScale(values[0], values[1], values[2],
                                                values[3]);
    } else if (blob.cols == 6) {
      keypoints[i] = {values[0], values[1], values[2],
                      values[3], values[4], values[5]};
    }
  }
  return keypoints;
}

DescriptorMatrix DecodeDescriptors(const SqliteStatement& row,
                                   const std::string& name) {
  const BlobView blob = row.Blob(3);
  const size_t rows =
      NumRows(row, blob, row.Int(2) == kSiftColumns ? kSiftColumns : 0,
              "the descriptors of " + name + " are not SIFT's", kExtractAgain);
  DescriptorMatrix descriptors(rows, kSiftColumns);
  if (rows > 0) std::memcpy(descriptors.data(), blob.data, blob.size);
  return descriptors;
}

}  // namespace mgsfm
