// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {

// docs/rendering.md explains them.
struct RenderingOptions {
  int samples_per_axis = 2;
  double max_view_angle_deg = 92.0;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("render_samples", self.samples_per_axis, Between(1, 16), "",
          "Rays for a pixel, along each of its sides.");
    visit("render_max_view_angle", self.max_view_angle_deg, Between(1.0, 180.0),
          "deg",
          "Images are black farther from the optical axis. Perspective images "
          "do not reach as far as the default.");
  }
};

// Row by row from the upper left corner; red, green, blue.
struct ColorImage {
  int width_px = 0;
  int height_px = 0;
  std::vector<uint8_t> rgb;
};

// The rig with images that are larger by a factor: focal lengths and principal
// points are exactly so, sizes are rounded up to whole pixels.
std::vector<SimulatedCamera> ScaledRig(std::vector<SimulatedCamera> rig,
                                       double scale);

// Draws the street of a simulation, by rays through each pixel to the first
// surface: facades, ground, cars, trees and poles, with a procedural texture,
// and sky and hills at infinity. A pixel is the mean of rays at a regular grid
// within it, each the exact inverse of the camera model; textures have no
// detail smaller than a pixel.
//
// Deterministic in options and input, whatever context.num_threads is. Holds 12
// bytes for each ray of an image of each camera.
class StreetRenderer {
 public:
  // The street is that of Simulate with the same options and input, and with
  // options.world = kStreet, but for duplicates.
  StreetRenderer(const SimulationOptions& options, const SimulationInput& input,
                 const std::vector<Camera>& cameras,
                 const RenderingOptions& rendering, const Context& context);
  ~StreetRenderer();
  StreetRenderer(const StreetRenderer&) = delete;
  StreetRenderer& operator=(const StreetRenderer&) = delete;

  ColorImage Render(int camera_idx, const Rigid3& cam_from_world,
                    const Context& context) const;

  // How far a ray of unit direction goes; nullopt if to the backdrop.
  std::optional<double> DistanceAlong(const Eigen::Vector3d& origin_in_world,
                                      const Eigen::Vector3d& direction) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace mgsfm
