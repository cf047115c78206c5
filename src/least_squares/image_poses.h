// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "least_squares/rig_problem.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {

// The poses and the camera of an image, ready for many observations:
//   x = y + t,  y = S R (p - c)
// is the point p in the camera. Matrices are row-major; plain arrays, so that
// hot loops compile to what the processor does best.
struct ImagePose {
  double cam_from_world[9];   // S R
  double sensor_from_rig[9];  // S; not set if rotations are held by the problem
  double center[3];           // c
  double translation[3];      // t
  const double* params = nullptr;  // of the state that it was made from
  PixelProjection projection;
  const int* free_params = nullptr;
  int num_free_params = 0;
  int num_params = 0;
};

// Allocates only if `poses` has another size than the problem has images.
void ComputeImagePoses(const RigProblemBase& problem, const RigState& state,
                       std::vector<ImagePose>* poses);

// How the point of an image moves in its camera for small changes of its frame
// and sensor: dx = turn x y + shift.
struct ImageTwist {
  double turn[3] = {0.0, 0.0, 0.0};
  double shift[3] = {0.0, 0.0, 0.0};
};

// `frame` and `sensor` are changes, with zeros for held coordinates.
ImageTwist ComputeImageTwist(const ImagePose& pose, const PoseVector& frame,
                             const PoseVector& sensor);

}  // namespace mgsfm
