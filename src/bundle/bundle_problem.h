// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <vector>

#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Bundle adjustment without scene: flat arrays that refer to each other by
// dense positions. A solver needs nothing else.

// Changes of a pose have six coordinates: a rotation vector w, then a
// translation d.
//   frame (R, c):   R <- Exp(w) R,  c <- c + d    (c: centre in the world)
//   sensor (S, t):  S <- Exp(w) S,  t <- t + d
// With the centre, turning a frame does not move it, however far it is from
// the origin.
using PoseVector = Eigen::Matrix<double, 6, 1>;

// 1 for coordinates that may change, 0 for those that are held.
using PoseMask = PoseVector;

struct FramePose {
  Eigen::Quaterniond rig_from_world = Eigen::Quaterniond::Identity();
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
};

using CameraParams = std::array<double, kMaxNumCameraParams>;

// All that a solve may change.
struct BundleState {
  std::vector<FramePose> frames;
  std::vector<Rigid3> sensors;  // sensor_from_rig
  std::vector<CameraParams> cameras;
  std::vector<Eigen::Vector3d> points;
};

// All that it may not.
//
//   minimise  1/2 sum_o rho(|Project(K, S R (p - c) + t) - x_o|^2)
//           + 1/2 sum_k ((K_k - value_k) / sigma_k)^2
//
// over what the masks free; rho is Huber's with threshold loss_scale_px.
struct BundleProblem {
  struct Image {
    int frame = 0;
    int sensor = 0;
    int camera = 0;
  };
  struct Camera {
    CameraModelId model;
    std::vector<int> free_params;  // ascending
  };
  struct PixelObservation {
    int image = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  };
  struct ParameterPrior {
    int camera = 0;
    int param = 0;  // must be free
    double value = 0.0;
    double sigma = 1.0;
  };

  std::vector<Image> images;
  std::vector<Camera> cameras;
  std::vector<PoseMask> frame_masks;
  std::vector<PoseMask> sensor_masks;
  std::vector<ParameterPrior> priors;
  // Those of point p: point_begin[p] to point_begin[p + 1] - 1. Any number of
  // them may be in one image.
  std::vector<PixelObservation> observations;
  std::vector<size_t> point_begin = {0};
  bool points_are_free = true;
  double loss_scale_px = 1.0;

  size_t num_points() const { return point_begin.size() - 1; }
};

}  // namespace mgsfm
