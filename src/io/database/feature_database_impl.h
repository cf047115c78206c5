// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// The open database behind a FeatureDatabase: its file or snapshot, its
// transaction, and what its version of the tables contains.

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "database/database_rows.h"
#include "database/sqlite_database.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/feature_database.h"

namespace mgsfm {

class FeatureDatabase::Impl {
 public:
  Impl(const std::string& path, OpenMode mode);
  ~Impl();

  const SqliteDatabase& database() const {
    return file_ ? *file_ : snapshot_->database();
  }
  // Only for databases that are open for writing, and in order to write.
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
  void DeletePrior(ImageId image_id);
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
  void Lock();
  bool IsEmpty() const;
  void CheckTables() const;
  // Begins a transaction that adds missing tables and columns. The first write
  // commits it, so that a run that writes nothing leaves the file as it was.
  void AddTables();

  // One of them.
  std::optional<SqliteDatabase> file_;
  std::optional<SqliteSnapshot> snapshot_;
  bool is_new_ = false;  // there was no file, and nothing has been written
  bool tables_are_pending_ = false;
  bool is_in_transaction_ = false;
  bool none_is_null_ = false;
  bool descriptors_have_type_ = false;
  bool images_have_priors_ = false;
  std::set<std::string> prior_columns_;
  std::set<std::string> prior_columns_before_;  // when the transaction began
};

}  // namespace mgsfm
