// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "base/ranges.h"
#include "recordings/byte_reader.h"
#include "recordings/decompression.h"
#include "recordings/recording.h"

namespace mgsfm {
namespace {

// Kinds of records.
constexpr uint8_t kMcapFooter = 2, kMcapSchema = 3, kMcapChannel = 4,
                  kMcapMessage = 5, kMcapChunk = 6, kMcapChunkIndex = 8,
                  kMcapStatistics = 11, kMcapDataEnd = 15;
constexpr uint64_t kMcapMagicSize = 8;
// Before the content of a record: its kind and size.
constexpr uint64_t kMcapPrefixSize = 9;
// Before the data of a message.
constexpr uint64_t kMcapMessageHeaderSize = 22;

// A record of the file. Its content may be incomplete at the end of a file that
// was cut short.
struct McapRecord {
  uint8_t kind = 0;
  uint64_t offset = 0;  // of the content
  uint64_t size = 0;

  uint64_t End() const { return offset + size; }
};

class McapFile final : public ChunkedRecordingFile {
 public:
  McapFile(const std::filesystem::path& path, const Context& context)
      : ChunkedRecordingFile(path, "channel") {
    if (ReadSummary()) return;
    ForgetIndex();
    type_of_schema_.clear();
    if (Scan(context)) WarnOfMissingIndex(context);
  }

 private:
  McapRecord RecordAt(uint64_t offset) const;
  std::string ContentOf(const McapRecord& record) const;
  bool ReadSummary();
  // Returns whether the file lacks its end.
  bool Scan(const Context& context);
  void ScanRecord(const McapRecord& record, const Context& context);
  // Schemas and channels; others are ignored.
  void AddDefinition(uint8_t kind, std::string_view content);
  // An index may lack the channels of a chunk.
  void AddChunkIndex(std::string_view content);
  void CountMessages(std::string_view statistics);
  std::optional<std::string> ReadChunk(
      const RecordingChunk& chunk) const override;
  void AddMessages(const RecordingChunk& chunk, std::string_view bytes,
                   const Mask& wanted,
                   std::vector<RecordedMessage>* messages) const override;

