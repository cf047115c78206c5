// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "base/random.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm::internal {

// One image pair in the calibration of focal lengths; see
// mgsfm/view_graph/focal_length_calibration.h.

// A lens relative to a camera: the logarithm of the factor on its focal
// lengths; for SIMPLE_DIVISION, the distortion k r^2 at the corner of the
// image, so that the two are nearly uncorrelated; and the offset of the
// principal point in larger image sides.
using LensOffset = Eigen::Vector4d;

Camera WithLens(const Camera& camera, const LensOffset& lens);

// A camera with its focal lengths multiplied by exp(s).
Camera WithFocalFactor(const Camera& camera, double s);

// The ray of a keypoint and its derivative with respect to the pixel.
struct RayPatch {
  Eigen::Vector3d ray;
  Eigen::Matrix<double, 3, 2> by_pixel;
};

// Normal equations of one pair for its pose (5) and the lenses of both cameras.
// If both images have one camera, only the first lens is used.
struct FocalEquations {
  Eigen::Matrix<double, 13, 13> hessian = Eigen::Matrix<double, 13, 13>::Zero();
  Eigen::Matrix<double, 13, 1> gradient = Eigen::Matrix<double, 13, 1>::Zero();
};

class FocalPair {
 public:
  // Uses at most 200 matches, at equal spacing. `cameras` replaces
  // scene.cameras and must outlive the pair.
  FocalPair(const Scene& scene, const std::vector<Camera>& cameras,
            const ImagePair& pair);

  int camera_idx1() const { return camera_idx1_; }
  int camera_idx2() const { return camera_idx2_; }
  int image_idx1() const { return pair_->image_idx1; }
  int image_idx2() const { return pair_->image_idx2; }

  // Drops all but `size` matches, at equal spacing. SetRays() must follow.
  void KeepMatches(size_t size);
  void SetRays(const LensOffset& lens1, const LensOffset& lens2);
  // Initializes the pose from the geometry of the view graph or by RANSAC.
  // Returns false if both fail.
  bool Initialize(Random* random);
  // Gauss-Newton on the pose alone, up to a relative decrease of the cost of
  // 1e-4. Returns the final cost.
  double RefinePose(int num_iterations);
  FocalEquations Linearize() const;
  void MovePose(const Eigen::Matrix<double, 5, 1>& step);
  double Cost() const;
  // Absolute residuals, in pixels.
  std::vector<double> Residuals() const;

  const Rigid3& pose() const { return pose_; }
  void set_pose(const Rigid3& pose) { pose_ = pose; }

 private:
  // nullopt where the camera model cannot unproject the keypoint.
  using Patches = std::vector<std::optional<RayPatch>>;
  static Patches MakePatches(const Camera& camera,
                             const std::vector<Eigen::Vector2d>& pixels);
  // Patches after a small change of the lens. Only focal lengths change the
  // derivatives of rays noticeably, which are divided by the factor.
  static Patches MoveRays(const Camera& camera,
                          const std::vector<Eigen::Vector2d>& pixels,
                          double focal_factor, Patches patches);
  const Camera& camera1() const { return (*cameras_)[camera_idx1_]; }
  const Camera& camera2() const { return (*cameras_)[camera_idx2_]; }
  // The derivatives of the residuals of all matches with respect to the pose.
  Eigen::Matrix<double, Eigen::Dynamic, 5> PoseDerivatives(
      std::vector<double>* residuals) const;
  static void AddResiduals(const Rigid3& pose, const Patches& patches1,
                           const Patches& patches2,
                           std::vector<double>* residuals);

  const std::vector<Camera>* cameras_;
  const ImagePair* pair_;
  int camera_idx1_ = 0, camera_idx2_ = 0;
  std::vector<Eigen::Vector2d> pixels1_, pixels2_;
  LensOffset lens1_ = LensOffset::Zero(), lens2_ = LensOffset::Zero();
  Patches patches1_, patches2_;
  Rigid3 pose_;
};

}  // namespace mgsfm::internal
