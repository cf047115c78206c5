// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/database/feature_database.h"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <limits>
#include <set>
#include <system_error>

#include "base/ranges.h"
#include "database/database_reader.h"
#include "database/database_rows.h"
#include "database/database_shard.h"
#include "database/sqlite_database.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Since this version, absent matrices and poses are NULL.
constexpr int64_t kFirstVersionWithNull = 4000000;
// Time for other programs to finish before the database counts as in use: long
// enough for a COLMAP transaction, short enough for a waiting user.
constexpr const char* kBusyTimeout = "PRAGMA busy_timeout = 2000";

int64_t PairIdOf(ImageId a, ImageId b) {
  MGSFM_CHECK_NE(a, b);
  return PairId(std::min(a, b).value(), std::max(a, b).value());
}

// Matches of image_id1 and image_id2, to or from the order in the database.
std::vector<Match> InOrder(std::vector<Match> matches, ImageId image_id1,
                           ImageId image_id2) {
  if (image_id2 < image_id1) SwapImages(&matches);
  return matches;
}

}  // namespace

// ------------------------------------------------------- the open database

// Its file or snapshot, its transaction, and what its version of the tables
// contains.
class FeatureDatabase::Impl {
 public:
  Impl(const std::string& path, OpenMode mode);
  ~Impl();

  const SqliteDatabase& database() const {
    return file_ ? *file_ : snapshot_->database();
  }
  // Only for databases that are open for writing, and only for writing.
  SqliteDatabase& file() {
    MGSFM_CHECK_MSG(file_.has_value(), path());
    if (tables_are_pending_ && !is_in_transaction_) Commit();
    return *file_;
  }
  const std::string& path() const { return database().path(); }
  void CheckUnchanged() const {
    if (snapshot_) snapshot_->CheckUnchanged();
  }

  void Begin();
  void Commit();
  void Rollback() noexcept;
  // Runs `write` in a transaction, the current one if there is one.
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

  // Runs a statement that writes with these parameters.
  template <class... Values>
  void Run(const std::string& sql, const Values&... values) {
    file().Prepare(sql).Run(values...);
  }

  bool Has(const std::string& table, const std::string& key, int64_t id) const {
    return database()
        .Prepare("SELECT 1 FROM " + table + " WHERE " + key + " = ?1", id)
        .Step();
  }
  std::vector<ImageId> ListImages(const std::string& table) const;
  std::vector<PairCount> ListPairs(const std::string& table) const;
  // "image 3 'a.jpg'", for messages.
  std::string ImageName(ImageId image_id) const;
  std::string PairName(ImageId image_id1, ImageId image_id2) const {
    return ImageName(image_id1) + " and " + ImageName(image_id2);
  }

  void WritePrior(const PosePriorRow& prior);
  int64_t FindOrAddRig(CameraId camera_id);
  // Of the row that was inserted last.
  uint32_t LastId() {
    SqliteStatement last = file().Prepare("SELECT last_insert_rowid()");
    last.Step();
    return static_cast<uint32_t>(last.Int(0));
  }

  // Whether the tables have these features.
  bool none_is_null = false;
  bool descriptors_have_type = false;

 private:
  void CheckTables() const;
  // Begins a transaction that adds missing tables and columns. The first write
  // commits it, so that a run without writes does not change the file.
  void AddTables();
  bool HasPriorColumn(const std::string& column) const {
    return prior_columns_.count(column) > 0;
  }

  // Exactly one of these is set.
  std::optional<SqliteDatabase> file_;
  std::optional<SqliteSnapshot> snapshot_;
  bool is_new_ = false;  // there was no file, and nothing has been written
  bool tables_are_pending_ = false;
  bool is_in_transaction_ = false;
  bool images_have_priors_ = false;
  std::set<std::string> prior_columns_;
  std::set<std::string> prior_columns_before_;  // when the transaction began
};

