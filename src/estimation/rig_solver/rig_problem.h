// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "math/robust_loss.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Least squares over rigs, points and cameras, independent of a scene: flat
// arrays that refer to each other by dense indices.

// Changes of a pose have six coordinates: a rotation vector w, then a
// translation d.
//   frame (R, c):   R <- Exp(w) R,  c <- c + d    (c: center in the world)
//   sensor (S, t):  S <- Exp(w) S,  t <- t + d
// With the center as coordinate, rotating a frame does not move it, however far
// it is from the origin. A PoseVector holds a change.
//
// 1 for free coordinates, 0 for constant ones.
using PoseMask = PoseVector;

struct FramePose {
  Eigen::Quaterniond rig_from_world = Eigen::Quaterniond::Identity();
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
};

using CameraParams = std::array<double, kMaxNumCameraParams>;

// The frame of an image at the time of the image.
inline FramePose Move(const FramePose& frame, const RigMotion& motion) {
  return {motion.rotation * frame.rig_from_world,
          frame.center + motion.shift_in_world};
}

// Everything that a solve may change.
struct RigState {
  std::vector<FramePose> frames;
  std::vector<Rigid3> sensors;  // sensor_from_rig
  std::vector<CameraParams> cameras;
  std::vector<Eigen::Vector3d> points;
};

// Image i sees the point p at x = S M R (p - c - m) + t in its camera frame,
// with the constant motion (M, m) of the rig since the time of the frame. The
// residual is Project(K, x) - pixel,
struct PixelObservation {
  int image = 0;
  Eigen::Vector2f pixel = Eigen::Vector2f::Zero();  // as in Image
};

// or x / |x| - ray, which does not depend on a camera.
struct RayObservation {
  int image = 0;
  Eigen::Vector3d ray = Eigen::Vector3d::Zero();  // unit, in the camera
};

// A residual on the baseline C = c_2 - c_1 of two images, whose centers are c_i
// = c - (S R)^T t, with its length smoothed to L = sqrt(|C|^2 + min_length^2),
// so that the residual is defined everywhere and its derivative is bounded. All
// rotations of the problem must be constant.
struct BaselineTerm {
  enum class Kind {
    kDirection,  // weight (C / L - direction)
    kLength,     // weight log(L / length)
    kZero,       // weight C
  };
  Kind kind = Kind::kDirection;
  int image1 = 0;
  int image2 = 0;
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  double length = 1.0;
  double min_length = 0.0;
  double weight = 1.0;
};

// The residual weight (sum_k coefficients_k . x_k - value), where x_k is the
// center of a frame or the translation of a sensor.
struct LinearTerm {
  struct Part {
    bool is_frame = false;  // else sensor
    int idx = 0;
    Eigen::Vector3d coefficients = Eigen::Vector3d::Zero();
  };
  std::vector<Part> parts;
  double value = 0.0;
  double weight = 1.0;
};

// The measured position of a point p in the camera frame of an image: the
// residual sqrt_information (p_i - position), p_i = c + (S R)^T (p - t).
struct PositionPrior {
  int image = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
  Eigen::Matrix3d sqrt_information = Eigen::Matrix3d::Identity();
  Eigen::Vector3d point_in_cam = Eigen::Vector3d::Zero();
};

// The measured direction of gravity in an image: the residual (S R down -
// direction) / sigma_rad of two unit vectors.
struct GravityPrior {
  int image = 0;
  Eigen::Vector3d direction = Eigen::Vector3d::UnitY();  // in the camera
  Eigen::Vector3d down = Eigen::Vector3d::UnitY();       // in the world
  double sigma_rad = 1.0;
};

// The given pose of a sensor: the residuals factor (Log(S S_0^T) / sigma_rad,
// (t - t_0) / sigma_length).
struct SensorPrior {
  int sensor = 0;
  Rigid3 sensor_from_rig;
  double sigma_rad = 1.0;
  double sigma_length = 1.0;
  // Not the identity if the coordinates are correlated.
  PoseMatrix factor = PoseMatrix::Identity();
};

// Everything that a solve leaves unchanged, except the observations.
struct RigProblemBase {
  struct Image {
    int frame = 0;
    int sensor = 0;
    int camera = 0;  // -1 if there are only rays
  };
  struct Camera {
    CameraModelId model;
    std::vector<int> free_params;  // ascending
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
  std::vector<PositionPrior> position_priors;
  std::vector<GravityPrior> gravity_priors;
  std::vector<SensorPrior> sensor_priors;
  std::vector<BaselineTerm> baselines;
  std::vector<LinearTerm> linear_terms;
  // The rotation S R of each image, for problems in which only products of
  // sensor and frame rotations are known; both must then be constant. If empty,
  // the state provides the rotations.
  std::vector<Eigen::Matrix3d> held_cam_from_world;
  // Per image; empty if images are simultaneous with their frames.
  std::vector<RigMotion> motions;
  // Point p has the observations point_begin[p] to point_begin[p + 1] - 1.
  // Several of them may be in one image.
  std::vector<size_t> point_begin = {0};
  bool points_are_free = true;
  RobustLoss loss = {RobustLossType::kHuber, 1.0};
  // A free point with n observations absorbs 3 of their 2 n degrees of freedom,
  // which reduces the root mean square of its residuals by the factor sqrt((2 n
  // - 3) / (2 n)). If set, the scale of the loss of its observations is smaller
  // by the same factor.
  bool loss_follows_freedom = false;
  RobustLoss position_loss;  // of position_priors
  RobustLoss gravity_loss;   // of gravity_priors

  size_t num_points() const { return point_begin.size() - 1; }
  // The loss of the observations of a point.
  RobustLoss LossOfPoint(size_t num_observations) const;
  RigMotion MotionOf(int image) const {
    return motions.empty() ? RigMotion() : motions[image];
  }
};

inline RobustLoss RigProblemBase::LossOfPoint(size_t num_observations) const {
  RobustLoss scaled = loss;
  if (loss_follows_freedom && points_are_free && num_observations >= 2) {
    const auto num_residuals = 2.0 * static_cast<double>(num_observations);
    scaled.scale *= std::sqrt((num_residuals - 3.0) / num_residuals);
  }
  return scaled;
}

//   minimize  1/2 sum_o rho_o(|r_o|^2) + 1/2 sum_b rho(|r_b|^2)
//           + 1/2 sum_l r_l^2 + 1/2 sum_k ((K_k - value_k) / sigma_k)^2
//           + 1/2 sum_g rho_g(|r_g|^2) + 1/2 sum_s |r_s|^2
//
// over the coordinates that masks leave free: o observations, b baseline terms,
// l linear terms, k priors of parameters, g of positions and of gravity with
// their losses rho_g, s of sensors; rho is the loss, rho_o the loss of the
// point.
template <class Observation>
struct RigProblem : RigProblemBase {
  std::vector<Observation> observations;
};

}  // namespace mgsfm
