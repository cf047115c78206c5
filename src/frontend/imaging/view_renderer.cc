// SPDX-License-Identifier: BSD-3-Clause
#include "imaging/view_renderer.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// Columns that bicubic interpolation needs beyond the border.
constexpr int kPadding = 2;

// The center of the pixel, in the convention of the camera models.
Eigen::Vector2d CenterOf(int x, int y) { return {x + 0.5, y + 0.5}; }

// The size of the original at the resolution of its views, but not larger than
// it is.
cv::Size ReducedSize(const Camera& camera, const View& view) {
  const double pixels_per_view_pixel =
      PixelsPerRadian(camera.model, camera.params.data()) /
      view.camera.params[0];
  const auto reduced = [&](int side) {
    const double factor = std::max(1.0, pixels_per_view_pixel);
    return std::max(1, static_cast<int>(std::lround(side / factor)));
  };
  return {reduced(camera.width_px), reduced(camera.height_px)};
}

}  // namespace

ViewRenderer::ViewRenderer(const Camera& camera, const std::vector<View>& views)
    : wraps_around_(camera.model == CameraModelId::kEquirectangular),
      reduced_size_(ReducedSize(camera, views.front())) {
  for (const View& view : views) maps_.push_back(MakeMap(camera, view));
}

ViewRenderer::Map ViewRenderer::MakeMap(const Camera& camera,
                                        const View& view) const {
  const cv::Size size(view.camera.width_px, view.camera.height_px);
  Map map{cv::Mat(size, CV_32FC2), cv::Mat(size, CV_8U)};
  const double scale_x =
      static_cast<double>(reduced_size_.width) / camera.width_px;
  const double scale_y =
      static_cast<double>(reduced_size_.height) / camera.height_px;
  const double offset = wraps_around_ ? kPadding - 0.5 : -0.5;
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const auto pixel = OriginalPixel(camera, view, CenterOf(x, y));
      map.unseen.at<uint8_t>(y, x) = pixel ? 0 : 255;
      const Eigen::Vector2d place = pixel.value_or(Eigen::Vector2d::Zero());
      map.pixels.at<cv::Vec2f>(y, x) = {
          static_cast<float>(scale_x * place.x() + offset),
          static_cast<float>(scale_y * place.y() - 0.5)};
    }
  }
  return map;
}

cv::Mat ViewRenderer::Prepare(const cv::Mat& image) const {
  cv::Mat prepared = image;
  if (image.size() != reduced_size_) {
    cv::resize(image, prepared, reduced_size_, 0.0, 0.0, cv::INTER_AREA);
  }
  if (wraps_around_) {
    cv::copyMakeBorder(prepared, prepared, 0, 0, kPadding, kPadding,
                       cv::BORDER_WRAP);
  }
  return prepared;
}

std::vector<cv::Mat> ViewRenderer::Render(const cv::Mat& image) const {
  const cv::Mat prepared = Prepare(image);
  std::vector<cv::Mat> rendered(maps_.size());
  for (size_t i = 0; i < maps_.size(); ++i) {
    cv::remap(prepared, rendered[i], maps_[i].pixels, cv::noArray(),
              cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    rendered[i].setTo(cv::Scalar::all(0), maps_[i].unseen);
  }
  return rendered;
}

std::vector<cv::Mat> ViewRenderer::RenderMasks(const cv::Mat& mask) const {
  const cv::Mat prepared = mask.empty() ? mask : Prepare(mask);
  std::vector<cv::Mat> rendered(maps_.size());
  for (size_t i = 0; i < maps_.size(); ++i) {
    if (mask.empty()) {
      cv::bitwise_not(maps_[i].unseen, rendered[i]);
      continue;
    }
    cv::remap(prepared, rendered[i], maps_[i].pixels, cv::noArray(),
              cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    // A pixel that is partly masked is masked.
    cv::threshold(rendered[i], rendered[i], 254.0, 255.0, cv::THRESH_BINARY);
    rendered[i].setTo(cv::Scalar::all(0), maps_[i].unseen);
  }
  return rendered;
}

}  // namespace mgsfm
