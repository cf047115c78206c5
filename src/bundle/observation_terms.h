// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "bundle/bundle_problem.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {

// The poses of an image, ready for many observations:
//   x = y + t,  y = S R (p - c)
// is the point p in the camera.
struct ImagePose {
  Eigen::Matrix3d sensor_from_rig;  // S
  Eigen::Matrix3d cam_from_world;   // S R
  Eigen::Vector3d center;           // c
  Eigen::Vector3d translation;      // t
  CameraModelId model = CameraModelId::kPinhole;
  const double* params = nullptr;  // of the state that it was made from
};

std::vector<ImagePose> ComputeImagePoses(const BundleProblem& problem,
                                         const BundleState& state);

// The residual r = Project(x) - pixel and its derivatives by the changes of
// bundle_problem.h. All follow from three of them:
//   sensor  [rotation, projection]
//   frame   [rotation S, -point]
struct ObservationTerms {
  Eigen::Vector2d residual;
  Eigen::Matrix<double, 2, 3> projection;  // by x
  Eigen::Matrix<double, 2, 3> rotation;    // by w of the sensor
  Eigen::Matrix<double, 2, 3> point;       // by p
  PixelJacobianParams params;              // only if asked for
};

// nullopt where the camera cannot see the point.
std::optional<Eigen::Vector2d> EvaluateResidual(const ImagePose& pose,
                                                const Eigen::Vector3d& point,
                                                const Eigen::Vector2d& pixel);

// False where the camera cannot see the point.
bool EvaluateTerms(const ImagePose& pose, const Eigen::Vector3d& point,
                   const Eigen::Vector2d& pixel, bool with_params,
                   ObservationTerms* terms);

// The derivatives of an observation side by side, as far as it has blocks
// (offset -1 if not): frame, sensor, free parameters of the camera.
constexpr int kMaxNumColumns = 12 + kMaxNumCameraParams;
using ObservationColumns = Eigen::Matrix<double, 2, Eigen::Dynamic,
                                         Eigen::RowMajor, 2, kMaxNumColumns>;

struct ColumnLayout {
  int frame = -1;
  int sensor = -1;
  int camera = -1;
  int num_columns = 0;
};

// Held coordinates get zeros. `columns` must have the size of the layout.
void FillColumns(const BundleProblem& problem,
                 const BundleProblem::Image& image, const ImagePose& pose,
                 const ObservationTerms& terms, const ColumnLayout& layout,
                 ObservationColumns* columns);

}  // namespace mgsfm
