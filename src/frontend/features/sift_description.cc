// SPDX-License-Identifier: BSD-3-Clause
#include "features/sift_description.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core/hal/hal.hpp>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

constexpr auto kTwoPi = static_cast<float>(2.0 * kPi);

// Lowe, sec. 5; the smoothing is VLFeat's.
constexpr int kNumOrientationBins = 36;
constexpr int kNumSmoothings = 6;
constexpr float kMinPeakRatio = 0.8f;
constexpr float kOrientationWindow = 1.5f;  // sigmas

// Lowe, sec. 6; the cell size is VLFeat's.
constexpr int kNumCells = 4;  // in each direction
constexpr int kNumDirections = 8;
constexpr float kCellSize = 3.0f;     // sigmas
constexpr float kWindowSigma = 2.0f;  // cells
constexpr float kMaxElement = 0.2f;

// A range of pixels that have a gradient.
struct PixelRange {
  int begin;
  int end;
};

PixelRange InnerRange(float center, float radius, int size) {
  return {
      std::max(1, static_cast<int>(std::ceil(center - radius))),
      std::min(size - 1, static_cast<int>(std::floor(center + radius)) + 1)};
}

size_t Area(const PixelRange& rows, const PixelRange& columns) {
  return static_cast<size_t>(std::max(0, rows.end - rows.begin)) *
         static_cast<size_t>(std::max(0, columns.end - columns.begin));
}

// Restricts the range of x to |offset + slope x| < limit.
void Narrow(float offset, float slope, float limit, PixelRange* range) {
  // A row of 1e6 pixels changes the offset by at most one pixel.
  constexpr float kMinSlope = 1e-6f;
  if (std::abs(slope) < kMinSlope) {
    if (std::abs(offset) >= limit) range->end = range->begin;
    return;
  }
  const float a = (-limit - offset) / slope;
  const float b = (limit - offset) / slope;
  constexpr float kFar = 1e6f;  // keeps the conversion to int defined
  const float low = std::clamp(std::min(a, b), -kFar, kFar);
  const float high = std::clamp(std::max(a, b), -kFar, kFar);
  range->begin = std::max(range->begin, static_cast<int>(std::floor(low)) + 1);
  range->end = std::min(range->end, static_cast<int>(std::ceil(high)));
}

using OrientationHistogram = std::array<float, kNumOrientationBins>;

OrientationHistogram Smooth(OrientationHistogram histogram) {
  for (int i = 0; i < kNumSmoothings; ++i) {
    const OrientationHistogram h = histogram;
    for (int k = 0; k < kNumOrientationBins; ++k) {
      histogram[k] = (h[(k + kNumOrientationBins - 1) % kNumOrientationBins] +
                      h[k] + h[(k + 1) % kNumOrientationBins]) /
                     3.0f;
    }
  }
  return histogram;
}

// Heights and angles of the peaks.
std::vector<std::pair<float, float>> FindPeaks(const OrientationHistogram& h) {
  const float threshold = kMinPeakRatio * *std::max_element(h.begin(), h.end());
  std::vector<std::pair<float, float>> peaks;
  for (int k = 0; k < kNumOrientationBins; ++k) {
    const float before = h[(k + kNumOrientationBins - 1) % kNumOrientationBins];
    const float after = h[(k + 1) % kNumOrientationBins];
    if (h[k] < threshold || h[k] <= before || h[k] <= after) continue;
    // Vertex of the parabola through the three bins.
    const float offset =
        0.5f * (before - after) / (before + after - 2.0f * h[k]);
    const float bin = static_cast<float>(k) + offset;
    peaks.emplace_back(
        h[k], bin * (kTwoPi / static_cast<float>(kNumOrientationBins)));
  }
  return peaks;
}

// Histogram with a margin of one cell on each side, so that no gradient needs a
// bounds check.
class CellHistogram {
 public:
  // Column and row are in [0, kNumCells + 1), counted from the margin;
  // direction is in [0, kNumDirections].
  void Add(float column, float row, float direction, float value) {
    const int c = static_cast<int>(column);
    const int r = static_cast<int>(row);
    const int d = static_cast<int>(direction);
    const float fc = column - static_cast<float>(c);
    const float fr = row - static_cast<float>(r);
    const float fd = direction - static_cast<float>(d);
    const float below = value * fr;
    const float above = value - below;
    const float above_right = above * fc;
    const float below_right = below * fc;
    float* bin = &bins_[(r * kRowSize + c) * kColumnSize + d];
    AddPair(above - above_right, fd, bin);
    AddPair(above_right, fd, bin + kColumnSize);
    bin += kRowSize * kColumnSize;
    AddPair(below - below_right, fd, bin);
    AddPair(below_right, fd, bin + kColumnSize);
  }

