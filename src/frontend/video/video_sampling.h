// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"

namespace mgsfm {

enum class VideoSampling { kMotion, kRate };

template <>
struct EnumTable<VideoSampling> {
  static constexpr std::pair<std::string_view, VideoSampling> kNames[] = {
      {"motion", VideoSampling::kMotion}, {"rate", VideoSampling::kRate}};
};

// What the time stamps of different videos have in common.
enum class VideoAlignment {
  kTimestamps,    // the clock
  kStart,         // nothing, but all first images are simultaneous
  kCreationTime,  // nothing, but the metadata state when each video began
};

template <>
struct EnumTable<VideoAlignment> {
  static constexpr std::pair<std::string_view, VideoAlignment> kNames[] = {
      {"timestamps", VideoAlignment::kTimestamps},
      {"start", VideoAlignment::kStart},
      {"creation_time", VideoAlignment::kCreationTime}};
};

enum class VideoImageFormat { kJpg, kPng };

template <>
struct EnumTable<VideoImageFormat> {
  static constexpr std::pair<std::string_view, VideoImageFormat> kNames[] = {
      {"jpg", VideoImageFormat::kJpg}, {"png", VideoImageFormat::kPng}};
};

struct VideoSamplingOptions {
  Option<VideoSampling> sampling{
      "sampling", VideoSampling::kMotion,
      "Choose the images to sample. motion: sharp images whose content moved "
      "by min_motion since the last one; none while the camera stands still. "
      "rate: images at a fixed rate."};
  Option<double> min_motion{
      "min_motion", 0.04, Between(0.002, 0.2), "of the larger side",
      "Set the motion of the image content from one sampled image to the next. "
      "Increase it for fewer images."};
  Option<double> rate{
      "rate", 2.0, Between(0.001, 1000.0), "images/s",
      "Sample this many images per second if sampling is rate."};
  Option<VideoAlignment> alignment{
      "alignment", VideoAlignment::kTimestamps,
      "Choose how the clocks of videos relate. timestamps: the time stamps of "
      "all videos have one clock, as if all began at once. start: all first "
      "images are simultaneous. creation_time: the metadata state when each "
      "video began."};
  Option<std::string> time_offsets{
      "time_offsets", "",
      "Add these seconds to the times of the videos, separated by commas, one "
      "number per video."};
  Option<double> max_time_difference_s{
      "max_time_difference_s", 0.0, Between(0.0, 1e6), "s",
      "Pair images of different videos that are at most this far apart. 0: "
      "half of the time between two images of a video."};
  Option<VideoImageFormat> image_format{"image_format", VideoImageFormat::kJpg,
                                        "Write images as jpg or png."};
  Option<int> jpeg_quality{"jpeg_quality", 95, Between(1, 100),
                           "Set the quality of JPEG images; 100 is best."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(sampling, min_motion, rate, alignment, time_offsets,
          max_time_difference_s, image_format, jpeg_quality);
  }
};

struct VideoSamplingSummary {
  size_t num_frames = 0;
  size_t num_written = 0;  // images
  size_t num_present = 0;  // of an earlier run
  double seconds = 0.0;
};

// Extracts images of videos, one video per camera of a rig, to
// output_path/images/VIDEO/TIME.jpg. The images of one frame have the same
// name, the time since the first frame, and differ by at most
// max_time_difference_s. The first video decides which frames are sampled; each
// other video adds the nearest image in time, if there is one.
// output_path/timestamps.txt has the times of all images on the common clock.
//
// Files appear only when complete. A run with the same videos and settings
// continues an interrupted run.
//
// Throws Error, naming the video, if it is damaged from its beginning, has no
// time stamps, or shares no time with the first video. Later damage loses
// images, with a warning.
VideoSamplingSummary SampleVideos(
    const std::vector<std::filesystem::path>& paths,
    const std::filesystem::path& output_path,
    const VideoSamplingOptions& options, const Context& context);

// The paths in a list separated by commas. Throws Error if the list is empty.
std::vector<std::filesystem::path> SplitVideoPaths(const std::string& list);

}  // namespace mgsfm
