// SPDX-License-Identifier: BSD-3-Clause
#include "scene/intrinsics_check.h"

#include <algorithm>
#include <cmath>

#include "base/ranges.h"
#include "base/text.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// A field of view of 3 deg, below that of any moving camera, and of 10 rad,
// above that of any fisheye.
constexpr double kMaxFocalLengthRatio = 20.0;
constexpr double kMinFocalLengthRatio = 0.1;

// Lenses are centered on their sensor within a few percent, and typical crops
// keep one of the coordinates. If both are off by a common factor, the
// intrinsics belong to images of another size.
constexpr double kMinScaleOfOtherSize = 1.2;
// The largest ratio of the scales along the axes of an ordinary lens.
constexpr double kMaxScaleMismatch = 1.1;

std::string Text(double value) {
  return FormatDouble(value, std::chars_format::general, 4);
}

std::string SizeText(double width, double height) {
  return Text(width) + " x " + Text(height) + " px";
}

std::string SizeText(const Camera& camera) {
  return SizeText(camera.width_px, camera.height_px);
}

std::string PrincipalPointText(double x, double y) {
  return "has its principal point (" + Text(x) + ", " + Text(y) + ") ";
}

bool HasTwoFocalLengths(const Camera& camera) {
  const CameraModelInfo& info = InfoOf(camera.model);
  return info.focal_length_idxs.size() == 2 &&
         !info.principal_point_idxs.empty();
}

// Anamorphic lenses compress one axis by up to a factor of two.
constexpr double kMaxRatioOfFocalLengths = 2.5;

std::optional<std::string> WhyBadFocalLength(const Camera& camera) {
  const double side_px = std::max(camera.width_px, camera.height_px);
  const std::vector<int>& idxs = InfoOf(camera.model).focal_length_idxs;
  for (const int i : idxs) {
    const double ratio = camera.params[i] / side_px;
    if (ratio >= kMinFocalLengthRatio && ratio <= kMaxFocalLengthRatio) {
      continue;
    }
    return "has a focal length of " + Text(camera.params[i]) +
           " px, which is " + Text(ratio) + " times the longer side of " +
           SizeText(camera);
  }
  if (HasTwoFocalLengths(camera)) {
    const double fx = camera.params[idxs[0]], fy = camera.params[idxs[1]];
    if (std::max(fx / fy, fy / fx) > kMaxRatioOfFocalLengths) {
      return "has the focal lengths " + Text(fx) + " and " + Text(fy) + " px";
    }
  }
  return std::nullopt;
}

std::optional<std::string> WhyBadPrincipalPoint(const Camera& camera) {
  const std::vector<int>& idxs = InfoOf(camera.model).principal_point_idxs;
  if (idxs.empty()) return std::nullopt;
  const double x = camera.params[idxs[0]], y = camera.params[idxs[1]];
  const bool is_fraction =
      x <= 1.0 && y <= 1.0 && std::min(camera.width_px, camera.height_px) > 2;
  if (is_fraction && x > 0.0 && y > 0.0) {
    return PrincipalPointText(x, y) +
           "in the corner, which is in pixels, not in fractions of " +
           SizeText(camera);
  }
  if (x >= 0.0 && x <= camera.width_px && y >= 0.0 && y <= camera.height_px) {
    return std::nullopt;
  }
  return PrincipalPointText(x, y) + "outside of the image of " +
         SizeText(camera);
}

// Compared with a pinhole camera of the same focal length, lenses magnify image
// borders at most twice.
constexpr double kMaxMagnification = 5.0;

// Whether a ray projects to this pixel, with a magnification that lenses have.
bool HasRay(const Camera& camera, const Eigen::Vector2d& pixel) {
  const double* params = camera.params.data();
  const auto ray = RayFromPixel(camera.model, params, pixel);
  if (!ray) return false;
  Eigen::Matrix<double, 2, 3> by_ray;
  const auto again = ProjectToPixel(camera.model, params, *ray, &by_ray);
  if (!again || !((*again - pixel).norm() < 0.1)) return false;
  const double of_pinhole =
      PixelsPerRadian(camera.model, params) / (ray->z() * ray->z());
  return by_ray.norm() <= kMaxMagnification * of_pinhole;
}

