// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/epipolar.h"

#include <Eigen/LU>
#include <cmath>

#include "geometry/decompositions.h"
#include "geometry/epipolar_terms.h"
#include "geometry/so3.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

using internal::EpipolarPose;
using internal::EpipolarTerms;

EpipolarPose ToEpipolarPose(const Rigid3& cam2_from_cam1) {
  return {cam2_from_cam1.rotation.toRotationMatrix(),
          cam2_from_cam1.translation.normalized()};
}

bool IsInlierOf(const EpipolarPose& pose, const Eigen::Vector3d& ray1,
                const Eigen::Vector3d& ray2, double max_error_rad) {
  const EpipolarTerms terms(pose, ray1, ray2);
  return terms.IsWithin(max_error_rad * max_error_rad) &&
         terms.IsInFront(ray2, max_error_rad);
}

// The two motions for a unit vector u normal to v2 with |H u| = 1. There are
// two such vectors; each spans a plane with v2 on which H is rigid.
void AppendPlanarMotions(const Eigen::Matrix3d& H, const Eigen::Vector3d& v2,
                         const Eigen::Vector3d& u,
                         std::vector<PlanarMotion>* motions) {
  const Eigen::Vector3d normal = v2.cross(u);
  const Eigen::Vector3d h2 = H * v2, hu = H * u;
  Eigen::Matrix3d from, to;
  from << v2, u, normal;
  to << h2, hu, h2.cross(hu);
  const Eigen::Matrix3d rotation = to * from.transpose();
  const Eigen::Vector3d translation = (H - rotation) * normal;
  const Eigen::Quaterniond q = Eigen::Quaterniond(rotation).normalized();
  motions->push_back({{q, translation}, normal});
  motions->push_back({{q, -translation}, -normal});
}

}  // namespace

Eigen::Matrix3d EssentialFromPose(const Rigid3& cam2_from_cam1) {
  return CrossMatrix(cam2_from_cam1.translation.normalized()) *
         cam2_from_cam1.rotation.toRotationMatrix();
}

std::array<Rigid3, 4> DecomposeEssential(const Eigen::Matrix3d& essential) {
  auto [U, V, values] = Svd3(essential);
  if (U.determinant() < 0.0) U.col(2) *= -1.0;
  if (V.determinant() < 0.0) V.col(2) *= -1.0;
  Eigen::Matrix3d W;
  W << 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0;
  const Eigen::Quaterniond q1(Eigen::Matrix3d(U * W * V.transpose()));
  const Eigen::Quaterniond q2(
      Eigen::Matrix3d(U * W.transpose() * V.transpose()));
  const Eigen::Vector3d t = U.col(2);
  return {Rigid3{q1.normalized(), t}, Rigid3{q1.normalized(), -t},
          Rigid3{q2.normalized(), t}, Rigid3{q2.normalized(), -t}};
}

std::vector<PlanarMotion> DecomposeHomography(const Eigen::Matrix3d& homography,
                                              double rotation_tolerance) {
  const Svd3 svd(homography);
  const Eigen::Vector3d& sigma = svd.values;
  if (!(sigma(2) > 1e-9 * sigma(0))) return {};
  // det(R + t n^T) = 1 + t . R n > 0 because both cameras are on the same side.
  const double sign = homography.determinant() > 0.0 ? 1.0 : -1.0;
  const Eigen::Matrix3d H = homography * (sign / sigma(1));
  if (sigma(0) / sigma(2) - 1.0 <= rotation_tolerance) {
    const Eigen::Matrix3d rotation = sign * svd.U * svd.V.transpose();
    return {
        {{Eigen::Quaterniond(rotation).normalized(), Eigen::Vector3d::Zero()},
         Eigen::Vector3d::UnitZ()}};
  }
  const double s1 = std::pow(sigma(0) / sigma(1), 2);
  const double s3 = std::pow(sigma(2) / sigma(1), 2);
  const Eigen::Matrix3d V = svd.V;
  const Eigen::Vector3d along = std::sqrt((1.0 - s3) / (s1 - s3)) * V.col(0);
  const Eigen::Vector3d across = std::sqrt((s1 - 1.0) / (s1 - s3)) * V.col(2);
  std::vector<PlanarMotion> motions;
  AppendPlanarMotions(H, V.col(1), along + across, &motions);
  AppendPlanarMotions(H, V.col(1), along - across, &motions);
  return motions;
}

