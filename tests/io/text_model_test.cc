// SPDX-License-Identifier: BSD-3-Clause
// Text models that other programs and editors write: each variant is read as
// what it means, or refused with its line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "mgsfm/models/model_io.h"
#include "support/error_of.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

using Files = std::map<std::string, std::string>;

Files Plain() {
  return {{"cameras.txt", "1 PINHOLE 640 480 500 501 320 240\n"},
          {"images.txt",
           "# IMAGE_ID, QW, ...\n"
           "1 1 0 0 0 0.25 0 0 1 a 1.jpg\n"
           "10.5 20 7 30 40 -1\n"
           "2 1 0 0 0 1 0 0 1 b.jpg\n"
           "\n"},
          {"points3D.txt", "7 1 2 3 4 5 6 0.5 1 0\n"},
          {"rigs.txt", "1 1 CAMERA 1\n"},
          {"frames.txt",
           "1 1 1 0 0 0 0.25 0 0 1 CAMERA 1 1\n"
           "2 1 1 0 0 0 1 0 0 1 CAMERA 1 2\n"}};
}

Model Read(const Files& files) {
  const TempDir dir;
  for (const auto& [name, text] : files) {
    WriteTextFile(dir.path() / name, text);
  }
  return ReadModel(dir.path());
}

void ExpectPlain(const Files& files) {
  const Model model = Read(files);
  ASSERT_EQ(model.poses.images.size(), 2u);
  EXPECT_EQ(model.poses.images[0].name, "a 1.jpg");
  EXPECT_EQ(model.poses.images[1].name, "b.jpg");
  EXPECT_EQ(model.poses.images[0].cam_from_world.translation.x(), 0.25);
  ASSERT_EQ(model.keypoints[0].size(), 2u);
  EXPECT_EQ(model.keypoints[0][0].position_px, Eigen::Vector2d(10.5, 20.0));
  EXPECT_EQ(model.keypoints[0][0].point_id, 7u);
  EXPECT_FALSE(model.keypoints[0][1].point_id.has_value());
  EXPECT_TRUE(model.keypoints[1].empty());
  ASSERT_EQ(model.cameras.size(), 1u);
  EXPECT_EQ(model.cameras[0].params,
            (std::vector<double>{500.0, 501.0, 320.0, 240.0}));
  ASSERT_EQ(model.points.size(), 1u);
  EXPECT_EQ(model.points[0].track.size(), 1u);
  EXPECT_EQ(model.poses.frames.size(), 2u);
  EXPECT_EQ(model.poses.rigs.size(), 1u);
}

std::string Replaced(std::string text, const std::string& before,
                     const std::string& after) {
  for (size_t at = text.find(before); at != std::string::npos;
       at = text.find(before, at + after.size())) {
    text.replace(at, before.size(), after);
  }
  return text;
}

// The plain files with `before` replaced by `after` in one of them.
Files Changed(const std::string& file, const std::string& before,
              const std::string& after) {
  Files files = Plain();
  EXPECT_NE(files[file].find(before), std::string::npos) << before;
  files[file] = Replaced(files[file], before, after);
  return files;
}

TEST(TextModel, FormOfLinesDoesNotCount) {
  ExpectPlain(Plain());
  for (auto& [name, unused] : Plain()) {
    ExpectPlain(Changed(name, "\n", "\r\n"));
    ExpectPlain(Changed(name, "\n", " \t\n"));
    Files marked = Plain();
    marked[name].insert(0, "\xef\xbb\xbf");
    ExpectPlain(marked);
    Files commented = Plain();
    commented[name].insert(0, "# one\n\n# two\n");
    ExpectPlain(commented);
    Files unended = Plain();
    unended[name].pop_back();
    ExpectPlain(unended);
  }
}

TEST(TextModel, TabsAndSeveralBlanksSeparateWords) {
  for (const auto& [name, words] : Files{{"cameras.txt", "640 480"},
                                         {"images.txt", "1 0 0 0"},
                                         {"points3D.txt", "1 2 3"},
                                         {"rigs.txt", "1 1 CAMERA"},
                                         {"frames.txt", "1 0 0 0"}}) {
    ExpectPlain(Changed(name, words, Replaced(words, " ", "\t  ")));
  }
}

