// SPDX-License-Identifier: BSD-3-Clause
#include "view_graph/focal_pair.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "geometry/epipolar.h"
#include "math/robust_loss.h"
#include "view_graph/pair_estimation.h"

namespace mgsfm::internal {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

// Steps of forward differences, which balance truncation and rounding.
constexpr double kPoseStep = 1e-6;
constexpr double kLensStep = 1e-5;
// The keypoint error up to which the loss is nearly quadratic.
constexpr double kLossScalePx = 1.0;
constexpr RobustLoss kLoss = {RobustLossType::kCauchy, kLossScalePx};

// First-order (Sampson) distance in pixels. Matches without rays and those at
// both epipoles, which constrain nothing, have residual 0.
struct PixelDistance {
  double value = 0.0;
  double variance = 0.0;  // zero if the match constrains nothing
  Vector3d line1 = Vector3d::Zero(), line2 = Vector3d::Zero();

  PixelDistance(const Matrix3d& E, const std::optional<RayPatch>& a,
                const std::optional<RayPatch>& b) {
    if (!a || !b) return;
    line2 = E * a->ray;
    line1 = E.transpose() * b->ray;
    const double squares = (b->by_pixel.transpose() * line2).squaredNorm() +
                           (a->by_pixel.transpose() * line1).squaredNorm();
    // At a focal length of 1000 px, such a match is within 1e-9 rad of both
    // epipoles.
    if (!(squares > 1e-24)) return;
    variance = squares;
    value = b->ray.dot(line2) / std::sqrt(squares);
  }
};

// The derivative with respect to E, as a 3 x 3 matrix.
Matrix3d ByEssential(const PixelDistance& r, const RayPatch& a,
                     const RayPatch& b) {
  const double relative = r.value / r.variance;
  const Vector3d left =
      b.ray / std::sqrt(r.variance) -
      relative * (b.by_pixel * (b.by_pixel.transpose() * r.line2));
  const Vector3d right =
      relative * (a.by_pixel * (a.by_pixel.transpose() * r.line1));
  return left * a.ray.transpose() - b.ray * right.transpose();
}

double CostOf(const std::vector<double>& residuals) {
  double cost = 0.0;
  for (const double r : residuals) cost += 0.5 * kLoss.Cost(r * r);
  return cost;
}

}  // namespace

Camera WithLens(const Camera& camera, const LensOffset& lens) {
  Camera changed = WithFocalFactor(camera, lens[0]);
  const std::vector<int>& center = InfoOf(camera.model).principal_point_idxs;
  for (size_t i = 0; i < center.size(); ++i) {
    changed.params[center[i]] += lens[2 + static_cast<Eigen::Index>(i)] *
                                 std::max(camera.width_px, camera.height_px);
  }
  if (camera.model != CameraModelId::kSimpleDivision) return changed;
  const double corner =
      0.5 * std::hypot(camera.width_px, camera.height_px) / changed.params[0];
  changed.params[3] += lens[1] / (corner * corner);
  return changed;
}

Camera WithFocalFactor(const Camera& camera, double s) {
  Camera scaled = camera;
  const CameraModelInfo& info = InfoOf(camera.model);
  for (const int idx : info.focal_length_idxs) {
    scaled.params[idx] *= std::exp(s);
  }
  return scaled;
}

FocalPair::FocalPair(const Scene& scene, const std::vector<Camera>& cameras,
                     const ImagePair& pair)
    : cameras_(&cameras), pair_(&pair) {
  const Image& image1 = scene.images[pair.image_idx1];
  const Image& image2 = scene.images[pair.image_idx2];
  camera_idx1_ = image1.camera_idx;
  camera_idx2_ = image2.camera_idx;
  // Bounds the cost of a pair; more matches hardly improve its 5 + 2 unknowns.
  const size_t num_used = std::min(size_t{200}, pair.matches.size());
  for (size_t i = 0; i < num_used; ++i) {
    const Match& match = pair.matches[i * pair.matches.size() / num_used];
    pixels1_.emplace_back(
        image1.keypoints_px[match.keypoint_idx1].cast<double>());
    pixels2_.emplace_back(
        image2.keypoints_px[match.keypoint_idx2].cast<double>());
  }
}

