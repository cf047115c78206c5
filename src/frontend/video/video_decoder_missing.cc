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

VideoIndex IndexVideo(const std::filesystem::path& path) { Throw(path); }
std::unique_ptr<VideoDecoder> OpenVideo(const std::filesystem::path& path,
                                        int /*num_threads*/) {
  Throw(path);
}

}  // namespace mgsfm
