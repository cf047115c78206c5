// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/imaging/views.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/text_tools.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

using Eigen::AngleAxisd;
using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;

// At the border of a pinhole image of 120 degrees, pixels are larger by
// 1 / cos^2(60 deg) = 4.
constexpr double kMaxMagnification = 4.0;
constexpr double kMaxAutomaticFieldOfView_rad = 2.0 * kPi / 3.0;
constexpr double kFaceFieldOfView_rad = 0.5 * kPi;
// Rounding errors must not change an integer size.
constexpr double kSizeTolerance = 1e-6;
// OpenCV resamples images with sides below 2^15.
constexpr int kMaxSide = 32766;
// The limit before max_image_size is applied.
constexpr double kMaxPlannedSide = 1e6;

struct Face {
  const char* name;
  double turn_deg;  // of the camera frame, to that of the face
  Vector3d axis;
};

const std::vector<Face>& CubeFaces() {
  static const std::vector<Face> kFaces = {
      {"front", 0.0, Vector3d::UnitY()}, {"right", -90.0, Vector3d::UnitY()},
      {"left", 90.0, Vector3d::UnitY()}, {"up", -90.0, Vector3d::UnitX()},
      {"down", 90.0, Vector3d::UnitX()}, {"back", 180.0, Vector3d::UnitY()}};
  return kFaces;
}

bool IsPinhole(const Camera& camera) {
  return camera.model == CameraModelId::kPinhole ||
         camera.model == CameraModelId::kSimplePinhole;
}

bool IsInside(const Camera& camera, const Vector2d& pixel) {
  return pixel.x() >= 0.0 && pixel.y() >= 0.0 && pixel.x() <= camera.width_px &&
         pixel.y() <= camera.height_px;
}

double AngleToAxis(const Vector3d& ray) {
  return AngleBetween(ray, Vector3d::UnitZ().eval());
}

// A PINHOLE camera with the principal point and the resolution of the camera on
// its optical axis. Most models have these as parameters.
Camera PinholeOnAxis(const Camera& camera) {
  Eigen::Matrix<double, 2, 3> jacobian;
  const auto center = ProjectToPixel(camera.model, camera.params.data(),
                                     Vector3d::UnitZ(), &jacobian);
  if (!center) {
    throw Error("camera " + std::to_string(camera.id.value()) +
                " does not project its optical axis, so it cannot be "
                "undistorted; check its parameters");
  }
  Camera pinhole = camera;
  pinhole.model = CameraModelId::kPinhole;
  pinhole.params = {jacobian(0, 0), jacobian(1, 1), center->x(), center->y()};
  pinhole.has_prior_focal_length = true;
  return pinhole;
}

constexpr char kUndistorted[] = "its undistorted images";
constexpr char kLimitSize[] = "set a smaller max_image_size";

void CheckSize(const Camera& camera, const std::string& images,
               const std::string& remedy) {
  const int side = std::max(camera.width_px, camera.height_px);
  const bool has_pixels = camera.width_px > 0 && camera.height_px > 0;
  if (has_pixels && side <= kMaxSide) return;
  throw Error("camera " + std::to_string(camera.id.value()) +
              " cannot be undistorted, as " + images + " have " +
              SizeText(camera.width_px, camera.height_px) + " pixels; " +
              remedy);
}

// -------------------------------------------------------------- the border

struct BorderPixels {
  std::vector<Vector2d> left, right, top, bottom;

  std::vector<Vector2d> All() const {
    std::vector<Vector2d> all = left;
    for (const auto* side : {&right, &top, &bottom}) {
      all.insert(all.end(), side->begin(), side->end());
    }
    return all;
  }
};

// The centers of the outermost pixels.
BorderPixels PixelsOfBorder(const Camera& camera) {
  BorderPixels border;
  for (int y = 0; y < camera.height_px; ++y) {
    border.left.emplace_back(0.5, y + 0.5);
    border.right.emplace_back(camera.width_px - 0.5, y + 0.5);
  }
  for (int x = 0; x < camera.width_px; ++x) {
    border.top.emplace_back(x + 0.5, 0.5);
    border.bottom.emplace_back(x + 0.5, camera.height_px - 0.5);
  }
  return border;
}