void FocalPair::KeepMatches(size_t size) {
  size = std::min(size, pixels1_.size());
  for (std::vector<Vector2d>* pixels : {&pixels1_, &pixels2_}) {
    for (size_t i = 0; i < size; ++i) {
      (*pixels)[i] = (*pixels)[i * pixels->size() / size];
    }
    pixels->resize(size);
  }
}

FocalPair::Patches FocalPair::MakePatches(const Camera& camera,
                                          const std::vector<Vector2d>& pixels) {
  Patches patches(pixels.size());
  for (size_t i = 0; i < pixels.size(); ++i) {
    const auto ray = RayFromPixel(camera, pixels[i]);
    if (!ray) continue;
    Eigen::Matrix<double, 2, 3> J;
    if (!ProjectToPixel(camera.model, camera.params.data(), *ray, &J)) continue;
    // J vanishes along the ray, so that its pseudoinverse is normal to it.
    patches[i] =
        RayPatch{*ray, J.transpose() * (J * J.transpose()).eval().inverse()};
  }
  return patches;
}

FocalPair::Patches FocalPair::MoveRays(const Camera& camera,
                                       const std::vector<Vector2d>& pixels,
                                       double focal_factor, Patches patches) {
  for (size_t i = 0; i < patches.size(); ++i) {
    if (!patches[i]) continue;
    const auto ray = RayFromPixel(camera, pixels[i]);
    if (!ray) continue;
    patches[i]->ray = *ray;
    patches[i]->by_pixel /= focal_factor;
  }
  return patches;
}

void FocalPair::SetRays(const LensOffset& lens1, const LensOffset& lens2) {
  lens1_ = lens1;
  lens2_ = lens2;
  patches1_ = MakePatches(WithLens(camera1(), lens1), pixels1_);
  patches2_ = MakePatches(WithLens(camera2(), lens2), pixels2_);
}

void FocalPair::AddResiduals(const Rigid3& pose, const Patches& patches1,
                             const Patches& patches2,
                             std::vector<double>* residuals) {
  const Matrix3d E = EssentialFromPose(pose);
  for (size_t i = 0; i < patches1.size(); ++i) {
    residuals->push_back(PixelDistance(E, patches1[i], patches2[i]).value);
  }
}

double FocalPair::Cost() const {
  std::vector<double> residuals;
  AddResiduals(pose_, patches1_, patches2_, &residuals);
  return CostOf(residuals);
}

std::vector<double> FocalPair::Residuals() const {
  std::vector<double> residuals;
  AddResiduals(pose_, patches1_, patches2_, &residuals);
  for (double& r : residuals) r = std::abs(r);
  return residuals;
}

bool FocalPair::Initialize(Random* random) {
  double least = std::numeric_limits<double>::infinity();
  const auto consider = [&](const Rigid3& pose) {
    const Rigid3 before = pose_;
    pose_ = pose;
    const double cost = Cost();
    if (cost < least) {
      least = cost;
    } else {
      pose_ = before;
    }
  };
  // All four poses of an essential matrix have the same residuals.
  const auto consider_matrix = [&](const Matrix3d& E) {
    consider(DecomposeEssential(E)[0]);
  };
  const auto& relative = pair_->relative_pose;
  if (relative && relative->translation_direction) {
    consider({relative->cam2_from_cam1, *relative->translation_direction});
  }
  if (pair_->E) consider_matrix(*pair_->E);
  const auto K1 = CalibrationMatrix(camera1());
  const auto K2 = CalibrationMatrix(camera2());
  if (pair_->F && K1 && K2) {
    consider_matrix(K2->transpose() * *pair_->F * *K1);
  }
  if (std::isfinite(least)) return true;
  RayMatches matches;
  for (size_t i = 0; i < patches1_.size(); ++i) {
    if (!patches1_[i] || !patches2_[i]) continue;
    matches.Add(patches1_[i]->ray, patches2_[i]->ray);
  }
  RansacOptions ransac;
  const Camera& camera = camera1();
  // COLMAP's default for two-view geometries; wide, because focal lengths are
  // wrong.
  ransac.max_error_rad = 4.0 / PixelsPerRadian(camera);
  // A sample of five inliers at an inlier ratio of 0.5 is found with
  // probability 1 - (1 - 0.5^5)^200 = 0.998.
  ransac.max_num_trials = 200;
  const auto pose = EstimateRelativePose(matches, ransac, random);
  if (pose) consider(*pose);
  return pose.has_value();
}

