// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <memory>

#include "features/image_file.h"
#include "files/image_reading.h"
#include "fuzz/fuzz_target.h"

namespace mgsfm {

// The input is an image file: EXIF is a TIFF file, alone or in a JPEG.
void FuzzExif(const std::string& input) {
  const QuietImageLibraries quiet;
  const ImageTags tags = ReadTags(input, 640, 480);
  FUZZ_CHECK(!tags.focal_length_px || (std::isfinite(*tags.focal_length_px) &&
                                       *tags.focal_length_px > 0.0));
  FUZZ_CHECK(!tags.position_wgs84 || tags.position_wgs84->allFinite());
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(exif, mgsfm::FuzzExif)
