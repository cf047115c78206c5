// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <exiv2/exiv2.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "features/image_file.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

std::optional<double> TimeOf(const std::string& date, const std::string& ms) {
  const TempDir dir;
  const std::string path = (dir.path() / "a.jpg").string();
  cv::imwrite(path, cv::Mat(16, 16, CV_8U, cv::Scalar(90)));
  const auto image = Exiv2::ImageFactory::open(path);
  Exiv2::ExifData tags;
  if (!date.empty()) tags["Exif.Photo.DateTimeOriginal"] = date;
  if (!ms.empty()) tags["Exif.Photo.SubSecTimeOriginal"] = ms;
  image->setExifData(tags);
  image->writeMetadata();
  return ReadTags(ReadImageFile(path), 16, 16).time_s;
}

// 1682944496 is 2023-05-01 12:34:56 UTC.
TEST(ImageTagsTest, TimesOfExposure) {
  EXPECT_EQ(TimeOf("2023:05:01 12:34:56", ""), 1682944496.0);
  EXPECT_EQ(TimeOf("2023:05:01 12:34:56", "25"), 1682944496.25);
  EXPECT_EQ(TimeOf("2023:05:01 12:34:56", "5"), 1682944496.5);
  EXPECT_EQ(TimeOf("", "25"), std::nullopt);
  EXPECT_EQ(TimeOf("0000:00:00 00:00:00", ""), std::nullopt);
  EXPECT_EQ(TimeOf("    :  :     :  :  ", ""), std::nullopt);
}

}  // namespace
}  // namespace mgsfm