  SiftDescriptor Inner() const {
    SiftDescriptor inner;
    float* out = inner.data();
    for (int r = 1; r <= kNumCells; ++r) {
      for (int c = 1; c <= kNumCells; ++c) {
        const float* bin = &bins_[(r * kRowSize + c) * kColumnSize];
        std::copy(bin, bin + kNumDirections, out);
        out[0] += bin[kNumDirections];  // 2 pi is 0
        out += kNumDirections;
      }
    }
    return inner;
  }

 private:
  static constexpr int kRowSize = kNumCells + 2;
  static constexpr int kColumnSize = kNumDirections + 2;
  static void AddPair(float value, float fraction, float* bins) {
    const float second = value * fraction;
    bins[0] += value - second;
    bins[1] += second;
  }

  std::array<float, kRowSize * kRowSize * kColumnSize> bins_{};
};

void Normalize(SiftDescriptor* descriptor) {
  float squared_norm = 0.0f;
  for (const float value : *descriptor) squared_norm += value * value;
  if (!(squared_norm > 0.0f)) return;
  const float factor = 1.0f / std::sqrt(squared_norm);
  for (float& value : *descriptor) value *= factor;
}

}  // namespace

void GradientDescriber::Gradients::Reserve(size_t capacity) {
  size = 0;
  if (dx.size() >= capacity) return;
  for (auto* values : {&dx, &dy, &weight, &column, &row, &length, &angle}) {
    values->resize(capacity);
  }
}

void GradientDescriber::Gradients::ComputePolar() {
  const auto num = static_cast<int>(size);
  cv::hal::magnitude32f(dx.data(), dy.data(), length.data(), num);
  cv::hal::fastAtan32f(dy.data(), dx.data(), angle.data(), num,
                       /*angleInDegrees=*/false);
}

void GradientDescriber::ComputeColumnWeights(float center, float factor,
                                             int begin, int end) {
  first_column_ = begin;
  column_weights_.clear();
  for (int x = begin; x < end; ++x) {
    const float dx = static_cast<float>(x) - center;
    column_weights_.push_back(std::exp(factor * dx * dx));
  }
}

void GradientDescriber::AppendRow(const cv::Mat& level,
                                  const ScaleSpacePoint& point, float factor,
                                  int y, int begin, int end) {
  const float* above = level.ptr<float>(y - 1);
  const float* pixel = level.ptr<float>(y);
  const float* below = level.ptr<float>(y + 1);
  const float dy = static_cast<float>(y) - point.y;
  const float row_weight = std::exp(factor * dy * dy);
  float* out_dx = gradients_.dx.data() + gradients_.size;
  float* out_dy = gradients_.dy.data() + gradients_.size;
  float* out_weight = gradients_.weight.data() + gradients_.size;
  const float* weights = column_weights_.data() + (begin - first_column_);
  for (int i = 0; i < end - begin; ++i) {
    out_dx[i] = pixel[begin + i + 1] - pixel[begin + i - 1];
    out_dy[i] = below[begin + i] - above[begin + i];
    out_weight[i] = row_weight * weights[i];
  }
  gradients_.size += static_cast<size_t>(end - begin);
}

