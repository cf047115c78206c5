// SPDX-License-Identifier: BSD-3-Clause
#include "features/sift.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/core/hal/hal.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "features/four.h"
#include "features/scale_space.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using SiftDescriptor = std::array<float, 128>;

// Orientations and descriptors of points from the image gradients around them.
// Reuses its memory; use one per thread. Angles are in radians from x to y
// (clockwise, as y points down).
class GradientDescriber {
 public:
  // Dominant orientations: peaks of the histogram of gradient directions (36
  // bins) of at least 0.8 of the highest peak; at most `max_num`, the highest
  // first. Gradients are weighted by magnitude and a Gaussian of 1.5 sigma.
  std::vector<float> FindOrientations(const cv::Mat& level,
                                      const ScaleSpacePoint& point,
                                      int max_num);

  // Histograms of 8 directions in 4 x 4 cells of 3 sigma, rotated by the
  // orientation. Gradients are interpolated between the nearest bins in x, y
  // and angle and weighted by a Gaussian of 2 cells. The descriptor is
  // L2-normalized, clipped at 0.2 and normalized again. Order: rows, columns,
  // directions; these run from y to x, like Lowe's.
  SiftDescriptor Describe(const cv::Mat& level, const ScaleSpacePoint& point,
                          float orientation_rad);

 private:
  // Gradients of pixels; the first `size` elements of the arrays are valid.
  struct Gradients {
    size_t size = 0;
    std::vector<float> dx, dy;       // derivatives of the gray value
    std::vector<float> weight;       // Gaussian
    std::vector<float> column, row;  // position in cells of the descriptor
    std::vector<float> length, angle;
    std::vector<int> sum_idx;

    // Makes room for `capacity` gradients and sets size to 0.
    void Reserve(size_t capacity);
    void ComputePolar();
    // Sets the sums of a CellHistogram that gradients are added to, and
    // replaces angle, column and row by fractions of their intervals. The
    // descriptor has the orientation.
    void FindSums(float orientation_rad);
  };
  // Appends the gradients of pixels [begin, end) of row y, weighted by
  // exp(factor |pixel - point|^2).
  void AppendRow(const cv::Mat& level, const ScaleSpacePoint& point,
                 float factor, int y, int begin, int end);
  // The factor of this weight that depends on x, for pixels [begin, end).
  void ComputeColumnWeights(float center, float factor, int begin, int end);
  void GatherCells(const cv::Mat& level, const ScaleSpacePoint& point,
                   float orientation_rad);

  Gradients gradients_;
  int first_column_ = 0;
  std::vector<float> column_weights_;
};

// Rows are too far apart for the processor to fetch them ahead. Without these
// requests, extraction takes 1.1 times as long.
constexpr int kNumPrefetchedRows = 5;
constexpr int kLineSize = 16;  // pixels of a line of the cache

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

// A range of pixels with gradients.
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
// bounds check. Each place between four cells has a sum per cell and direction,
// so that a gradient is added by two instructions.
class CellHistogram {
 public:
  // Columns and rows are in [0, kNumCells + 1), counted from the margin;
  // directions are in [0, kNumDirections]. A sum is that of a place (row,
  // column), between the cells (row, column) and (row + 1, column + 1).
  static constexpr int kNumColumns = kNumCells + 1;
  static constexpr int kNumSums = kNumDirections + 2;

  // Divides a value among the cells at a place, and the direction of `sum_idx`
  // and the next, by the distance to them.
  void Add(int sum_idx, float column_fraction, float row_fraction,
           float direction_fraction, float value) {
    const float below = value * row_fraction;
    const float above = value - below;
    const float above_right = above * column_fraction;
    const float below_right = below * column_fraction;
    const Four cells = {above - above_right, above_right, below - below_right,
                        below_right};
    const Four next = cells * direction_fraction;
    sums_[sum_idx] += cells - next;
    sums_[sum_idx + 1] += next;
  }

  SiftDescriptor Inner() const {
    SiftDescriptor inner;
    float* out = inner.data();
    for (int row = 1; row <= kNumCells; ++row) {
      for (int column = 1; column <= kNumCells; ++column) {
        for (int d = 0; d < kNumDirections; ++d) out[d] = At(row, column, d);
        out[0] += At(row, column, kNumDirections);  // 2 pi is 0
        out += kNumDirections;
      }
    }
    return inner;
  }

 private:
  // The value of a cell, from the four places around it.
  float At(int row, int column, int direction) const {
    const auto sums = [&](int r, int c) -> const auto& {
      return sums_[(r * kNumColumns + c) * kNumSums + direction];
    };
    return sums(row, column)[0] + sums(row, column - 1)[1] +
           sums(row - 1, column)[2] + sums(row - 1, column - 1)[3];
  }

