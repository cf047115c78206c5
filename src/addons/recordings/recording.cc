// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/recording.h"

#include <algorithm>
#include <tuple>

#include "base/file_reading.h"
#include "base/nanoseconds.h"
#include "base/natural_order.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "mgsfm/base/error.h"
#include "recordings/decompression.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

std::unique_ptr<RecordingFile> OpenFile(const fs::path& path,
                                        const Context& context) {
  // As long as the longest of these beginnings.
  constexpr size_t kMagicSize = 16;
  const std::string start =
      ReadFile(path, "recording '" + path.string() + "'", kMagicSize);
  const auto begins = [&](std::string_view magic) {
    return std::string_view(start).substr(0, magic.size()) == magic;
  };
  if (begins("#ROSBAG V2.0\n")) return OpenRos1Bag(path, context);
  if (begins("\x89MCAP0\r\n")) return OpenMcap(path, context);
  if (begins("SQLite format 3")) return OpenSqliteBag(path);
  const std::string subject = "recording '" + path.string() + "' ";
  if (begins("#ROSBAG")) {
    throw Error(subject + "has an old format; convert it with rosbag fix");
  }
  if (HasZstdHeader(start)) {
    throw Error(subject + "is compressed as a whole; run zstd -d on it first");
  }
  throw Error(subject +
              "is neither a ROS 1 bag (.bag), nor MCAP, nor a .db3 file of "
              "rosbag2; give one of these");
}

// The files of a folder that rosbag2 wrote, or of a recording in parts.
std::vector<fs::path> FilesOfFolder(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string extension = ToLower(entry.path().extension().string());
    if (extension == ".bag" || extension == ".mcap" || extension == ".db3") {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end(),
            [](const fs::path& a, const fs::path& b) {
              return IsNaturallyBefore(a.string(), b.string());
            });
  if (files.empty()) {
    throw Error("folder '" + folder.string() +
                "' has no recordings (.bag, .mcap, .db3); give the files of a "
                "recording, or their folder");
  }
  return files;
}

}  // namespace

int RecordingFile::TopicIdx(const std::string& name, std::string type,
                            const std::string& encoding) {
  // ROS 2 says "sensor_msgs/msg/Image".
  const size_t middle = type.find("/msg/");
  if (middle != std::string::npos) type.erase(middle, 4);
  if (type == "tf/tfMessage") type = "tf2_msgs/TFMessage";  // its older name
  auto found =
      std::find_if(topics_.begin(), topics_.end(), [&](const auto& topic) {
        return topic.name == name && topic.type == type &&
               topic.encoding == encoding;
      });
  if (found == topics_.end()) {
    found = topics_.insert(found, {name, type, encoding, 0});
  }
  return static_cast<int>(found - topics_.begin());
}

void RecordingFile::AddTime(int64_t time_ns) {
  if (time_ns <= 0) return;  // of an empty chunk
  first_ns_ = std::min(first_ns_, time_ns);
  last_ns_ = std::max(last_ns_, time_ns);
}

void RecordingFile::WarnOnce(const std::string& text, const Context& context) {
  if (warnings_.insert(text).second) context.Warning(text);
}

int ChunkedRecordingFile::TopicOf(uint32_t source) const {
  const auto found = topic_of_source_.find(source);
  if (found == topic_of_source_.end()) {
    throw BytesError("has messages of an unknown " + source_);
  }
  return found->second;
}

void ChunkedRecordingFile::WarnOfChunk(const RecordingChunk& chunk,
                                       const Context& context) {
  const std::vector<std::string> names =
      Transformed(chunk.topic_idxs,
                  [&](int topic) { return "'" + topics_[topic].name + "'"; });
  std::string text = "recording '" + file_.path().string() +
                     "': the chunk at byte " + std::to_string(chunk.offset) +
                     " is damaged and skipped; copy the file again from where "
                     "it was recorded if you need its messages";
  if (!names.empty()) text += " of " + Joined(names, ", ");
  WarnOnce(text, context);
}

