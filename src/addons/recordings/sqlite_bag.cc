// SPDX-License-Identifier: BSD-3-Clause
#include <map>
#include <string>

#include "database/sqlite_database.h"
#include "mgsfm/base/error.h"
#include "recordings/decompression.h"
#include "recordings/recording.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

class SqliteBag : public RecordingFile {
 public:
  explicit SqliteBag(const fs::path& path)
      : path_(path), database_(Open(path)) {
    for (const char* table : {"topics", "messages"}) {
      if (database_.HasTable(table)) continue;
      throw Error("recording '" + path.string() + "' has no table '" + table +
                  "'; give a .db3 file of rosbag2");
    }
    SqliteStatement rows = database_.Prepare(
        "SELECT id, name, type, serialization_format FROM topics ORDER BY id");
    while (rows.Step()) {
      topic_of_id_[rows.Int(0)] =
          TopicIdx(rows.Text(1), rows.Text(2), rows.Text(3));
    }
    SqliteStatement counts = database_.Prepare(
        "SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM "
        "messages GROUP BY topic_id");
    while (counts.Step()) {
      const auto found = topic_of_id_.find(counts.Int(0));
      if (found == topic_of_id_.end()) continue;
      topics_[found->second].num_messages +=
          static_cast<uint64_t>(counts.Int(1));
      AddTime(counts.Int(2));
      AddTime(counts.Int(3));
    }
  }

  void Read(const Mask& wanted, const Context& context,
            const MessageSink& sink) override;

 private:
  static SqliteDatabase Open(const fs::path& path);

  const fs::path path_;
  const SqliteDatabase database_;
  std::map<int64_t, int> topic_of_id_;
};

// As immutable, so that no file beside it is made or changed.
SqliteDatabase SqliteBag::Open(const fs::path& path) {
  for (const char* suffix : {"-wal", "-journal"}) {
    std::error_code ignored;
    const std::string beside = path.string() + suffix;
    if (fs::is_regular_file(beside, ignored) &&
        fs::file_size(beside, ignored) > 0) {
      throw Error("recording '" + path.string() + "' was not closed: '" +
                  beside +
                  "' has changes to it; take them over with sqlite3 '" +
                  path.string() + "' 'PRAGMA wal_checkpoint'");
    }
  }
  SqliteDatabase database =
      SqliteDatabase::OpenImmutable(path.string(), path.string());
  try {
    database.LimitWork(fs::file_size(path));
    (void)database.HasTable("messages");  // reads the first page
  } catch (const Error& error) {
    throw Error(std::string(error.what()) +
                ", or recover what is left with sqlite3 '" + path.string() +
                "' .recover | sqlite3 recovered.db3");
  }
  return database;
}

void SqliteBag::Read(const Mask& wanted, const Context& context,
                     const MessageSink& sink) {
  std::string ids;
  for (const auto& [id, topic] : topic_of_id_) {
    if (!wanted[topic]) continue;
    ids += (ids.empty() ? "" : ",") + std::to_string(id);
  }
  uint64_t num_messages = 0, num_read = 0;
  for (size_t i = 0; i < topics_.size(); ++i) {
    if (wanted[i]) num_messages += topics_[i].num_messages;
  }
  SqliteStatement rows = database_.Prepare(
      "SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN (" +
      ids + ") ORDER BY rowid");
  while (rows.Step()) {
    context.ReportProgress("reading " + path_.filename().string(), num_read++,
                           num_messages);
    const BlobView blob = rows.Blob(2);
    RecordedMessage message{
        topic_of_id_.at(rows.Int(0)), rows.Int(1), {blob.data, blob.size}};
    // rosbag2 compresses single messages with compression_mode: message. CDR
    // starts with other bytes.
    DecompressedBytes bytes;
    if (HasZstdHeader(message.data)) {
      bytes = Decompress("zstd", message.data, kMaxChunkBytes);
      message.data = bytes.bytes;
    }
    sink(message);
  }
}

}  // namespace

std::unique_ptr<RecordingFile> OpenSqliteBag(const fs::path& path) {
  return std::make_unique<SqliteBag>(path);
}

}  // namespace mgsfm
