// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/io/database/feature_database.h"

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <limits>
#include <set>
#include <system_error>
#include <tuple>
#include <utility>

#include "io/database/database_pair_id.h"
#include "io/database/database_reader.h"
#include "io/database/database_rows.h"
#include "io/database/database_schema.h"
#include "io/database/database_shard.h"
#include "io/database/feature_keypoints.h"
#include "io/database/sqlite_database.h"
#include "io/database/sqlite_snapshot.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Since this version, absent matrices and poses are NULL.
constexpr int64_t kFirstVersionWithNull = 4000000;
// Time for other programs to finish before the database counts as in use: long
// enough for a COLMAP transaction, short enough for a user who waits.
constexpr const char* kBusyTimeout = "PRAGMA busy_timeout = 2000";

int64_t PairIdOf(ImageId a, ImageId b) {
  MGSFM_CHECK_NE(a, b);
  return PairId(std::min(a, b).value(), std::max(a, b).value());
}

std::vector<Match> WithColumnsSwapped(std::vector<Match> matches) {
  for (Match& match : matches) {
    std::swap(match.keypoint_idx1, match.keypoint_idx2);
  }
  return matches;
}

SqliteDatabase OpenOrThrow(const std::string& path,
                           FeatureDatabase::OpenMode mode) {
  namespace fs = std::filesystem;
  std::error_code ignored;
  if (path.front() == ':') {
    ThrowDatabaseError(path,
                       "is no file to SQLite, and would be lost; choose "
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

class FeatureDatabase::Impl {
 public:
  Impl(const std::string& path, OpenMode mode) {
    if (mode == OpenMode::kReadOnly) {
      snapshot_.emplace(path);
    } else {
      file_.emplace(OpenOrThrow(path, mode));
      Lock();
      AddTables();
    }
    SqliteStatement version = database().Prepare("PRAGMA user_version");
    version.Step();
    none_is_null_ = version.Int(0) >= kFirstVersionWithNull;
    descriptors_have_type_ =
        database().Columns("descriptors").count("type") > 0;
    prior_columns_ = database().Columns("pose_priors");
    images_have_priors_ = database().Columns("images").count("prior_tx") > 0;
  }

  const SqliteDatabase& database() const {
    return file_ ? *file_ : snapshot_->database();
  }
  // Only for databases that are open for writing.
  SqliteDatabase& file() {
    MGSFM_CHECK_MSG(file_.has_value(), path());
    return *file_;
  }
  const std::string& path() const { return database().path(); }
  void CheckUnchanged() const {
    if (snapshot_) snapshot_->CheckUnchanged();
  }

  void Begin() {
    MGSFM_CHECK(!is_in_transaction_);
    file().Execute("BEGIN IMMEDIATE");
    is_in_transaction_ = true;
  }
  void Commit() {
    file().Execute("COMMIT");
    is_in_transaction_ = false;
  }
  void Rollback() noexcept {
    is_in_transaction_ = false;
    try {
      file().Execute("ROLLBACK");
    } catch (const Error&) {
      // After some failures, SQLite has rolled back already.
    }
  }
  // Runs `write` in a transaction, the present one if there is one.
  template <class Function>
  void InTransaction(const Function& write) {
    if (is_in_transaction_) return write();
    Begin();
    try {
      write();
      Commit();
    } catch (...) {
      Rollback();
      throw;
    }
  }

  SqliteStatement Select(const std::string& sql, int64_t id) const {
    SqliteStatement statement = database().Prepare(sql);
    statement.BindInt(1, id);
    return statement;
  }
  bool Has(const std::string& table, const std::string& key, int64_t id) const {
    return Select("SELECT 1 FROM " + table + " WHERE " + key + " = ?1", id)
        .Step();
  }
  std::vector<ImageId> ListImages(const std::string& table) const;
  std::vector<PairCount> ListPairs(const std::string& table) const;
  // "image 3 'a.jpg'", for messages.
  std::string ImageName(ImageId image_id) const;

  void WritePrior(const PosePriorRow& prior);
  int64_t CameraOfImage(ImageId image_id) const;
  // Runs the insertion of a row; returns its new id.
  uint32_t AddRow(SqliteStatement* row);
  int64_t FindOrAddRig(CameraId camera_id);
  void AddFrame(ImageId image_id, CameraId camera_id);
  void ReplaceRigsAndFrames(const std::vector<RigRow>& rigs,
                            const std::vector<FrameRow>& frames);

  bool none_is_null() const { return none_is_null_; }
  bool descriptors_have_type() const { return descriptors_have_type_; }
  bool HasPriorColumn(const std::string& column) const {
    return prior_columns_.count(column) > 0;
  }

 private:
  // Holds the lock until the end, so that no other program adds the same rows.
  void Lock() {
    file().Execute(kBusyTimeout);
    file().Execute("PRAGMA locking_mode = EXCLUSIVE");
    file().Execute("PRAGMA foreign_keys = ON");
    file().Execute("BEGIN EXCLUSIVE; COMMIT");
  }
  bool IsEmpty() const {
    return !database().Prepare("SELECT 1 FROM sqlite_master LIMIT 1").Step();
  }
  void AddTables();

  // One of them.
  std::optional<SqliteDatabase> file_;
  std::optional<SqliteSnapshot> snapshot_;
  bool is_in_transaction_ = false;
  bool none_is_null_ = false;
  bool descriptors_have_type_ = false;
  bool images_have_priors_ = false;
  std::set<std::string> prior_columns_;
};

void FeatureDatabase::Impl::AddTables() {
  if (!IsEmpty() && !file().HasTable("images")) {
    ThrowDatabaseError(
        path(), "belongs to another program, not to COLMAP; choose a new file");
  }
  for (const char* table : {"cameras", "images", "keypoints", "descriptors",
                            "matches", "two_view_geometries", "pose_priors",
                            "rigs", "rig_sensors", "frames", "frame_data"}) {
    std::ignore = file().HasTable(table);  // throws if it is none of COLMAP
  }
  InTransaction([&] {
    if (file().HasTable("inlier_matches") &&
        !file().HasTable("two_view_geometries")) {
      file().Execute(
          "ALTER TABLE inlier_matches RENAME TO two_view_geometries");
    }
    CreateTables(TableLayout::k38And312, &file());
    const std::set<std::string> columns = file().Columns("two_view_geometries");
    for (const char* column : {"F", "E", "H", "qvec", "tvec"}) {
      if (columns.count(column) > 0) continue;
      file().Execute(
          std::string("ALTER TABLE two_view_geometries ADD COLUMN ") + column +
          " BLOB");
    }
  });
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
  std::string sql = "INSERT OR REPLACE INTO pose_priors (position, ";
  sql += HasPriorColumn("position_covariance") ? "position_covariance, " : "";
  sql += HasPriorColumn("gravity") ? "gravity, " : "";
  sql += is_version4 ? "pose_prior_id, corr_data_id, corr_sensor_id, "
                       "corr_sensor_type, "
                     : "image_id, ";
  sql += "coordinate_system) VALUES (?2, ";
  sql += HasPriorColumn("position_covariance") ? "?3, " : "";
  sql += HasPriorColumn("gravity") ? "?7, " : "";
  sql += is_version4 ? "?1, ?1, ?5, ?6, ?4)" : "?1, ?4)";
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

// -------------------------------------------------------------- reading

FeatureDatabase::FeatureDatabase(const std::string& path, OpenMode mode)
    : impl_(std::make_unique<Impl>(path, mode)) {}
FeatureDatabase::~FeatureDatabase() = default;
FeatureDatabase::FeatureDatabase(FeatureDatabase&&) noexcept = default;
FeatureDatabase& FeatureDatabase::operator=(FeatureDatabase&&) noexcept =
    default;

const std::string& FeatureDatabase::path() const { return impl_->path(); }

void FeatureDatabase::CheckUnchanged() const { impl_->CheckUnchanged(); }

DatabaseContents FeatureDatabase::ReadStructure(const Context& context) const {
  return mgsfm::ReadStructure(impl_->database(), context);
}

bool FeatureDatabase::HasKeypoints(ImageId image_id) const {
  return impl_->Has("keypoints", "image_id", image_id.value());
}

bool FeatureDatabase::HasDescriptors(ImageId image_id) const {
  return impl_->Has("descriptors", "image_id", image_id.value());
}

bool FeatureDatabase::HasMatches(ImageId image_id1, ImageId image_id2) const {
  return impl_->Has("matches", "pair_id", PairIdOf(image_id1, image_id2));
}

bool FeatureDatabase::HasTwoViewGeometry(ImageId image_id1,
                                         ImageId image_id2) const {
  return impl_->Has("two_view_geometries", "pair_id",
                    PairIdOf(image_id1, image_id2));
}

std::vector<ImageId> FeatureDatabase::ImagesWithKeypoints() const {
  return impl_->ListImages("keypoints");
}

std::vector<ImageId> FeatureDatabase::ImagesWithDescriptors() const {
  return impl_->ListImages("descriptors");
}

std::vector<std::pair<ImageId, size_t>> FeatureDatabase::CountKeypoints()
    const {
  std::vector<std::pair<ImageId, size_t>> counts;
  SqliteStatement row = impl_->database().Prepare(
      "SELECT image_id, rows FROM keypoints ORDER BY image_id");
  while (row.Step()) {
    counts.emplace_back(static_cast<uint32_t>(row.Int(0)),
                        static_cast<size_t>(std::max<int64_t>(0, row.Int(1))));
  }
  return counts;
}

std::vector<PairCount> FeatureDatabase::CountMatches() const {
  return impl_->ListPairs("matches");
}

std::vector<PairCount> FeatureDatabase::CountInlierMatches() const {
  return impl_->ListPairs("two_view_geometries");
}

std::vector<FeatureKeypoint> FeatureDatabase::ReadKeypoints(
    ImageId image_id) const {
  SqliteStatement row = impl_->Select(
      "SELECT image_id, rows, cols, data FROM keypoints WHERE image_id = ?1",
      image_id.value());
  if (!row.Step()) return {};
  return MakeFeatureKeypoints(DecodeKeypoints(
      row, path(), "the keypoints of " + impl_->ImageName(image_id)));
}

DescriptorMatrix FeatureDatabase::ReadDescriptors(ImageId image_id) const {
  SqliteStatement row = impl_->Select(
      "SELECT image_id, rows, cols, data FROM descriptors WHERE image_id = ?1",
      image_id.value());
  if (!row.Step()) return DescriptorMatrix(0, kSiftColumns);
  return DecodeDescriptors(row, path(), impl_->ImageName(image_id));
}

std::vector<Match> FeatureDatabase::ReadMatches(ImageId image_id1,
                                                ImageId image_id2) const {
  SqliteStatement row = impl_->Select(
      "SELECT pair_id, rows, cols, data FROM matches WHERE pair_id = ?1",
      PairIdOf(image_id1, image_id2));
  if (!row.Step()) return {};
  std::vector<Match> matches = DecodeMatches(
      row, path(),
      impl_->ImageName(image_id1) + " and " + impl_->ImageName(image_id2));
  return image_id2 < image_id1 ? WithColumnsSwapped(std::move(matches))
                               : matches;
}

std::optional<TwoViewGeometryRow> FeatureDatabase::ReadTwoViewGeometry(
    ImageId image_id1, ImageId image_id2) const {
  SqliteStatement row = impl_->Select(
      TwoViewGeometryQuery(impl_->database(), "two_view_geometries") +
          " WHERE pair_id = ?1",
      PairIdOf(image_id1, image_id2));
  if (!row.Step()) return std::nullopt;
  TwoViewGeometryRow pair{std::min(image_id1, image_id2),
                          std::max(image_id1, image_id2),
                          TwoViewConfig::kUndefined,
                          {},
                          {},
                          {},
                          {},
                          {}};
  DecodeTwoViewGeometry(
      row, path(),
      impl_->ImageName(image_id1) + " and " + impl_->ImageName(image_id2),
      &pair);
  if (image_id2 < image_id1) SwapImages(&pair);
  return pair;
}

std::vector<PosePriorRow> FeatureDatabase::ReadPosePriors() const {
  std::vector<PosePriorRow> priors;
  if (!impl_->database().HasTable("pose_priors")) return priors;
  SqliteStatement row =
      impl_->database().Prepare(PosePriorQuery(impl_->database()));
  while (row.Step()) {
    const PosePriorRow prior = DecodePosePrior(row);
    if (prior.position.allFinite()) priors.push_back(prior);
  }
  return priors;
}

// -------------------------------------------------------------- writing

CameraId FeatureDatabase::AddCamera(const Camera& camera) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT INTO cameras (model, width, height, params, prior_focal_length) "
      "VALUES (?1, ?2, ?3, ?4, ?5)");
  BindCamera(camera, &row);
  return CameraId(impl_->AddRow(&row));
}

void FeatureDatabase::UpdateCamera(const Camera& camera) {
  SqliteStatement row = impl_->file().Prepare(
      "UPDATE cameras SET model = ?1, width = ?2, height = ?3, params = ?4, "
      "prior_focal_length = ?5 WHERE camera_id = ?6");
  BindCamera(camera, &row);
  row.BindInt(6, camera.id.value());
  row.Run();
}

ImageId FeatureDatabase::AddImage(const std::string& name, CameraId camera_id) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT INTO images (name, camera_id) VALUES (?1, ?2)");
  row.BindText(1, name);
  row.BindInt(2, camera_id.value());
  return ImageId(impl_->AddRow(&row));
}

void FeatureDatabase::SetImageCamera(ImageId image_id, CameraId camera_id) {
  SqliteStatement row = impl_->file().Prepare(
      "UPDATE images SET camera_id = ?2 WHERE image_id = ?1");
  row.BindInt(1, image_id.value());
  row.BindInt(2, camera_id.value());
  row.Run();
}

void FeatureDatabase::WriteKeypoints(
    ImageId image_id, const std::vector<FeatureKeypoint>& keypoints) {
  static_assert(sizeof(FeatureKeypoint) == 6 * sizeof(float),
                "as in the database");
  SqliteStatement row = impl_->file().Prepare(
      "INSERT OR REPLACE INTO keypoints (image_id, rows, cols, data) "
      "VALUES (?1, ?2, 6, ?3)");
  row.BindInt(1, image_id.value());
  row.BindInt(2, static_cast<int64_t>(keypoints.size()));
  row.BindBlob(3, keypoints.data(), keypoints.size() * sizeof(FeatureKeypoint));
  row.Run();
}

void FeatureDatabase::WriteDescriptors(ImageId image_id,
                                       const DescriptorMatrix& descriptors) {
  // Types of COLMAP 4.
  constexpr int kUndefined = -1;
  constexpr int kSift = 0;
  SqliteStatement row = impl_->file().Prepare(
      impl_->descriptors_have_type()
          ? "INSERT OR REPLACE INTO descriptors "
            "(image_id, rows, cols, data, type) VALUES (?1, ?2, ?3, ?4, ?5)"
          : "INSERT OR REPLACE INTO descriptors "
            "(image_id, rows, cols, data) VALUES (?1, ?2, ?3, ?4)");
  row.BindInt(1, image_id.value());
  row.BindInt(2, descriptors.rows());
  row.BindInt(3, descriptors.cols());
  row.BindBlob(4, descriptors.data(), descriptors.size());
  if (impl_->descriptors_have_type()) {
    row.BindInt(5, descriptors.cols() == kSiftColumns ? kSift : kUndefined);
  }
  row.Run();
}

void FeatureDatabase::WritePosePrior(const PosePriorRow& prior) {
  impl_->InTransaction([&] { impl_->WritePrior(prior); });
}

void FeatureDatabase::WriteMatches(ImageId image_id1, ImageId image_id2,
                                   const std::vector<Match>& matches) {
  const std::vector<Match> swapped = image_id2 < image_id1
                                         ? WithColumnsSwapped(matches)
                                         : std::vector<Match>();
  SqliteStatement row = impl_->file().Prepare(
      "INSERT OR REPLACE INTO matches (pair_id, rows, cols, data) "
      "VALUES (?1, ?2, 2, ?3)");
  BindMatches(PairIdOf(image_id1, image_id2),
              image_id2 < image_id1 ? swapped : matches, &row);
  row.Run();
}

void FeatureDatabase::WriteTwoViewGeometry(const TwoViewGeometryRow& pair) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT OR REPLACE INTO two_view_geometries "
      "(pair_id, rows, cols, data, config, F, E, H, qvec, tvec) "
      "VALUES (?1, ?2, 2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)");
  if (pair.image_id1 < pair.image_id2) {
    return WriteTwoViewGeometryRow(pair, impl_->none_is_null(), &row);
  }
  TwoViewGeometryRow swapped = pair;
  SwapImages(&swapped);
  WriteTwoViewGeometryRow(swapped, impl_->none_is_null(), &row);
}

