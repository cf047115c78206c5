// SPDX-License-Identifier: BSD-3-Clause
#include "database/feature_database_impl.h"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <limits>
#include <system_error>
#include <tuple>
#include <utility>

#include "database/database_reader.h"
#include "database/database_rows.h"

namespace mgsfm {
namespace {

// Since this version, absent matrices and poses are NULL.
constexpr int64_t kFirstVersionWithNull = 4000000;
// Time for other programs to finish before the database counts as in use: long
// enough for a COLMAP transaction, short enough for a user who waits.
constexpr const char* kBusyTimeout = "PRAGMA busy_timeout = 2000";

SqliteDatabase OpenOrThrow(const std::string& path,
                           FeatureDatabase::OpenMode mode) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (path.front() == ':') {
    ThrowDatabaseError(path,
                       "is not a file to SQLite, and would be lost; choose "
                       "another name");
  }
  if (fs::is_directory(path, ignored)) {
    ThrowDatabaseError(path, "is a folder; choose a file in it");
  }
  if (!fs::exists(path, ignored)) {
    if (mode == FeatureDatabase::OpenMode::kExisting) {
      ThrowDatabaseError(path,
                         "there is no such file; check the path, or run the "
                         "feature extractor first");
    }
    const fs::path folder = fs::absolute(path).parent_path();
    if (!fs::is_directory(folder, ignored)) {
      ThrowDatabaseError(path, "cannot be created, as there is no folder '" +
                                   folder.string() + "'; create it first");
    }
  }
  return SqliteDatabase::Create(path);
}

}  // namespace

FeatureDatabase::Impl::Impl(const std::string& path, OpenMode mode) {
  if (mode == OpenMode::kReadOnly) {
    snapshot_.emplace(path);
  } else {
    std::error_code ignored;
    const bool is_new = !std::filesystem::exists(path, ignored);
    file_.emplace(OpenOrThrow(path, mode));
    is_new_ = is_new;
    Lock();
    CheckTables();
    AddTables();
  }
  SqliteStatement version = database().Prepare("PRAGMA user_version");
  version.Step();
  none_is_null_ = version.Int(0) >= kFirstVersionWithNull;
  descriptors_have_type_ = database().Columns("descriptors").count("type") > 0;
  prior_columns_ = database().Columns("pose_priors");
  images_have_priors_ = database().Columns("images").count("prior_tx") > 0;
}

FeatureDatabase::Impl::~Impl() {
  if (!is_new_) return;
  const std::string path = this->path();
  file_.reset();
  std::error_code ignored;
  std::filesystem::remove(path, ignored);
}

void FeatureDatabase::Impl::Begin() {
  MGSFM_CHECK(file_ && !is_in_transaction_);
  prior_columns_before_ = prior_columns_;
  if (!tables_are_pending_) file_->Execute("BEGIN IMMEDIATE");
  is_in_transaction_ = true;
}

void FeatureDatabase::Impl::Commit() {
  file_->Execute("COMMIT");
  is_in_transaction_ = false;
  tables_are_pending_ = false;
  is_new_ = false;
}

void FeatureDatabase::Impl::Rollback() noexcept {
  is_in_transaction_ = false;
  prior_columns_.swap(prior_columns_before_);
  try {
    file_->Execute("ROLLBACK");
  } catch (const Error&) {
    // After some failures, SQLite has rolled back already.
  }
  if (!tables_are_pending_) return;
  try {
    AddTables();
  } catch (const std::exception&) {
    // The error before the rollback is reported.
    tables_are_pending_ = false;
  }
}

void FeatureDatabase::Impl::Lock() {
  file_->Execute(kBusyTimeout);
  file_->Execute("PRAGMA locking_mode = EXCLUSIVE");
  file_->Execute("PRAGMA foreign_keys = ON");
  file_->Execute("BEGIN EXCLUSIVE; COMMIT");
}

bool FeatureDatabase::Impl::IsEmpty() const {
  return !database().Prepare("SELECT 1 FROM sqlite_master LIMIT 1").Step();
}

