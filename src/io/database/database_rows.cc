// SPDX-License-Identifier: BSD-3-Clause
#include "database/database_rows.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <set>
#include <string>

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

namespace {

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

// `name` is plural, as in "the keypoints of image 'a.jpg'".
[[noreturn]] void ThrowDamagedTable(const std::string& path,
                                    const std::string& name,
                                    const SqliteStatement& row,
                                    const char* remedy) {
  ThrowDatabaseError(
      path, name + " are damaged: " + std::to_string(row.Blob(3).size) +
                " bytes for " + std::to_string(row.Int(1)) + " x " +
                std::to_string(row.Int(2)) + " values" + remedy);
}

std::optional<Eigen::Matrix3d> DecodeMatrix(const BlobView& blob,
                                            const std::string& path,
                                            const std::string& name) {
  if (blob.size == 0) return std::nullopt;
  const auto values = Decode<double, 9>(blob);
  if (!values) {
    ThrowDatabaseError(path, "the matrix " + name +
                                 " is damaged: " + std::to_string(blob.size) +
                                 " bytes instead of 72" + kMatchAgain);
  }
  const Eigen::Matrix3d matrix =
      Eigen::Map<const RowMajorMatrix>(values->data());
  if (!matrix.allFinite() || matrix.isZero(0.0)) return std::nullopt;
  return matrix;
}

std::optional<Rigid3> DecodeRelativePose(const SqliteStatement& row,
                                         const std::string& path,
                                         const std::string& name) {
  const BlobView qvec_blob = row.Blob(8);
  const BlobView tvec_blob = row.Blob(9);
  if (qvec_blob.size == 0 && tvec_blob.size == 0) return std::nullopt;
  const auto qvec = Decode<double, 4>(qvec_blob);
  const auto tvec = Decode<double, 3>(tvec_blob);
  if (!qvec || !tvec) {
    ThrowDatabaseError(path, "the relative pose of " + name + " is damaged: " +
                                 std::to_string(qvec_blob.size) + " and " +
                                 std::to_string(tvec_blob.size) +
                                 " bytes instead of 32 and 24" + kMatchAgain);
  }
  const auto pose = PoseFromNumbers(qvec->data(), tvec->data());
  if (const auto problem = pose ? WhyImplausible(*pose) : std::nullopt) {
    ThrowDatabaseError(
        path, "the relative pose of " + name + ' ' + *problem + kMatchAgain);
  }
  const bool is_default =
      pose && pose->translation.isZero(0.0) && pose->rotation.vec().isZero(0.0);
  return is_default ? std::nullopt : pose;
}

}  // namespace

std::optional<Rigid3> PoseFromNumbers(const double* qvec, const double* tvec) {
  const Eigen::Quaterniond rotation(qvec[0], qvec[1], qvec[2], qvec[3]);
  if (!AllFinite(qvec, 4) || !AllFinite(tvec, 3) || !(rotation.norm() > 0.0)) {
    return std::nullopt;
  }
  return PoseOfFile(rotation, {tvec[0], tvec[1], tvec[2]});
}

std::string PosePriorQuery(const SqliteDatabase& database) {
  const std::set<std::string> columns = database.Columns("pose_priors");
  const std::string covariance =
      columns.count("position_covariance") > 0 ? "position_covariance" : "NULL";
  const std::string gravity = columns.count("gravity") > 0 ? "gravity" : "NULL";
  if (columns.count("corr_data_id") > 0) {
    return "SELECT corr_data_id, position, " + covariance +
           ", coordinate_system, " + gravity +
           " FROM pose_priors WHERE corr_sensor_type = " +
           std::to_string(kCameraSensorType) + " ORDER BY corr_data_id";
  }
  return "SELECT image_id, position, " + covariance + ", coordinate_system, " +
         gravity + " FROM pose_priors ORDER BY image_id";
}

std::string PriorGravityQuery(const SqliteDatabase& database) {
  if (!database.HasTable("pose_priors")) return "";
  const std::set<std::string> columns = database.Columns("pose_priors");
  if (columns.count("gravity") == 0) return "";
  if (columns.count("corr_data_id") > 0) {
    return "SELECT corr_data_id, gravity FROM pose_priors WHERE "
           "corr_sensor_type = " +
           std::to_string(kCameraSensorType) + " ORDER BY corr_data_id";
  }
  return "SELECT image_id, gravity FROM pose_priors ORDER BY image_id";
}

std::optional<Eigen::Vector3d> DecodeVector3(const BlobView& blob) {
  const auto values = Decode<double, 3>(blob);
  if (!values) return std::nullopt;
  return Eigen::Vector3d(Eigen::Vector3d::Map(values->data()));
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
  const auto gravity = DecodeVector3(row.Blob(4));
  if (gravity && gravity->allFinite()) prior.gravity = gravity;
  return prior;
}

KeypointBlob DecodeKeypoints(const SqliteStatement& row,
                             const std::string& path, const std::string& name) {
  const BlobView blob = row.Blob(3);
  const int64_t rows = row.Int(1);
  const int64_t cols = row.Int(2);
  if (rows == 0 && blob.size == 0) return {};
  const bool cols_are_known = cols == 2 || cols == 4 || cols == 6;
  const size_t row_size = static_cast<size_t>(cols) * sizeof(float);
  if (!cols_are_known || rows < 0 || blob.size % row_size != 0 ||
      blob.size / row_size != static_cast<size_t>(rows)) {
    ThrowDamagedTable(path, name, row, kExtractAgain);
  }
  return {blob.data, static_cast<size_t>(rows), static_cast<size_t>(cols)};
}

