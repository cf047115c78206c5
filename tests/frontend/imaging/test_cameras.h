// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <utility>
#include <vector>

#include "mgsfm/scene/scene.h"

namespace mgsfm {

inline Camera MakeCamera(CameraModelId model, int width_px, int height_px,
                         std::vector<double> params) {
  return {CameraId(7), model, width_px, height_px, std::move(params), true};
}

// 180 degrees between opposite borders.
inline Camera Fisheye180() {
  return MakeCamera(CameraModelId::kOpenCVFisheye, 400, 400,
                    {125, 126, 201, 198, 0.01, -0.003, 0, 0});
}

// A lens with 75 degrees and barrel distortion.
inline Camera Barrel() {
  return MakeCamera(CameraModelId::kRadial, 640, 480,
                    {420, 325, 238, -0.12, 0.02});
}

inline Camera Panorama() {
  return MakeCamera(CameraModelId::kEquirectangular, 800, 400, {800, 400});
}

// The brightness of a direction: waves of 12 degrees along all axes.
inline double Brightness(const Eigen::Vector3d& ray) {
  const Eigen::Vector3d direction = ray.normalized();
  double sum = 128.0;
  for (const double x : direction) sum += 40.0 * std::sin(30.0 * x);
  return sum;
}

// The ray of a pixel of a PINHOLE camera, by its definition.
inline Eigen::Vector3d PinholeRay(const Camera& camera, double u, double v) {
  const std::vector<double>& p = camera.params;
  return Eigen::Vector3d((u - p[2]) / p[0], (v - p[3]) / p[1], 1.0);
}

}  // namespace mgsfm
