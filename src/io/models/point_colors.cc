// SPDX-License-Identifier: BSD-3-Clause
#include "models/point_colors.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/file_reading.h"
#include "base/parallel.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Rgb = Eigen::Vector3f;

// Ignores the EXIF orientation, as feature extraction does. Returns an empty
// image if the file cannot be read.
cv::Mat ReadImage(const std::filesystem::path& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return {};
  try {
    return DecodeForDisplay(ReadFile(path),
                            cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const Error&) {
    return {};
  }
}

// Empty if the image has the size of the camera.
std::string WhyUnusable(const cv::Mat& image, const Camera& camera) {
  if (image.empty()) return "cannot be read";
  if (image.cols == camera.width_px && image.rows == camera.height_px) {
    return "";
  }
  return "has " + SizeText(image.cols, image.rows) + " px, its camera " +
         SizeText(camera.width_px, camera.height_px);
}

// An observation of one image and where its color goes.
struct Sample {
  int keypoint_idx;
  size_t sample_idx;
};

Rgb PixelAt(const cv::Mat& bgr, int x, int y) {
  const auto& pixel = bgr.at<cv::Vec3b>(std::clamp(y, 0, bgr.rows - 1),
                                        std::clamp(x, 0, bgr.cols - 1));
  return {static_cast<float>(pixel[2]), static_cast<float>(pixel[1]),
          static_cast<float>(pixel[0])};
}

// Bilinear; the center of the first pixel is (0.5, 0.5).
Rgb Interpolate(const cv::Mat& bgr, const Eigen::Vector2f& keypoint_px) {
  // Pixels beyond the border repeat the border.
  const float x = std::clamp(keypoint_px.x() - 0.5f, 0.0f,
                             static_cast<float>(bgr.cols - 1));
  const float y = std::clamp(keypoint_px.y() - 0.5f, 0.0f,
                             static_cast<float>(bgr.rows - 1));
  const int x0 = static_cast<int>(std::floor(x));
  const int y0 = static_cast<int>(std::floor(y));
  const float dx = x - static_cast<float>(x0);
  const float dy = y - static_cast<float>(y0);
  return (1 - dy) *
             ((1 - dx) * PixelAt(bgr, x0, y0) + dx * PixelAt(bgr, x0 + 1, y0)) +
         dy * ((1 - dx) * PixelAt(bgr, x0, y0 + 1) +
               dx * PixelAt(bgr, x0 + 1, y0 + 1));
}

}  // namespace

std::vector<UncoloredImage> ColorPoints(const Scene& scene,
                                        const std::filesystem::path& image_path,
                                        const Context& context,
                                        Reconstruction* reconstruction) {
  std::vector<std::vector<Sample>> samples(scene.images.size());
  size_t num_samples = 0;
  for (const Point3D& point : reconstruction->points) {
    for (const Observation& o : point.track) {
      samples[o.image_idx].push_back({o.keypoint_idx, num_samples++});
    }
  }

  const QuietImageLibraries quiet;
  std::vector<Rgb> colors(num_samples, Rgb::Zero());
  std::vector<std::string> problems(scene.images.size());
  ParallelFor(
      scene.images.size(), context.num_threads,
      [&](size_t image_idx) {
        if (samples[image_idx].empty()) return;
        const Image& image = scene.images[image_idx];
        const cv::Mat bgr = StaysInFolder(image.name)
                                ? ReadImage(image_path / image.name)
                                : cv::Mat();
        problems[image_idx] = WhyUnusable(bgr, scene.cameras[image.camera_idx]);
        if (!problems[image_idx].empty()) return;
        for (const Sample& sample : samples[image_idx]) {
          colors[sample.sample_idx] =
              Interpolate(bgr, image.keypoints_px[sample.keypoint_idx]);
        }
      },
      1,
      [&](size_t num_done) {
        context.ReportProgress("colors", num_done, scene.images.size());
      });

  size_t sample_idx = 0;
  for (Point3D& point : reconstruction->points) {
    Rgb sum = Rgb::Zero();
    int count = 0;
    for (const Observation& o : point.track) {
      const Rgb& color = colors[sample_idx++];
      if (!problems[o.image_idx].empty()) continue;
      sum += color;
      ++count;
    }
    if (count == 0) continue;
    point.color =
        (sum / static_cast<float>(count)).array().round().cast<uint8_t>();
  }
  std::vector<UncoloredImage> unused;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (problems[i].empty()) continue;
    unused.push_back({scene.images[i].name, problems[i]});
  }
  SortBy(&unused, &UncoloredImage::name);
  return unused;
}

}  // namespace mgsfm