TEST(TextModel, ExponentsMayHaveThreeDigits) {
  ExpectPlain(Changed("images.txt", "0.25", "2.5e-001"));
  ExpectPlain(Changed("cameras.txt", "500", "5e+002"));
  // Below the smallest double of full precision, and below all.
  ExpectPlain(
      Changed("images.txt", "1 0 0 0 1 0 0", "1 0 0 0 1 1e-310 1e-400"));
}

TEST(TextModel, UnknownErrorsOfPoints) {
  for (const char* error : {"-1", "nan", "inf"}) {
    EXPECT_FALSE(Read(Changed("points3D.txt", "0.5", error))
                     .points.at(0)
                     .error_px.has_value());
  }
}

TEST(TextModel, WhatDoesNotFitIsRefusedWithItsLine) {
  const auto refuses = [](const std::string& file, int line,
                          const std::string& before, const std::string& after) {
    const Files files = Changed(file, before, after);
    EXPECT_THAT(
        ErrorOf([&] { (void)Read(files); }),
        AllOf(HasSubstr(file), HasSubstr("line " + std::to_string(line))))
        << after;
  };
  refuses("cameras.txt", 1, "240\n", "240 0.1 0.2 0 0\n");
  refuses("cameras.txt", 1, "PINHOLE 640", "PINHOLE 640.5");
  refuses("cameras.txt", 1, "500", "5,00");
  // The empty lines of images without keypoints are left out.
  refuses("images.txt", 3, "10.5 20 7 30 40 -1\n", "");
  refuses("images.txt", 3, "10.5 20 7 30 40 -1", "10.5 20 7 30 40");
  refuses("images.txt", 3, "10.5 20 7", "10.5 20 7.5");
  refuses("images.txt", 3, "10.5", "10.5.");
  refuses("images.txt", 2, " a 1.jpg", "");
  refuses("images.txt", 2, "1 1 0 0 0 0.25", "1 0.02 0 0 0 0.25");
  refuses("images.txt", 2, "1 1 0 0 0 0.25", "1 9 0 0 0 0.25");
  refuses("points3D.txt", 1, "0.5 1 0", "0.5 1 0 2");
  refuses("points3D.txt", 1, "4 5 6", "4 5 256");
  refuses("rigs.txt", 1, "CAMERA 1", "CAMERA 1 CAMERA 2");
  refuses("rigs.txt", 1, "CAMERA", "camera");
  refuses("frames.txt", 2, "CAMERA 1 2", "CAMERA 1 2 3");
  refuses("frames.txt", 1, "CAMERA 1 1", "CAMERA 2 1");
}

TEST(TextModel, EvaluationSkipsNoImageEither) {
  const TempDir dir;
  WriteTextFile(dir.path() / "images.txt",
                "1 1 0 0 0 0 0 0 1 a.jpg\n2 1 0 0 0 1 0 0 1 b.jpg\n");
  EXPECT_THAT(ErrorOf([&] { (void)ReadModelPoses(dir.path()); }),
              HasSubstr("line 2"));
}

TEST(TextModel, NoTwoImagesHaveOneName) {
  EXPECT_THAT(
      ErrorOf([] { (void)Read(Changed("images.txt", "b.jpg", "a 1.jpg")); }),
      HasSubstr("two images 'a 1.jpg'"));
}

TEST(BinaryModel, NothingFollowsTheLastRecord) {
  const TempDir dir;
  for (const auto& [name, text] : Plain()) {
    WriteTextFile(dir.path() / name, text);
  }
  for (const char* stem : {"images", "cameras", "points3D", "rigs", "frames"}) {
    WriteTextFile(dir.path() / (std::string(stem) + ".bin"),
                  std::string(8, '\0'));
  }
  EXPECT_TRUE(ReadModel(dir.path()).poses.images.empty());
  for (const char* stem : {"images", "cameras", "points3D", "rigs", "frames"}) {
    const auto path = dir.path() / (std::string(stem) + ".bin");
    WriteTextFile(path, std::string(9, '\0'));
    EXPECT_THAT(ErrorOf([&] { (void)ReadModel(dir.path()); }),
                AllOf(HasSubstr(path.string()), HasSubstr("1 bytes follow")));
    WriteTextFile(path, std::string(8, '\0'));
  }
}

}  // namespace
}  // namespace mgsfm