bool IsInFront(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
               const Eigen::Vector3d& ray2, double tolerance_rad) {
  return EpipolarTerms(ToEpipolarPose(cam2_from_cam1), ray1, ray2)
      .IsInFront(ray2, tolerance_rad);
}

bool IsInlier(const Rigid3& cam2_from_cam1, const Eigen::Vector3d& ray1,
              const Eigen::Vector3d& ray2, double max_error_rad) {
  return IsInlierOf(ToEpipolarPose(cam2_from_cam1), ray1, ray2, max_error_rad);
}

bool IsRotationInlier(const Eigen::Quaterniond& cam2_from_cam1,
                      const Eigen::Vector3d& ray1, const Eigen::Vector3d& ray2,
                      double max_error_rad) {
  return (cam2_from_cam1 * ray1 - ray2).squaredNorm() <=
         2.0 * max_error_rad * max_error_rad;
}

Mask FindInliers(const RayMatches& matches, const Rigid3& cam2_from_cam1,
                 double max_error_rad) {
  const EpipolarPose pose = ToEpipolarPose(cam2_from_cam1);
  Mask is_inlier(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    is_inlier[i] =
        IsInlierOf(pose, matches.rays1[i], matches.rays2[i], max_error_rad);
  }
  return is_inlier;
}

Mask FindRotationInliers(const RayMatches& matches,
                         const Eigen::Quaterniond& cam2_from_cam1,
                         double max_error_rad) {
  Mask is_inlier(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    is_inlier[i] = IsRotationInlier(cam2_from_cam1, matches.rays1[i],
                                    matches.rays2[i], max_error_rad);
  }
  return is_inlier;
}

std::vector<double> SampsonAngles(const RayMatches& matches,
                                  const Rigid3& cam2_from_cam1) {
  const EpipolarPose pose = ToEpipolarPose(cam2_from_cam1);
  std::vector<double> angles(matches.size());
  for (size_t i = 0; i < matches.size(); ++i) {
    angles[i] = std::sqrt(
        EpipolarTerms(pose, matches.rays1[i], matches.rays2[i]).SquaredError());
  }
  return angles;
}

PoseScore ScoreRelativePose(const RayMatches& matches,
                            const Rigid3& cam2_from_cam1,
                            double max_error_rad) {
  const EpipolarPose pose = ToEpipolarPose(cam2_from_cam1);
  const double max_squared_error = max_error_rad * max_error_rad;
  PoseScore score;
  for (size_t i = 0; i < matches.size(); ++i) {
    const EpipolarTerms terms(pose, matches.rays1[i], matches.rays2[i]);
    if (terms.IsWithin(max_squared_error) &&
        terms.IsInFront(matches.rays2[i], max_error_rad)) {
      score.cost += terms.SquaredError();
      ++score.num_inliers;
    } else {
      score.cost += max_squared_error;
    }
  }
  return score;
}

PoseScore ScoreRotation(const RayMatches& matches,
                        const Eigen::Quaterniond& cam2_from_cam1,
                        double max_error_rad) {
  const Eigen::Matrix3d rotation = cam2_from_cam1.toRotationMatrix();
  const double max_squared_error = max_error_rad * max_error_rad;
  PoseScore score;
  for (size_t i = 0; i < matches.size(); ++i) {
    const double squared_error =
        0.5 * (rotation * matches.rays1[i] - matches.rays2[i]).squaredNorm();
    score.cost += std::min(squared_error, max_squared_error);
    score.num_inliers += squared_error <= max_squared_error;
  }
  return score;
}

}  // namespace mgsfm
