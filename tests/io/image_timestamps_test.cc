// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/test_database.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"
#include "rigs/image_times.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class ImageTimestampsTest : public testing::Test {
 protected:
  ImageTimestampsTest()
      : scene_(LoadScene(MakeContents({"a b/2.png", "a b/9.png", "a b/10.png"}),
                         {}, Context())
                   .scene) {}

  std::string Path() const { return (dir_.path() / "times.txt").string(); }
  void Read(const std::string& text) {
    WriteTextFile(Path(), text);
    ReadImageTimestamps(Path(), &scene_);
  }
  std::string ErrorOfText(const std::string& text) {
    return ErrorOf([&] { Read(text); });
  }
  double TimeOf(const std::string& name) const {
    for (const Image& image : scene_.images) {
      if (image.name == name) return *image.timestamp_s;
    }
    return -1.0;
  }

  const TempDir dir_;
  Scene scene_;
};

TEST_F(ImageTimestampsTest, AreReadByName) {
  Read("# times\r\n a b/2.png 0.5\r\n\na b/10.png\t1e1  \na b/9.png 7\n");
  EXPECT_EQ(TimeOf("a b/2.png"), 0.5);
  EXPECT_EQ(TimeOf("a b/9.png"), 7.0);
  EXPECT_EQ(TimeOf("a b/10.png"), 10.0);
}

TEST_F(ImageTimestampsTest, WhatIsWrittenIsRead) {
  SimulationOptions options;
  options.num_frames = 5;
  const Simulation simulation = Simulate(options);
  WriteImageTimestamps(Path(), simulation.scene);
  Scene scene = simulation.scene;
  for (Image& image : scene.images) image.timestamp_s.reset();
  ReadImageTimestamps(Path(), &scene);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    EXPECT_NEAR(*scene.images[i].timestamp_s,
                *simulation.scene.images[i].timestamp_s, 1e-9);
  }
}

TEST_F(ImageTimestampsTest, ErrorsNameLineOrImage) {
  const std::string rest = "a b/9.png 2\na b/10.png 3\n";
  EXPECT_THAT(ErrorOf([&] { ReadImageTimestamps("/no/file", &scene_); }),
              AllOf(HasSubstr("/no/file"), HasSubstr("cannot be read")));
  EXPECT_THAT(ErrorOfText("alone\n"),
              AllOf(HasSubstr("times.txt"), HasSubstr("line 1"),
                    HasSubstr("image_name SECONDS")));
  EXPECT_THAT(ErrorOfText(rest + "a b/2.png soon\n"),
              AllOf(HasSubstr("line 3"), HasSubstr("soon")));
  for (const char* bad : {"nan", "inf", "-inf", "1.5x"}) {
    EXPECT_THAT(ErrorOfText("\n" + rest + "a b/2.png " + bad + "\n"),
                AllOf(HasSubstr("line 4"), HasSubstr("a b/2.png"),
                      HasSubstr("finite")));
  }
  EXPECT_THAT(ErrorOfText("a b/3.png 1\n"),
              AllOf(HasSubstr("line 1"), HasSubstr("a b/3.png")));
  EXPECT_THAT(
      ErrorOfText(rest + rest),
      AllOf(HasSubstr("line 3"), HasSubstr("a b/9.png"), HasSubstr("again")));
  EXPECT_THAT(ErrorOfText(rest),
              AllOf(HasSubstr("no time for image 'a b/2.png'"),
                    HasSubstr("add a line")));
}

// The magnitude of UNIX times shows their unit.
TEST_F(ImageTimestampsTest, OtherUnitsThanSecondsAreRefused) {
  for (const char* time :
       {"1403715273262", "1403715273262143", "1403715273262142976"}) {
    EXPECT_THAT(ErrorOfText("a b/2.png " + std::string(time) + "\n"),
                AllOf(HasSubstr("line 1"), HasSubstr("year 2200"),
                      HasSubstr("seconds")));
  }
}

// Times from zero have no such magnitude, but their intervals have.
TEST_F(ImageTimestampsTest, OtherUnitsFromZeroAreNamed) {
  const auto doubts = [&](double interval_s) {
    const auto line = [&](const char* name, int frame) {
      return std::string("a b/") + name + ".png " +
             std::to_string(frame * interval_s) + "\n";
    };
    Read(line("2", 0) + line("9", 1) + line("10", 2));
    return WhyTimesAreNotSeconds(Path(), scene_).value_or("");
  };
  for (const double interval_s : {0.01, 1.0, 5.0}) {
    EXPECT_EQ(doubts(interval_s), "");
    EXPECT_THAT(doubts(1e3 * interval_s + 1), HasSubstr("milliseconds"));
    EXPECT_THAT(doubts(1e6 * interval_s + 1), HasSubstr("microseconds"));
  }
}

TEST_F(ImageTimestampsTest, ImagesOfAFrameAreCloserThanFrames) {
  scene_ = LoadScene(MakeContents({"a/1.png", "a/2.png", "b/1.png", "b/2.png"}),
                     {}, Context())
               .scene;
  const std::string first = "a/1.png 1\na/2.png 2\n";
  Read(first + "b/1.png 1.4\nb/2.png 2.4\n");
  EXPECT_THAT(ErrorOfText(first + "b/1.png 3\nb/2.png 4\n"),
              AllOf(HasSubstr("times.txt"), HasSubstr("2 s"), HasSubstr("1 s"),
                    HasSubstr("frame_max_time_difference_s")));
}

TEST_F(ImageTimestampsTest, TimesIncreaseInTheOrderOfNames) {
  for (const char* time : {"2", "2.5"}) {
    EXPECT_THAT(ErrorOfText("a b/9.png 2\na b/10.png 3\na b/2.png " +
                            std::string(time) + "\n"),
                AllOf(HasSubstr("a b/9.png"), HasSubstr("not later than"),
                      HasSubstr("a b/2.png"), HasSubstr("correct the times")));
  }
}

}  // namespace
}  // namespace mgsfm
