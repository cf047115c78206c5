// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace mgsfm {

// Metadata of the images of a video file; reading it requires no decoding.
struct VideoIndex {
  std::vector<int64_t> times_ns;  // presentation times of all images, ascending
  // Whether the file ends early, or cannot be read beyond these images.
  bool is_cut_off = false;
  // The creation time in the container, usually in whole seconds.
  std::optional<int64_t> creation_time_ns;  // since 1970
};

// Decodes the images of a video in the order of their presentation times.
// Images are upright: the rotation in the metadata is applied.
class VideoDecoder {
 public:
  VideoDecoder() = default;
  virtual ~VideoDecoder() = default;
  VideoDecoder(const VideoDecoder&) = delete;
  VideoDecoder& operator=(const VideoDecoder&) = delete;

  // Returns false at the end. Images that cannot be decoded are skipped.
  virtual bool Next() = 0;

  // The time of the current image. Valid after Next() returned true.
  virtual int64_t TimeNs() const = 0;
  // 8 bits per channel: BGR, or gray for gray videos.
  virtual cv::Mat ReadPixels() const = 0;
  // Gray, scaled down such that no side exceeds `max_size_px`.
  virtual cv::Mat ReadSmallGray(int max_size_px) const = 0;
};

// Both functions throw Error, naming the file and a remedy, if it is missing,
// is not a video or has no time stamps. They read only this file, never the
// network or other files that it refers to.
VideoIndex IndexVideo(const std::filesystem::path& path);
std::unique_ptr<VideoDecoder> OpenVideo(const std::filesystem::path& path,
                                        int num_threads);

}  // namespace mgsfm