void FeatureDatabase::Impl::CheckTables() const {
  if (!IsEmpty() && !database().HasTable("images")) {
    ThrowDatabaseError(
        path(), "belongs to another program, not to COLMAP; choose a new file");
  }
  for (const char* table : {"cameras", "images", "keypoints", "descriptors",
                            "matches", "two_view_geometries", "pose_priors",
                            "rigs", "rig_sensors", "frames", "frame_data"}) {
    // Throws if it is none of COLMAP.
    std::ignore = database().HasTable(table);
  }
}

void FeatureDatabase::Impl::AddTables() {
  file_->Execute("BEGIN IMMEDIATE");
  tables_are_pending_ = true;
  if (file_->HasTable("inlier_matches") &&
      !file_->HasTable("two_view_geometries")) {
    file_->Execute("ALTER TABLE inlier_matches RENAME TO two_view_geometries");
  }
  CreateTables(TableLayout::k38And312, &*file_);
  const std::set<std::string> columns = file_->Columns("two_view_geometries");
  for (const char* column : {"F", "E", "H", "qvec", "tvec"}) {
    if (columns.count(column) > 0) continue;
    file_->Execute(std::string("ALTER TABLE two_view_geometries ADD COLUMN ") +
                   column + " BLOB");
  }
}

std::vector<ImageId> FeatureDatabase::Impl::ListImages(
    const std::string& table) const {
  std::vector<ImageId> ids;
  if (!database().HasTable(table)) return ids;
  SqliteStatement row = database().Prepare("SELECT image_id FROM " + table +
                                           " ORDER BY image_id");
  while (row.Step()) ids.emplace_back(static_cast<uint32_t>(row.Int(0)));
  return ids;
}

std::vector<PairCount> FeatureDatabase::Impl::ListPairs(
    const std::string& table) const {
  std::vector<PairCount> pairs;
  if (!database().HasTable(table)) return pairs;
  SqliteStatement row = database().Prepare("SELECT pair_id, rows FROM " +
                                           table + " ORDER BY pair_id");
  while (row.Step()) {
    const int64_t pair_id = row.Int(0);
    const int64_t id1 = pair_id / kMaxNumIds, id2 = pair_id % kMaxNumIds;
    if (pair_id < 0 || id1 >= id2) {
      ThrowDatabaseError(database().path(),
                         "has the invalid pair id " + std::to_string(pair_id) +
                             " in the table " + table + kMatchAgain);
    }
    pairs.push_back({ImageId(static_cast<uint32_t>(id1)),
                     ImageId(static_cast<uint32_t>(id2)),
                     static_cast<size_t>(std::max<int64_t>(0, row.Int(1)))});
  }
  return pairs;
}

std::string FeatureDatabase::Impl::ImageName(ImageId image_id) const {
  SqliteStatement row =
      Select("SELECT name FROM images WHERE image_id = ?1", image_id.value());
  return "image " + std::to_string(image_id.value()) +
         (row.Step() ? " '" + row.Text(0) + "'" : "");
}

int64_t FeatureDatabase::Impl::CameraOfImage(ImageId image_id) const {
  SqliteStatement row = Select(
      "SELECT camera_id FROM images WHERE image_id = ?1", image_id.value());
  MGSFM_CHECK_MSG(row.Step(), ImageName(image_id));
  return row.Int(0);
}

// Since COLMAP 4, the key of a prior is not that of its image.
void FeatureDatabase::Impl::DeletePrior(ImageId image_id) {
  SqliteStatement row = file().Prepare(
      "DELETE FROM pose_priors WHERE corr_data_id = ?1 AND corr_sensor_type = "
      "?2");
  row.BindInt(1, image_id.value());
  row.BindInt(2, kCameraSensorType);
  row.Run();
}

