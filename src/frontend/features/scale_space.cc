// SPDX-License-Identifier: BSD-3-Clause
#include "features/scale_space.h"

#include <sys/mman.h>
#include <unistd.h>

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "features/four.h"

namespace mgsfm {
namespace {

// Base blur and assumed blur of the input image, in pixels (Lowe, sec. 3.3).
constexpr double kBaseSigma = 1.6;
constexpr double kImageSigma = 0.5;
// The descriptor window, at least 19 px wide, is mostly outside smaller images.
constexpr int kMinOctaveSize = 8;
// Pixels need less contrast than the refined extremum, which is stronger. The
// values are those of VLFeat, which COLMAP uses.
constexpr float kPixelThresholdFactor = 0.8f;
constexpr int kMaxRefinementSteps = 5;
constexpr double kMaxStep = 0.6;    // beyond it the next pixel is nearer
constexpr double kMaxOffset = 1.5;  // beyond it the quadratic is invalid

using DogTriple = std::array<const cv::Mat*, 3>;

// An uninitialized image, in huge pages where the system has them. The system
// maps and clears small pages one by one at their first write.
cv::Mat NewImage(int rows, int cols) {
  cv::Mat image(rows, cols, CV_32F);
#if defined(MADV_HUGEPAGE)
  uchar* const page =
      cv::alignPtr(image.data, static_cast<int>(sysconf(_SC_PAGESIZE)));
  if (page < image.dataend) {
    madvise(page, image.dataend - page, MADV_HUGEPAGE);
  }
#endif
  return image;
}

// Pixel 2 i is pixel i; pixels in between are the mean of their neighbors.
cv::Mat DoubleSize(const cv::Mat& image) {
  cv::Mat doubled = NewImage(2 * image.rows, 2 * image.cols);
  for (int y = 0; y < doubled.rows; ++y) {
    const float* above = image.ptr<float>(y / 2);
    const float* below =
        image.ptr<float>(std::min((y + 1) / 2, image.rows - 1));
    float* row = doubled.ptr<float>(y);
    for (int x = 0; x < image.cols; ++x) {
      const int next = std::min(x + 1, image.cols - 1);
      row[2 * x] = 0.5f * (above[x] + below[x]);
      row[2 * x + 1] =
          0.25f * (above[x] + below[x] + above[next] + below[next]);
    }
  }
  return doubled;
}

cv::Mat HalveSize(const cv::Mat& image) {
  cv::Mat halved = NewImage((image.rows + 1) / 2, (image.cols + 1) / 2);
  for (int y = 0; y < halved.rows; ++y) {
    const float* source = image.ptr<float>(2 * y);
    float* row = halved.ptr<float>(y);
    for (int x = 0; x < halved.cols; ++x) row[x] = source[2 * x];
  }
  return halved;
}

// Increases the blur from `sigma1` to `sigma2`.
cv::Mat Blur(const cv::Mat& image, double sigma1, double sigma2) {
  const double sigma = std::sqrt(sigma2 * sigma2 - sigma1 * sigma1);
  cv::Mat blurred = NewImage(image.rows, image.cols);
  cv::GaussianBlur(image, blurred, cv::Size(), sigma, sigma,
                   cv::BORDER_REPLICATE);
  return blurred;
}

// Whether D at `center` is above (sign 1) or below (sign -1) all neighbors.
bool IsExtremum(const std::array<const float*, 3>& center, ptrdiff_t stride,
                float sign) {
  const float value = sign * center[1][0];
  for (const int s : {1, 0, 2}) {
    for (ptrdiff_t dy = -stride; dy <= stride; dy += stride) {
      for (ptrdiff_t dx = -1; dx <= 1; ++dx) {
        const bool is_center = s == 1 && dy == 0 && dx == 0;
        if (!is_center && sign * center[s][dy + dx] >= value) return false;
      }
    }
  }
  return true;
}

// D and its derivatives with respect to x, y and scale at a pixel.
struct Quadratic {
  double value = 0.0;
  Eigen::Vector3d gradient;
  Eigen::Matrix3d hessian;
};

Quadratic FitQuadratic(const DogTriple& dogs, int x, int y) {
  const auto at = [&](int dx, int dy, int ds) {
    return static_cast<double>(dogs[1 + ds]->at<float>(y + dy, x + dx));
  };
  Quadratic q;
  q.value = at(0, 0, 0);
  q.gradient << 0.5 * (at(1, 0, 0) - at(-1, 0, 0)),
      0.5 * (at(0, 1, 0) - at(0, -1, 0)), 0.5 * (at(0, 0, 1) - at(0, 0, -1));
  const double dxx = at(1, 0, 0) + at(-1, 0, 0) - 2.0 * q.value;
  const double dyy = at(0, 1, 0) + at(0, -1, 0) - 2.0 * q.value;
  const double dss = at(0, 0, 1) + at(0, 0, -1) - 2.0 * q.value;
  const double dxy =
      0.25 * (at(1, 1, 0) + at(-1, -1, 0) - at(-1, 1, 0) - at(1, -1, 0));
  const double dxs =
      0.25 * (at(1, 0, 1) + at(-1, 0, -1) - at(-1, 0, 1) - at(1, 0, -1));
  const double dys =
      0.25 * (at(0, 1, 1) + at(0, -1, -1) - at(0, -1, 1) - at(0, 1, -1));
  q.hessian << dxx, dxy, dxs, dxy, dyy, dys, dxs, dys, dss;
  return q;
}

bool IsEdge(const Eigen::Matrix3d& hessian, double edge_threshold) {
  const double trace = hessian(0, 0) + hessian(1, 1);
  const double determinant = hessian.topLeftCorner<2, 2>().determinant();
  const double limit =
      (edge_threshold + 1.0) * (edge_threshold + 1.0) / edge_threshold;
  return !(determinant > 0.0) || trace * trace >= limit * determinant;
}

// Refines the extremum near a pixel; false if it is rejected.
bool Refine(const DogTriple& dogs, int x, int y, const SiftOptions& options,
            ScaleSpacePoint* point) {
  const int width = dogs[1]->cols;
  const int height = dogs[1]->rows;
  Quadratic q;
  Eigen::Vector3d offset;
  for (int step = 0; step < kMaxRefinementSteps; ++step) {
    q = FitQuadratic(dogs, x, y);
    offset = -q.hessian.fullPivLu().solve(q.gradient);
    const int dx = (offset.x() > kMaxStep && x < width - 2) -
                   (offset.x() < -kMaxStep && x > 1);
    const int dy = (offset.y() > kMaxStep && y < height - 2) -
                   (offset.y() < -kMaxStep && y > 1);
    if (dx == 0 && dy == 0) break;
    x += dx;
    y += dy;
  }
  const double contrast = std::abs(q.value + 0.5 * q.gradient.dot(offset));
  if (!(offset.cwiseAbs().maxCoeff() < kMaxOffset) ||
      !(contrast > options.peak_threshold) ||
      IsEdge(q.hessian, options.edge_threshold)) {
    return false;
  }
  const double x_refined = x + offset.x();
  const double y_refined = y + offset.y();
  const double level = point->level + offset.z();
  point->x = static_cast<float>(x_refined);
  point->y = static_cast<float>(y_refined);
  point->sigma =
      static_cast<float>(LevelSigma(level, options.octave_resolution));
  point->contrast = static_cast<float>(contrast);
  return x_refined >= 0.0 && x_refined <= width - 1 && y_refined >= 0.0 &&
         y_refined <= height - 1 && level >= 0.0 &&
         level <= options.octave_resolution + 1;
}

// Whether D at one of the four pixels from `pixels` on has at least the
// threshold and is above, or below, its neighbors in the row and the column.
bool MayHaveExtremum(const float* pixels, ptrdiff_t stride, float threshold) {
  const Four d = LoadFour(pixels);
  const Four left = LoadFour(pixels - 1);
  const Four right = LoadFour(pixels + 1);
  const Four above = LoadFour(pixels - stride);
  const Four below = LoadFour(pixels + stride);
  return HasAny(((d >= threshold) & (d > left) & (d > right) & (d > above) &
                 (d > below)) |
                ((d <= -threshold) & (d < left) & (d < right) & (d < above) &
                 (d < below)));
}

void DetectExtrema(const DogTriple& dogs, int octave_idx, int level,
                   const SiftOptions& options,
                   std::vector<ScaleSpacePoint>* points) {
  const auto threshold =
      kPixelThresholdFactor * static_cast<float>(options.peak_threshold);
  const auto stride = static_cast<ptrdiff_t>(dogs[1]->step1());
  for (int y = 1; y + 1 < dogs[1]->rows; ++y) {
    std::array<const float*, 3> rows;
    for (int s = 0; s < 3; ++s) rows[s] = dogs[s]->ptr<float>(y);
    for (int x = 1; x + 1 < dogs[1]->cols; ++x) {
      while (x + 5 < dogs[1]->cols &&
             !MayHaveExtremum(rows[1] + x, stride, threshold)) {
        x += 4;
      }
      const float value = rows[1][x];
      if (std::abs(value) < threshold) continue;
      const std::array<const float*, 3> center = {rows[0] + x, rows[1] + x,
                                                  rows[2] + x};
      if (!IsExtremum(center, stride, value > 0.0f ? 1.0f : -1.0f)) continue;
      ScaleSpacePoint point;
      point.octave_idx = octave_idx;
      point.level = level;
      if (Refine(dogs, x, y, options, &point)) points->push_back(point);
    }
  }
}

// Blurs, detects, and keeps the levels for descriptors. Returns the level from
// which the next octave is made.
cv::Mat ProcessOctave(const cv::Mat& base, const SiftOptions& options,
                      ScaleSpace* space) {
  const int resolution = options.octave_resolution;
  const auto octave_idx = static_cast<int>(space->octaves.size()) - 1;
  std::vector<cv::Mat>& levels = space->octaves.back().levels;
  std::array<cv::Mat, 3> dogs;
  levels.assign(resolution + 3, cv::Mat());
  for (cv::Mat& dog : dogs) dog = NewImage(base.rows, base.cols);
  levels[0] = base;
  for (int k = 1; k < resolution + 3; ++k) {
    levels[k] = Blur(levels[k - 1], LevelSigma(k - 1, resolution),
                     LevelSigma(k, resolution));
    std::swap(dogs[0], dogs[1]);
    std::swap(dogs[1], dogs[2]);
    cv::subtract(levels[k], levels[k - 1], dogs[2]);
    if (k < 3) continue;
    DetectExtrema({&dogs[0], &dogs[1], &dogs[2]}, octave_idx, k - 2, options,
                  &space->points);
  }
  levels.resize(resolution + 1);
  levels[0].release();
  return levels[resolution];
}

}  // namespace

double LevelSigma(double level, int octave_resolution) {
  return kBaseSigma * std::exp2(level / octave_resolution);
}

ScaleSpace BuildScaleSpace(const cv::Mat& image, const SiftOptions& options) {
  ScaleSpace space;
  cv::Mat base = Blur(DoubleSize(image), 2.0 * kImageSigma, kBaseSigma);
  for (int i = 0; i < options.num_octaves; ++i) {
    if (std::min(base.rows, base.cols) < kMinOctaveSize) break;
    space.octaves.push_back({i - 1, {}});
    base = HalveSize(ProcessOctave(base, options, &space));
  }
  return space;
}

}  // namespace mgsfm