Eigen::Matrix<double, Eigen::Dynamic, 5> FocalPair::PoseDerivatives(
    std::vector<double>* residuals) const {
  const Matrix3d E = EssentialFromPose(pose_);
  std::array<Matrix3d, 5> by_pose;
  for (int k = 0; k < 5; ++k) {
    const Rigid3 moved = PerturbRelativePose(
        pose_, kPoseStep * Eigen::Matrix<double, 5, 1>::Unit(k));
    by_pose[k] = (EssentialFromPose(moved) - E) / kPoseStep;
  }
  Eigen::Matrix<double, Eigen::Dynamic, 5> J;
  J.setZero(static_cast<Eigen::Index>(patches1_.size()), 5);
  for (Eigen::Index i = 0; i < J.rows(); ++i) {
    const PixelDistance r(E, patches1_[i], patches2_[i]);
    residuals->push_back(r.value);
    if (r.variance == 0.0) continue;
    const Matrix3d by_E = ByEssential(r, *patches1_[i], *patches2_[i]);
    for (int k = 0; k < 5; ++k) J(i, k) = by_E.cwiseProduct(by_pose[k]).sum();
  }
  return J;
}

FocalEquations FocalPair::Linearize() const {
  std::vector<double> r0;
  const Eigen::Matrix<double, Eigen::Dynamic, 5> by_pose = PoseDerivatives(&r0);
  const auto size = static_cast<Eigen::Index>(r0.size());
  Eigen::Matrix<double, Eigen::Dynamic, 13> J(size, 13);
  J.setZero();
  const auto set_column = [&](int column, const Patches& patches1,
                              const Patches& patches2) {
    std::vector<double> r;
    AddResiduals(pose_, patches1, patches2, &r);
    J.col(column) = (Eigen::VectorXd::Map(r.data(), size) -
                     Eigen::VectorXd::Map(r0.data(), size)) /
                    kLensStep;
  };
  J.leftCols<5>() = by_pose;
  for (int k = 0; k < LensOffset::SizeAtCompileTime; ++k) {
    const LensOffset step = kLensStep * LensOffset::Unit(k);
    const double factor = std::exp(step[0]);
    const Patches moved1 = MoveRays(WithLens(camera1(), lens1_ + step),
                                    pixels1_, factor, patches1_);
    const Patches moved2 = MoveRays(WithLens(camera2(), lens2_ + step),
                                    pixels2_, factor, patches2_);
    if (camera_idx1_ == camera_idx2_) {
      set_column(5 + k, moved1, moved2);
    } else {
      set_column(5 + k, moved1, patches2_);
      set_column(9 + k, patches1_, moved2);
    }
  }
  FocalEquations equations;
  for (Eigen::Index i = 0; i < size; ++i) {
    const double weight = kLoss.Weight(r0[i] * r0[i]);
    equations.hessian += weight * J.row(i).transpose() * J.row(i);
    equations.gradient += weight * r0[i] * J.row(i).transpose();
  }
  return equations;
}

void FocalPair::MovePose(const Eigen::Matrix<double, 5, 1>& step) {
  pose_ = PerturbRelativePose(pose_, step);
}

double FocalPair::RefinePose(int num_iterations) {
  double cost = Cost();
  for (int i = 0; i < num_iterations; ++i) {
    std::vector<double> r;
    const Eigen::Matrix<double, Eigen::Dynamic, 5> J = PoseDerivatives(&r);
    Eigen::Matrix<double, 5, 5> H = Eigen::Matrix<double, 5, 5>::Zero();
    Eigen::Matrix<double, 5, 1> gradient = Eigen::Matrix<double, 5, 1>::Zero();
    for (Eigen::Index k = 0; k < J.rows(); ++k) {
      const double weight = kLoss.Weight(r[k] * r[k]);
      H += weight * J.row(k).transpose() * J.row(k);
      gradient += weight * r[k] * J.row(k).transpose();
    }
    // Damping only acts on directions that no match determines.
    H.diagonal() *= 1.0 + 1e-6;
    H.diagonal().array() += 1e-9;
    const Rigid3 before = pose_;
    MovePose(-H.ldlt().solve(gradient));
    const double new_cost = Cost();
    if (!(new_cost < cost)) {
      pose_ = before;
      break;
    }
    const bool has_converged = new_cost > (1.0 - 1e-4) * cost;
    cost = new_cost;
    if (has_converged) break;
  }
  return cost;
}

}  // namespace mgsfm::internal
