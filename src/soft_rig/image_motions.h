// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "soft_rig/rig_path.h"

namespace mgsfm {

// How the rig moved between the instant of a frame and that of an image of it.
class ImageMotions {
 public:
  // If times are not used, rigs do not move between the two.
  ImageMotions(const Scene& scene, bool use_times);

  // Takes the paths of all rigs from the poses of their frames.
  void SetPaths(const Reconstruction& reconstruction);

  // The motion (D_i) of a registered image whose camera is late by offset_s.
  Rigid3 MotionOf(int image_idx, double offset_s) const;
  // Between the frames around the image.
  double IntervalAt(int image_idx, double offset_s) const;
  // Between two frames of a rig; infinite with fewer.
  double MedianInterval(int rig_idx) const;

 private:
  const Scene& scene_;
  const bool use_times_;
  std::vector<RigPath> paths_;    // of rigs with frames
  std::vector<int> path_of_rig_;  // -1: none
  std::vector<double> median_interval_;
  std::vector<Rigid3> world_from_rig_;  // per frame
};

}  // namespace mgsfm
