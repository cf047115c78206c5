// SPDX-License-Identifier: BSD-3-Clause
#include "features/image_file.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <exiv2/exiv2.hpp>
#include <mutex>
#include <new>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <utility>

#include "base/file_reading.h"
#include "files/exif_gps_time.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"
#include "rigs/image_times.h"

namespace mgsfm {
namespace {

// Scales images of more than 8 bits such that the brightest pixel is 255.
cv::Mat To8Bits(const cv::Mat& image) {
  if (image.depth() == CV_8U) return image;
  double max = 0.0;
  cv::minMaxLoc(image, nullptr, &max);
  cv::Mat scaled;
  image.convertTo(scaled, CV_8U, max > 0.0 ? 255.0 / max : 0.0);
  return scaled;
}

GrayImage ToGrayImage(const cv::Mat& image) {
  MGSFM_CHECK_EQ(image.channels(), 1);
  const cv::Mat scaled = To8Bits(image);
  GrayImage gray(scaled.rows, scaled.cols);
  for (int y = 0; y < scaled.rows; ++y) {
    std::memcpy(gray.row(y).data(), scaled.ptr(y),
                static_cast<size_t>(scaled.cols));
  }
  return gray;
}

}  // namespace

std::string ReadImageFile(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) throw Error("does not exist");
  if (!std::filesystem::is_regular_file(path, ignored)) {
    throw Error("is not a regular file");
  }
  return ReadFile(path, "is a file that");
}

ImageFile DecodeImageFile(const std::string& file, int64_t max_num_pixels) {
  DecodedImage image = DecodeImage(file,
                                   cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH |
                                       cv::IMREAD_IGNORE_ORIENTATION,
                                   max_num_pixels);
  return {ToGrayImage(image.pixels),
          ReadTags(file, image.pixels.cols, image.pixels.rows),
          std::move(image.warning)};
}

namespace {

constexpr double kFilmDiagonalMm = 43.26661530556787;  // 24 x 36 mm

// A finite component of a tag.
std::optional<double> NumberOf(const Exiv2::ExifData& tags,
                               const std::string& name, int component = 0) {
  const auto tag = tags.findKey(Exiv2::ExifKey(name));
  if (tag == tags.end() || tag->count() <= component) return std::nullopt;
  const Exiv2::Rational rational = tag->toRational(component);
  if (rational.second == 0) return std::nullopt;
  return static_cast<double>(rational.first) / rational.second;
}

std::optional<double> PositiveNumberOf(const Exiv2::ExifData& tags,
                                       const std::string& name) {
  const std::optional<double> number = NumberOf(tags, name);
  return number && *number > 0.0 ? number : std::nullopt;
}

// Values of Exif.Photo.FocalPlaneResolutionUnit: inch, cm, mm, um.
std::optional<double> MillimetersOfUnit(double unit) {
  switch (static_cast<int>(unit)) {
    case 2:
      return 25.4;
    case 3:
      return 10.0;
    case 4:
      return 1.0;
    case 5:
      return 0.001;
    default:
      return std::nullopt;
  }
}

std::optional<double> FocalLengthPx(const Exiv2::ExifData& tags, int width,
                                    int height) {
  const auto film_mm =
      PositiveNumberOf(tags, "Exif.Photo.FocalLengthIn35mmFilm");
  if (film_mm) return *film_mm / kFilmDiagonalMm * std::hypot(width, height);
  const auto focal_mm = PositiveNumberOf(tags, "Exif.Photo.FocalLength");
  const auto resolution =
      PositiveNumberOf(tags, "Exif.Photo.FocalPlaneXResolution");
  // The default unit is the inch.
  const auto unit_mm = MillimetersOfUnit(
      NumberOf(tags, "Exif.Photo.FocalPlaneResolutionUnit").value_or(2.0));
  if (!focal_mm || !resolution || !unit_mm) return std::nullopt;
  // The resolution refers to the original image; the file may be resized.
  const double taken_width =
      PositiveNumberOf(tags, "Exif.Photo.PixelXDimension").value_or(width);
  return *focal_mm * *resolution / *unit_mm * width / taken_width;
}

// An angle in degrees, minutes and seconds; the hemisphere `negative` (S or W)
// negates it.
std::optional<double> AngleDeg(const Exiv2::ExifData& tags,
                               const std::string& name, char negative) {
  double angle = 0.0;
  double unit = 1.0;
  for (int i = 0; i < 3; ++i) {
    const std::optional<double> number = NumberOf(tags, name, i);
    if (!number && i == 0) return std::nullopt;
    angle += number.value_or(0.0) * unit;
    unit /= 60.0;
  }
  const auto half = tags.findKey(Exiv2::ExifKey(name + "Ref"));
  if (half == tags.end()) return std::nullopt;
  const std::string text = half->toString();
  return !text.empty() && text[0] == negative ? -angle : angle;
}

std::optional<Eigen::Vector3d> PositionWgs84(const Exiv2::ExifData& tags) {
  const auto latitude = AngleDeg(tags, "Exif.GPSInfo.GPSLatitude", 'S');
  const auto longitude = AngleDeg(tags, "Exif.GPSInfo.GPSLongitude", 'W');
  if (!latitude || !longitude || std::abs(*latitude) > 90.0 ||
      std::abs(*longitude) > 180.0) {
    return std::nullopt;
  }
  const double altitude =
      NumberOf(tags, "Exif.GPSInfo.GPSAltitude").value_or(0.0);
  const bool is_below_sea =
      NumberOf(tags, "Exif.GPSInfo.GPSAltitudeRef").value_or(0.0) == 1.0;
  return Eigen::Vector3d(*latitude, *longitude,
                         is_below_sea ? -altitude : altitude);
}

// "2023:05:01 12:34:56" and "789".
std::optional<double> TimeOf(const Exiv2::ExifData& tags) {
  const auto text_of = [&tags](const char* name) {
    const auto tag = tags.findKey(Exiv2::ExifKey(name));
    return tag == tags.end() ? std::string() : tag->toString();
  };
  std::string digits = text_of("Exif.Photo.DateTimeOriginal");
  digits.erase(std::remove(digits.begin(), digits.end(), ':'), digits.end());
  const std::string fraction = text_of("Exif.Photo.SubSecTimeOriginal");
  const auto time_ns =
      TimeInName(digits + (fraction.empty() ? "" : "." + fraction) + ".jpg");
  if (!time_ns) return std::nullopt;
  return 1e-9 * static_cast<double>(*time_ns);
}

}  // namespace

ImageTags ReadTags(const std::string& file, int width, int height) {
  const std::lock_guard<std::mutex> lock(Exiv2Mutex());
  Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
  try {
    const auto image = Exiv2::ImageFactory::open(
        reinterpret_cast<const Exiv2::byte*>(file.data()),
        static_cast<long>(file.size()));
    image->readMetadata();
    const Exiv2::ExifData& tags = image->exifData();
    return {FocalLengthPx(tags, width, height), PositionWgs84(tags),
            TimeOf(tags)};
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception&) {
    return {};  // a format without tags, or damaged tags
  }
}

}  // namespace mgsfm