void FeatureDatabase::Impl::WritePrior(const PosePriorRow& prior) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const Eigen::Matrix<double, 3, 3, Eigen::RowMajor> covariance =
      prior.covariance.value_or(Eigen::Matrix3d::Constant(kNaN));
  const Eigen::Vector3d gravity =
      prior.gravity.value_or(Eigen::Vector3d::Constant(kNaN));
  if (prior.gravity && !HasPriorColumn("gravity")) {
    file().Execute("ALTER TABLE pose_priors ADD COLUMN gravity BLOB");
    prior_columns_.insert("gravity");
  }
  const bool is_version4 = HasPriorColumn("corr_data_id");
  if (is_version4) DeletePrior(prior.image_id);
  std::string sql = "INSERT OR REPLACE INTO pose_priors (position, ";
  sql += HasPriorColumn("position_covariance") ? "position_covariance, " : "";
  sql += HasPriorColumn("gravity") ? "gravity, " : "";
  sql += is_version4 ? "corr_data_id, corr_sensor_id, corr_sensor_type, "
                     : "image_id, ";
  sql += "coordinate_system) VALUES (?2, ";
  sql += HasPriorColumn("position_covariance") ? "?3, " : "";
  sql += HasPriorColumn("gravity") ? "?7, " : "";
  sql += is_version4 ? "?1, ?5, ?6, ?4)" : "?1, ?4)";
  SqliteStatement row = file().Prepare(sql);
  row.BindInt(1, prior.image_id.value());
  row.BindBlob(2, prior.position.data(), 3 * sizeof(double));
  if (HasPriorColumn("position_covariance")) {
    row.BindBlob(3, covariance.data(), 9 * sizeof(double));
  }
  row.BindInt(4, static_cast<int64_t>(prior.coordinate_system));
  if (is_version4) {
    row.BindInt(5, CameraOfImage(prior.image_id));
    row.BindInt(6, kCameraSensorType);
  }
  if (HasPriorColumn("gravity")) {
    row.BindBlob(7, gravity.data(), 3 * sizeof(double));
  }
  row.Run();
  if (!images_have_priors_) return;
  SqliteStatement image = file().Prepare(
      "UPDATE images SET prior_tx = ?2, prior_ty = ?3, prior_tz = ?4 "
      "WHERE image_id = ?1");
  image.BindInt(1, prior.image_id.value());
  for (int i = 0; i < 3; ++i) image.BindDouble(2 + i, prior.position[i]);
  image.Run();
}

uint32_t FeatureDatabase::Impl::AddRow(SqliteStatement* row) {
  row->Run();
  SqliteStatement last = file().Prepare("SELECT last_insert_rowid()");
  last.Step();
  return static_cast<uint32_t>(last.Int(0));
}

int64_t FeatureDatabase::Impl::FindOrAddRig(CameraId camera_id) {
  SqliteStatement rig = file().Prepare(
      "SELECT rig_id FROM rigs WHERE ref_sensor_id = ?1 AND "
      "ref_sensor_type = ?2 UNION SELECT rig_id FROM rig_sensors WHERE "
      "sensor_id = ?1 AND sensor_type = ?2");
  rig.BindInt(1, camera_id.value());
  rig.BindInt(2, kCameraSensorType);
  if (rig.Step()) return rig.Int(0);
  SqliteStatement row = file().Prepare(
      "INSERT INTO rigs (ref_sensor_id, ref_sensor_type) VALUES (?1, ?2)");
  row.BindInt(1, camera_id.value());
  row.BindInt(2, kCameraSensorType);
  return AddRow(&row);
}

void FeatureDatabase::Impl::AddFrame(ImageId image_id, CameraId camera_id) {
  SqliteStatement row =
      file().Prepare("INSERT INTO frames (rig_id) VALUES (?1)");
  row.BindInt(1, FindOrAddRig(camera_id));
  const uint32_t frame_id = AddRow(&row);
  SqliteStatement data = file().Prepare(
      "INSERT INTO frame_data (frame_id, data_id, sensor_id, sensor_type) "
      "VALUES (?1, ?2, ?3, ?4)");
  data.BindInt(1, frame_id);
  data.BindInt(2, image_id.value());
  data.BindInt(3, camera_id.value());
  data.BindInt(4, kCameraSensorType);
  data.Run();
}

void FeatureDatabase::Impl::ReplaceRigsAndFrames(
    const std::vector<RigRow>& rigs, const std::vector<FrameRow>& frames) {
  for (const char* table : {"frame_data", "frames", "rig_sensors", "rigs"}) {
    file().Execute(std::string("DELETE FROM ") + table);
  }
  WriteRigRows(rigs, &file());
  WriteFrameRows(frames, &file());
}

}  // namespace mgsfm