double MaxViewAngle(const Camera& camera, const ViewOptions& options) {
  if (options.max_view_angle_deg > 0.0) {
    return DegToRad(options.max_view_angle_deg);
  }
  if (camera.model == CameraModelId::kEquirectangular) return kPi;
  double nearest = kPi;
  for (const Vector2d& pixel : PixelsOfBorder(camera).All()) {
    const auto ray = RayFromPixel(camera, pixel);
    if (ray) nearest = std::min(nearest, AngleToAxis(*ray));
  }
  return std::max(nearest, 0.5 * kPi);
}

// The magnification of a pixel of the border in a pinhole image; nullopt if the
// camera model has no ray there.
std::optional<double> Magnification(const Camera& camera, const Camera& pinhole,
                                    const Vector2d& pixel) {
  const Vector2d center(pinhole.params[2], pinhole.params[3]);
  const auto ray = RayFromPixel(camera, pixel);
  const auto inner_ray =
      RayFromPixel(camera, pixel + (center - pixel).normalized());
  if (!ray || !inner_ray) return std::nullopt;
  const auto image = ProjectToPixel(pinhole, *ray);
  const auto inner_image = ProjectToPixel(pinhole, *inner_ray);
  if (!image || !inner_image) return std::numeric_limits<double>::infinity();
  return (*image - *inner_image).norm();
}

bool IsTooWide(const Camera& camera, const Camera& pinhole) {
  if (camera.model == CameraModelId::kEquirectangular) return true;
  bool has_ray = false;
  for (const Vector2d& pixel : PixelsOfBorder(camera).All()) {
    const auto magnification = Magnification(camera, pinhole, pixel);
    if (magnification.value_or(0.0) > kMaxMagnification) return true;
    has_ray |= magnification.has_value();
  }
  return !has_ray;  // the image circle lies within the image
}

// ---------------------------------------------------- size of pinhole images

// The range of one coordinate of border pixels, projected to the pinhole image.
struct Extent {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();
};

Extent ExtentOf(const std::vector<Vector2d>& pixels, int axis,
                const Camera& camera, const Camera& pinhole) {
  Extent extent;
  for (const Vector2d& pixel : pixels) {
    const auto ray = RayFromPixel(camera, pixel);
    const auto image = ray ? ProjectToPixel(pinhole, *ray) : std::nullopt;
    if (!image) continue;
    extent.min = std::min(extent.min, (*image)(axis));
    extent.max = std::max(extent.max, (*image)(axis));
  }
  return extent;
}

// The scale of one image side, as in COLMAP. It interpolates between the size
// without blank pixels and the size with all pixels of the original.
double ScaleOfSize(const Extent& begin, const Extent& end, double center,
                   int size, const ViewOptions& options) {
  const double after_center = size - 0.5 - center;
  const double all_pixels = std::min(center / (center - begin.min),
                                     after_center / (end.max - center));
  const double no_blank = std::max(center / (center - begin.max),
                                   after_center / (end.min - center));
  const double scale = 1.0 / (all_pixels * options.blank_pixels +
                              no_blank * (1.0 - options.blank_pixels));
  // The principal point may lie on the border, or a side may have no ray.
  if (!std::isfinite(scale)) return 1.0;
  return std::clamp<double>(scale, options.min_scale,
                            std::max(*options.min_scale, *options.max_scale));
}

void SetSize(int width_px, int height_px, Camera* pinhole) {
  pinhole->params[2] *= static_cast<double>(width_px) / pinhole->width_px;
  pinhole->params[3] *= static_cast<double>(height_px) / pinhole->height_px;
  pinhole->width_px = width_px;
  pinhole->height_px = height_px;
}

