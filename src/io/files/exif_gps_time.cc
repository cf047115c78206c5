// SPDX-License-Identifier: BSD-3-Clause
#include "files/exif_gps_time.h"

#include <exiv2/exiv2.hpp>
#include <new>

namespace mgsfm {
namespace {

Exiv2::Image::AutoPtr OpenImage(const std::string& file) {
  Exiv2::LogMsg::setLevel(Exiv2::LogMsg::mute);
  auto image = Exiv2::ImageFactory::open(
      reinterpret_cast<const Exiv2::byte*>(file.data()),
      static_cast<long>(file.size()));
  image->readMetadata();
  return image;
}

std::string BytesOf(Exiv2::Image* image) {
  Exiv2::BasicIo& io = image->io();
  io.open();
  const Exiv2::DataBuf bytes = io.read(static_cast<long>(io.size()));
  return {reinterpret_cast<const char*>(bytes.pData_),
          static_cast<size_t>(bytes.size_)};
}

// Calls use(image) with the open image. Does nothing for a format without tags,
// and ends early for damaged tags.
template <class Use>
void UseTags(const std::string& file, const Use& use) {
  const std::lock_guard<std::mutex> lock(Exiv2Mutex());
  try {
    use(OpenImage(file).get());
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception&) {
  }
}

bool IsPlaceOrTime(const std::string& key) {
  return key.compare(0, 13, "Exif.GPSInfo.") == 0 ||
         key == "Exif.Photo.DateTimeOriginal" ||
         key == "Exif.Photo.SubSecTimeOriginal" ||
         key == "Exif.Photo.OffsetTimeOriginal";
}

}  // namespace

std::mutex& Exiv2Mutex() {
  static std::mutex mutex;
  return mutex;
}

struct ExifGpsTime::Tags {
  Exiv2::ExifData data;
};

ExifGpsTime::ExifGpsTime(const std::string& file)
    : tags_(std::make_unique<Tags>()) {
  UseTags(file, [&](Exiv2::Image* image) {
    Exiv2::ExifData tags;
    for (const Exiv2::Exifdatum& tag : image->exifData()) {
      if (IsPlaceOrTime(tag.key())) tags.add(tag);
    }
    tags_->data = tags;
  });
}

ExifGpsTime::~ExifGpsTime() = default;

std::string ExifGpsTime::AddTo(const std::string& file) const {
  std::string tagged = file;
  if (tags_->data.empty()) return tagged;
  UseTags(file, [&](Exiv2::Image* image) {
    image->setExifData(tags_->data);
    image->writeMetadata();
    tagged = BytesOf(image);
  });
  return tagged;
}

std::string WithoutOrientation(const std::string& file) {
  constexpr uint16_t kAsStored = 1;
  std::string upright = file;
  UseTags(file, [&](Exiv2::Image* image) {
    Exiv2::ExifData& tags = image->exifData();
    const auto tag = tags.findKey(Exiv2::ExifKey("Exif.Image.Orientation"));
    const auto xmp =
        image->xmpData().findKey(Exiv2::XmpKey("Xmp.tiff.Orientation"));
    const bool has_xmp = xmp != image->xmpData().end();
    if (tag == tags.end() && !has_xmp) return;
    if (tag != tags.end()) *tag = kAsStored;
    if (has_xmp) image->xmpData().erase(xmp);
    image->writeMetadata();
    upright = BytesOf(image);
  });
  return upright;
}

}  // namespace mgsfm
