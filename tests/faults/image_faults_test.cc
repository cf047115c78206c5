// SPDX-License-Identifier: BSD-3-Clause
// Commands that write images, and whole reconstructions from images.
#include "faults/fault_sweep.h"
#include "mgsfm/models/model_io.h"
#ifdef MGSFM_HAS_VIDEO
#include "support/test_video.h"
#endif

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Images that were written before the fault are not written again.
TEST_F(FaultTest, Undistort) {
  fs::create_directories(Before());
  Prepare(
      "simulate --output_path sim --rig mono --num_frames 2 "
      "--num_points_per_frame 60");
  for (const ModelImage& image :
       ReadModelPoses(Before() / "sim" / "truth").images) {
    WriteImage(Before() / "images" / image.name, image.id.value());
  }
  Prepare(
      "model_converter --input_path sim/truth --output_path small "
      "--output_type txt");
  // A lens that needs undistortion, and images of 80 x 60 pixels.
  const Camera camera = ReadModel(Before() / "sim" / "truth").cameras.at(0);
  WriteTextFile(Before() / "small" / "cameras.txt",
                std::to_string(camera.id.value()) +
                    " SIMPLE_RADIAL 80 60 60 40 30 0.1\n");
  Sweep({"image_undistorter",
         "image_undistorter --image_path images --input_path small "
         "--output_path out --num_threads 1",
         false, false, 2});
}

TEST_F(FaultTest, SplitPanoramas) {
  fs::create_directories(Before() / "panoramas");
  for (int i = 0; i < 2; ++i) {
    WriteTextFile(Before() / "panoramas" / (std::to_string(i) + ".pgm"),
                  "P5 64 32 255\n" + std::string(64 * 32, 'a'));
  }
  Sweep({"image_splitter",
         "image_splitter --image_path panoramas --output_path out "
         "--max_image_size 16 --num_threads 1",
         false, false, 2});
}

TEST_F(FaultTest, Render) {
  fs::create_directories(Before());
  Sweep({"simulate_images",
         "simulate --output_path out --preset street --render --rig mono "
         "--num_frames 3 --render_scale 0.05 --render_samples 1 "
         "--num_threads 1",
         true, false, kFewRuns});
}

TEST_F(FaultTest, Reconstruct) {
  fs::create_directories(Before());
  Prepare(
      "simulate --output_path sim --preset street --render --rig mono "
      "--num_frames 3 --render_scale 0.2 --render_samples 1");
  Sweep({"automatic_reconstructor",
         "automatic_reconstructor --image_path sim/images --workspace_path w "
         "--write_report 0 --num_threads 1",
         false, false, kFewRuns, "", "w/database.db"});
}

#ifdef MGSFM_HAS_VIDEO
TEST_F(FaultTest, SampleVideos) {
  fs::create_directories(Before());
  TestVideo video;
  video.codec = "mjpeg";
  for (int i = 0; i < 4; ++i) {
    video.images.emplace_back(48, 64, CV_8U, cv::Scalar(50 * i));
    video.times_ms.push_back(100 * int64_t{i});
  }
  for (const char* name : {"left.mp4", "right.mp4"}) {
    WriteTestVideo((Before() / name).string(), video);
  }
  Sweep({"video_sampler",
         "video_sampler --video_path left.mp4 right.mp4 --output_path out "
         "--sampling rate --rate 10 --num_threads 1",
         false, false, 2});
}
#endif

}  // namespace
}  // namespace mgsfm
