// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/simulator/simulation.h"
#include "simulator/road.h"
#include "simulator/street_painter.h"
#include "simulator/street_surfaces.h"

namespace mgsfm {

// See docs/reference/rendering.md.
struct RenderingOptions {
  Option<int> samples_per_axis{"render_samples", 2, Between(1, 16),
                               "Trace this many rays along each side of a "
                               "pixel. Increase it to reduce aliasing."};
  Option<double> max_view_angle_deg{
      "render_max_view_angle", 92.0, Between(1.0, 180.0), "deg",
      "Render pixels up to this angle to the optical axis; pixels beyond it "
      "are black. The default does not affect perspective images."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(samples_per_axis, max_view_angle_deg);
  }
};

// Row-major from the upper left corner; red, green, blue.
struct ColorImage {
  int width_px = 0;
  int height_px = 0;
  std::vector<uint8_t> rgb;
};

// A ray of an image and its brightness; 0 is black.
struct PixelRay {
  Eigen::Vector3f ray = Eigen::Vector3f::Zero();
  float brightness = 0.0f;
};

// The rays of all samples of the pixels of a camera in row-major order.
struct CameraRays {
  int width_px = 0;
  int height_px = 0;
  double footprint_rad = 0.0;
  std::vector<PixelRay> rays;
};

// Scales the images of a rig. Focal lengths and principal points scale exactly;
// image sizes are rounded up to whole pixels.
std::vector<SimulatedCamera> ScaledRig(std::vector<SimulatedCamera> rig,
                                       double scale);

// Renders the street of a simulation by ray casting: facades, ground, cars,
// trees and poles with procedural textures, and sky and hills at infinity. A
// pixel is the mean over a regular grid of rays, computed by the exact inverse
// of the camera model. Textures have no detail smaller than a pixel.
//
// Deterministic for given options and input, independent of
// context.num_threads. Memory: 12 bytes per ray of one image of each camera.
class StreetRenderer {
 public:
  // Uses the street of Simulate with the same options and input and
  // options.world = kStreet, without duplicate structures.
  StreetRenderer(const SimulationOptions& options, const SimulationInput& input,
                 const std::vector<Camera>& cameras,
                 const RenderingOptions& rendering, const Context& context);
  // Parts refer to each other.
  StreetRenderer(const StreetRenderer&) = delete;
  StreetRenderer& operator=(const StreetRenderer&) = delete;

  ColorImage Render(int camera_idx, const Rigid3& cam_from_world,
                    const Context& context) const;

  // Length of a ray of unit direction up to the first surface; nullopt for the
  // backdrop.
  std::optional<double> DistanceAlong(const Eigen::Vector3d& origin_in_world,
                                      const Eigen::Vector3d& direction) const;

 private:
  // The first intersection with ground or surfaces; none for the backdrop.
  struct Hit {
    std::optional<double> distance_m;
    std::optional<SurfaceHit> surface;
  };

  Hit Cast(const Eigen::Vector3d& origin,
           const Eigen::Vector3d& direction) const;
  Color Trace(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
              double footprint_rad) const;

  const Road road_;
  const StreetSurfaces surfaces_;
  const Ground ground_;
  const StreetPainter painter_;
  const int num_samples_;
  std::vector<CameraRays> camera_rays_;
};

}  // namespace mgsfm
