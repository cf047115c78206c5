// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <mutex>
#include <string>

namespace mgsfm {

// Exiv2 is not thread-safe; every use holds this lock.
std::mutex& Exiv2Mutex();

// The EXIF tags of an image file that also hold for parts and views of the
// image: GPS position and time of exposure, but not focal length and
// orientation. Thread-safe.
class ExifGpsTime {
 public:
  // Takes the content of the file. Missing or damaged tags are treated as none.
  explicit ExifGpsTime(const std::string& file);
  ~ExifGpsTime();
  ExifGpsTime(const ExifGpsTime&) = delete;
  ExifGpsTime& operator=(const ExifGpsTime&) = delete;

  // The content of another image file with these tags. Formats without tags,
  // such as BMP, are unchanged.
  std::string AddTo(const std::string& file) const;

 private:
  struct Tags;
  std::unique_ptr<Tags> tags_;
};

// An image file whose pixels are shown as stored: without the tag that makes
// viewers rotate them. Thread-safe.
std::string WithoutOrientation(const std::string& file);

}  // namespace mgsfm