FeatureDatabase::Impl::Impl(const std::string& path, OpenMode mode) {
  if (mode == OpenMode::kReadOnly) {
    snapshot_.emplace(path);
  } else {
    std::error_code ignored;
    const bool is_new = !std::filesystem::exists(path, ignored);
    file_.emplace(
        SqliteDatabase::OpenOrCreate(path, mode == OpenMode::kOrCreate));
    is_new_ = is_new;
    // Locks the database until the end, so that no other program adds the same
    // rows.
    file_->Execute(kBusyTimeout);
    file_->Execute("PRAGMA locking_mode = EXCLUSIVE");
    file_->Execute("PRAGMA foreign_keys = ON");
    file_->Execute("BEGIN EXCLUSIVE; COMMIT");
    CheckTables();
    AddTables();
  }
  SqliteStatement version = database().Prepare("PRAGMA user_version");
  version.Step();
  none_is_null = version.Int(0) >= kFirstVersionWithNull;
  descriptors_have_type = database().Columns("descriptors").count("type") > 0;
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

void FeatureDatabase::Impl::CheckTables() const {
  const bool is_empty =
      !database().Prepare("SELECT 1 FROM sqlite_master LIMIT 1").Step();
  if (!is_empty && !database().HasTable("images")) {
    ThrowDatabaseError(
        path(), "belongs to another program, not to COLMAP; choose a new file");
  }
  for (const char* table : {"cameras", "images", "keypoints", "descriptors",
                            "matches", "two_view_geometries", "pose_priors",
                            "rigs", "rig_sensors", "frames", "frame_data"}) {
    // Throws if the name is not a COLMAP table.
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
      ThrowDatabaseError(path(), "has the invalid pair id " +
                                     std::to_string(pair_id) +
                                     " in the table " + table + kMatchAgain);
    }
    pairs.push_back({ImageId(static_cast<uint32_t>(id1)),
                     ImageId(static_cast<uint32_t>(id2)),
                     static_cast<size_t>(std::max<int64_t>(0, row.Int(1)))});
  }
  return pairs;
}

std::string FeatureDatabase::Impl::ImageName(ImageId image_id) const {
  SqliteStatement row = database().Prepare(
      "SELECT name FROM images WHERE image_id = ?1", image_id);
  return "image " + std::to_string(image_id.value()) +
         (row.Step() ? " '" + row.Text(0) + "'" : "");
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
  int64_t camera_id = 0;
  const bool is_version4 = HasPriorColumn("corr_data_id");
  if (is_version4) {
    // The key of a prior is not that of its image.
    Run("DELETE FROM pose_priors WHERE corr_data_id = ?1 AND "
        "corr_sensor_type = ?2",
        prior.image_id, kCameraSensorType);
    SqliteStatement image = database().Prepare(
        "SELECT camera_id FROM images WHERE image_id = ?1", prior.image_id);
    MGSFM_CHECK_MSG(image.Step(), ImageName(prior.image_id));
    camera_id = image.Int(0);
  }
  std::string names = "position, coordinate_system", values = "?2, ?7";
  const auto add = [&](const char* name, const char* value) {
    names += std::string(", ") + name;
    values += std::string(", ") + value;
  };
  add(is_version4 ? "corr_data_id" : "image_id", "?1");
  if (HasPriorColumn("position_covariance")) add("position_covariance", "?3");
  if (HasPriorColumn("gravity")) add("gravity", "?4");
  if (is_version4) add("corr_sensor_id, corr_sensor_type", "?5, ?6");
  // Coordinate systems come last: SQLite ignores a parameter below the last one
  // that does not occur.
  Run("INSERT OR REPLACE INTO pose_priors (" + names + ") VALUES (" + values +
          ")",
      prior.image_id, BlobOf(prior.position.data(), 3),
      BlobOf(covariance.data(), 9), BlobOf(gravity.data(), 3), camera_id,
      kCameraSensorType, prior.coordinate_system);
  if (!images_have_priors_) return;
  Run("UPDATE images SET prior_tx = ?2, prior_ty = ?3, prior_tz = ?4 "
      "WHERE image_id = ?1",
      prior.image_id, prior.position.x(), prior.position.y(),
      prior.position.z());
}

