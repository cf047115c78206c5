// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

namespace mgsfm {

// The longest side that OpenCV reads (OPENCV_IO_MAX_IMAGE_WIDTH).
constexpr int kMaxImageSide_px = 1 << 20;

// ReadImageSize needs no more bytes of a file. Only tags precede the size; the
// largest one, a preview, has at most 64 KiB.
constexpr size_t kMaxImageHeaderBytes = size_t{1} << 20;

}  // namespace mgsfm