// Fraction of the pixels, on a grid, without a ray.
double ShareWithoutRay(const Camera& camera) {
  constexpr int kNumSteps = 8;
  int num_without = 0, num_pixels = 0;
  for (int i = 0; i <= kNumSteps; ++i) {
    for (int k = 0; k <= kNumSteps; ++k, ++num_pixels) {
      const Eigen::Vector2d pixel(camera.width_px * i / double{kNumSteps},
                                  camera.height_px * k / double{kNumSteps});
      if (!HasRay(camera, pixel)) ++num_without;
    }
  }
  return static_cast<double>(num_without) / num_pixels;
}

std::string DescribeWithoutRay(const Camera& camera, double share) {
  return "has a distortion that cannot be inverted, or magnifies more than " +
         Text(kMaxMagnification) + " times, in " +
         std::to_string(static_cast<int>(std::lround(100.0 * share))) +
         " % of " + SizeText(camera);
}

bool HasDistortion(const Camera& camera) {
  const std::vector<int>& idxs = InfoOf(camera.model).extra_params_idxs;
  return AnyOf(idxs, [&](int i) { return camera.params[i] != 0.0; });
}

// Describes a principal point that is the center of images of another size.
std::optional<std::string> WhyOfOtherSize(const Camera& camera) {
  const std::vector<int>& idxs = InfoOf(camera.model).principal_point_idxs;
  if (idxs.empty()) return std::nullopt;
  const double width = 2.0 * camera.params[idxs[0]];
  const double height = 2.0 * camera.params[idxs[1]];
  const double scale_x = width / camera.width_px;
  const double scale_y = height / camera.height_px;
  const double mismatch =
      std::max(scale_x, scale_y) / std::min(scale_x, scale_y);
  const double scale = std::sqrt(scale_x * scale_y);
  if (mismatch > kMaxScaleMismatch ||
      std::max(scale, 1.0 / scale) < kMinScaleOfOtherSize) {
    return std::nullopt;
  }
  return PrincipalPointText(0.5 * width, 0.5 * height) +
         "far from the center of " + SizeText(camera) +
         ", as intrinsics for images of about " +
         SizeText(std::round(width), std::round(height)) + " have";
}

// Whether fx, cx, fy, cy were given instead of fx, fy, cx, cy: swapping them
// back makes the focal lengths agree better and centers the principal point.
std::optional<std::string> WhyInOtherOrder(const Camera& camera) {
  constexpr double kMaxMismatch = 1.05;  // after the swap
  if (!HasTwoFocalLengths(camera)) return std::nullopt;
  const std::vector<int>& focal_idxs = InfoOf(camera.model).focal_length_idxs;
  const double fx = camera.params[focal_idxs[0]];
  const double fy = camera.params[focal_idxs[1]];
  const double cx = camera.params[InfoOf(camera.model).principal_point_idxs[0]];
  const double center_x = 0.5 * camera.width_px;
  const auto mismatch = [fx](double other) {
    return std::max(fx / other, other / fx);
  };
  if (mismatch(fy) < kMaxScaleMismatch || mismatch(cx) > kMaxMismatch ||
      std::abs(fy - center_x) >= std::abs(cx - center_x)) {
    return std::nullopt;
  }
  return "has fx " + Text(fx) + ", fy " + Text(fy) + " and cx " + Text(cx) +
         " px for " + SizeText(camera) +
         ", as if fx, cx, fy, cy were given in place of fx, fy, cx, cy";
}

}  // namespace

std::optional<IntrinsicsProblem> FindIntrinsicsProblem(const Camera& camera) {
  for (const auto& problem :
       {WhyBadFocalLength(camera), WhyBadPrincipalPoint(camera)}) {
    if (problem) return {{*problem, true, false}};
  }
  const double share = HasDistortion(camera) ? ShareWithoutRay(camera) : 0.0;
  if (share > 0.5) {
    return {{DescribeWithoutRay(camera, share), true, false}};
  }
  for (const auto& problem :
       {WhyOfOtherSize(camera), WhyInOtherOrder(camera)}) {
    if (problem) return {{*problem, false, true}};
  }
  if (share == 0.0) return std::nullopt;
  return {{DescribeWithoutRay(camera, share), false, false}};
}

bool HasLensOfExif(const Camera& camera) {
  return camera.has_prior_focal_length &&
         camera.model == CameraModelId::kSimpleRadial &&
         camera.params[1] == 0.5 * camera.width_px &&
         camera.params[2] == 0.5 * camera.height_px && camera.params[3] == 0.0;
}

}  // namespace mgsfm