int64_t FeatureDatabase::Impl::FindOrAddRig(CameraId camera_id) {
  SqliteStatement rig = file().Prepare(
      "SELECT rig_id FROM rigs WHERE ref_sensor_id = ?1 AND "
      "ref_sensor_type = ?2 UNION SELECT rig_id FROM rig_sensors WHERE "
      "sensor_id = ?1 AND sensor_type = ?2",
      camera_id, kCameraSensorType);
  if (rig.Step()) return rig.Int(0);
  Run("INSERT INTO rigs (ref_sensor_id, ref_sensor_type) VALUES (?1, ?2)",
      camera_id, kCameraSensorType);
  return LastId();
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
  SqliteStatement row = impl_->database().Prepare(
      "SELECT image_id, rows, cols, data FROM keypoints WHERE image_id = ?1",
      image_id);
  if (!row.Step()) return {};
  return MakeFeatureKeypoints(
      DecodeKeypoints(row, "the keypoints of " + impl_->ImageName(image_id)));
}

DescriptorMatrix FeatureDatabase::ReadDescriptors(ImageId image_id) const {
  SqliteStatement row = impl_->database().Prepare(
      "SELECT image_id, rows, cols, data FROM descriptors WHERE image_id = ?1",
      image_id);
  if (!row.Step()) return DescriptorMatrix(0, kSiftColumns);
  return DecodeDescriptors(row, impl_->ImageName(image_id));
}

std::vector<Match> FeatureDatabase::ReadMatches(ImageId image_id1,
                                                ImageId image_id2) const {
  SqliteStatement row = impl_->database().Prepare(
      "SELECT pair_id, rows, cols, data FROM matches WHERE pair_id = ?1",
      PairIdOf(image_id1, image_id2));
  if (!row.Step()) return {};
  return InOrder(DecodeMatches(row, impl_->PairName(image_id1, image_id2)),
                 image_id1, image_id2);
}

std::optional<TwoViewGeometryRow> FeatureDatabase::ReadTwoViewGeometry(
    ImageId image_id1, ImageId image_id2) const {
  SqliteStatement row = impl_->database().Prepare(
      TwoViewGeometryQuery(impl_->database(), "two_view_geometries") +
          " WHERE pair_id = ?1",
      PairIdOf(image_id1, image_id2));
  if (!row.Step()) return std::nullopt;
  TwoViewGeometryRow pair{std::min(image_id1, image_id2),
                          std::max(image_id1, image_id2)};
  DecodeTwoViewGeometry(row, impl_->PairName(image_id1, image_id2), &pair);
  if (image_id2 < image_id1) SwapImages(&pair);
  return pair;
}

std::vector<PosePriorRow> FeatureDatabase::ReadPosePriors() const {
  std::vector<PosePriorRow> priors = ReadPosePriorRows(impl_->database());
  EraseIf(&priors, [](const PosePriorRow& prior) {
    return !prior.position.allFinite();
  });
  return priors;
}

// -------------------------------------------------------------- writing

// SQLite assigns an id to a row whose id is NULL, as unbound parameters are.
CameraId FeatureDatabase::AddCamera(const Camera& camera,
                                    std::optional<CameraId> id) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT INTO cameras (model, width, height, params, prior_focal_length, "
      "camera_id) VALUES (?1, ?2, ?3, ?4, ?5, ?6)");
  RunWithCamera(camera, id, &row);
  return CameraId(impl_->LastId());
}

void FeatureDatabase::UpdateCamera(const Camera& camera) {
  SqliteStatement row = impl_->file().Prepare(
      "UPDATE cameras SET model = ?1, width = ?2, height = ?3, params = ?4, "
      "prior_focal_length = ?5 WHERE camera_id = ?6");
  RunWithCamera(camera, camera.id, &row);
}

ImageId FeatureDatabase::AddImage(const std::string& name, CameraId camera_id,
                                  std::optional<ImageId> id) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT INTO images (name, camera_id, image_id) VALUES (?1, ?2, ?3)");
  id ? row.Run(name, camera_id, *id) : row.Run(name, camera_id);
  return ImageId(impl_->LastId());
}