std::vector<Match> DecodeMatches(const SqliteStatement& row,
                                 const std::string& path,
                                 const std::string& name) {
  static_assert(sizeof(Match) == 2 * sizeof(uint32_t), "as in the database");
  const BlobView blob = row.Blob(3);
  const int64_t rows = row.Int(1);
  if (rows == 0 && blob.size == 0) return {};
  if (row.Int(2) != 2 || rows < 0 || blob.size % sizeof(Match) != 0 ||
      blob.size / sizeof(Match) != static_cast<size_t>(rows)) {
    ThrowDamagedTable(path, "the matches of " + name, row, kMatchAgain);
  }
  std::vector<Match> matches(static_cast<size_t>(rows));
  std::memcpy(matches.data(), blob.data, blob.size);
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

void DecodeTwoViewGeometry(const SqliteStatement& row, const std::string& path,
                           const std::string& name, TwoViewGeometryRow* pair) {
  const int64_t config = row.Int(4);
  if (config < 0 || config > static_cast<int>(TwoViewConfig::kCalibratedRig)) {
    ThrowDatabaseError(path, name + " has the unknown configuration " +
                                 std::to_string(config) + kMatchAgain);
  }
  pair->config = static_cast<TwoViewConfig>(config);
  pair->F = DecodeMatrix(row.Blob(5), path, "F of " + name);
  pair->E = DecodeMatrix(row.Blob(6), path, "E of " + name);
  pair->H = DecodeMatrix(row.Blob(7), path, "H of " + name);
  if (pair->H && !pair->H->inverse().allFinite()) pair->H.reset();
  pair->cam2_from_cam1 = DecodeRelativePose(row, path, name);
  pair->matches = DecodeMatches(row, path, name);
}

void BindCamera(const Camera& camera, SqliteStatement* row) {
  row->BindInt(1, static_cast<int64_t>(camera.model));
  row->BindInt(2, camera.width_px);
  row->BindInt(3, camera.height_px);
  row->BindBlob(4, camera.params.data(), camera.params.size() * sizeof(double));
  row->BindInt(5, camera.has_prior_focal_length ? 1 : 0);
}

void BindMatches(int64_t pair_id, const std::vector<Match>& matches,
                 SqliteStatement* row) {
  row->BindInt(1, pair_id);
  row->BindInt(2, static_cast<int64_t>(matches.size()));
  row->BindBlob(3, matches.data(), matches.size() * sizeof(Match));
}

void WriteTwoViewGeometryRow(const TwoViewGeometryRow& pair, bool none_is_null,
                             SqliteStatement* row) {
  MGSFM_CHECK_LT(pair.image_id1.value(), pair.image_id2.value());
  BindMatches(PairId(pair.image_id1.value(), pair.image_id2.value()),
              pair.matches, row);
  row->BindInt(4, static_cast<int64_t>(pair.config));
  RowMajorMatrix matrices[3];  // must live until Run()
  int parameter = 5;
  for (const auto* matrix : {&pair.F, &pair.E, &pair.H}) {
    RowMajorMatrix& values = matrices[parameter - 5];
    values = matrix->value_or(Eigen::Matrix3d::Zero());
    row->BindBlob(parameter, values.data(), 9 * sizeof(double));
    if (none_is_null && !*matrix) row->BindNull(parameter);
    ++parameter;
  }
  const Rigid3 pose = pair.cam2_from_cam1.value_or(Rigid3());
  const Eigen::Vector4d qvec(pose.rotation.w(), pose.rotation.x(),
                             pose.rotation.y(), pose.rotation.z());
  row->BindBlob(8, qvec.data(), 4 * sizeof(double));
  row->BindBlob(9, pose.translation.data(), 3 * sizeof(double));
  if (none_is_null && !pair.cam2_from_cam1) {
    row->BindNull(8);
    row->BindNull(9);
  }
  row->Run();
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

void WriteFrameRows(const std::vector<FrameRow>& frames,
                    SqliteDatabase* database) {
  SqliteStatement frame_row =
      database->Prepare("INSERT INTO frames VALUES (?1, ?2)");
  SqliteStatement data_row =
      database->Prepare("INSERT INTO frame_data VALUES (?1, ?2, ?3, ?4)");
  for (const FrameRow& frame : frames) {
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
                                   const std::string& path,
                                   const std::string& name) {
  const int64_t rows = row.Int(1);
  const BlobView blob = row.Blob(3);
  if (rows == 0 && blob.size == 0) return DescriptorMatrix(0, kSiftColumns);
  if (rows < 0 || row.Int(2) != kSiftColumns || blob.size % kSiftColumns != 0 ||
      blob.size / kSiftColumns != static_cast<size_t>(rows)) {
    ThrowDatabaseError(
        path, "the descriptors of " + name +
                  " are not SIFT's: " + std::to_string(blob.size) +
                  " bytes for " + std::to_string(rows) + " x " +
                  std::to_string(row.Int(2)) + " values" + kExtractAgain);
  }
  DescriptorMatrix descriptors(rows, kSiftColumns);
  std::memcpy(descriptors.data(), blob.data, blob.size);
  return descriptors;
}

}  // namespace mgsfm
