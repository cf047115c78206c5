// SPDX-License-Identifier: BSD-3-Clause
// From videos of a rig to its model.
#include <filesystem>
#include <opencv2/imgcodecs.hpp>

#include "cli/program_runs.h"
#include "cli/rendered_drives.h"
#include "support/temp_dir.h"
#include "support/test_video.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

class VideoCommands : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  // The first frames of a camera of data/rendered_rig, ten per second.
  void WriteVideo(const std::string& camera, int num_frames) const {
    TestVideo video;
    video.codec = "mjpeg";
    for (int i = 0; i < num_frames; ++i) {
      const std::string digits = std::to_string(100000 + i).substr(1);
      video.images.push_back(
          cv::imread(kData + "/images/" + camera + "/0" + digits + ".jpg",
                     cv::IMREAD_GRAYSCALE));
      video.times_ms.push_back(100 * int64_t{i});
    }
    WriteTestVideo(Path(camera + ".mp4"), video);
  }
  std::string Videos() const {
    return " --video_path " + Path("front_left.mp4") + " " +
           Path("front_right.mp4");
  }

  const std::string kData = MGSFM_SOURCE_DIR "/data/rendered_rig";
  TempDir dir_;
};

TEST_F(VideoCommands, VideosBecomeAnAccurateModel) {
  WriteVideo("front_left", 8);
  WriteVideo("front_right", 8);
  const std::string line = "automatic_reconstructor --workspace_path " +
                           Path("work") + Videos() +
                           " --Video.sampling rate --Video.rate 10 "
                           "--ImageReader.camera_params_path " +
                           kData + "/cameras.txt";
  const CommandOutput run = RunMgsfm(line);
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("extracted 16 images of 8 frames"));
  EXPECT_THAT(run.err, HasSubstr("1 rigs, 8 frames, 16 images"));
  for (const std::string camera : {"front_left/", "front_right/"}) {
    ExpectSamePath(PosesBelow(camera, Path("work/sparse/0")),
                   PosesBelow(camera, kData + "/truth"), 0.03, 0.2);
  }
}

TEST_F(VideoCommands, SamplerContinues) {
  WriteVideo("front_left", 3);
  WriteVideo("front_right", 3);
  const std::string line = "video_sampler --sampling rate --rate 10" +
                           Videos() + " --output_path " + Path("out");
  const CommandOutput first = RunMgsfm(line);
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_TRUE(
      std::filesystem::exists(Path("out/images/front_right/000000.200.jpg")));
  std::filesystem::remove(Path("out/images/front_right/000000.200.jpg"));
  const CommandOutput again = RunMgsfm(line);
  EXPECT_THAT(again.err, HasSubstr("extracted 1 images of 3 frames"));
  EXPECT_THAT(again.err, HasSubstr("5 were already there"));
}

TEST_F(VideoCommands, BadUseIsNamed) {
  const std::string line =
      "automatic_reconstructor --workspace_path " + Path("work");
  const CommandOutput none = RunMgsfm(line);
  EXPECT_EQ(none.exit_code, 1);
  EXPECT_THAT(LastWord(none), HasSubstr("image_path"));
  const CommandOutput both =
      RunMgsfm(line + " --image_path " + kData + "/images --video_path a.mp4");
  EXPECT_EQ(both.exit_code, 1);
  EXPECT_THAT(LastWord(both), HasSubstr("only one of"));
  const CommandOutput missing = RunMgsfm(line + " --video_path a.mp4 b.mp4");
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_THAT(LastWord(missing), HasSubstr("a.mp4"));
  EXPECT_FALSE(std::filesystem::exists(Path("work")));
}

}  // namespace
}  // namespace mgsfm
