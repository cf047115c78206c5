// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "video_run.h"

namespace mgsfm {
namespace {

struct VideoSamplerOptions {
  Option<std::string> video_path{
      "video_path", "", Required(),
      "Sample these videos, one per camera of the rig, separated by blanks or "
      "commas. The first one decides which frames are sampled."};
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write images/VIDEO/TIME.jpg and timestamps.txt into this folder. Images "
      "of an interrupted run with the same settings are kept."};
  VideoSamplingOptions sampling;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(video_path, output_path, sampling);
  }
};

int RunVideoSampler(const VideoSamplerOptions& options,
                    const Context& context) {
  SampleVideosInto(*options.output_path, options.video_path, options.sampling,
                   context);
  return kExitSuccess;
}

}  // namespace

Command VideoSamplerCommand() {
  return MakeResumableCommand(
      "video_sampler",
      "Extracts images of videos, one video per camera of a rig.",
      RunVideoSampler);
}

}  // namespace mgsfm