  // Per place and direction: the four cells, row by row.
  std::array<Four, kNumColumns * kNumColumns * kNumSums> sums_{};
};

void Normalize(SiftDescriptor* descriptor) {
  float squared_norm = 0.0f;
  for (const float value : *descriptor) squared_norm += value * value;
  if (!(squared_norm > 0.0f)) return;
  const float factor = 1.0f / std::sqrt(squared_norm);
  for (float& value : *descriptor) value *= factor;
}

void GradientDescriber::Gradients::Reserve(size_t capacity) {
  size = 0;
  capacity += 3;  // the last step is a whole one
  if (dx.size() >= capacity) return;
  sum_idx.resize(capacity);
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

void GradientDescriber::Gradients::FindSums(float orientation_rad) {
  // Returns the fractions of values, and leaves the integers.
  const auto split = [](Four* values) {
    const Four integers = __builtin_convertvector(
        __builtin_convertvector(*values, FourInts), Four);
    return std::exchange(*values, integers) - integers;
  };
  for (size_t i = 0; i < size; i += 4) {
    // Orientations exceed the range [0, 2 pi) by at most half a bin.
    Four d = orientation_rad - LoadFour(&angle[i]);
    d = d < 0.0f ? d + kTwoPi : d;
    d = d >= kTwoPi ? d - kTwoPi : d;
    d = (d > 0.0f ? d : Four{}) * (kNumDirections / kTwoPi);
    Four c = LoadFour(&column[i]);
    Four r = LoadFour(&row[i]);
    StoreFour(split(&d), &angle[i]);
    StoreFour(split(&c), &column[i]);
    StoreFour(split(&r), &row[i]);
    const Four idx =
        (r * CellHistogram::kNumColumns + c) * CellHistogram::kNumSums + d;
    StoreFour(__builtin_convertvector(idx, FourInts), &sum_idx[i]);
  }
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
  const float* later =
      level.ptr<float>(std::min(y + kNumPrefetchedRows, level.rows - 1));
  for (int x = begin; x < end + kLineSize; x += kLineSize) {
    __builtin_prefetch(later + x);
  }
  const float dy = static_cast<float>(y) - point.y;
  const float row_weight = std::exp(factor * dy * dy);
  const float* weights = column_weights_.data() + (begin - first_column_);
  float* gradient_x = gradients_.dx.data() + gradients_.size;
  float* gradient_y = gradients_.dy.data() + gradients_.size;
  float* weight = gradients_.weight.data() + gradients_.size;
  int x = begin;
  for (; x + 4 <= end; x += 4) {
    const int i = x - begin;
    StoreFour(LoadFour(pixel + x + 1) - LoadFour(pixel + x - 1),
              gradient_x + i);
    StoreFour(LoadFour(below + x) - LoadFour(above + x), gradient_y + i);
    StoreFour(row_weight * LoadFour(weights + i), weight + i);
  }
  for (; x < end; ++x) {
    const int i = x - begin;
    gradient_x[i] = pixel[x + 1] - pixel[x - 1];
    gradient_y[i] = below[x] - above[x];
    weight[i] = row_weight * weights[i];
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
    const int k = static_cast<int>(bin);  // at most the number of bins
    const int before = k < kNumOrientationBins ? k : 0;
    const int after = before + 1 < kNumOrientationBins ? before + 1 : 0;
    const float fraction = bin - static_cast<float>(k);
    const float value = gradients_.weight[i] * gradients_.length[i];
    histogram[before] += (1.0f - fraction) * value;
    histogram[after] += fraction * value;
  }
  std::vector<std::pair<float, float>> peaks = FindPeaks(Smooth(histogram));
  StableSortDescendingBy(&peaks, [](const auto& a) { return a.first; });
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
  gradients_.FindSums(orientation_rad);
  CellHistogram histogram;
  for (size_t i = 0; i < gradients_.size; ++i) {
    histogram.Add(gradients_.sum_idx[i], gradients_.column[i],
                  gradients_.row[i], gradients_.angle[i],
                  gradients_.length[i] * gradients_.weight[i]);
  }
  SiftDescriptor descriptor = histogram.Inner();
  Normalize(&descriptor);
  for (float& value : descriptor) value = std::min(value, kMaxElement);
  Normalize(&descriptor);
  return descriptor;
}

struct PreparedImage {
  cv::Mat image;         // floats in [0, 1]
  float scale_x = 1.0f;  // pixels of the original per pixel of the image
  float scale_y = 1.0f;
};

// Converts to floats and downscales to max_image_size.
PreparedImage PrepareImage(const GrayImage& image, const SiftOptions& options) {
  // cv::Mat cannot refer to const data; it is only read.
  const cv::Mat original(static_cast<int>(image.rows()),
                         static_cast<int>(image.cols()), CV_8U,
                         const_cast<uint8_t*>(image.data()));
  PreparedImage prepared;
  original.convertTo(prepared.image, CV_32F, 1.0 / 255.0);
  const int max_size = std::max(original.cols, original.rows);
  if (max_size <= options.max_image_size) return prepared;
  const double scale = static_cast<double>(options.max_image_size) / max_size;
  const cv::Size size(std::max(1, static_cast<int>(original.cols * scale)),
                      std::max(1, static_cast<int>(original.rows * scale)));
  cv::Mat scaled;
  cv::resize(prepared.image, scaled, size, 0.0, 0.0, cv::INTER_AREA);
  prepared.image = scaled;
  prepared.scale_x =
      static_cast<float>(original.cols) / static_cast<float>(size.width);
  prepared.scale_y =
      static_cast<float>(original.rows) / static_cast<float>(size.height);
  return prepared;
}

// A point and one of its orientations.
struct OrientedPoint {
  const ScaleSpacePoint* point;
  float orientation_rad;
  float scale;  // in pixels of the prepared image
};

// Sorted by detection, then by descending peak.
std::vector<OrientedPoint> FindOrientations(const ScaleSpace& space,
                                            const SiftOptions& options,
                                            GradientDescriber* describer) {
  std::vector<OrientedPoint> oriented;
  for (const ScaleSpacePoint& point : space.points) {
    const Octave& octave = space.octaves[point.octave_idx];
    const float scale = std::ldexp(point.sigma, octave.index);
    for (const float orientation_rad : describer->FindOrientations(
             octave.levels[point.level], point, options.max_num_orientations)) {
      oriented.push_back({&point, orientation_rad, scale});
    }
  }
  return oriented;
}

// Sorts by descending scale and keeps the first `max_num`.
void SelectLargest(int max_num, std::vector<OrientedPoint>* oriented) {
  StableSortDescendingBy(oriented, &OrientedPoint::scale);
  if (oriented->size() > static_cast<size_t>(max_num)) {
    oriented->resize(static_cast<size_t>(max_num));
  }
}

void RootNormalize(const SiftDescriptor& descriptor, uint8_t* normalized) {
  float sum = 0.0f;
  for (const float value : descriptor) sum += value;
  const float factor = sum > 0.0f ? 1.0f / sum : 0.0f;
  for (size_t i = 0; i < descriptor.size(); ++i) {
    const float value = std::round(512.0f * std::sqrt(descriptor[i] * factor));
    normalized[i] = static_cast<uint8_t>(std::min(255.0f, value));
  }
}

}  // namespace

