// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "base/nanoseconds.h"
#include "mgsfm/base/error.h"
#include "recordings/byte_reader.h"
#include "recordings/decompression.h"
#include "recordings/recording.h"

namespace mgsfm {
namespace {

// Kinds of records: the field `op` of their headers.
constexpr uint8_t kMessageOp = 2, kBagOp = 3, kChunkOp = 5, kChunkInfoOp = 6,
                  kConnectionOp = 7;
constexpr std::string_view kBagMagic = "#ROSBAG V2.0\n";

// Fields "name=value" of a header, each after its size.
class BagFields {
 public:
  explicit BagFields(std::string_view header) {
    ByteReader reader(header);
    while (!reader.IsEmpty()) {
      const std::string_view field = reader.TakeSized();
      const size_t equals = field.find('=');
      if (equals == std::string_view::npos) throw BytesError("has no '='");
      fields_[field.substr(0, equals)] = field.substr(equals + 1);
    }
  }

  std::string_view Text(std::string_view name) const {
    const auto found = fields_.find(name);
    if (found == fields_.end()) {
      throw BytesError("has no field '" + std::string(name) + "'");
    }
    return found->second;
  }
  template <class T>
  T Int(std::string_view name) const {
    return ByteReader(Text(name)).Take<T>();
  }
  uint8_t Op() const { return Int<uint8_t>("op"); }
  int64_t TimeNs(std::string_view name) const {
    ByteReader reader(Text(name));
    const auto seconds = reader.Take<uint32_t>();
    return int64_t{seconds} * kNsPerSecond + reader.Take<uint32_t>();
  }

 private:
  std::map<std::string_view, std::string_view> fields_;
};

// A record of the file. Its data may be incomplete at the end of a file that
// was cut short.
struct BagRecord {
  std::string header;
  uint64_t data_offset = 0;
  uint64_t data_size = 0;

  uint64_t End() const { return data_offset + data_size; }
};

class Ros1Bag : public RecordingFile {
 public:
  Ros1Bag(const std::filesystem::path& path, const Context& context)
      : file_(path) {
    uint64_t index_pos = 0;
    try {
      index_pos = ReadBagHeader();
    } catch (const BytesError& error) {
      throw Error("recording '" + path.string() +
                  "' is damaged at its beginning (" + error.what() +
                  "); copy it again from where it was recorded");
    }
    if (ReadIndex(index_pos)) return;
    topics_.clear();
    topic_of_connection_.clear();
    chunks_.clear();
    Scan(context);
    WarnOnce("recording '" + path.string() +
                 "' has no index, as it was not closed or is cut short; it is "
                 "read as far as it goes",
             context);
  }

  void Read(const Mask& wanted, const Context& context,
            const MessageSink& sink) override;

 private:
  BagRecord ReadRecord(uint64_t offset) const;
  uint64_t ReadBagHeader();  // returns the place of the index
  bool ReadIndex(uint64_t offset);
  void Scan(const Context& context);
  void AddConnection(const BagFields& fields, std::string_view data);
  int TopicOf(uint32_t connection) const;
  // The records of a chunk; nullopt, or those before the end of the file, if
  // it is damaged.
  std::optional<std::string> ReadChunk(const RecordingChunk& chunk) const;
  // Calls use(fields, data) for each record that is complete; returns whether
  // all are.
  template <class Use>
  static bool ForEachRecord(std::string_view bytes, const Use& use);

