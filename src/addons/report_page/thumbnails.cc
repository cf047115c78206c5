// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/thumbnails.h"

#include <algorithm>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "base/file_reading.h"
#include "base/parallel.h"
#include "files/image_reading.h"
#include "files/image_writing.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Sufficient to recognize a place. A larger size or quality shows fewer images
// within the bytes of a page.
constexpr int kWidthPx = 192;
constexpr int kJpegQuality = 60;
// The size of a thumbnail; textured images of this size and quality need 3 to 8
// kB.
constexpr size_t kTypicalBytes = 7000;
// Reading more images would take longer than everything else together.
constexpr size_t kMaxThumbnails = 400;

// Reads JPEGs at the smallest resolution that suffices, which is faster.
cv::ImreadModes ReadingMode(const Camera& camera) {
  if (camera.width_px >= 8 * kWidthPx) return cv::IMREAD_REDUCED_COLOR_8;
  if (camera.width_px >= 4 * kWidthPx) return cv::IMREAD_REDUCED_COLOR_4;
  if (camera.width_px >= 2 * kWidthPx) return cv::IMREAD_REDUCED_COLOR_2;
  return cv::IMREAD_COLOR;
}

// Empty if the image cannot be read.
std::string MakeJpeg(const std::filesystem::path& path, const Camera& camera) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return {};
  try {
    const cv::Mat image = DecodeForDisplay(
        ReadFile(path), ReadingMode(camera) | cv::IMREAD_IGNORE_ORIENTATION);
    const int height_px =
        std::max(1, image.rows * kWidthPx / std::max(image.cols, 1));
    cv::Mat small;
    cv::resize(image, small, {kWidthPx, std::min(height_px, 4 * kWidthPx)}, 0,
               0, cv::INTER_AREA);
    return EncodeImage(".jpg", small, {cv::IMWRITE_JPEG_QUALITY, kJpegQuality});
  } catch (const Error&) {
    return {};
  }
}

// Images of frames at equal steps, at most `max_images`.
std::vector<int> ChooseImages(const Scene& scene, size_t max_images) {
  if (max_images == 0 || scene.images.empty()) return {};
  const size_t step = (scene.images.size() + max_images - 1) / max_images;
  std::vector<int> chosen;
  for (size_t i = 0; i < scene.frames.size(); i += step) {
    for (const int image_idx : scene.frames[i].image_idxs) {
      if (chosen.size() < max_images) chosen.push_back(image_idx);
    }
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

}  // namespace

std::vector<Thumbnail> MakeThumbnails(const Scene& scene,
                                      const std::string& image_path,
                                      size_t max_bytes,
                                      const Context& context) {
  if (image_path.empty()) return {};
  const std::vector<int> chosen =
      ChooseImages(scene, std::min(max_bytes / kTypicalBytes, kMaxThumbnails));
  std::vector<Thumbnail> all(chosen.size());
  const QuietImageLibraries quiet;
  ParallelFor(
      chosen.size(), context.num_threads,
      [&](size_t i) {
        const Image& image = scene.images[chosen[i]];
        if (!StaysInFolder(image.name)) return;
        all[i] = {chosen[i],
                  MakeJpeg(std::filesystem::path(image_path) / image.name,
                           scene.cameras[image.camera_idx])};
      },
      1, [&](size_t) { context.CheckInterrupted(); });
  std::vector<Thumbnail> thumbnails;
  size_t num_bytes = 0;
  for (Thumbnail& thumbnail : all) {
    num_bytes += thumbnail.jpeg.size();
    if (num_bytes > max_bytes) break;
    if (!thumbnail.jpeg.empty()) thumbnails.push_back(std::move(thumbnail));
  }
  return thumbnails;
}

}  // namespace mgsfm