void FeatureDatabase::AddSingleImageFrame(ImageId image_id,
                                          CameraId camera_id) {
  impl_->InTransaction([&] { impl_->AddFrame(image_id, camera_id); });
}

void FeatureDatabase::WriteRigsAndFrames(const std::vector<RigRow>& rigs,
                                         const std::vector<FrameRow>& frames) {
  impl_->InTransaction([&] { impl_->ReplaceRigsAndFrames(rigs, frames); });
}

std::optional<ShardManifest> FeatureDatabase::ReadShard() const {
  return ReadShardManifest(impl_->database());
}

void FeatureDatabase::WriteShard(const ShardManifest& manifest) {
  impl_->InTransaction([&] { WriteShardManifest(manifest, &impl_->file()); });
}

std::map<CameraId, std::string> FeatureDatabase::ReadShardCameras() const {
  return mgsfm::ReadShardCameras(impl_->database());
}

void FeatureDatabase::WriteShardCamera(CameraId camera_id,
                                       const std::string& image_name) {
  mgsfm::WriteShardCamera(camera_id, image_name, &impl_->file());
}

void FeatureDatabase::DeleteMatches() {
  impl_->file().Execute("DELETE FROM matches");
}

void FeatureDatabase::DeleteTwoViewGeometries() {
  impl_->file().Execute("DELETE FROM two_view_geometries");
}

DatabaseTransaction::DatabaseTransaction(FeatureDatabase* database)
    : database_(database) {
  database_->impl_->Begin();
}

DatabaseTransaction::~DatabaseTransaction() {
  if (is_open_) database_->impl_->Rollback();
}

void DatabaseTransaction::Commit() {
  database_->impl_->Commit();
  is_open_ = false;
}

}  // namespace mgsfm
