// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/rendering.h"

#include <algorithm>
#include <cmath>

#include "base/parallel.h"
#include "geometry/so3.h"
#include "simulator/world.h"

namespace mgsfm {
namespace {

// Rays end in the backdrop beyond this distance, where haze hides the surfaces.
constexpr double kMaxDistance_m = 400.0;
constexpr double kGroundMargin_m = 40.0;  // beyond all surfaces and the road
// Length scale of haze; contrast halves every 0.7 times this distance.
constexpr double kHaze_m = 250.0;
// Width of the dark fade at the field-of-view boundary, which avoids features
// on a sharp edge.
constexpr double kFade_deg = 8.0;
// Bounds the footprint of pixels on surfaces seen at grazing angles.
constexpr double kMinIncidence = 0.08;

// The bounding box of all surfaces and the road.
Eigen::AlignedBox2d GroundBox(const Road& road,
                              const std::vector<Surface>& surfaces) {
  Eigen::AlignedBox2d box;
  for (const RoadNode& node : road.nodes()) box.extend(node.ground.head<2>());
  for (const Surface& surface : surfaces) {
    box.extend(surface.a).extend(surface.b);
  }
  const Eigen::Vector2d margin(kGroundMargin_m, kGroundMargin_m);
  return {box.min() - margin, box.max() + margin};
}

PixelRay MakePixelRay(const Camera& camera, const Eigen::Vector2d& pixel,
                      double max_view_angle_deg) {
  const auto ray = RayFromPixel(camera, pixel);
  if (!ray) return {};
  const double angle_deg =
      RadToDeg(std::atan2(ray->head<2>().norm(), ray->z()));
  const double inside = (max_view_angle_deg - angle_deg) / kFade_deg;
  const double fade = max_view_angle_deg < 180.0 ? inside : 1.0;
  return {ray->cast<float>(), static_cast<float>(std::clamp(fade, 0.0, 1.0))};
}

CameraRays MakeCameraRays(const Camera& camera, const RenderingOptions& options,
                          const Context& context) {
  CameraRays result{
      camera.width_px, camera.height_px, 1.0 / PixelsPerRadian(camera), {}};
  const int n = options.samples_per_axis;
  const size_t row_size = static_cast<size_t>(n) * n * camera.width_px;
  result.rays.resize(row_size * camera.height_px);
  ParallelFor(
      camera.height_px, ResolveNumThreads(context.num_threads),
      [&](size_t row) {
        PixelRay* ray = result.rays.data() + row * row_size;
        for (int column = 0; column < camera.width_px; ++column) {
          for (int i = 0; i < n * n; ++i, ++ray) {
            const int sample_row = i / n;
            const int sample_column = i % n;
            const Eigen::Vector2d pixel(
                column + (sample_column + 0.5) / n,
                static_cast<double>(row) + (sample_row + 0.5) / n);
            *ray = MakePixelRay(camera, pixel, options.max_view_angle_deg);
          }
        }
      },
      8);
  return result;
}

uint8_t ToByte(float level) {
  return static_cast<uint8_t>(
      std::lround(255.0f * std::clamp(level, 0.0f, 1.0f)));
}

}  // namespace

std::vector<SimulatedCamera> ScaledRig(std::vector<SimulatedCamera> rig,
                                       double scale) {
  const auto scaled_size = [scale](double size) {
    return static_cast<int>(std::ceil(scale * size - 1e-9));
  };
  for (SimulatedCamera& camera : rig) {
    camera.width_px = scaled_size(camera.width_px);
    camera.height_px = scaled_size(camera.height_px);
    if (camera.model == CameraModelId::kEquirectangular) {
      camera.params = {static_cast<double>(camera.width_px),
                       static_cast<double>(camera.height_px)};
      continue;
    }
    const CameraModelInfo& info = InfoOf(camera.model);
    for (const int i : info.focal_length_idxs) camera.params[i] *= scale;
    for (const int i : info.principal_point_idxs) camera.params[i] *= scale;
  }
  return rig;
}

StreetRenderer::StreetRenderer(const SimulationOptions& options,
                               const SimulationInput& input,
                               const std::vector<Camera>& cameras,
                               const RenderingOptions& rendering,
                               const Context& context)
    : road_(MakeDrive(options, input), kRoadExtension_m),
      surfaces_(road_, 0, options.random_seed),
      ground_(road_, GroundBox(road_, surfaces_.surfaces())),
      painter_(surfaces_.surfaces(), ground_, options.random_seed),
      num_samples_(rendering.samples_per_axis * rendering.samples_per_axis) {
  for (const Camera& camera : cameras) {
    camera_rays_.push_back(MakeCameraRays(camera, rendering, context));
  }
}

StreetRenderer::Hit StreetRenderer::Cast(
    const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
  const auto surface = surfaces_.Cast(origin, direction, kMaxDistance_m);
  const double nearest = surface ? surface->distance_m : kMaxDistance_m;
  const auto ground = ground_.Cast(origin, direction, nearest);
  if (ground) return {*ground, std::nullopt};
  if (surface) return {nearest, surface};
  return {};
}

std::optional<double> StreetRenderer::DistanceAlong(
    const Eigen::Vector3d& origin_in_world,
    const Eigen::Vector3d& direction) const {
  const Eigen::Quaterniond& level_from_world = road_.level_from_world();
  return Cast(level_from_world * origin_in_world, level_from_world * direction)
      .distance_m;
}

Color StreetRenderer::Trace(const Eigen::Vector3d& origin,
                            const Eigen::Vector3d& direction,
                            double footprint_rad) const {
  const Hit hit = Cast(origin, direction);
  if (!hit.distance_m) return painter_.PaintBackdrop(direction, footprint_rad);
  const double distance = *hit.distance_m;
  const Eigen::Vector3d point = origin + distance * direction;
  const double incidence =
      hit.surface ? hit.surface->normal.dot(direction) : direction.z();
  const double footprint_m =
      distance * footprint_rad / std::max(std::abs(incidence), kMinIncidence);
  const Color color =
      hit.surface ? painter_.PaintSurface(*hit.surface, point, footprint_m)
                  : painter_.PaintGround(point, footprint_m);
  const auto clear = static_cast<float>(std::exp(-distance / kHaze_m));
  return clear * color + (1.0f - clear) * Color(0.68f, 0.73f, 0.78f);
}

ColorImage StreetRenderer::Render(int camera_idx, const Rigid3& cam_from_world,
                                  const Context& context) const {
  const CameraRays& camera = camera_rays_[camera_idx];
  ColorImage image{camera.width_px, camera.height_px, {}};
  image.rgb.resize(3 * static_cast<size_t>(camera.width_px) * camera.height_px);
  const Eigen::Vector3d origin =
      road_.level_from_world() * cam_from_world.Center();
  const Eigen::Matrix3d level_from_cam =
      (road_.level_from_world() * cam_from_world.rotation.conjugate())
          .toRotationMatrix();
  ParallelFor(
      camera.height_px, ResolveNumThreads(context.num_threads),
      [&](size_t row) {
        context.CheckInterrupted();
        const size_t first = row * camera.width_px;
        const PixelRay* ray = camera.rays.data() + first * num_samples_;
        uint8_t* byte = image.rgb.data() + 3 * first;
        for (int column = 0; column < camera.width_px; ++column) {
          Color sum = Color::Zero();
          for (int i = 0; i < num_samples_; ++i, ++ray) {
            if (ray->brightness == 0.0f) continue;
            const Eigen::Vector3d direction =
                (level_from_cam * ray->ray.cast<double>()).normalized();
            sum += ray->brightness *
                   Trace(origin, direction, camera.footprint_rad);
          }
          for (int i = 0; i < 3; ++i) {
            *byte++ = ToByte(sum[i] / static_cast<float>(num_samples_));
          }
        }
      },
      8);
  return image;
}

}  // namespace mgsfm
