// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/geometry/camera_models.h"
#include "rig_solver/rig_problem.h"

namespace mgsfm {

// The pose and the camera of an image, prepared for many observations. The
// point p in the camera frame is x = y + t, y = S M R (p - c - m). Matrices are
// row-major plain arrays, so that the compiler vectorizes the kernels.
struct ImagePose {
  double cam_from_world[9];        // S M R
  double sensor_from_frame[9];     // S M; unset if the problem fixes S R
  double center[3];                // c + m
  double translation[3];           // t
  const double* params = nullptr;  // references the state
  PixelProjection projection;
  bool is_pinhole = false;  // CameraModelId::kPinhole without free parameters
  const int* free_params = nullptr;
  int num_free_params = 0;
  int num_params = 0;
};

// Allocates only if `poses` does not have the number of images.
void ComputeImagePoses(const RigProblemBase& problem, const RigState& state,
                       std::vector<ImagePose>* poses);

// The motion of a point in the camera frame for a small change of frame and
// sensor: dx = rotation x y + shift.
struct ImageTwist {
  double rotation[3] = {0.0, 0.0, 0.0};
  double shift[3] = {0.0, 0.0, 0.0};
};

// `frame` and `sensor` are changes, zero for constant coordinates.
ImageTwist ComputeImageTwist(const ImagePose& pose, const PoseVector& frame,
                             const PoseVector& sensor);

}  // namespace mgsfm
