// SPDX-License-Identifier: BSD-3-Clause
#include "features/sift.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "features/scale_space.h"
#include "features/sift_description.h"

namespace mgsfm {
namespace {

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
  std::stable_sort(oriented->begin(), oriented->end(),
                   [](const OrientedPoint& a, const OrientedPoint& b) {
                     return a.scale > b.scale;
                   });
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
  for (size_t i = 0; i < oriented.size(); ++i) {
    const ScaleSpacePoint& point = *oriented[i].point;
    const Octave& octave = space.octaves[point.octave_idx];
    features.keypoints.push_back(FeatureKeypoint::FromScale(
        (std::ldexp(point.x, octave.index) + 0.5f) * prepared.scale_x,
        (std::ldexp(point.y, octave.index) + 0.5f) * prepared.scale_y,
        oriented[i].scale * mean_scale, oriented[i].orientation_rad));
    RootNormalize(
        describer.Describe(octave.levels[point.level], point,
                           oriented[i].orientation_rad),
        features.descriptors.row(static_cast<Eigen::Index>(i)).data());
  }
  return features;
}

}  // namespace mgsfm
