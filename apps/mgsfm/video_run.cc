// SPDX-License-Identifier: BSD-3-Clause
#include "video_run.h"

#include "base/format.h"

namespace mgsfm {

void SampleVideosInto(const std::filesystem::path& output_path,
                      const std::string& video_paths,
                      const VideoSamplingOptions& options,
                      const Context& context) {
  const VideoSamplingSummary summary =
      SampleVideos(SplitVideoPaths(video_paths), output_path, options, context);
  const std::string seconds = Formatted("%.1f s", summary.seconds);
  context.Info("extracted " + std::to_string(summary.num_written) +
               " images of " + std::to_string(summary.num_frames) +
               " frames in " + seconds + "; " +
               std::to_string(summary.num_present) + " were already there");
  context.Info("images are in " + (output_path / "images").string() +
               ", their times in " + (output_path / "timestamps.txt").string());
}

}  // namespace mgsfm
