// SPDX-License-Identifier: BSD-3-Clause
#include "models/point_colors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using Rgb = Eigen::Matrix<uint8_t, 3, 1>;

// The red of a pixel tells its column, the green its row.
cv::Mat Ramp(int cols, int rows) {
  cv::Mat bgr(rows, cols, CV_8UC3);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols; ++x) {
      bgr.at<cv::Vec3b>(y, x) = {77, static_cast<uint8_t>(20 * y),
                                 static_cast<uint8_t>(10 * x)};
    }
  }
  return bgr;
}

class PointColors : public testing::Test {
 protected:
  int AddImage(const std::string& name,
               const std::vector<Eigen::Vector2f>& keypoints_px) {
    const auto size = size_of_image_.find(name);
    const cv::Size known =
        size == size_of_image_.end() ? cv::Size(1, 1) : size->second;
    scene_.cameras.push_back({CameraId(1),
                              CameraModelId::kSimplePinhole,
                              known.width,
                              known.height,
                              {}});
    Image image{ImageId(1), name, 0, 0, 0, keypoints_px};
    image.camera_idx = static_cast<int>(scene_.cameras.size()) - 1;
    scene_.images.push_back(image);
    return static_cast<int>(scene_.images.size()) - 1;
  }
  void WriteImage(const std::string& name, const cv::Mat& image) {
    size_of_image_[name] = image.size();
    fs::create_directories((dir_.path() / name).parent_path());
    ASSERT_TRUE(cv::imwrite((dir_.path() / name).string(), image));
  }
  void AddPoint(const std::vector<Observation>& track) {
    Point3D point;
    point.track = track;
    model_.points.push_back(point);
  }
  // The names of images that give no colors.
  std::vector<std::string> Color(int num_threads = 1) {
    Context context;
    context.num_threads = num_threads;
    uncolored_ = ColorPoints(scene_, dir_.path(), context, &model_);
    std::vector<std::string> names;
    for (const UncoloredImage& image : uncolored_) names.push_back(image.name);
    return names;
  }

  const TempDir dir_;
  Scene scene_;
  Reconstruction model_;
  std::map<std::string, cv::Size> size_of_image_;
  std::vector<UncoloredImage> uncolored_;
};

TEST_F(PointColors, InterpolatesBetweenPixelCenters) {
  WriteImage("a/0.png", Ramp(12, 8));
  AddImage("a/0.png", {{3.5f, 2.5f},     // the center of pixel (3, 2)
                       {4.0f, 3.0f},     // between four pixels
                       {0.0f, 0.0f},     // the corner
                       {12.0f, 8.0f},    // the corner opposite
                       {-1e30f, 1e30f},  // far outside
                       {3.75f, 2.5f}});
  for (int i = 0; i < 6; ++i) AddPoint({{0, i}});
  EXPECT_THAT(Color(), testing::IsEmpty());
  EXPECT_EQ(model_.points[0].color, Rgb(30, 40, 77));
  EXPECT_EQ(model_.points[1].color, Rgb(35, 50, 77));
  EXPECT_EQ(model_.points[2].color, Rgb(0, 0, 77));
  EXPECT_EQ(model_.points[3].color, Rgb(110, 140, 77));
  EXPECT_EQ(model_.points[4].color, Rgb(0, 140, 77));
  EXPECT_EQ(model_.points[5].color, Rgb(33, 40, 77));  // 32.5, rounded up
}

TEST_F(PointColors, TakesTheMeanOfTheImagesThatCanBeRead) {
  WriteImage("dark.png", cv::Mat(4, 4, CV_8UC3, cv::Scalar(0, 0, 10)));
  WriteImage("gray.png", cv::Mat(4, 4, CV_8UC1, cv::Scalar(90)));
  WriteTextFile(dir_.path() / "broken.png", "no image");
  fs::create_directory(dir_.path() / "folder.png");
  const Eigen::Vector2f center(2.0f, 2.0f);
  const int dark = AddImage("dark.png", {center, center});
  const int gray = AddImage("gray.png", {center});
  const int broken = AddImage("broken.png", {center});
  const int missing = AddImage("absent/0.png", {center});
  const int folder = AddImage("folder.png", {center});
  AddImage("unused and absent.png", {center});
  AddPoint({{dark, 0}, {gray, 0}});
  AddPoint({{dark, 1}, {broken, 0}, {missing, 0}});
  AddPoint({{missing, 0}, {folder, 0}});
  EXPECT_THAT(Color(), ElementsAre("absent/0.png", "broken.png", "folder.png"));
  EXPECT_EQ(model_.points[0].color, Rgb(50, 45, 45));
  EXPECT_EQ(model_.points[1].color, Rgb(10, 0, 0));
  EXPECT_EQ(model_.points[2].color, Rgb(0, 0, 0));
}

