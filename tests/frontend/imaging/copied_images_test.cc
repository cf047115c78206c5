// SPDX-License-Identifier: BSD-3-Clause
// Images whose only view is the image itself, and images of more than 8 bits.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <exiv2/exiv2.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "imaging/image_run.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr int kWidthPx = 40, kHeightPx = 24;

cv::Mat Ramp(int type, double max) {
  cv::Mat image(kHeightPx, kWidthPx, CV_64F);
  for (int y = 0; y < kHeightPx; ++y) {
    for (int x = 0; x < kWidthPx; ++x) {
      image.at<double>(y, x) = max * (x + y) / (kWidthPx + kHeightPx - 2);
    }
  }
  cv::Mat converted;
  image.convertTo(converted, type);
  return converted;
}

Camera PinholeCamera(double focal_px) {
  return {CameraId(1),
          CameraModelId::kPinhole,
          kWidthPx,
          kHeightPx,
          {focal_px, focal_px, 0.5 * kWidthPx, 0.5 * kHeightPx}};
}

class CopiedImages : public testing::Test {
 protected:
  fs::path Path(const std::string& name) const { return dir_.path() / name; }

  void Write(const std::string& name, const cv::Mat& image) const {
    fs::create_directory(Path("in"));
    ASSERT_TRUE(cv::imwrite(Path("in/" + name).string(), image));
  }

  // Writes one view of each image.
  std::vector<std::string> Run(const std::vector<std::string>& names,
                               const Camera& camera, const Camera& view) {
    std::vector<ImageTask> tasks;
    for (const std::string& name : names) tasks.push_back({name, 0, {name}});
    std::vector<std::string> warnings;
    Context context;
    context.log = [&](LogLevel level, const std::string& message) {
      if (level == LogLevel::kWarning) warnings.push_back(message);
    };
    const View same{"", Eigen::Quaterniond::Identity(), view, 1.5};
    ImageRunOptions options;
    options.image_path = Path("in");
    options.output_path = Path("out");
    WriteViews(tasks, {camera}, {{same}}, options, context);
    return warnings;
  }

  const TempDir dir_;
};

// Cameras store what viewers have to turn; poses are those of what is stored.
TEST_F(CopiedImages, ReadersDoNotTurnThem) {
  const cv::Mat stored = Ramp(CV_8U, 255.0);
  const std::vector<std::string> names = {"a.jpg", "b.png", "c.tif"};
  for (const std::string& name : names) {
    Write(name, stored);
    const auto image = Exiv2::ImageFactory::open(Path("in/" + name).string());
    image->readMetadata();
    image->exifData()["Exif.Image.Orientation"] = uint16_t{6};
    image->exifData()["Exif.Photo.DateTimeOriginal"] = "2023:05:01 12:34:56";
    image->writeMetadata();
  }
  ASSERT_EQ(cv::imread(Path("in/a.jpg").string()).rows, kWidthPx);
  const Camera camera = PinholeCamera(30.0);
  EXPECT_THAT(Run(names, camera, camera), IsEmpty());
  for (const std::string& name : names) {
    const std::string path = Path("out/images/" + name).string();
    const cv::Mat read = cv::imread(path, cv::IMREAD_GRAYSCALE);
    ASSERT_EQ(read.size(), stored.size()) << name;
    EXPECT_LE(cv::norm(read, stored, cv::NORM_INF), 3.0) << name;
    const auto image = Exiv2::ImageFactory::open(path);
    image->readMetadata();
    EXPECT_EQ(image->exifData()["Exif.Photo.DateTimeOriginal"].toString(),
              "2023:05:01 12:34:56");
  }
}

TEST_F(CopiedImages, TwelveBitsInSixteenAreNamed) {
  Write("a.png", Ramp(CV_16U, 4095.0));
  Write("b.png", Ramp(CV_16U, 4000.0));
  Write("c.png", Ramp(CV_16U, 65535.0));
  Write("d.png", Ramp(CV_8U, 255.0));
  Write("e.tif", Ramp(CV_16U, 4095.0));
  // Copies, which keep 16 bits, and views of 8 bits.
  for (const double focal_px : {30.0, 33.0}) {
    fs::remove_all(Path("out"));
    const auto warnings = Run({"a.png", "b.png", "c.png", "d.png", "e.tif"},
                              PinholeCamera(30.0), PinholeCamera(focal_px));
    EXPECT_THAT(warnings, ElementsAre(testing::AllOf(
                              HasSubstr("'a.png'"), HasSubstr("multiply"),
                              HasSubstr("first of 3 such"))));
  }
}

}  // namespace
}  // namespace mgsfm