void FeatureDatabase::SetImageCamera(ImageId image_id, CameraId camera_id) {
  impl_->Run("UPDATE images SET camera_id = ?2 WHERE image_id = ?1", image_id,
             camera_id);
}

void FeatureDatabase::WriteKeypoints(
    ImageId image_id, const std::vector<FeatureKeypoint>& keypoints) {
  static_assert(sizeof(FeatureKeypoint) == 6 * sizeof(float),
                "as in the database");
  impl_->Run(
      "INSERT OR REPLACE INTO keypoints (image_id, rows, cols, data) "
      "VALUES (?1, ?2, 6, ?3)",
      image_id, keypoints.size(), BlobOf(keypoints));
}

void FeatureDatabase::WriteDescriptors(ImageId image_id,
                                       const DescriptorMatrix& descriptors) {
  // Feature types of COLMAP 4.
  constexpr int kUndefined = -1;
  constexpr int kSift = 0;
  // The last parameter is that of data: SQLite ignores one below it that does
  // not occur.
  impl_->Run(
      impl_->descriptors_have_type
          ? "INSERT OR REPLACE INTO descriptors (image_id, rows, cols, type, "
            "data) VALUES (?1, ?2, ?3, ?4, ?5)"
          : "INSERT OR REPLACE INTO descriptors (image_id, rows, cols, data) "
            "VALUES (?1, ?2, ?3, ?5)",
      image_id, descriptors.rows(), descriptors.cols(),
      descriptors.cols() == kSiftColumns ? kSift : kUndefined,
      BlobOf(descriptors.data(), static_cast<size_t>(descriptors.size())));
}

void FeatureDatabase::WritePosePrior(const PosePriorRow& prior) {
  impl_->InTransaction([&] { impl_->WritePrior(prior); });
}

void FeatureDatabase::WriteMatches(ImageId image_id1, ImageId image_id2,
                                   const std::vector<Match>& matches) {
  const std::vector<Match> ordered = InOrder(matches, image_id1, image_id2);
  impl_->Run(
      "INSERT OR REPLACE INTO matches (pair_id, rows, cols, data) "
      "VALUES (?1, ?2, 2, ?3)",
      PairIdOf(image_id1, image_id2), ordered.size(), BlobOf(ordered));
}

void FeatureDatabase::WriteTwoViewGeometry(const TwoViewGeometryRow& pair) {
  SqliteStatement row = impl_->file().Prepare(
      "INSERT OR REPLACE INTO two_view_geometries "
      "(pair_id, rows, cols, data, config, F, E, H, qvec, tvec) "
      "VALUES (?1, ?2, 2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)");
  if (pair.image_id1 < pair.image_id2) {
    return WriteTwoViewGeometryRow(pair, impl_->none_is_null, &row);
  }
  TwoViewGeometryRow swapped = pair;
  SwapImages(&swapped);
  WriteTwoViewGeometryRow(swapped, impl_->none_is_null, &row);
}

void FeatureDatabase::AddSingleImageFrame(ImageId image_id,
                                          CameraId camera_id) {
  impl_->InTransaction([&] {
    impl_->Run("INSERT INTO frames (rig_id) VALUES (?1)",
               impl_->FindOrAddRig(camera_id));
    impl_->Run(
        "INSERT INTO frame_data (frame_id, data_id, sensor_id, sensor_type) "
        "VALUES (?1, ?2, ?3, ?4)",
        impl_->LastId(), image_id, camera_id, kCameraSensorType);
  });
}

void FeatureDatabase::WriteRigsAndFrames(const std::vector<RigRow>& rigs,
                                         const std::vector<FrameRow>& frames) {
  impl_->InTransaction([&] {
    for (const char* table : {"frame_data", "frames", "rig_sensors", "rigs"}) {
      impl_->file().Execute(std::string("DELETE FROM ") + table);
    }
    WriteRigRows(rigs, &impl_->file());
    WriteFrameRows(frames, &impl_->file());
  });
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