  std::map<uint16_t, std::string> type_of_schema_;
};

McapRecord McapFile::RecordAt(uint64_t offset) const {
  const std::string prefix = file_.Read(offset, kMcapPrefixSize);
  ByteReader reader(prefix);
  McapRecord record;
  record.kind = reader.Take<uint8_t>();
  record.size = reader.Take<uint64_t>();
  record.offset = offset + kMcapPrefixSize;
  // Beyond any file, so that sums cannot overflow.
  if (record.size > uint64_t{1} << 60) throw BytesError("has a damaged size");
  return record;
}

std::string McapFile::ContentOf(const McapRecord& record) const {
  return file_.Read(record.offset, record.size);
}

void McapFile::AddDefinition(uint8_t kind, std::string_view content) {
  ByteReader reader(content);
  if (kind == kMcapSchema) {
    const auto id = reader.Take<uint16_t>();
    type_of_schema_[id] = reader.TakeText();
  } else if (kind == kMcapChannel) {
    const auto id = reader.Take<uint16_t>();
    const std::string type = type_of_schema_[reader.Take<uint16_t>()];
    const std::string topic = reader.TakeText();
    topic_of_source_[id] = TopicIdx(topic, type, reader.TakeText());
  }
}

void McapFile::AddChunkIndex(std::string_view content) {
  ByteReader reader(content);
  AddTime(static_cast<int64_t>(reader.Take<uint64_t>()));
  AddTime(static_cast<int64_t>(reader.Take<uint64_t>()));
  RecordingChunk chunk;
  chunk.offset = reader.Take<uint64_t>();
  (void)reader.Take<uint64_t>();  // size
  ByteReader channels(reader.TakeSized());
  while (!channels.IsEmpty()) {
    chunk.topic_idxs.insert(TopicOf(channels.Take<uint16_t>()));
    (void)channels.Take<uint64_t>();  // place of the index of messages
  }
  chunks_.push_back(std::move(chunk));
}

void McapFile::CountMessages(std::string_view statistics) {
  ByteReader reader(statistics);
  // Counts of schemas to chunks, first and last time.
  (void)reader.TakeBytes(8 + 2 + 4 + 4 + 4 + 4 + 8 + 8);
  ByteReader counts(reader.TakeSized());
  while (!counts.IsEmpty()) {
    RecordingTopic& topic = topics_[TopicOf(counts.Take<uint16_t>())];
    topic.num_messages += counts.Take<uint64_t>();
  }
}

// Returns false unless there is a summary with an index of chunks and counts.
bool McapFile::ReadSummary() {
  constexpr uint64_t kFooterSize = 20;
  constexpr uint64_t kEndSize = kMcapPrefixSize + kFooterSize + kMcapMagicSize;
  if (file_.size() < kMcapMagicSize + kEndSize) return false;
  bool has_statistics = false;
  try {
    const McapRecord footer = RecordAt(file_.size() - kEndSize);
    if (footer.kind != kMcapFooter || footer.size != kFooterSize) return false;
    uint64_t offset = ByteReader(ContentOf(footer)).Take<uint64_t>();
    if (offset == 0) return false;
    std::vector<McapRecord> later;  // these refer to channels
    while (offset < footer.offset - kMcapPrefixSize) {
      const McapRecord record = RecordAt(offset);
      offset = record.End();
      if (record.kind == kMcapSchema || record.kind == kMcapChannel) {
        AddDefinition(record.kind, ContentOf(record));
      } else {
        later.push_back(record);
      }
    }
    for (const McapRecord& record : later) {
      has_statistics |= record.kind == kMcapStatistics;
      if (record.kind == kMcapChunkIndex) AddChunkIndex(ContentOf(record));
      if (record.kind == kMcapStatistics) CountMessages(ContentOf(record));
    }
  } catch (const BytesError&) {
    return false;
  }
  SortBy(&chunks_, &RecordingChunk::offset);
  const bool has_messages =
      AnyOf(topics_, [](const auto& topic) { return topic.num_messages > 0; });
  return has_statistics && !(has_messages && chunks_.empty());
}

std::optional<std::string> McapFile::ReadChunk(
    const RecordingChunk& chunk) const {
  constexpr uint64_t kMinHeaderSize = 40;
  try {
    McapRecord record = RecordAt(chunk.offset);
    if (chunk.is_message) return ContentOf(record);
    if (record.kind != kMcapChunk) return std::nullopt;
    const bool is_cut = record.End() > file_.size();
    if (is_cut) record.size = file_.size() - record.offset;
    if (record.size < kMinHeaderSize) return std::nullopt;
    const std::string content = ContentOf(record);
    ByteReader reader(content);
    (void)reader.TakeBytes(8 + 8);  // first and last time
    const auto size = reader.Take<uint64_t>();
    const auto checksum = reader.Take<uint32_t>();
    const std::string_view compression = reader.TakeSized();
    CheckCompression(compression, "recording '" + file_.path().string() + "'");
    const auto stored_size = reader.Take<uint64_t>();
    DecompressedBytes bytes = Decompress(
        compression,
        reader.TakeBytes(std::min<uint64_t>(stored_size, reader.NumLeft())),
        size);
    const bool is_intact = bytes.is_complete && bytes.bytes.size() == size &&
                           (checksum == 0 || checksum == Crc32(bytes.bytes));
    if (!is_intact && !is_cut) return std::nullopt;
    return std::move(bytes.bytes);
  } catch (const BytesError&) {
    return std::nullopt;
  }
}

// Calls use(kind, content) for each record that is complete.
template <class Use>
void ForEachMcapRecord(std::string_view bytes, const Use& use) {
  ByteReader reader(bytes);
  try {
    while (!reader.IsEmpty()) {
      const auto kind = reader.Take<uint8_t>();
      use(kind, reader.TakeSized<uint64_t>());
    }
  } catch (const BytesError&) {  // the last record is cut short
  }
}

void McapFile::ScanRecord(const McapRecord& record, const Context& context) {
  RecordingChunk chunk;
  chunk.offset = record.offset - kMcapPrefixSize;
  const auto count = [&](std::string_view message) {
    ByteReader reader(message);
    const int topic = TopicOf(reader.Take<uint16_t>());
    (void)reader.Take<uint32_t>();  // counter
    AddTime(static_cast<int64_t>(reader.Take<uint64_t>()));
    ++topics_[topic].num_messages;
    chunk.topic_idxs.insert(topic);
  };
  if (record.kind == kMcapChunk) {
    const std::optional<std::string> bytes = ReadChunk(chunk);
    if (!bytes) {
      WarnOfChunk(chunk, context);
      return;
    }
    ForEachMcapRecord(*bytes, [&](uint8_t kind, std::string_view content) {
      AddDefinition(kind, content);
      if (kind == kMcapMessage) count(content);
    });
  } else if (record.kind == kMcapMessage && record.End() <= file_.size()) {
    chunk.is_message = true;
    count(file_.Read(record.offset,
                     std::min(record.size, kMcapMessageHeaderSize)));
  } else if (record.kind == kMcapSchema || record.kind == kMcapChannel) {
    AddDefinition(record.kind, ContentOf(record));
  }
  if (!chunk.topic_idxs.empty()) chunks_.push_back(std::move(chunk));
}

bool McapFile::Scan(const Context& context) {
  uint64_t offset = kMcapMagicSize;
  try {
    while (offset < file_.size()) {
      context.ReportProgress("scanning a recording without index", offset,
                             file_.size());
      const McapRecord record = RecordAt(offset);
      if (record.kind == kMcapDataEnd || record.kind == kMcapFooter) {
        return false;
      }
      offset = record.End();
      ScanRecord(record, context);
    }
  } catch (const BytesError&) {  // a record that is cut short ends the scan
  }
  return true;
}

void McapFile::AddMessages(const RecordingChunk& chunk, std::string_view bytes,
                           const Mask& wanted,
                           std::vector<RecordedMessage>* messages) const {
  const auto add = [&](std::string_view content) {
    ByteReader reader(content);
    const int topic = TopicOf(reader.Take<uint16_t>());
    if (!wanted[topic]) return;
    (void)reader.Take<uint32_t>();  // counter
    const auto received_ns = static_cast<int64_t>(reader.Take<uint64_t>());
    (void)reader.Take<uint64_t>();  // when it was sent
    messages->push_back(
        {topic, received_ns, reader.TakeBytes(reader.NumLeft())});
  };
  if (chunk.is_message) {
    add(bytes);
  } else {
    ForEachMcapRecord(bytes, [&](uint8_t kind, std::string_view content) {
      if (kind == kMcapMessage) add(content);
    });
  }
}

}  // namespace

std::unique_ptr<RecordingFile> OpenMcap(const std::filesystem::path& path,
                                        const Context& context) {
  return std::make_unique<McapFile>(path, context);
}

}  // namespace mgsfm
