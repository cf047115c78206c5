// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/recording_import.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/file_reading.h"
#include "base/format.h"
#include "base/grouped_warnings.h"
#include "base/nanoseconds.h"
#include "base/parallel.h"
#include "base/ranges.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "files/file_operations.h"
#include "imaging/image_run.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/options_io.h"
#include "mgsfm/base/timer.h"
#include "recordings/byte_reader.h"
#include "recordings/image_messages.h"
#include "recordings/recorded_priors.h"
#include "recordings/recording.h"
#include "recordings/recording_cameras.h"
#include "video/motion_sampler.h"
#include "video/sampling_plan.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// As for videos: sharpness needs more pixels than motion; even larger images
// add nothing.
constexpr int kMotionImageSize_px = 640;

// The images of a camera.
struct CameraImages {
  // Per message in the order of the recording; nullopt if it is damaged.
  struct Message {
    int64_t stamp_ns = 0;
    int64_t received_ns = 0;
  };
  std::vector<std::optional<Message>> messages;
  // By time, without repeated times.
  std::vector<int64_t> times_ns;
  std::vector<size_t> message_of_time;
  // The names, without folder and extension, of the messages to write.
  std::map<size_t, std::string> name_of_message;
};

class RecordingImport {
 public:
  RecordingImport(const Recording& recording,
                  const RecordingImportOptions& options, const Context& context)
      : recording_(recording),
        options_(options),
        context_(context),
        cameras_(ChooseCameras(recording, options.image_topics, context)),
        images_(cameras_.size()),
        priors_(recording, options, context),
        camera_of_topic_(recording.topics().size(), -1) {
    for (size_t c = 0; c < cameras_.size(); ++c) {
      camera_of_topic_[cameras_[c].topic_idx] = static_cast<int>(c);
    }
  }

  RecordingImportSummary Run(const fs::path& output_path);

 private:
  const RecordingTopic& Topic(int topic_idx) const {
    return recording_.topics()[topic_idx];
  }
  std::string Settings() const;

  // Headers of images, and all other messages.
  void ReadMessages();
  void TakeMessage(const RecordedMessage& message);
  void TakeImage(const RecordedMessage& message);
  void SetTimes(size_t camera_idx);
  double MaxDifferenceSeconds() const;

  void SelectImages();
  std::vector<int> SelectLeading();
  std::vector<int> SelectByMotion();
  void SelectNearest(size_t camera_idx,
                     const std::vector<int64_t>& instants_ns);
  void Select(size_t camera_idx, const std::vector<int>& selected);

  void WriteTasks(std::vector<ImageMessageTask>* tasks,
                  RecordingImportSummary* summary);
  void WriteImages(const fs::path& folder, RecordingImportSummary* summary);
  void WarnOfDamage(int topic_idx, const std::string& problem) {
    warnings_.Add(recording_.Subject(topic_idx) +
                  " has a damaged message, which " + problem +
                  "; it is skipped");
  }

  const Recording& recording_;
  const RecordingImportOptions& options_;
  const Context& context_;
  std::vector<RecordedCamera> cameras_;
  std::vector<CameraImages> images_;
  RecordedPriors priors_;
  std::vector<int> camera_of_topic_;
  FrameTree frames_;
  GroupedWarnings warnings_;
};

// -------------------------------------------------------------------- settings

std::string RecordingImport::Settings() const {
  nlohmann::ordered_json files = nlohmann::ordered_json::array();
  for (const fs::path& path : recording_.paths()) {
    files.push_back(
        {{"path", fs::weakly_canonical(fs::absolute(path)).string()},
         {"size", fs::file_size(path)}});
  }
  auto options = nlohmann::ordered_json::parse(OptionsToJsonOf(options_));
  // Positions and gravity are read again; earlier versions wrote their topic.
  options["position_topic"] = "auto";
  for (const char* name : {"body_frame", "world_frame", "imu_topic",
                           "gravity_window_s", "gravity_axes"}) {
    options.erase(name);
  }
  const nlohmann::ordered_json settings = {{"recording", std::move(files)},
                                           {"options", std::move(options)}};
  return settings.dump(1) + "\n";
}

// --------------------------------------------------------------------- reading

void RecordingImport::TakeImage(const RecordedMessage& message) {
  const auto camera_idx =
      static_cast<size_t>(camera_of_topic_[message.topic_idx]);
  RecordedCamera& camera = cameras_[camera_idx];
  const RecordingTopic& topic = Topic(message.topic_idx);
  std::optional<CameraImages::Message>& taken =
      images_[camera_idx].messages.emplace_back();
  const MessageHeader header = ReadMessageHeader(message.data, topic.encoding);
  if (camera.size_px.width == 0) {
    // An unknown encoding is known before anything is written.
    camera.size_px = SizeOfImage(topic, message.data);
    camera.frame_id = header.frame_id;
  }
  taken = {header.stamp_ns, message.received_ns};
}

