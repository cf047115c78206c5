// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace mgsfm {

// Metadata of the images of a video file, which need no decoding.
struct VideoIndex {
  std::vector<int64_t> times_ns;  // presentation times of all images, ascending
  // The file ends early, or cannot be read beyond these images.
  bool is_cut_off = false;
  // The creation time in the container, usually in whole seconds.
  std::optional<int64_t> creation_time_ns;  // since 1970
};

// Throws Error, naming the file and a remedy, if it is missing, is no video or
// has no time stamps. Only the file itself is read, never others or the
// network, whatever it refers to.
VideoIndex IndexVideo(const std::filesystem::path& path);

// Decodes the images of a video in the order of their presentation times.
// Images are upright: the rotation in the metadata is applied.
class VideoDecoder {
 public:
  // Throws like IndexVideo.
  VideoDecoder(const std::filesystem::path& path, int num_threads);
  ~VideoDecoder();
  VideoDecoder(const VideoDecoder&) = delete;
  VideoDecoder& operator=(const VideoDecoder&) = delete;

  // Returns false at the end. Images that cannot be decoded are skipped.
  bool Next();

  // The time of the current image. Valid after Next() returned true.
  int64_t TimeNs() const;
  // 8 bits per channel; BGR, or grey if the video is.
  cv::Mat ReadPixels() const;
  // Gray, scaled down such that no side exceeds `max_size_px`.
  cv::Mat ReadSmallGray(int max_size_px) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mgsfm
