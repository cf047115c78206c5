// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/evaluation/evaluation.h"

namespace mgsfm {
namespace {

// A drive of 1.3 m steps along a winding road, estimated with random errors of
// each step in another unit of length. Every seventh image is of a second
// camera, and some images are not registered.
std::vector<ImagePoses> NoisyDrive(int num_frames, double noise) {
  Random random(7);
  const auto vector = [&](double sigma) {
    return Eigen::Vector3d(sigma * random.Normal(), sigma * random.Normal(),
                           sigma * random.Normal());
  };
  std::vector<ImagePoses> images;
  Rigid3 pose, estimate;  // cam_from_world
  for (int i = 0; i < num_frames; ++i) {
    const Rigid3 step{ExpSO3({0.0, 0.02 * std::sin(0.05 * i), 0.0}),
                      {0.0, 0.0, -1.3}};
    pose = step * pose;
    estimate =
        Rigid3{ExpSO3(vector(noise)), vector(5.0 * noise)} * step * estimate;
    Rigid3 in_model = estimate;
    in_model.translation *= 0.25;
    images.push_back({"left" + std::to_string(i), true, in_model, pose});
    if (i % 50 == 20) images.back().cam_from_model.reset();
    if (i % 7 == 0) images.push_back({"right", false, in_model, pose});
  }
  return images;
}

Eigen::Matrix4d Matrix(const Rigid3& pose) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = pose.rotation.toRotationMatrix();
  matrix.topRightCorner<3, 1>() = pose.translation;
  return matrix;
}

// The poses world_from_cam of the reference camera, as the devkits have them.
struct Paths {
  std::vector<Eigen::Matrix4d> truth, result;
  std::vector<bool> is_registered;
};

Paths MakePaths(const std::vector<ImagePoses>& images, double scale) {
  Paths paths;
  for (const ImagePoses& image : images) {
    if (!image.is_reference) continue;
    paths.truth.push_back(Matrix(image.cam_from_world.Inverse()));
    Rigid3 result = image.cam_from_model.value_or(Rigid3());
    result.translation *= scale;
    paths.result.push_back(Matrix(result.Inverse()));
    paths.is_registered.push_back(image.cam_from_model.has_value());
  }
  return paths;
}

double Angle(const Eigen::Matrix4d& error) {
  return std::acos(
      std::clamp(0.5 * (error.topLeftCorner<3, 3>().trace() - 1.0), -1.0, 1.0));
}

// evaluate_odometry.cpp of KITTI, without segments that lack an image.
TEST(RelativeErrors, SegmentsAreThoseOfKitti) {
  const std::vector<ImagePoses> images = NoisyDrive(800, 1e-3);
  const Evaluation evaluation = Evaluate(images, true, {}, {});
  const Paths paths = MakePaths(images, evaluation.world_from_model->scale);
  std::vector<double> dist = {0.0};
  for (size_t i = 1; i < paths.truth.size(); ++i) {
    dist.push_back(dist.back() +
                   (paths.truth[i] - paths.truth[i - 1]).col(3).norm());
  }
  double t_sum = 0.0, r_sum = 0.0;
  int num = 0;
  for (size_t first = 0; first < paths.truth.size(); first += 10) {
    for (const double len : {100., 200., 300., 400., 500., 600., 700., 800.}) {
      size_t last = first;
      while (last < dist.size() && dist[last] <= dist[first] + len) ++last;
      if (last == dist.size()) continue;
      if (!paths.is_registered[first] || !paths.is_registered[last]) continue;
      const Eigen::Matrix4d delta_gt =
          paths.truth[first].inverse() * paths.truth[last];
      const Eigen::Matrix4d delta_result =
          paths.result[first].inverse() * paths.result[last];
      const Eigen::Matrix4d error = delta_result.inverse() * delta_gt;
      t_sum += error.topRightCorner<3, 1>().norm() / len;
      r_sum += Angle(error) / len;
      ++num;
    }
  }
  ASSERT_TRUE(evaluation.segments.has_value());
  EXPECT_EQ(evaluation.segments->num_segments, num);
  EXPECT_NEAR(evaluation.segments->translation_percent, 100.0 * t_sum / num,
              1e-9);
  EXPECT_NEAR(evaluation.segments->rotation_deg_per_100m,
              100.0 * RadToDeg(r_sum / num), 1e-6);
}

// evaluate_rpe.py of TUM with a delta of one image.
TEST(RelativeErrors, StepsAreThoseOfTum) {
  const std::vector<ImagePoses> images = NoisyDrive(60, 1e-2);
  const Evaluation evaluation = Evaluate(images, true, {}, {});
  const Paths paths = MakePaths(images, evaluation.world_from_model->scale);
  double t_square = 0.0, r_square = 0.0;
  int num = 0;
  for (size_t i = 1; i < paths.truth.size(); ++i) {
    if (!paths.is_registered[i - 1] || !paths.is_registered[i]) continue;
    const Eigen::Matrix4d error =
        (paths.truth[i - 1].inverse() * paths.truth[i]).inverse() *
        (paths.result[i - 1].inverse() * paths.result[i]);
    t_square += error.topRightCorner<3, 1>().squaredNorm();
    r_square += Angle(error) * Angle(error);
    ++num;
  }
  ASSERT_TRUE(evaluation.steps.has_value());
  EXPECT_EQ(evaluation.steps->num_steps, num);
  EXPECT_NEAR(evaluation.steps->translation_m.rms, std::sqrt(t_square / num),
              1e-9);
  EXPECT_NEAR(evaluation.steps->rotation_deg.rms,
              RadToDeg(std::sqrt(r_square / num)), 1e-6);
  EXPECT_FALSE(evaluation.segments.has_value());  // shorter than 100 m
}

TEST(RelativeErrors, TheTrajectoryErrorIsARootMeanSquare) {
  std::vector<ImagePoses> images = NoisyDrive(100, 1e-2);
  const Evaluation evaluation = Evaluate(images, true, {}, {});
  double square = 0.0;
  int num = 0;
  for (const ImagePoses& image : images) {
    if (!image.cam_from_model) continue;
    square += (*evaluation.world_from_model * image.cam_from_model->Center() -
               image.cam_from_world.Center())
                  .squaredNorm();
    ++num;
  }
  EXPECT_NEAR(evaluation.position_m->rms, std::sqrt(square / num), 1e-9);
  EXPECT_GT(evaluation.position_m->rms, evaluation.position_m->mean);
}

}  // namespace
}  // namespace mgsfm
