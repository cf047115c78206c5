// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "base/nanoseconds.h"
#include "base/ranges.h"
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

class Ros1Bag final : public ChunkedRecordingFile {
 public:
  Ros1Bag(const std::filesystem::path& path, const Context& context)
      : ChunkedRecordingFile(path, "connection") {
    uint64_t index_pos = 0;
    try {
      index_pos = ReadBagHeader();
    } catch (const BytesError& error) {
      throw Error("recording '" + path.string() +
                  "' is damaged at its beginning (" + error.what() +
                  "); copy it again from where it was recorded");
    }
    if (ReadIndex(index_pos)) return;
    ForgetIndex();
    Scan(context);
    WarnOfMissingIndex(context);
  }

 private:
  BagRecord ReadRecord(uint64_t offset) const;
  uint64_t ReadBagHeader();  // returns the place of the index
  bool ReadIndex(uint64_t offset);
  void Scan(const Context& context);
  void AddConnection(const BagFields& fields, std::string_view data);
  std::optional<std::string> ReadChunk(
      const RecordingChunk& chunk) const override;
  void AddMessages(const RecordingChunk& chunk, std::string_view bytes,
                   const Mask& wanted,
                   std::vector<RecordedMessage>* messages) const override;
  // Calls use(fields, data) for each record that is complete; returns whether
  // all are.
  template <class Use>
  static bool ForEachRecord(std::string_view bytes, const Use& use);

  uint64_t records_begin_ = 0;
  uint32_t num_chunks_ = 0;
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
  topic_of_source_[fields.Int<uint32_t>("conn")] =
      TopicIdx(topic, std::string(BagFields(data).Text("type")), "ros1");
}

// Returns false if there is no complete index.
bool Ros1Bag::ReadIndex(uint64_t offset) {
  if (offset < records_begin_ || offset >= file_.size()) return false;
  uint32_t num_chunks = 0;
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
      ++num_chunks;
      if (!chunk.topic_idxs.empty()) chunks_.push_back(std::move(chunk));
    }
  } catch (const BytesError&) {
    return false;
  }
  if (num_chunks != num_chunks_) return false;
  SortBy(&chunks_, &RecordingChunk::offset);
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
        WarnOfChunk(chunk, context);
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
      if (!chunk.topic_idxs.empty()) chunks_.push_back(std::move(chunk));
    }
  } catch (const BytesError&) {  // a record that is cut short ends the scan
  }
}

void Ros1Bag::AddMessages(const RecordingChunk&, std::string_view bytes,
                          const Mask& wanted,
                          std::vector<RecordedMessage>* messages) const {
  ForEachRecord(bytes, [&](const BagFields& fields, std::string_view data) {
    if (fields.Op() != kMessageOp) return;
    const int topic = TopicOf(fields.Int<uint32_t>("conn"));
    if (!wanted[topic]) return;
    messages->push_back({topic, fields.TimeNs("time"), data});
  });
}

}  // namespace

std::unique_ptr<RecordingFile> OpenRos1Bag(const std::filesystem::path& path,
                                           const Context& context) {
  return std::make_unique<Ros1Bag>(path, context);
}

}  // namespace mgsfm
