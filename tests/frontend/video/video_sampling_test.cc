// SPDX-License-Identifier: BSD-3-Clause
// Tiny videos, encoded here, whose images are known pixel by pixel.
#include "video/video_sampling.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "mgsfm/base/error.h"
#include "support/temp_dir.h"
#include "support/test_video.h"
#include "video/video_decoder.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

cv::Mat RandomImage(int seed, int width_px = 64, int height_px = 48) {
  cv::Mat image(height_px, width_px, CV_8U);
  cv::theRNG().state = static_cast<uint64_t>(seed) + 1;
  cv::randu(image, 0, 256);
  cv::GaussianBlur(image, image, cv::Size(), 1.0);
  return image;
}

// One image every 100 ms; image i has the seed `seed` + i.
TestVideo RandomVideo(int num_images, int seed, int64_t start_ms = 0) {
  TestVideo video;
  for (int i = 0; i < num_images; ++i) {
    video.images.push_back(RandomImage(seed + i));
    video.times_ms.push_back(start_ms + 100 * int64_t{i});
  }
  return video;
}

class VideoSamplingTest : public testing::Test {
 protected:
  VideoSamplingTest() {
    options_.sampling = VideoSampling::kRate;
    options_.rate = 10.0;
    options_.image_format = VideoImageFormat::kPng;
    context_.log = [this](LogLevel level, const std::string& text) {
      (level == LogLevel::kWarning ? warnings_ : infos_) += text + "\n";
    };
  }
  fs::path Path(const std::string& name) const { return dir_.path() / name; }
  void Write(const std::string& name, const TestVideo& video) const {
    fs::create_directories(Path(name).parent_path());
    WriteTestVideo(Path(name).string(), video);
  }
  VideoSamplingSummary Sample(const std::vector<std::string>& names) const {
    std::vector<fs::path> paths;
    for (const std::string& name : names) paths.push_back(Path(name));
    return SampleVideos(paths, Path("out"), options_, context_);
  }
  std::string ErrorOf(const std::vector<std::string>& names) const {
    try {
      Sample(names);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }
  cv::Mat Read(const std::string& name) const {
    return cv::imread(Path("out/images/" + name).string(),
                      cv::IMREAD_UNCHANGED);
  }
  std::set<std::string> Images() const {
    std::set<std::string> names;
    for (const auto& entry :
         fs::recursive_directory_iterator(Path("out/images"))) {
      if (!entry.is_regular_file()) continue;
      names.insert(fs::relative(entry.path(), Path("out/images")).string());
    }
    return names;
  }
  void ExpectEqual(const std::string& name, const cv::Mat& expected) const {
    const cv::Mat image = Read(name);
    ASSERT_EQ(image.size(), expected.size()) << name;
    ASSERT_EQ(image.channels(), 1) << name;
    EXPECT_EQ(cv::norm(image, expected, cv::NORM_INF), 0.0) << name;
  }

  TempDir dir_;
  VideoSamplingOptions options_;
  Context context_;
  std::string warnings_, infos_;
};

TEST_F(VideoSamplingTest, ARateSelectsExactImages) {
  const TestVideo video = RandomVideo(12, 100);
  Write("front.mkv", video);
  options_.rate = 2.5;
  EXPECT_EQ(Sample({"front.mkv"}).num_written, 3u);
  EXPECT_THAT(Images(),
              ElementsAre("front/000000.000.png", "front/000000.400.png",
                          "front/000000.800.png"));
  ExpectEqual("front/000000.000.png", video.images[0]);
  ExpectEqual("front/000000.400.png", video.images[4]);
  ExpectEqual("front/000000.800.png", video.images[8]);
  EXPECT_EQ(ReadTextFile(Path("out/timestamps.txt")),
            "# image_name SECONDS\n"
            "front/000000.000.png 0.000000\n"
            "front/000000.400.png 0.400000\n"
            "front/000000.800.png 0.800000\n");
}

// The second camera is 30 ms late, has no image at 0.3 s and begins at 0.1 s.
TEST_F(VideoSamplingTest, CamerasAreAlignedByTimeStamps) {
  const TestVideo front = RandomVideo(6, 100);
  TestVideo left = RandomVideo(6, 200, 30);
  left.images.erase(left.images.begin() + 3);
  left.times_ms.erase(left.times_ms.begin() + 3);
  left.images.erase(left.images.begin());
  left.times_ms.erase(left.times_ms.begin());
  Write("front.mkv", front);
  Write("left.mkv", left);
  const VideoSamplingSummary summary = Sample({"front.mkv", "left.mkv"});
  EXPECT_EQ(summary.num_frames, 6u);
  EXPECT_EQ(summary.num_written, 10u);
  ExpectEqual("front/000000.300.png", front.images[3]);
  ExpectEqual("left/000000.100.png", RandomImage(201));
  ExpectEqual("left/000000.200.png", RandomImage(202));
  ExpectEqual("left/000000.400.png", RandomImage(204));
  EXPECT_FALSE(fs::exists(Path("out/images/left/000000.000.png")));
  EXPECT_FALSE(fs::exists(Path("out/images/left/000000.300.png")));
  EXPECT_THAT(ReadTextFile(Path("out/timestamps.txt")),
              HasSubstr("left/000000.100.png 0.130000\n"));
  EXPECT_THAT(infos_, HasSubstr("'left.mkv': 4 of 4 images in 6 frames; times "
                                "differ from those of the first video by "
                                "0.030 s in the median"));
}

TEST_F(VideoSamplingTest, OtherAlignments) {
  TestVideo front = RandomVideo(30, 100);
  TestVideo left = RandomVideo(30, 200, 5000);
  front.creation_time = "2023-05-01T12:34:56Z";
  left.creation_time = "2023-05-01T12:34:58Z";
  Write("front.mkv", front);
  Write("left.mkv", left);
  EXPECT_THAT(ErrorOf({"front.mkv", "left.mkv"}),
              HasSubstr("left.mkv' (5.000 s to 7.900 s) has no image at the "
                        "times of"));
  EXPECT_THAT(warnings_, HasSubstr("creation times of the videos differ by "
                                   "2.000 s"));
  EXPECT_FALSE(fs::exists(Path("out")));

  options_.alignment = VideoAlignment::kStart;
  Sample({"front.mkv", "left.mkv"});
  ExpectEqual("left/000000.700.png", left.images[7]);
  fs::remove_all(Path("out"));

  options_.alignment = VideoAlignment::kCreationTime;
  Sample({"front.mkv", "left.mkv"});
  ExpectEqual("front/000002.700.png", front.images[27]);
  ExpectEqual("left/000002.700.png", left.images[7]);
  // 1682944496 is 2023-05-01 12:34:56 UTC.
  EXPECT_THAT(ReadTextFile(Path("out/timestamps.txt")),
              HasSubstr("left/000002.700.png 1682944498.700000\n"));
  fs::remove_all(Path("out"));

  options_.alignment = VideoAlignment::kTimestamps;
  options_.time_offsets = "0,-4.9";
  Sample({"front.mkv", "left.mkv"});
  ExpectEqual("left/000000.700.png", left.images[6]);
  fs::remove_all(Path("out"));
  options_.time_offsets = "1";
  EXPECT_THAT(ErrorOf({"front.mkv", "left.mkv"}),
              HasSubstr("give one per video"));
}

TEST_F(VideoSamplingTest, CreationTimesMustExist) {
  Write("front.mkv", RandomVideo(2, 100));
  options_.alignment = VideoAlignment::kCreationTime;
  EXPECT_THAT(ErrorOf({"front.mkv"}), HasSubstr("does not state its creation"));
}

TEST_F(VideoSamplingTest, MotionDecidesInTheFirstVideo) {
  const cv::Mat wall = RandomImage(1, 600, 96);
  TestVideo front, left;
  // Stands, then moves by 4 of 128 pixels per image.
  for (int i = 0; i < 20; ++i) {
    const int x_px = 4 * std::max(0, i - 9);
    front.images.push_back(wall(cv::Rect(x_px, 0, 128, 96)).clone());
    front.times_ms.push_back(100 * int64_t{i});
    left.images.push_back(RandomImage(300 + i));
    left.times_ms.push_back(100 * int64_t{i});
  }
  Write("front.mkv", front);
  Write("left.mkv", left);
  options_.sampling = VideoSampling::kMotion;
  options_.min_motion = 0.06;  // 8 pixels are 0.0625
  Sample({"front.mkv", "left.mkv"});
  EXPECT_THAT(Images(),
              ElementsAre("front/000000.000.png", "front/000001.100.png",
                          "front/000001.300.png", "front/000001.500.png",
                          "front/000001.700.png", "front/000001.900.png",
                          "left/000000.000.png", "left/000001.100.png",
                          "left/000001.300.png", "left/000001.500.png",
                          "left/000001.700.png", "left/000001.900.png"));
  ExpectEqual("front/000001.300.png", front.images[13]);
  ExpectEqual("left/000001.300.png", left.images[13]);
}

TEST_F(VideoSamplingTest, RotationIsApplied) {
  for (const int rotation_deg : {90, 180, 270}) {
    TestVideo video = RandomVideo(1, 100);
    video.codec = "mjpeg";
    video.rotation_deg = rotation_deg;
    Write("a.mov", video);
    fs::remove_all(Path("out"));
    Sample({"a.mov"});
    cv::Mat expected;
    cv::rotate(video.images[0], expected,
               rotation_deg == 90    ? cv::ROTATE_90_CLOCKWISE
               : rotation_deg == 180 ? cv::ROTATE_180
                                     : cv::ROTATE_90_COUNTERCLOCKWISE);
    cv::Mat image = Read("a/000000.000.png");
    ASSERT_EQ(image.size(), expected.size()) << rotation_deg;
    cv::cvtColor(image, image, cv::COLOR_BGR2GRAY);
    EXPECT_LT(cv::norm(image, expected, cv::NORM_L1) / expected.total(), 4.0)
        << rotation_deg;
  }
}

// Images that are stored out of order, at irregular times.
TEST_F(VideoSamplingTest, ReorderedImagesKeepTheirTimes) {
  TestVideo video = RandomVideo(12, 100);
  for (size_t i = 0; i < video.times_ms.size(); ++i) {
    video.times_ms[i] += static_cast<int64_t>(7 * i * i % 40);
    // Steps of brightness survive any compression; 16 is black in MPEG-4.
    video.images[i].setTo(16.0 + 18.0 * static_cast<double>(i));
  }
  video.codec = "mpeg4";
  video.num_b_frames = 2;
  Write("a.mp4", video);
  const VideoIndex index = IndexVideo(Path("a.mp4"));
  const auto decoder = OpenVideo(Path("a.mp4"), 2);
  for (size_t i = 0; i < video.times_ms.size(); ++i) {
    ASSERT_TRUE(decoder->Next()) << i;
    EXPECT_EQ(index.times_ns[i] - index.times_ns[0],
              1'000'000 * (video.times_ms[i] - video.times_ms[0]));
    EXPECT_EQ(decoder->TimeNs(), index.times_ns[i]);
    EXPECT_NEAR(cv::mean(decoder->ReadSmallGray(64))[0],
                18.0 * 255.0 / 219.0 * static_cast<double>(i), 5.0)
        << i;
  }
  EXPECT_FALSE(decoder->Next());
}

TEST_F(VideoSamplingTest, ASecondRunContinues) {
  Write("a.mkv", RandomVideo(5, 100));
  EXPECT_EQ(Sample({"a.mkv"}).num_written, 5u);
  fs::remove(Path("out/images/a/000000.200.png"));
  const std::string other =
      ReadTextFile(Path("out/images/a/000000.100.png")) + "x";
  WriteTextFile(Path("out/images/a/000000.100.png"), other);
  const VideoSamplingSummary summary = Sample({"a.mkv"});
  EXPECT_EQ(summary.num_written, 1u);
  EXPECT_EQ(summary.num_present, 4u);
  ExpectEqual("a/000000.200.png", RandomImage(102));
  EXPECT_EQ(ReadTextFile(Path("out/images/a/000000.100.png")), other);
  options_.rate = 5.0;
  EXPECT_THAT(ErrorOf({"a.mkv"}), HasSubstr("of other videos or settings"));
  fs::remove(Path("out/video_sampling.json"));
  EXPECT_THAT(ErrorOf({"a.mkv"}), HasSubstr("did not write"));
}

TEST_F(VideoSamplingTest, FilesThatAreNoVideosAreNamed) {
  Write("front.mkv", RandomVideo(5, 100));
  WriteTextFile(Path("text.mp4"), "no video");
  WriteTextFile(Path("empty.mp4"), "");
  // A play list could make the program read other files.
  WriteTextFile(Path("list.m3u8"), "#EXTM3U\n#EXTINF:1,\nfront.mkv\n");
  WriteTextFile(Path("concat.mp4"), "ffconcat version 1.0\nfile '" +
                                        Path("front.mkv").string() + "'\n");
  for (const std::string name :
       {"text.mp4", "empty.mp4", "list.m3u8", "concat.mp4"}) {
    EXPECT_THAT(ErrorOf({"front.mkv", name}),
                testing::AllOf(HasSubstr(Path(name).string()),
                               HasSubstr("is damaged or not a video")))
        << name;
  }
  EXPECT_THAT(ErrorOf({"missing.mp4"}), HasSubstr("does not exist"));
  EXPECT_FALSE(fs::exists(Path("out")));
}

TEST_F(VideoSamplingTest, DamageInTheMiddleLeavesTheRest) {
  Write("a.mkv", RandomVideo(10, 100));
  std::string bytes = ReadTextFile(Path("a.mkv"));
  // In the middle, where lossless images fill the file.
  for (size_t i = 0; i < 600; ++i) bytes[bytes.size() / 2 + i] ^= 0x5a;
  WriteTextFile(Path("a.mkv"), bytes);
  Sample({"a.mkv"});
  EXPECT_GE(Images().size(), 4u);
  ExpectEqual("a/000000.000.png", RandomImage(100));
  ExpectEqual("a/000000.100.png", RandomImage(101));
}

TEST_F(VideoSamplingTest, ATruncatedVideoGivesWhatIsLeft) {
  TestVideo video = RandomVideo(20, 100);
  video.codec = "mjpeg";
  Write("a.mp4", video);
  const std::string whole = ReadTextFile(Path("a.mp4"));
  WriteTextFile(Path("a.mp4"), whole.substr(0, whole.size() * 3 / 5));
  Sample({"a.mp4"});
  EXPECT_GT(Images().size(), 5u);
  EXPECT_LT(Images().size(), 15u);
  EXPECT_THAT(warnings_, HasSubstr("is damaged after"));
}

}  // namespace
}  // namespace mgsfm
