// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <exiv2/exiv2.hpp>
#include <opencv2/imgcodecs.hpp>

#include "cli/program_runs.h"
#include "frontend/features/blob_images.h"
#include "mgsfm/database/feature_database.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

// mgsfm feature_extractor and rig_configurator, as programs.
class FeatureCommandsTest : public testing::Test {
 protected:
  void WriteImage(const std::string& name, uint64_t seed, int width = 160,
                  int height = 120) const {
    const std::filesystem::path path = dir_.path() / "images" / name;
    std::filesystem::create_directories(path.parent_path());
    const GrayImage image =
        RenderBlobs(RandomBlobs(100, width, height, seed), width, height);
    std::string text =
        "P5 " + std::to_string(width) + " " + std::to_string(height) + " 255\n";
    text.append(reinterpret_cast<const char*>(image.data()),
                static_cast<size_t>(image.size()));
    WriteTextFile(path, text);
  }
  void WriteDrive(int num_frames) const {
    for (int i = 0; i < num_frames; ++i) {
      const std::string name = std::to_string(1000 + i) + ".pgm";
      WriteImage("left/" + name, 2 * i);
      WriteImage("right/" + name, 2 * i + 1);
    }
  }
  std::string Database(const std::string& name = "a.db") const {
    return (dir_.path() / name).string();
  }
  std::string ExtractorLine(const std::string& more,
                            const std::string& database = "a.db") const {
    return "feature_extractor --database_path " + Database(database) +
           " --image_path " + (dir_.path() / "images").string() + " " + more;
  }
  // Names, and all features, of the images.
  std::map<std::string, std::string> Features(
      const std::string& database = "a.db") const {
    const FeatureDatabase file(Database(database),
                               FeatureDatabase::OpenMode::kExisting);
    std::map<std::string, std::string> features;
    for (const ImageRow& image : file.ReadStructure(Context()).images) {
      const auto keypoints = file.ReadKeypoints(image.id);
      const DescriptorMatrix descriptors = file.ReadDescriptors(image.id);
      std::string& bytes = features[image.name];
      bytes = std::to_string(image.id.value()) + " " +
              std::to_string(image.camera_id.value()) + " ";
      bytes.append(reinterpret_cast<const char*>(keypoints.data()),
                   keypoints.size() * sizeof(FeatureKeypoint));
      bytes.append(reinterpret_cast<const char*>(descriptors.data()),
                   static_cast<size_t>(descriptors.size()));
    }
    return features;
  }

  TempDir dir_;
};

// One line for one cause, whatever the number of images.
TEST_F(FeatureCommandsTest, MissingImagesOfAListAreCounted) {
  WriteDrive(1);
  std::string list = "left/1000.pgm\n";
  for (int i = 0; i < 300; ++i) {
    list += "left/none" + std::to_string(i) + ".pgm\n";
  }
  const std::string path = (dir_.path() / "list.txt").string();
  WriteTextFile(path, list);
  const CommandOutput output =
      RunMgsfm(ExtractorLine("--image_list_path " + path));
  EXPECT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.err, HasSubstr("does not exist"));
  EXPECT_THAT(output.err, HasSubstr("the first of 300 such"));
  EXPECT_LT(std::count(output.err.begin(), output.err.end(), '\n'), 10);
}

TEST_F(FeatureCommandsTest, ExtractAndConfigure) {
  WriteDrive(3);
  const CommandOutput extracted =
      RunMgsfm(ExtractorLine("--ImageReader.camera_model PINHOLE "
                             "--SiftExtraction.max_num_features 50"));
  EXPECT_EQ(extracted.exit_code, 0) << extracted.err;
  EXPECT_THAT(extracted.err, HasSubstr("features of 6 images"));
  EXPECT_THAT(extracted.err, HasSubstr("images/s"));
  const CommandOutput again = RunMgsfm(ExtractorLine(""));
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("6 images already had features"));
  const CommandOutput configured =
      RunMgsfm("rig_configurator --database_path " + Database());
  EXPECT_EQ(configured.exit_code, 0) << configured.err;
  EXPECT_THAT(configured.err, HasSubstr("1 rigs of 2 cameras, 3 frames"));
}