// Keypoints would be looked up at wrong places, or beyond the border.
TEST_F(PointColors, ImagesOfAnotherSizeGiveNone) {
  WriteImage("half.png", cv::Mat(4, 8, CV_8UC3, cv::Scalar(200, 200, 200)));
  size_of_image_["half.png"] = {16, 8};
  AddImage("half.png", {{2.0f, 2.0f}});
  AddPoint({{0, 0}});
  EXPECT_THAT(Color(), ElementsAre("half.png"));
  EXPECT_EQ(uncolored_[0].problem, "has 8 x 4 px, its camera 16 x 8");
  EXPECT_EQ(model_.points[0].color, Rgb(0, 0, 0));
}

// Keypoints refer to the picture as it is stored, regardless of its EXIF
// orientation.
// Cameras with 12 bits leave the upper four of 16 at zero.
TEST_F(PointColors, TwelveBitsInSixteenAreNotBlack) {
  WriteImage("a.png", cv::Mat(4, 4, CV_16UC3, cv::Scalar(0, 2048, 4095)));
  WriteImage("b.png", cv::Mat(4, 4, CV_16UC3, cv::Scalar(0, 32896, 65535)));
  for (const char* name : {"a.png", "b.png"}) {
    AddPoint({{AddImage(name, {{2.0f, 2.0f}}), 0}});
  }
  EXPECT_THAT(Color(), testing::IsEmpty());
  for (const Point3D& point : model_.points) {
    EXPECT_THAT(point.color, ElementsAre(255, 128, 0));
  }
}

TEST_F(PointColors, DoesNotTurnImages) {
  cv::Mat left_is_red(16, 32, CV_8UC3, cv::Scalar(0, 0, 0));
  left_is_red.colRange(0, 16) = cv::Scalar(0, 0, 250);
  WriteImage("0.jpg", left_is_red);
  std::string jpeg = ReadTextFile(dir_.path() / "0.jpg");
  // An APP1 segment with an orientation of 6, turned by 90 deg.
  const std::string tiff(
      "II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0", 26);
  const std::string exif = std::string("Exif\0\0", 6) + tiff;
  const std::string header = {'\xff', '\xe1', '\0',
                              static_cast<char>(exif.size() + 2)};
  jpeg.insert(2, header + exif);
  WriteTextFile(dir_.path() / "0.jpg", jpeg);
  ASSERT_EQ(cv::imread((dir_.path() / "0.jpg").string()).rows, 32)
      << "the test image is not turned by those who heed EXIF";

  AddImage("0.jpg", {{4.0f, 8.0f}, {28.0f, 8.0f}});
  AddPoint({{0, 0}});
  AddPoint({{0, 1}});
  EXPECT_THAT(Color(), testing::IsEmpty());
  EXPECT_GT(model_.points[0].color.x(), 200);
  EXPECT_LT(model_.points[1].color.x(), 50);
}

TEST_F(PointColors, ThreadsDoNotChangeColors) {
  for (int i = 0; i < 8; ++i) {
    const std::string name = std::to_string(i) + ".png";
    WriteImage(name, Ramp(10 + i, 7));
    AddImage(name, {{1.3f + static_cast<float>(i), 2.7f}});
  }
  AddPoint({{0, 0}, {3, 0}, {5, 0}, {7, 0}});
  AddPoint({{1, 0}, {2, 0}, {4, 0}, {6, 0}});
  Color(1);
  const std::vector<Point3D> one = model_.points;
  Color(3);
  for (size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(model_.points[i].color, one[i].color);
  }
}

}  // namespace
}  // namespace mgsfm
