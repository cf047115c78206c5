// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "video/video_sampling.h"

namespace mgsfm {

enum class RecordingSampling { kMotion, kRate, kAll };

template <>
struct EnumTable<RecordingSampling> {
  static constexpr std::pair<std::string_view, RecordingSampling> kNames[] = {
      {"motion", RecordingSampling::kMotion},
      {"rate", RecordingSampling::kRate},
      {"all", RecordingSampling::kAll}};
};

enum class GravityAxes { kCamera, kImu };

template <>
struct EnumTable<GravityAxes> {
  static constexpr std::pair<std::string_view, GravityAxes> kNames[] = {
      {"camera", GravityAxes::kCamera}, {"imu", GravityAxes::kImu}};
};

struct RecordingImportOptions {
  Option<std::string> image_topics{
      "image_topics", "",
      "Import the images of these topics, separated by commas; the first one "
      "decides which frames are sampled. By default, all cameras are imported, "
      "without depth images."};
  Option<RecordingSampling> sampling{
      "sampling", RecordingSampling::kMotion,
      "Choose the images to sample. motion: sharp images whose content moved "
      "by min_motion since the last one; none while the camera stands still. "
      "rate: images at a fixed rate. all: every image."};
  Option<double> min_motion{
      "min_motion", 0.04, Between(0.002, 0.2), "of the larger side",
      "Set the motion of the image content from one sampled image to the next. "
      "Increase it for fewer images."};
  Option<double> rate{
      "rate", 2.0, Between(0.001, 1000.0), "images/s",
      "Sample this many images per second if sampling is rate."};
  Option<double> max_time_difference_s{
      "max_time_difference_s", 0.0, Between(0.0, 1e6), "s",
      "Pair images of different cameras that are at most this far apart. 0: "
      "half of the time between two images of a camera."};
  Option<std::string> position_topic{
      "position_topic", "auto",
      "Import the positions of this topic of NavSatFix, Odometry or TFMessage "
      "(/tf). auto: the only topic of NavSatFix, or else of Odometry. none: no "
      "positions."};
  Option<std::string> body_frame{
      "body_frame", "auto",
      "Take the positions of /tf at this frame. auto: the topmost frame that "
      "/tf_static connects with the first camera."};
  Option<std::string> world_frame{
      "world_frame", "auto",
      "Take the positions of /tf in this frame, such as map or odom. auto: the "
      "topmost frame above body_frame."};
  Option<std::string> imu_topic{
      "imu_topic", "auto",
      "Import gravity by this topic of Imu messages: by their orientation, or "
      "else by the mean acceleration. auto: the only topic. none: no gravity."};
  Option<double> gravity_window_s{
      "gravity_window_s", 10.0, Between(0.01, 1000.0), "s",
      "Take the mean acceleration over this time for gravity. Increase it for "
      "vehicles, decrease it for a turning IMU without a gyroscope."};
  Option<GravityAxes> gravity_axes{
      "gravity_axes", GravityAxes::kCamera,
      "Write gravity in the axes of the first camera, by /tf_static, or of the "
      "IMU, for a mapper with body_calibration."};
  Option<VideoImageFormat> image_format{
      "image_format", VideoImageFormat::kPng,
      "Write images as jpg or png. Compressed images are copied as they are."};
  Option<int> jpeg_quality{"jpeg_quality", 95, Between(1, 100),
                           "Set the quality of JPEG images; 100 is best."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(image_topics, sampling, min_motion, rate, max_time_difference_s,
          position_topic, body_frame, world_frame, imu_topic, gravity_window_s,
          gravity_axes, image_format, jpeg_quality);
  }
};

struct RecordingImportSummary {
  size_t num_written = 0;  // images
  size_t num_present = 0;  // of an earlier run
  // The value of frame_max_time_difference_s for the images: as in the options,
  // or half of the time between two images. 0 if frames have equal names.
  double max_time_difference_s = 0.0;
  // In the output folder; empty if the recording has none.
  std::filesystem::path rig_config_path;
  std::filesystem::path positions_path;
  bool positions_are_gps = false;
  std::filesystem::path gravity_path;
  double seconds = 0.0;
};

// Imports ROS 1 bags, and MCAP and .db3 files of ROS 2: one file, several parts
// or files with different topics, or folders of them.
//
// Writes output_path/images/CAMERA/TIME.png, a folder per topic of images. TIME
// is that of the header in seconds or, if headers of the topic have none, that
// of the recorder, with a warning. Files are lossless, or those in compressed
// messages. The first camera decides which frames are sampled; each other one
// adds the nearest image in time, if there is one.
//
// output_path/rig_config.json has the intrinsics of CameraInfo and the poses of
// /tf_static, positions.txt the positions in TUM's format: of the antenna in
// degrees and meters (NavSatFix), or poses of the first camera (Odometry, /tf).
// gravity.txt has lines "SECONDS GX GY GZ" at the times of the first camera.
//
// A run with the same recording and settings of images continues an interrupted
// run.
// Throws Error, naming file, topic and remedy, if a file is damaged from its
// beginning, and if a topic or encoding cannot be read. Damaged chunks and
// messages, and a missing end, lose images with a warning.
RecordingImportSummary ImportRecording(
    const std::vector<std::filesystem::path>& paths,
    const std::filesystem::path& output_path,
    const RecordingImportOptions& options, const Context& context);

// A table of the topics with their types and numbers of messages, after a line
// with the duration. Throws Error as above.
std::string ListTopics(const std::vector<std::filesystem::path>& paths,
                       const Context& context);

}  // namespace mgsfm