Features ExtractSift(const GrayImage& image, const SiftOptions& options) {
  Features features;
  if (image.size() == 0) return features;
  const PreparedImage prepared = PrepareImage(image, options);
  const ScaleSpace space = BuildScaleSpace(prepared.image, options);
  GradientDescriber describer;
  std::vector<OrientedPoint> oriented =
      FindOrientations(space, options, &describer);
  SelectLargest(options.max_num_features, &oriented);

  features.descriptors.resize(static_cast<Eigen::Index>(oriented.size()), 128);
  const float mean_scale = 0.5f * (prepared.scale_x + prepared.scale_y);
  // Points in the order of the image find the pixels of their neighbors in the
  // cache.
  std::vector<size_t> order = Indices<size_t>(oriented.size());
  SortBy(
      &order, [&](size_t i) -> const auto& { return oriented[i].point; });
  features.keypoints.resize(oriented.size());
  for (const size_t i : order) {
    const ScaleSpacePoint& point = *oriented[i].point;
    const Octave& octave = space.octaves[point.octave_idx];
    features.keypoints[i] = FeatureKeypoint::FromScale(
        (std::ldexp(point.x, octave.index) + 0.5f) * prepared.scale_x,
        (std::ldexp(point.y, octave.index) + 0.5f) * prepared.scale_y,
        oriented[i].scale * mean_scale, oriented[i].orientation_rad);
    RootNormalize(
        describer.Describe(octave.levels[point.level], point,
                           oriented[i].orientation_rad),
        features.descriptors.row(static_cast<Eigen::Index>(i)).data());
  }
  return features;
}

}  // namespace mgsfm