void FitToOriginal(const Camera& camera, const ViewOptions& options,
                   Camera* pinhole) {
  if (IsPinhole(camera)) return;
  const BorderPixels border = PixelsOfBorder(camera);
  const auto scaled = [&](const std::vector<Vector2d>& begin,
                          const std::vector<Vector2d>& end, int axis,
                          int size) {
    const double scale = ScaleOfSize(ExtentOf(begin, axis, camera, *pinhole),
                                     ExtentOf(end, axis, camera, *pinhole),
                                     pinhole->params[2 + axis], size, options);
    return std::max(1, static_cast<int>(scale * size));
  };
  const int width_px = scaled(border.left, border.right, 0, camera.width_px);
  const int height_px = scaled(border.top, border.bottom, 1, camera.height_px);
  SetSize(width_px, height_px, pinhole);
}

// Sets a centered image with this horizontal field of view.
void FitToAngle(double field_of_view_rad, double height_per_width,
                Camera* pinhole) {
  const double tangent = std::tan(0.5 * field_of_view_rad);
  const auto whole = [](double size) {
    return static_cast<int>(
        std::ceil(std::clamp(size, 1.0, kMaxPlannedSide) - kSizeTolerance));
  };
  const double width = 2.0 * pinhole->params[0] * tangent;
  pinhole->width_px = whole(width);
  pinhole->height_px =
      whole(2.0 * pinhole->params[1] * tangent * height_per_width);
  pinhole->params[2] = 0.5 * pinhole->width_px;
  pinhole->params[3] = 0.5 * pinhole->height_px;
}

void LimitSize(int max_image_size, Camera* pinhole) {
  const int size = std::max(pinhole->width_px, pinhole->height_px);
  if (max_image_size <= 0 || size <= max_image_size) return;
  const double scale = static_cast<double>(max_image_size) / size;
  const auto scaled = [&](int side) {
    return std::max(1, static_cast<int>(std::lround(scale * side)));
  };
  const int width_px = scaled(pinhole->width_px);
  const int height_px = scaled(pinhole->height_px);
  pinhole->params[0] *= static_cast<double>(width_px) / pinhole->width_px;
  pinhole->params[1] *= static_cast<double>(height_px) / pinhole->height_px;
  SetSize(width_px, height_px, pinhole);
}

// Crops to the largest part of the image whose center is the principal point.
void CenterPrincipalPoint(Camera* pinhole) {
  const auto crop = [](int size, double* center) {
    const double cropped_size = 2.0 * std::min(*center, size - *center);
    const int cropped =
        std::clamp(static_cast<int>(cropped_size + kSizeTolerance), 1, size);
    *center = 0.5 * cropped;
    return cropped;
  };
  pinhole->width_px = crop(pinhole->width_px, &pinhole->params[2]);
  pinhole->height_px = crop(pinhole->height_px, &pinhole->params[3]);
}

// ------------------------------------------------------------------- views

Camera PlanPinhole(const Camera& camera, Camera pinhole, bool is_too_wide,
                   const ViewOptions& options) {
  const double field_of_view_rad = DegToRad(options.field_of_view_deg);
  const double height_per_width =
      static_cast<double>(camera.height_px) / camera.width_px;
  if (field_of_view_rad > 0.0) {
    FitToAngle(field_of_view_rad, height_per_width, &pinhole);
  } else if (is_too_wide) {
    FitToAngle(kMaxAutomaticFieldOfView_rad, height_per_width, &pinhole);
  } else {
    FitToOriginal(camera, options, &pinhole);
  }
  if (options.center_principal_point) CenterPrincipalPoint(&pinhole);
  LimitSize(options.max_image_size, &pinhole);
  CheckSize(pinhole, kUndistorted, kLimitSize);
  return pinhole;
}

// Whether the camera sees any pixel of a grid that includes the border.
bool SeesAny(const Camera& camera, const View& view) {
  // Steps of less than 1.5 degrees in a face of 90 degrees.
  constexpr int kNumSteps = 64;
  for (int i = 0; i <= kNumSteps; ++i) {
    for (int k = 0; k <= kNumSteps; ++k) {
      const Vector2d pixel(
          static_cast<double>(view.camera.width_px) * i / kNumSteps,
          static_cast<double>(view.camera.height_px) * k / kNumSteps);
      if (OriginalPixel(camera, view, pixel)) return true;
    }
  }
  return false;
}