// Cameras with counters of their own and synchronized clocks.
TEST_F(FeatureCommandsTest, ExifTimesBecomeFrames) {
  const auto write = [&](const std::string& name, uint64_t seed,
                         const std::string& milliseconds) {
    const std::filesystem::path path = dir_.path() / "images" / name;
    std::filesystem::create_directories(path.parent_path());
    const GrayImage gray =
        RenderBlobs(RandomBlobs(100, 160, 120, seed), 160, 120);
    cv::Mat image(120, 160, CV_8U);
    std::copy_n(gray.data(), gray.size(), image.data);
    cv::imwrite(path.string(), image);
    const auto tags = Exiv2::ImageFactory::open(path.string());
    tags->exifData()["Exif.Photo.DateTimeOriginal"] = "2023:05:01 12:34:56";
    tags->exifData()["Exif.Photo.SubSecTimeOriginal"] = milliseconds;
    tags->writeMetadata();
  };
  write("left/DSC1.jpg", 1, "100");
  write("left/DSC2.jpg", 2, "500");
  write("left/DSC3.jpg", 3, "900");
  write("right/DSC8.jpg", 4, "510");
  write("right/DSC9.jpg", 5, "880");
  ASSERT_EQ(RunMgsfm(ExtractorLine("")).exit_code, 0);
  const std::string line = "rig_configurator --database_path " + Database() +
                           " --frame_max_time_difference_s 0.05 --image_path " +
                           (dir_.path() / "images").string();
  const CommandOutput configured = RunMgsfm(line);
  EXPECT_EQ(configured.exit_code, 0) << configured.err;
  EXPECT_THAT(configured.err,
              HasSubstr("1 rigs of 2 cameras, 3 frames, 5 images"));
  const auto times = dir_.path() / "timestamps.txt";
  // 1682944496 is 2023-05-01 12:34:56 UTC.
  EXPECT_THAT(ReadTextFile(times),
              HasSubstr("right/DSC8.jpg 1682944496.510000"));
  // Times of somebody else are not replaced.
  WriteTextFile(times, "other");
  const CommandOutput refused = RunMgsfm(line);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(LastWord(refused), HasSubstr("image_timestamps_path"));
  EXPECT_EQ(ReadTextFile(times), "other");
}

TEST_F(FeatureCommandsTest, NamesBadImagesAndGoesOn) {
  WriteDrive(1);
  WriteTextFile(dir_.path() / "images/left/empty.jpg", "");
  WriteTextFile(dir_.path() / "images/left/notes.txt", "text");
  WriteImage("right/2000.pgm", 3, 161, 120);
  const CommandOutput output = RunMgsfm(ExtractorLine(""));
  EXPECT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.err, HasSubstr("'left/empty.jpg' is rejected: it is"));
  EXPECT_THAT(output.err, HasSubstr("'left/notes.txt' is rejected: it is"));
  EXPECT_THAT(output.err, HasSubstr("'right/2000.pgm' is rejected: it has"));
  EXPECT_EQ(Features().size(), 2u);
}

TEST_F(FeatureCommandsTest, BadUseLeavesNoDatabase) {
  WriteDrive(1);
  for (const std::string more :
       {"--ImageReader.camera_model NONE", "--image_list_path /nowhere",
        "--image_path /nowhere", "--ImageReader.camera_mask_path /nowhere"}) {
    const CommandOutput output = RunMgsfm(ExtractorLine(more));
    EXPECT_EQ(output.exit_code, 1) << more;
    EXPECT_NE(LastWord(output), "") << output.err;
    EXPECT_FALSE(std::filesystem::exists(Database())) << more;
  }
  EXPECT_EQ(
      RunMgsfm("rig_configurator --database_path " + Database()).exit_code, 1);
}

TEST_F(FeatureCommandsTest, GoesOnAfterBeingKilled) {
  WriteDrive(40);
  ASSERT_EQ(RunMgsfm(ExtractorLine("", "whole.db")).exit_code, 0);
  // Whenever it is killed, what is there is whole.
  for (const char* seconds : {"0.05", "0.1", "0.2", "0.4"}) {
    RunShell("timeout -s KILL " + std::string(seconds) +
             " " MGSFM_EXECUTABLE " " + ExtractorLine("", "parts.db"));
  }
  ASSERT_EQ(RunMgsfm(ExtractorLine("", "parts.db")).exit_code, 0);
  EXPECT_EQ(Features("whole.db"), Features("parts.db"));
}

}  // namespace
}  // namespace mgsfm