void ChunkedRecordingFile::WarnOfMissingIndex(const Context& context) {
  WarnOnce("recording '" + file_.path().string() +
               "' has no index, as it was not closed or is cut short; it is "
               "read as far as it goes",
           context);
}

void ChunkedRecordingFile::ForgetIndex() {
  topics_.clear();
  topic_of_source_.clear();
  chunks_.clear();
}

void ChunkedRecordingFile::Read(const Mask& wanted, const Context& context,
                                const MessageSink& sink) {
  const auto is_wanted = [&](int topic) { return bool{wanted[topic]}; };
  for (const RecordingChunk& chunk : chunks_) {
    context.ReportProgress("reading " + file_.path().filename().string(),
                           chunk.offset, file_.size());
    const bool is_known = !chunk.topic_idxs.empty();
    if (is_known && !AnyOf(chunk.topic_idxs, is_wanted)) continue;
    const std::optional<std::string> bytes = ReadChunk(chunk);
    if (!bytes) {
      WarnOfChunk(chunk, context);
      continue;
    }
    // The sink is not called within AddMessages(), which ends at damaged
    // records.
    std::vector<RecordedMessage> messages;
    AddMessages(chunk, *bytes, wanted, &messages);
    for (const RecordedMessage& message : messages) sink(message);
  }
}

Recording::Recording(const std::vector<fs::path>& paths,
                     const Context& context) {
  for (const fs::path& path : paths) {
    if (!fs::is_directory(path)) {
      paths_.push_back(path);
      continue;
    }
    const std::vector<fs::path> files = FilesOfFolder(path);
    paths_.insert(paths_.end(), files.begin(), files.end());
  }
  if (paths_.empty()) throw Error("recording_path names no recording");
  first_ns_ = std::numeric_limits<int64_t>::max();
  last_ns_ = std::numeric_limits<int64_t>::min();
  const auto key_of = [](const RecordingTopic& topic) {
    return std::make_tuple(topic.name, topic.type, topic.encoding);
  };
  std::map<std::tuple<std::string, std::string, std::string>, uint64_t> counts;
  for (const fs::path& path : paths_) {
    files_.push_back(OpenFile(path, context));
    first_ns_ = std::min(first_ns_, files_.back()->first_ns());
    last_ns_ = std::max(last_ns_, files_.back()->last_ns());
    for (const RecordingTopic& topic : files_.back()->topics()) {
      counts[key_of(topic)] += topic.num_messages;
    }
  }
  for (const auto& [key, count] : counts) {
    const auto& [name, type, encoding] = key;
    topics_.push_back({name, type, encoding, count});
  }
  for (const auto& file : files_) {
    topic_of_file_.push_back(
        Transformed(file->topics(), [&](const RecordingTopic& topic) {
          return static_cast<int>(
              std::distance(counts.begin(), counts.find(key_of(topic))));
        }));
  }
}

void Recording::Read(const Mask& wanted, const Context& context,
                     const MessageSink& sink) const {
  for (size_t f = 0; f < files_.size(); ++f) {
    const std::vector<int>& topic_of = topic_of_file_[f];
    Mask wanted_of_file(topic_of.size(), false);
    bool is_any_wanted = false;
    for (size_t i = 0; i < topic_of.size(); ++i) {
      wanted_of_file[i] = wanted[topic_of[i]];
      is_any_wanted |= wanted[topic_of[i]];
    }
    if (!is_any_wanted) continue;
    files_[f]->Read(
        wanted_of_file, context, [&](const RecordedMessage& message) {
          sink(
              {topic_of[message.topic_idx], message.received_ns, message.data});
        });
  }
}

std::string Recording::Name() const {
  std::string name = "'" + paths_.front().string() + "'";
  if (paths_.size() == 1) return name;
  return name + " and " + std::to_string(paths_.size() - 1) + " more";
}

std::string Recording::Subject(int topic_idx) const {
  return "topic '" + topics_[topic_idx].name + "' of recording " + Name();
}

double Recording::DurationSeconds() const {
  return last_ns_ <= first_ns_ ? 0.0 : Seconds(last_ns_ - first_ns_);
}

}  // namespace mgsfm