void RecordingImport::TakeMessage(const RecordedMessage& message) {
  const RecordingTopic& topic = Topic(message.topic_idx);
  if (camera_of_topic_[message.topic_idx] >= 0) {
    TakeImage(message);
  } else if (priors_.Have(message.topic_idx)) {
    priors_.Take(message);
  } else if (topic.type == "tf2_msgs/TFMessage") {
    for (const TransformMessage& transform :
         ReadTransformMessages(message.data, topic.encoding)) {
      frames_.Add(transform.parent, transform.child,
                  transform.parent_from_child);
    }
  } else {
    for (RecordedCamera& camera : cameras_) {
      // Drivers send zeros until they have read the calibration.
      const bool is_known = camera.info && camera.info->K[0] != 0.0;
      if (camera.info_topic_idx == message.topic_idx && !is_known) {
        camera.info = ReadCameraInfoMessage(message.data, topic.encoding);
      }
    }
  }
}

void RecordingImport::ReadMessages() {
  const std::vector<RecordingTopic>& topics = recording_.topics();
  Mask wanted(topics.size(), false);
  for (const RecordedCamera& camera : cameras_) {
    wanted[camera.topic_idx] = true;
    if (camera.info_topic_idx >= 0) wanted[camera.info_topic_idx] = true;
  }
  for (size_t i = 0; i < topics.size(); ++i) {
    const bool has_frames = topics[i].name == "/tf_static" &&
                            topics[i].IsReadable() &&
                            topics[i].type == "tf2_msgs/TFMessage";
    if (has_frames || priors_.Have(static_cast<int>(i))) wanted[i] = true;
  }
  recording_.Read(wanted, context_, [&](const RecordedMessage& message) {
    try {
      TakeMessage(message);
    } catch (const BytesError& error) {
      WarnOfDamage(message.topic_idx, error.what());
    } catch (const Error& error) {
      throw Error(recording_.Subject(message.topic_idx) + " " + error.what());
    }
  });
}

void RecordingImport::SetTimes(size_t camera_idx) {
  CameraImages& images = images_[camera_idx];
  const int topic_idx = cameras_[camera_idx].topic_idx;
  size_t num_images = 0, num_unset = 0;
  for (const auto& message : images.messages) {
    if (!message) continue;
    ++num_images;
    num_unset += message->stamp_ns == 0 ? 1 : 0;
  }
  if (num_images == 0) {
    throw Error(recording_.Subject(topic_idx) +
                " has no image that can be read; choose others with "
                "image_topics");
  }
  if (num_unset > 0) {
    context_.Warning(recording_.Subject(topic_idx) + ": the headers of " +
                     std::to_string(num_unset) + " of " +
                     std::to_string(num_images) +
                     " images have no time; the times at which they were "
                     "received are used for all");
  }
  std::map<int64_t, size_t> message_of_time;
  for (size_t i = 0; i < images.messages.size(); ++i) {
    const auto& message = images.messages[i];
    if (!message) continue;
    message_of_time.emplace(
        num_unset > 0 ? message->received_ns : message->stamp_ns, i);
  }
  for (const auto& [time_ns, i] : message_of_time) {
    images.times_ns.push_back(time_ns);
    images.message_of_time.push_back(i);
  }
  if (message_of_time.size() == num_images) return;
  context_.Warning(recording_.Subject(topic_idx) + ": " +
                   std::to_string(num_images - message_of_time.size()) +
                   " images have the time of an earlier one and are skipped");
}

// ------------------------------------------------------------------- selection

double RecordingImport::MaxDifferenceSeconds() const {
  if (options_.max_time_difference_s > 0.0) {
    return options_.max_time_difference_s;
  }
  int64_t interval_ns = 0;
  for (const CameraImages& images : images_) {
    interval_ns =
        std::max(interval_ns, MedianInterval(images.times_ns).value_or(0));
  }
  return Seconds(interval_ns) / 2.0;
}