std::vector<float> GradientDescriber::FindOrientations(
    const cv::Mat& level, const ScaleSpacePoint& point, int max_num) {
  const float sigma = kOrientationWindow * point.sigma;
  const float radius = std::max(1.0f, std::floor(3.0f * sigma));
  const float factor = -0.5f / (sigma * sigma);
  const PixelRange rows = InnerRange(point.y, radius, level.rows);
  const PixelRange columns = InnerRange(point.x, radius, level.cols);
  gradients_.Reserve(Area(rows, columns));
  ComputeColumnWeights(point.x, factor, columns.begin, columns.end);
  for (int y = rows.begin; y < rows.end; ++y) {
    const float dy = static_cast<float>(y) - point.y;
    const float half_width =
        std::sqrt(std::max(0.0f, radius * radius - dy * dy));
    const PixelRange inside = InnerRange(point.x, half_width, level.cols);
    if (inside.begin >= inside.end) continue;
    AppendRow(level, point, factor, y, inside.begin, inside.end);
  }
  gradients_.ComputePolar();

  OrientationHistogram histogram{};
  const float bins_per_radian = kNumOrientationBins / kTwoPi;
  for (size_t i = 0; i < gradients_.size; ++i) {
    const float bin = gradients_.angle[i] * bins_per_radian;
    const int k = static_cast<int>(bin);
    const float fraction = bin - static_cast<float>(k);
    const float value = gradients_.weight[i] * gradients_.length[i];
    histogram[k % kNumOrientationBins] += (1.0f - fraction) * value;
    histogram[(k + 1) % kNumOrientationBins] += fraction * value;
  }
  std::vector<std::pair<float, float>> peaks = FindPeaks(Smooth(histogram));
  std::stable_sort(
      peaks.begin(), peaks.end(),
      [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<float> orientations;
  for (const auto& [height, angle] : peaks) {
    if (static_cast<int>(orientations.size()) < max_num) {
      orientations.push_back(angle);
    }
  }
  return orientations;
}

void GradientDescriber::GatherCells(const cv::Mat& level,
                                    const ScaleSpacePoint& point,
                                    float orientation_rad) {
  const float cells_per_pixel = 1.0f / (kCellSize * point.sigma);
  const float c = std::cos(orientation_rad) * cells_per_pixel;
  const float s = std::sin(orientation_rad) * cells_per_pixel;
  // Distance from the center up to which gradients contribute to the outermost
  // cells, up to rounding.
  const float reach = 0.5f * (kNumCells + 1) - 1e-3f;
  const float radius = std::sqrt(2.0f) * reach / cells_per_pixel;
  const float center = 0.5f * (kNumCells + 1);  // one more for the margin
  const float factor =
      -0.5f * cells_per_pixel * cells_per_pixel / (kWindowSigma * kWindowSigma);
  const PixelRange rows = InnerRange(point.y, radius, level.rows);
  const PixelRange all_columns = InnerRange(point.x, radius, level.cols);
  gradients_.Reserve(Area(rows, all_columns));
  ComputeColumnWeights(point.x, factor, all_columns.begin, all_columns.end);
  for (int y = rows.begin; y < rows.end; ++y) {
    const float dy = static_cast<float>(y) - point.y;
    PixelRange columns = all_columns;
    Narrow(s * dy - c * point.x, c, reach, &columns);
    Narrow(c * dy + s * point.x, -s, reach, &columns);
    if (columns.begin >= columns.end) continue;
    float* column = gradients_.column.data() + gradients_.size;
    float* row = gradients_.row.data() + gradients_.size;
    AppendRow(level, point, factor, y, columns.begin, columns.end);
    for (int i = 0; i < columns.end - columns.begin; ++i) {
      const float dx = static_cast<float>(columns.begin + i) - point.x;
      column[i] = c * dx + s * dy + center;
      row[i] = c * dy - s * dx + center;
    }
  }
}

SiftDescriptor GradientDescriber::Describe(const cv::Mat& level,
                                           const ScaleSpacePoint& point,
                                           float orientation_rad) {
  GatherCells(level, point, orientation_rad);
  gradients_.ComputePolar();
  // Orientations exceed [0, 2 pi) by at most half a bin.
  const float bins_per_radian = kNumDirections / kTwoPi;
  for (size_t i = 0; i < gradients_.size; ++i) {
    float angle = orientation_rad - gradients_.angle[i];
    angle += angle < 0.0f ? kTwoPi : 0.0f;
    angle -= angle >= kTwoPi ? kTwoPi : 0.0f;
    gradients_.angle[i] = std::max(0.0f, angle) * bins_per_radian;
    gradients_.length[i] *= gradients_.weight[i];
  }
  CellHistogram histogram;
  for (size_t i = 0; i < gradients_.size; ++i) {
    histogram.Add(gradients_.column[i], gradients_.row[i], gradients_.angle[i],
                  gradients_.length[i]);
  }
  SiftDescriptor descriptor = histogram.Inner();
  Normalize(&descriptor);
  for (float& value : descriptor) value = std::min(value, kMaxElement);
  Normalize(&descriptor);
  return descriptor;
}

}  // namespace mgsfm
