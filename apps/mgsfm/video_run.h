// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "mgsfm/base/context.h"
#include "video/video_sampling.h"

namespace mgsfm {

// SampleVideos for a list of videos, which commas separate; logs the result.
void SampleVideosInto(const std::filesystem::path& output_path,
                      const std::string& video_paths,
                      const VideoSamplingOptions& options,
                      const Context& context);

}  // namespace mgsfm