std::vector<int> RecordingImport::SelectByMotion() {
  const int topic_idx = cameras_.front().topic_idx;
  CameraImages& images = images_.front();
  std::map<size_t, int> idx_of_message;
  for (size_t i = 0; i < images.message_of_time.size(); ++i) {
    idx_of_message[images.message_of_time[i]] = static_cast<int>(i);
  }
  MotionSampler sampler(options_.min_motion);
  Mask wanted(recording_.topics().size(), false);
  wanted[topic_idx] = true;
  size_t message_idx = 0;
  int last_idx = -1;
  const QuietImageLibraries quiet;
  recording_.Read(wanted, context_, [&](const RecordedMessage& message) {
    const auto found = idx_of_message.find(message_idx++);
    // Images that arrive late are no candidates.
    if (found == idx_of_message.end() || found->second <= last_idx) return;
    try {
      const cv::Mat gray =
          SmallGrayOf(Topic(topic_idx), message.data, kMotionImageSize_px);
      last_idx = found->second;
      sampler.Add(last_idx, gray);
    } catch (const BytesError& error) {
      WarnOfDamage(topic_idx, error.what());
    } catch (const Error& error) {
      throw Error(recording_.Subject(topic_idx) + " " + error.what());
    }
  });
  return sampler.Finish();
}

std::vector<int> RecordingImport::SelectLeading() {
  const std::vector<int64_t>& times_ns = images_.front().times_ns;
  if (options_.sampling == RecordingSampling::kRate) {
    return SelectByRate(times_ns, options_.rate);
  }
  std::vector<int> selected = SelectByMotion();
  if (!selected.empty()) return selected;
  throw Error(recording_.Subject(cameras_.front().topic_idx) +
              " has no image that can be decoded; choose others with "
              "image_topics");
}

void RecordingImport::Select(size_t camera_idx,
                             const std::vector<int>& selected) {
  CameraImages& images = images_[camera_idx];
  for (const int idx : selected) {
    images.name_of_message[images.message_of_time[idx]] =
        TimeText(images.times_ns[idx]);
  }
  context_.Info("'" + cameras_[camera_idx].folder + "' (" +
                Topic(cameras_[camera_idx].topic_idx).name +
                "): " + std::to_string(selected.size()) + " of " +
                std::to_string(images.times_ns.size()) + " images");
}

void RecordingImport::SelectNearest(size_t camera_idx,
                                    const std::vector<int64_t>& instants_ns) {
  const std::vector<int64_t>& times_ns = images_[camera_idx].times_ns;
  std::vector<int> selected;
  for (const std::optional<int>& idx :
       SelectAtInstants(instants_ns, times_ns,
                        std::llround(MaxDifferenceSeconds() * kNsPerSecond))) {
    if (idx) selected.push_back(*idx);
  }
  if (selected.empty()) {
    throw Error(recording_.Subject(cameras_[camera_idx].topic_idx) + " (" +
                TimeText(times_ns.front()) + " s to " +
                TimeText(times_ns.back()) +
                " s) has no image at the times of '" +
                Topic(cameras_.front().topic_idx).name + "' (" +
                TimeText(instants_ns.front()) + " s to " +
                TimeText(instants_ns.back()) +
                " s); set max_time_difference_s, or choose others with "
                "image_topics");
  }
  Select(camera_idx, selected);
}

void RecordingImport::SelectImages() {
  if (options_.sampling == RecordingSampling::kAll) {
    for (size_t c = 0; c < cameras_.size(); ++c) {
      Select(c, Indices(images_[c].times_ns.size()));
    }
    return;
  }
  const std::vector<int> leading = SelectLeading();
  const std::vector<int64_t> instants_ns = Transformed(
      leading, [&](int idx) { return images_.front().times_ns[idx]; });
  Select(0, leading);
  for (size_t c = 1; c < cameras_.size(); ++c) SelectNearest(c, instants_ns);
}

// --------------------------------------------------------------------- writing

void RecordingImport::WriteTasks(std::vector<ImageMessageTask>* tasks,
                                 RecordingImportSummary* summary) {
  ParallelFor(
      tasks->size(), context_.num_threads,
      [&](size_t i) {
        ImageMessageTask& task = (*tasks)[i];
        try {
          WriteImageMessage(Topic(task.topic_idx), options_, &task);
        } catch (const Error& error) {
          throw Error(recording_.Subject(task.topic_idx) + " " + error.what());
        }
      },
      1);
  for (const ImageMessageTask& task : *tasks) {
    if (!task.problem.empty()) {
      WarnOfDamage(task.topic_idx, task.problem);
    } else {
      ++(task.was_present ? summary->num_present : summary->num_written);
    }
  }
  tasks->clear();
}

