// SPDX-License-Identifier: BSD-3-Clause
// The build without libav.
#include "mgsfm/base/error.h"
#include "video/video_decoder.h"

namespace mgsfm {
namespace {

[[noreturn]] void Throw(const std::filesystem::path& path) {
  throw Error("'" + path.string() +
              "' is a video, but this build cannot read videos; install "
              "libavformat-dev, libavcodec-dev and libswscale-dev and build "
              "again");
}

}  // namespace

class VideoDecoder::Impl {};

VideoIndex IndexVideo(const std::filesystem::path& path) { Throw(path); }

VideoDecoder::VideoDecoder(const std::filesystem::path& path,
                           int /*num_threads*/) {
  Throw(path);
}
VideoDecoder::~VideoDecoder() = default;

bool VideoDecoder::Next() { return false; }
int64_t VideoDecoder::TimeNs() const { return 0; }
cv::Mat VideoDecoder::ReadPixels() const { return {}; }
cv::Mat VideoDecoder::ReadSmallGray(int /*max_size_px*/) const { return {}; }

}  // namespace mgsfm