std::vector<View> PlanCube(const Camera& camera, Camera pinhole,
                           double max_view_angle_rad,
                           const ViewOptions& options) {
  const double focal_px = std::max(pinhole.params[0], pinhole.params[1]);
  pinhole.params[0] = pinhole.params[1] = focal_px;
  FitToAngle(options.field_of_view_deg > 0.0
                 ? DegToRad(options.field_of_view_deg)
                 : kFaceFieldOfView_rad,
             1.0, &pinhole);
  LimitSize(options.max_image_size, &pinhole);
  CheckSize(pinhole, kUndistorted, kLimitSize);
  std::vector<View> views;
  for (const Face& face : CubeFaces()) {
    const View view{face.name,
                    Quaterniond(AngleAxisd(DegToRad(face.turn_deg), face.axis)),
                    pinhole, max_view_angle_rad};
    if (views.empty() || SeesAny(camera, view)) views.push_back(view);
  }
  return views;
}

}  // namespace

std::vector<View> PlanViews(const Camera& camera, const ViewOptions& options) {
  CheckSize(camera, "its images", "scale them down");
  const Camera pinhole = PinholeOnAxis(camera);
  const double max_view_angle_rad = MaxViewAngle(camera, options);
  const bool is_too_wide = IsTooWide(camera, pinhole);
  const bool is_cube =
      options.projection == ViewProjection::kCube ||
      (options.projection == ViewProjection::kAuto && is_too_wide);
  if (is_cube) return PlanCube(camera, pinhole, max_view_angle_rad, options);
  return {{"", Quaterniond::Identity(),
           PlanPinhole(camera, pinhole, is_too_wide, options),
           max_view_angle_rad}};
}

std::optional<Vector2d> OriginalPixel(const Camera& camera, const View& view,
                                      const Vector2d& pixel) {
  const Vector3d ray =
      view.view_from_cam.conjugate() * *RayFromPixel(view.camera, pixel);
  if (AngleToAxis(ray) > view.max_view_angle_rad) return std::nullopt;
  const auto original = ProjectToPixel(camera, ray);
  return original && IsInside(camera, *original) ? original : std::nullopt;
}

std::optional<ViewPixel> FindInViews(const Camera& camera,
                                     const std::vector<View>& views,
                                     const Vector2d& pixel) {
  std::optional<ViewPixel> best;
  const auto ray = RayFromPixel(camera, pixel);
  if (!ray || !IsInside(camera, pixel)) return best;
  double best_z = 0.0;
  for (size_t i = 0; i < views.size(); ++i) {
    const View& view = views[i];
    if (AngleToAxis(*ray) > view.max_view_angle_rad) continue;
    const Vector3d ray_in_view = view.view_from_cam * *ray;
    const auto image = ProjectToPixel(view.camera, ray_in_view);
    if (!image || !IsInside(view.camera, *image)) continue;
    if (ray_in_view.z() <= best_z) continue;
    best_z = ray_in_view.z();
    best = ViewPixel{static_cast<int>(i), *image};
  }
  return best;
}

bool HasBlankPixels(const Camera& camera, const View& view) {
  // The unseen region reaches the border of the view or, behind a fisheye,
  // fills much of it.
  constexpr int kStep = 16;
  const int width_px = view.camera.width_px, height_px = view.camera.height_px;
  for (int y = 0; y < height_px; ++y) {
    const bool is_full_row = y % kStep == 0 || y == height_px - 1;
    for (int x = 0; x < width_px; ++x) {
      if (!is_full_row && x % kStep != 0 && x != width_px - 1) continue;
      if (!OriginalPixel(camera, view, {x + 0.5, y + 0.5})) return true;
    }
  }
  return false;
}

bool IsUnchanged(const Camera& camera, const std::vector<View>& views) {
  if (!IsPinhole(camera) || views.size() != 1) return false;
  const Camera& view = views.front().camera;
  const std::vector<double> params =
      camera.model == CameraModelId::kPinhole
          ? camera.params
          : std::vector<double>{camera.params[0], camera.params[0],
                                camera.params[1], camera.params[2]};
  return view.params == params && view.width_px == camera.width_px &&
         view.height_px == camera.height_px;
}

}  // namespace mgsfm
