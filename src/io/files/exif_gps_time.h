// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <mutex>
#include <string>

namespace mgsfm {

// Exiv2 is not thread-safe; every use of it holds this lock.
std::mutex& Exiv2Mutex();

// The EXIF tags of an image file that remain true for parts and views of the
// image: GPS position and time of exposure. Focal length and orientation do
// not. Thread-safe.
class ExifGpsTime {
 public:
  // Takes the content of the file. No tags if it has none, or damaged ones.
  explicit ExifGpsTime(const std::string& file);
  ~ExifGpsTime();
  ExifGpsTime(const ExifGpsTime&) = delete;
  ExifGpsTime& operator=(const ExifGpsTime&) = delete;

  // The content of another image file with these tags. Formats without tags,
  // such as BMP, stay as they are.
  std::string AddTo(const std::string& file) const;

 private:
  struct Tags;
  std::unique_ptr<Tags> tags_;
};

// An image file whose pixels are shown as they are stored: without the tag by
// which viewers would turn them. Thread-safe.
std::string WithoutOrientation(const std::string& file);

}  // namespace mgsfm