void RecordingImport::WriteImages(const fs::path& folder,
                                  RecordingImportSummary* summary) {
  Mask wanted(recording_.topics().size(), false);
  for (const RecordedCamera& camera : cameras_) {
    wanted[camera.topic_idx] = true;
    fs::create_directories(folder / camera.folder);
  }
  const auto max_num_tasks =
      2 * static_cast<size_t>(ResolveNumThreads(context_.num_threads));
  std::vector<ImageMessageTask> tasks;
  std::vector<size_t> next_message(cameras_.size(), 0);
  recording_.Read(wanted, context_, [&](const RecordedMessage& message) {
    const int camera_idx = camera_of_topic_[message.topic_idx];
    const auto& names = images_[camera_idx].name_of_message;
    const auto found = names.find(next_message[camera_idx]++);
    if (found == names.end()) return;
    tasks.emplace_back();
    tasks.back().topic_idx = message.topic_idx;
    tasks.back().path = folder / cameras_[camera_idx].folder / found->second;
    tasks.back().message = message.data;
    if (tasks.size() >= max_num_tasks) WriteTasks(&tasks, summary);
  });
  WriteTasks(&tasks, summary);
  FileOperations operations;
  for (const RecordedCamera& camera : cameras_) {
    operations.Sync(folder / camera.folder);
  }
  operations.Sync(folder);
}

RecordingImportSummary RecordingImport::Run(const fs::path& output_path) {
  RecordingImportSummary summary;
  ReadMessages();
  for (size_t c = 0; c < cameras_.size(); ++c) SetTimes(c);
  priors_.Finish(cameras_.front(), frames_);
  SelectImages();
  ContinueOrBegin(output_path, Settings(), "recording_import.json");
  WriteImages(output_path / "images", &summary);
  warnings_.Log(context_);
  if (summary.num_written + summary.num_present == 0) {
    throw Error("recording " + recording_.Name() +
                " has no image that can be decoded; choose other topics with "
                "image_topics");
  }
  const bool has_same_times = AllOf(images_, [&](const auto& images) {
    return images.times_ns == images_.front().times_ns;
  });
  if (!has_same_times) summary.max_time_difference_s = MaxDifferenceSeconds();
  // A file of an earlier run with other options does not remain. All of them
  // begin with the names of their columns.
  const auto write = [&](const char* name, const std::string& text) {
    fs::path path = output_path / name;
    if (!text.empty()) {
      ReplaceFile(path, text);
      return path;
    }
    if (fs::exists(path) && ReadFile(path).rfind("# SECONDS ", 0) == 0) {
      fs::remove(path);
    }
    return fs::path();
  };
  const auto rig =
      MakeRecordedRig(cameras_, frames_, recording_.topics(), context_);
  const RecordedCamera& first = cameras_.front();
  if (rig) {
    summary.rig_config_path =
        write("rig_config.json", RigConfigsToJson({*rig}));
  }
  summary.positions_path =
      write("positions.txt", priors_.PositionLines(first, frames_));
  summary.positions_are_gps = priors_.PositionsAreGps();
  summary.gravity_path =
      write("gravity.txt",
            priors_.GravityLines(first, frames_, images_.front().times_ns));
  return summary;
}

}  // namespace

RecordingImportSummary ImportRecording(const std::vector<fs::path>& paths,
                                       const fs::path& output_path,
                                       const RecordingImportOptions& options,
                                       const Context& context) {
  const Timer timer;
  const Recording recording(paths, context);
  RecordingImportSummary summary =
      RecordingImport(recording, options, context).Run(output_path);
  summary.seconds = timer.Seconds();
  return summary;
}

std::string ListTopics(const std::vector<fs::path>& paths,
                       const Context& context) {
  const Recording recording(paths, context);
  size_t type_width = 0;
  for (const RecordingTopic& topic : recording.topics()) {
    type_width = std::max(type_width, topic.type.size());
  }
  const double duration_s = recording.DurationSeconds();
  std::string text =
      recording.Name() + ": " + Formatted("%.3f s", duration_s) +
      (duration_s > 0.0 ? " from " + TimeText(recording.first_ns()) + " s"
                        : "") +
      ", " + std::to_string(recording.topics().size()) +
      " topics\n  messages      Hz  " + "type" +
      std::string(std::max<size_t>(type_width, 4) - 4, ' ') + "  topic\n";
  for (const RecordingTopic& topic : recording.topics()) {
    const auto count = static_cast<double>(topic.num_messages);
    const std::string rate =
        duration_s > 0.0 ? Formatted("%8.2f", count / duration_s) : "       -";
    text += Formatted("%10.0f", count) + rate + "  " + Printable(topic.type) +
            std::string(type_width - topic.type.size(), ' ') + "  " +
            Printable(topic.name);
    text += topic.IsReadable()
                ? "\n"
                : " (" + Printable(topic.encoding) + ", cannot be imported)\n";
  }
  return text;
}

}  // namespace mgsfm
