// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "recordings/byte_reader.h"
#include "recordings/ros_messages.h"

namespace mgsfm {

struct RecordingTopic {
  std::string name;
  std::string type;      // "sensor_msgs/Image", also for ROS 2
  std::string encoding;  // "ros1", "cdr", or one that cannot be read
  uint64_t num_messages = 0;

  bool IsReadable() const { return encoding == "ros1" || encoding == "cdr"; }
};

struct RecordedMessage {
  int topic_idx = 0;
  int64_t received_ns = 0;  // when the recorder got it
  std::string_view data;    // valid during the call
};

using MessageSink = std::function<void(const RecordedMessage&)>;

// One file of a recording. Opening it reads the index only; files that were not
// closed have none and are scanned.
class RecordingFile {
 public:
  RecordingFile() = default;
  virtual ~RecordingFile() = default;
  RecordingFile(const RecordingFile&) = delete;
  RecordingFile& operator=(const RecordingFile&) = delete;

  // Calls `sink` with the messages of the topics in the mask, in the order of
  // the file; chunks without such messages are skipped. Damaged chunks are
  // skipped with a warning.
  virtual void Read(const Mask& wanted, const Context& context,
                    const MessageSink& sink) = 0;

  const std::vector<RecordingTopic>& topics() const { return topics_; }
  int64_t first_ns() const { return first_ns_; }
  int64_t last_ns() const { return last_ns_; }

 protected:
  // The topic with this name, type and encoding; added if missing.
  int TopicIdx(const std::string& name, std::string type,
               const std::string& encoding);
  void AddTime(int64_t time_ns);
  // A file is read several times, but warned of once.
  void WarnOnce(const std::string& text, const Context& context);

  std::vector<RecordingTopic> topics_;
  int64_t first_ns_ = std::numeric_limits<int64_t>::max();
  int64_t last_ns_ = std::numeric_limits<int64_t>::min();

 private:
  std::set<std::string> warnings_;
};

// All functions throw Error, naming the file and a remedy, if it is not what
// the name of the function says, or is damaged from its beginning.
//
// ROS 1 bags, version 2.0 (https://wiki.ros.org/Bags/Format/2.0).
std::unique_ptr<RecordingFile> OpenRos1Bag(const std::filesystem::path& path,
                                           const Context& context);
// MCAP (https://mcap.dev/spec).
std::unique_ptr<RecordingFile> OpenMcap(const std::filesystem::path& path,
                                        const Context& context);
// The SQLite storage of rosbag2, uncompressed or with compressed messages.
std::unique_ptr<RecordingFile> OpenSqliteBag(const std::filesystem::path& path);

// A chunk of a file, or a message that is in none.
struct RecordingChunk {
  uint64_t offset = 0;
  std::set<int> topic_idxs;  // of its messages; empty: unknown
  bool is_message = false;
};

// A file whose messages are in chunks.
class ChunkedRecordingFile : public RecordingFile {
 public:
  void Read(const Mask& wanted, const Context& context,
            const MessageSink& sink) override;

 protected:
  // `source` is what a message names instead of its topic: "channel".
  ChunkedRecordingFile(const std::filesystem::path& path, std::string source)
      : file_(path), source_(std::move(source)) {}

  // The records in a chunk; nullopt, or those before the end of the file, if
  // it is damaged.
  virtual std::optional<std::string> ReadChunk(
      const RecordingChunk& chunk) const = 0;
  // Appends the messages of wanted topics.
  virtual void AddMessages(const RecordingChunk& chunk, std::string_view bytes,
                           const Mask& wanted,
                           std::vector<RecordedMessage>* messages) const = 0;
  int TopicOf(uint32_t source) const;
  void WarnOfChunk(const RecordingChunk& chunk, const Context& context);
  void WarnOfMissingIndex(const Context& context);
  void ForgetIndex();

  const RandomAccessFile file_;
  std::map<uint32_t, int> topic_of_source_;
  std::vector<RecordingChunk> chunks_;  // by place in the file

 private:
  const std::string source_;
};

// One or several files with one set of topics.
class Recording {
 public:
  // Opens files, or the files in folders. The first bytes of a file show its
  // format. Throws Error as above, and if there is no file.
  Recording(const std::vector<std::filesystem::path>& paths,
            const Context& context);

  // Sorted by name.
  const std::vector<RecordingTopic>& topics() const { return topics_; }
  // Messages of all files, one after the other.
  void Read(const Mask& wanted, const Context& context,
            const MessageSink& sink) const;
  const std::vector<std::filesystem::path>& paths() const { return paths_; }
  // "'a.bag'", or "'a.bag' and 2 others".
  std::string Name() const;
  // From the first to the last message; 0 without messages.
  double DurationSeconds() const;
  // "topic '/fix' of recording 'a.bag'".
  std::string Subject(int topic_idx) const;
  int64_t first_ns() const { return first_ns_; }

 private:
  std::vector<std::filesystem::path> paths_;
  std::vector<std::unique_ptr<RecordingFile>> files_;
  std::vector<RecordingTopic> topics_;
  std::vector<std::vector<int>> topic_of_file_;  // file, its topic: topic
  int64_t first_ns_ = 0;
  int64_t last_ns_ = 0;
};

}  // namespace mgsfm
