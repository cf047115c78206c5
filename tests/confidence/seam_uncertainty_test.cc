// SPDX-License-Identifier: BSD-3-Clause
#include "confidence/seam_uncertainty.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <vector>

#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {
namespace {

constexpr double kErrorOfPoints_px = 0.8;

Simulation Drive() {
  SimulationOptions options;
  options.num_frames = 6;
  options.num_points_per_frame = 15;
  Simulation simulation = Simulate(options);
  for (Point3D& point : simulation.ground_truth.points) {
    point.error_px = kErrorOfPoints_px;
  }
  return simulation;
}

// Direct application of the definition: rays of all crossing points as a
// function of the motion of one side and of all points, differentiated
// numerically, and the inverse of the dense normal matrix.
class DenseSeam {
 public:
  DenseSeam(const Simulation& simulation, const std::vector<int>& side,
            int frame_idx)
      : scene_(simulation.scene),
        model_(simulation.ground_truth),
        side_(side),
        center_(model_.rig_from_world[frame_idx]->Center()) {
    for (const Point3D& point : model_.points) {
      size_t num_on_side = 0;
      for (const Observation& o : point.track) num_on_side += IsOnSide(o);
      if (num_on_side > 0 && num_on_side < point.track.size()) {
        points_.push_back(&point);
      }
    }
  }

  Eigen::Matrix<double, 6, 6> Covariance() const {
    const Eigen::Index num_parameters =
        6 + 3 * static_cast<Eigen::Index>(points_.size());
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(num_parameters);
    const Eigen::VectorXd base = Residuals(zero);
    Eigen::MatrixXd jacobian(base.size(), num_parameters);
    constexpr double kStep = 1e-6;
    for (Eigen::Index i = 0; i < num_parameters; ++i) {
      Eigen::VectorXd plus = zero, minus = zero;
      plus[i] += kStep;
      minus[i] -= kStep;
      jacobian.col(i) = (Residuals(plus) - Residuals(minus)) / (2.0 * kStep);
    }
    const Eigen::MatrixXd inverse = (jacobian.transpose() * jacobian).inverse();
    return inverse.topLeftCorner<6, 6>();
  }

 private:
  bool IsOnSide(const Observation& observation) const {
    const int frame_idx = scene_.images[observation.image_idx].frame_idx;
    return std::find(side_.begin(), side_.end(), frame_idx) != side_.end();
  }

  // Unit rays in units of one pixel.
  Eigen::VectorXd Residuals(const Eigen::VectorXd& parameters) const {
    std::vector<double> residuals;
    for (size_t i = 0; i < points_.size(); ++i) {
      const Eigen::Vector3d moved =
          points_[i]->point_in_world +
          parameters.segment<3>(6 + 3 * static_cast<Eigen::Index>(i));
      for (const Observation& o : points_[i]->track) {
        const Eigen::Vector3d seen =
            IsOnSide(o) ? Eigen::Vector3d(center_ +
                                          ExpSO3(parameters.head<3>()) *
                                              (moved - center_) +
                                          parameters.segment<3>(3))
                        : moved;
        const Camera& camera =
            model_.cameras[scene_.images[o.image_idx].camera_idx];
        const Eigen::Vector3d ray =
            PixelsPerRadian(camera.model, camera.params.data()) *
            (*model_.CamFromWorld(scene_, o.image_idx) * seen).normalized();
        residuals.insert(residuals.end(), {ray.x(), ray.y(), ray.z()});
      }
    }
    return Eigen::Map<Eigen::VectorXd>(
        residuals.data(), static_cast<Eigen::Index>(residuals.size()));
  }

  const Scene& scene_;
  const Reconstruction& model_;
  const std::vector<int>& side_;
  const Eigen::Vector3d center_;
  std::vector<const Point3D*> points_;
};

TEST(SeamUncertainty, EqualsThatOfTheDenseProblem) {
  const Simulation simulation = Drive();
  const std::vector<int> side = {3, 4, 5};
  const auto uncertainty = EstimateSeamUncertainty(
      simulation.scene, simulation.ground_truth, side, 3);
  ASSERT_TRUE(uncertainty.has_value());
  const double noise_px = SigmaFromMedianNorm<2>(kErrorOfPoints_px);
  const Eigen::Matrix<double, 6, 6> covariance =
      noise_px * noise_px * DenseSeam(simulation, side, 3).Covariance();
  const double sigma_rotation_deg =
      RadToDeg(std::sqrt(covariance.topLeftCorner<3, 3>().trace()));
  const double sigma_position =
      std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
  EXPECT_NEAR(uncertainty->sigma_rotation_deg, sigma_rotation_deg,
              1e-4 * sigma_rotation_deg);
  EXPECT_NEAR(uncertainty->sigma_position, sigma_position,
              1e-4 * sigma_position);
}

TEST(SeamUncertainty, IsUnknownWithoutEnoughPoints) {
  Simulation simulation = Drive();
  simulation.ground_truth.points.resize(1);
  EXPECT_FALSE(EstimateSeamUncertainty(simulation.scene,
                                       simulation.ground_truth, {3, 4, 5}, 3));
}

}  // namespace
}  // namespace mgsfm
