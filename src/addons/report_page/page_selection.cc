// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/page_selection.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <unordered_map>

#include "base/file_reading.h"
#include "base/parallel.h"
#include "base/random.h"
#include "base/ranges.h"
#include "files/image_reading.h"
#include "files/image_writing.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

// Extends the box by the range of the coordinates between two quantiles,
// widened by its own length on both sides.
void ExtendByMost(const std::vector<Vector3d>& places, double quantile,
                  AlignedBox3d* box) {
  if (places.empty()) return;
  Vector3d min, max;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values =
        Transformed(places, [&](const Vector3d& place) { return place[axis]; });
    min[axis] = Quantile(values, quantile);
    max[axis] = Quantile(std::move(values), 1.0 - quantile);
  }
  const Vector3d margin = max - min;
  AlignedBox3d most;
  for (const Vector3d& place : places) {
    const bool is_near = ((place - min + margin).array() >= 0.0).all() &&
                         ((max + margin - place).array() >= 0.0).all();
    if (is_near) most.extend(place);
  }
  if (!most.isEmpty()) box->extend(most);
}

// Cubes, so many along the longest side of the box.
constexpr int kNumCells = 256;

uint32_t CellOf(const Vector3d& point, const AlignedBox3d& box) {
  const double cells_per_unit =
      kNumCells / std::max(box.sizes().maxCoeff(), 1e-300);
  const Eigen::Array3i cell = ((point - box.min()).array() * cells_per_unit)
                                  .min(kNumCells - 1.0)
                                  .cast<int>();
  return static_cast<uint32_t>((cell.x() * kNumCells + cell.y()) * kNumCells +
                               cell.z());
}

double Weight(const Point3D& point, uint32_t num_in_cell) {
  // Longer tracks are not shown before points of other places.
  constexpr double kMaxLength = 12.0;
  const double length =
      std::min(static_cast<double>(point.track.size()), kMaxLength);
  return std::max(length, 1.0) / (1.0 + point.error_px.value_or(0.0)) /
         std::sqrt(static_cast<double>(num_in_cell));
}

}  // namespace

AlignedBox3d ShownBox(const Reconstruction& reconstruction) {
  // Most wrong points lie far outside, in the direction of a ray.
  constexpr double kPointQuantile = 0.005, kFrameQuantile = 0.01;
  std::vector<Vector3d> centers, points;
  for (const auto& pose : reconstruction.rig_from_world) {
    if (pose && pose->Center().allFinite()) centers.push_back(pose->Center());
  }
  for (const Point3D& point : reconstruction.points) {
    if (point.point_in_world.allFinite()) {
      points.push_back(point.point_in_world);
    }
  }
  AlignedBox3d box;
  ExtendByMost(centers, kFrameQuantile, &box);
  ExtendByMost(points, kPointQuantile, &box);
  if (box.isEmpty()) box.extend(Vector3d::Zero());
  return box;
}

std::vector<size_t> SelectPoints(const Reconstruction& reconstruction,
                                 const AlignedBox3d& box, size_t max_points) {
  const std::vector<Point3D>& points = reconstruction.points;
  std::unordered_map<uint32_t, uint32_t> num_in_cell;
  for (const Point3D& point : points) {
    if (box.contains(point.point_in_world)) {
      ++num_in_cell[CellOf(point.point_in_world, box)];
    }
  }
  // The points with the largest u^(1/weight), u uniform in (0, 1).
  Random random(0);
  std::vector<std::pair<double, size_t>> keys;
  for (size_t i = 0; i < points.size(); ++i) {
    const double uniform = random.Uniform();
    if (!box.contains(points[i].point_in_world)) continue;
    const uint32_t count = num_in_cell[CellOf(points[i].point_in_world, box)];
    keys.emplace_back(-std::log(uniform) / Weight(points[i], count), i);
  }
  const size_t num_selected = std::min(max_points, keys.size());
  const auto end = keys.begin() + static_cast<std::ptrdiff_t>(num_selected);
  std::partial_sort(keys.begin(), end, keys.end());
  std::vector<size_t> selected;
  for (auto key = keys.begin(); key != end; ++key) {
    selected.push_back(key->second);
  }
  return selected;
}

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