  const RandomAccessFile file_;
  uint64_t records_begin_ = 0;
  uint32_t num_chunks_ = 0;
  std::map<uint32_t, int> topic_of_connection_;
  std::vector<RecordingChunk> chunks_;
};

BagRecord Ros1Bag::ReadRecord(uint64_t offset) const {
  const auto size_at = [&](uint64_t place) {
    return ByteReader(file_.Read(place, 4)).Take<uint32_t>();
  };
  BagRecord record;
  const uint64_t header_size = size_at(offset);
  record.header = file_.Read(offset + 4, header_size);
  record.data_offset = offset + 8 + header_size;
  record.data_size = size_at(record.data_offset - 4);
  return record;
}

uint64_t Ros1Bag::ReadBagHeader() {
  const BagRecord record = ReadRecord(kBagMagic.size());
  const BagFields fields(record.header);
  if (fields.Op() != kBagOp) throw BytesError("there is no bag header");
  records_begin_ = record.End();
  num_chunks_ = fields.Int<uint32_t>("chunk_count");
  return fields.Int<uint64_t>("index_pos");
}

void Ros1Bag::AddConnection(const BagFields& fields, std::string_view data) {
  const std::string topic(fields.Text("topic"));
  topic_of_connection_[fields.Int<uint32_t>("conn")] =
      TopicIdx(topic, std::string(BagFields(data).Text("type")), "ros1");
}

int Ros1Bag::TopicOf(uint32_t connection) const {
  const auto found = topic_of_connection_.find(connection);
  if (found == topic_of_connection_.end()) {
    throw BytesError("has messages of an unknown connection");
  }
  return found->second;
}

// Returns false if there is no complete index.
bool Ros1Bag::ReadIndex(uint64_t offset) {
  if (offset < records_begin_ || offset >= file_.size()) return false;
  try {
    while (offset < file_.size()) {
      const BagRecord record = ReadRecord(offset);
      const std::string data = file_.Read(record.data_offset, record.data_size);
      const BagFields fields(record.header);
      offset = record.End();
      if (fields.Op() == kConnectionOp) AddConnection(fields, data);
      if (fields.Op() != kChunkInfoOp) continue;
      RecordingChunk chunk;
      chunk.offset = fields.Int<uint64_t>("chunk_pos");
      AddTime(fields.TimeNs("start_time"));
      AddTime(fields.TimeNs("end_time"));
      ByteReader counts(data);
      while (!counts.IsEmpty()) {
        const int topic = TopicOf(counts.Take<uint32_t>());
        chunk.topic_idxs.insert(topic);
        topics_[topic].num_messages += counts.Take<uint32_t>();
      }
      chunks_.push_back(std::move(chunk));
    }
  } catch (const BytesError&) {
    return false;
  }
  if (chunks_.size() != num_chunks_) return false;
  std::sort(chunks_.begin(), chunks_.end(),
            [](const RecordingChunk& a, const RecordingChunk& b) {
              return a.offset < b.offset;
            });
  return true;
}

template <class Use>
bool Ros1Bag::ForEachRecord(std::string_view bytes, const Use& use) {
  ByteReader reader(bytes);
  try {
    while (!reader.IsEmpty()) {
      const BagFields fields(reader.TakeSized());
      use(fields, reader.TakeSized());
    }
  } catch (const BytesError&) {
    return false;
  }
  return true;
}

std::optional<std::string> Ros1Bag::ReadChunk(
    const RecordingChunk& chunk) const {
  try {
    const BagRecord record = ReadRecord(chunk.offset);
    const BagFields fields(record.header);
    if (fields.Op() != kChunkOp) return std::nullopt;
    const bool is_cut = record.End() > file_.size();
    const std::string data = file_.Read(
        record.data_offset, std::min(record.End(), file_.size()) -
                                std::min(record.data_offset, file_.size()));
    const auto size = fields.Int<uint32_t>("size");
    const std::string_view compression = fields.Text("compression");
    CheckCompression(compression, "recording '" + file_.path().string() + "'");
    DecompressedBytes chunk_bytes = Decompress(compression, data, size);
    const bool is_intact =
        chunk_bytes.is_complete && chunk_bytes.bytes.size() == size;
    if (!is_intact && !is_cut) return std::nullopt;
    return std::move(chunk_bytes.bytes);
  } catch (const BytesError&) {
    return std::nullopt;
  }
}

void Ros1Bag::Scan(const Context& context) {
  uint64_t offset = records_begin_;
  try {
    while (offset < file_.size()) {
      context.ReportProgress("scanning a recording without index", offset,
                             file_.size());
      const BagRecord record = ReadRecord(offset);
      RecordingChunk chunk;
      chunk.offset = std::exchange(offset, record.End());
      if (BagFields(record.header).Op() != kChunkOp) continue;
      const std::optional<std::string> bytes = ReadChunk(chunk);
      if (!bytes) {
        WarnOnce(ChunkWarning(file_.path(), chunk, topics_), context);
        continue;
      }
      ForEachRecord(*bytes,
                    [&](const BagFields& fields, std::string_view data) {
                      if (fields.Op() == kConnectionOp)
                        AddConnection(fields, data);
                      if (fields.Op() != kMessageOp) return;
                      const int topic = TopicOf(fields.Int<uint32_t>("conn"));
                      AddTime(fields.TimeNs("time"));
                      chunk.topic_idxs.insert(topic);
                      ++topics_[topic].num_messages;
                    });
      chunks_.push_back(std::move(chunk));
    }
  } catch (const BytesError&) {  // a record that is cut short ends the scan
  }
}

void Ros1Bag::Read(const Mask& wanted, const Context& context,
                   const MessageSink& sink) {
  for (const RecordingChunk& chunk : chunks_) {
    context.ReportProgress("reading " + file_.path().filename().string(),
                           chunk.offset, file_.size());
    if (!chunk.HasAny(wanted)) continue;
    const std::optional<std::string> bytes = ReadChunk(chunk);
    if (!bytes) {
      WarnOnce(ChunkWarning(file_.path(), chunk, topics_), context);
      continue;
    }
    // Not within ForEachRecord, whose errors are about records.
    std::vector<RecordedMessage> messages;
    ForEachRecord(*bytes, [&](const BagFields& fields, std::string_view data) {
      if (fields.Op() != kMessageOp) return;
      const int topic = TopicOf(fields.Int<uint32_t>("conn"));
      if (!wanted[topic]) return;
      messages.push_back({topic, fields.TimeNs("time"), data});
    });
    for (const RecordedMessage& message : messages) sink(message);
  }
}

}  // namespace

std::unique_ptr<RecordingFile> OpenRos1Bag(const std::filesystem::path& path,
                                           const Context& context) {
  return std::make_unique<Ros1Bag>(path, context);
}

}  // namespace mgsfm
