// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/observation_terms.h"

#include <gtest/gtest.h>

#include <functional>

#include "mgsfm/base/random.h"
#include "mgsfm/geometry/so3.h"

namespace mgsfm {
namespace {

struct ModelCase {
  CameraModelId model;
  std::vector<double> params;
};

// One image, one point; all free.
struct OneObservation {
  BundleProblem problem;
  BundleState state;
  Eigen::Vector2d pixel{500.0, 400.0};

  explicit OneObservation(const ModelCase& model) {
    Random random(3);
    const auto vector = [&random](double size) {
      return Eigen::Vector3d(size * random.Normal(), size * random.Normal(),
                             size * random.Normal());
    };
    FramePose frame;
    frame.rig_from_world = ExpSO3(vector(1.0));
    frame.center = vector(10.0);
    const Rigid3 sensor = {ExpSO3(vector(1.0)), vector(0.5)};
    CameraParams params{};
    BundleProblem::Camera camera{model.model, {}};
    for (size_t i = 0; i < model.params.size(); ++i) {
      params[i] = model.params[i];
      camera.free_params.push_back(static_cast<int>(i));
    }
    const Eigen::Vector3d x(0.8, -0.4, 3.0);
    const Rigid3 rig_from_world =
        Rigid3::FromRotationAndCenter(frame.rig_from_world, frame.center);
    state = {
        {frame}, {sensor}, {params}, {(sensor * rig_from_world).Inverse() * x}};
    problem.images = {{0, 0, 0}};
    problem.cameras = {camera};
    problem.frame_masks = {PoseMask::Ones()};
    problem.sensor_masks = {PoseMask::Ones()};
  }

  Eigen::Vector2d Residual(const BundleState& at) const {
    return EvaluateResidual(ComputeImagePoses(problem, at)[0], at.points[0],
                            pixel)
        .value();
  }

  // Central difference of the residual when `move` changes the state by +-h.
  Eigen::Vector2d Difference(
      double h, const std::function<void(double, BundleState*)>& move) const {
    BundleState plus = state, minus = state;
    move(h, &plus);
    move(-h, &minus);
    return (Residual(plus) - Residual(minus)) / (2.0 * h);
  }
};

class ObservationTermsTest : public testing::TestWithParam<ModelCase> {};

TEST_P(ObservationTermsTest, DerivativesAreThoseOfDifferences) {
  const OneObservation one(GetParam());
  const auto poses = ComputeImagePoses(one.problem, one.state);
  ObservationTerms terms;
  ASSERT_TRUE(
      EvaluateTerms(poses[0], one.state.points[0], one.pixel, true, &terms));
  EXPECT_LT((terms.residual - one.Residual(one.state)).norm(), 1e-12);
  const int num_params = static_cast<int>(GetParam().params.size());
  const ColumnLayout layout{0, 6, 12, 12 + num_params};
  ObservationColumns columns(2, layout.num_columns);
  FillColumns(one.problem, one.problem.images[0], poses[0], terms, layout,
              &columns);

  constexpr double kStep = 1e-6;
  const auto expect_near = [](const Eigen::Vector2d& analytic,
                              const Eigen::Vector2d& numeric,
                              const std::string& what) {
    EXPECT_LT((analytic - numeric).norm(), 1e-6 * (100.0 + numeric.norm()))
        << what << ": " << analytic.transpose() << " vs. "
        << numeric.transpose();
  };
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector3d e = Eigen::Vector3d::Unit(k);
    expect_near(columns.col(k),
                one.Difference(kStep,
                               [&](double h, auto* s) {
                                 s->frames[0].rig_from_world =
                                     ExpSO3(h * e) *
                                     s->frames[0].rig_from_world;
                               }),
                "frame rotation");
    expect_near(
        columns.col(3 + k),
        one.Difference(
            kStep, [&](double h, auto* s) { s->frames[0].center += h * e; }),
        "frame centre");
    expect_near(columns.col(6 + k),
                one.Difference(kStep,
                               [&](double h, auto* s) {
                                 s->sensors[0].rotation =
                                     ExpSO3(h * e) * s->sensors[0].rotation;
                               }),
                "internal rotation");
    expect_near(columns.col(9 + k),
                one.Difference(kStep,
                               [&](double h, auto* s) {
                                 s->sensors[0].translation += h * e;
                               }),
                "internal translation");
    expect_near(terms.point.col(k),
                one.Difference(
                    kStep, [&](double h, auto* s) { s->points[0] += h * e; }),
                "point");
  }
  for (int k = 0; k < num_params; ++k) {
    expect_near(columns.col(12 + k),
                one.Difference(
                    kStep, [&](double h, auto* s) { s->cameras[0][k] += h; }),
                "parameter " + std::to_string(k));
  }
}

TEST_P(ObservationTermsTest, HeldCoordinatesHaveNoDerivative) {
  OneObservation one(GetParam());
  one.problem.frame_masks[0][4] = 0.0;
  one.problem.sensor_masks[0].head<3>().setZero();
  const auto poses = ComputeImagePoses(one.problem, one.state);
  ObservationTerms terms;
  ASSERT_TRUE(
      EvaluateTerms(poses[0], one.state.points[0], one.pixel, false, &terms));
  const ColumnLayout layout{0, 6, -1, 12};
  ObservationColumns columns(2, layout.num_columns);
  FillColumns(one.problem, one.problem.images[0], poses[0], terms, layout,
              &columns);
  for (int k = 0; k < 12; ++k) {
    const bool is_held = k == 4 || (k >= 6 && k < 9);
    EXPECT_EQ(columns.col(k).norm() == 0.0, is_held) << k;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Models, ObservationTermsTest,
    testing::Values(
        ModelCase{CameraModelId::kSimplePinhole, {700.0, 500.0, 300.0}},
        ModelCase{CameraModelId::kPinhole, {700.0, 710.0, 500.0, 300.0}},
        ModelCase{CameraModelId::kSimpleRadial, {700.0, 500.0, 300.0, 0.05}},
        ModelCase{CameraModelId::kOpenCV,
                  {700.0, 710.0, 500.0, 300.0, -0.2, 0.05, 1e-3, -2e-3}},
        ModelCase{CameraModelId::kOpenCVFisheye,
                  {400.0, 410.0, 500.0, 500.0, 0.01, -0.003, 1e-3, 1e-4}},
        ModelCase{CameraModelId::kThinPrismFisheye,
                  {400.0, 410.0, 500.0, 500.0, 0.01, -0.003, 1e-3, 1e-4, 1e-3,
                   1e-4, 1e-3, -1e-3}},
        ModelCase{CameraModelId::kEquirectangular, {2000.0, 1000.0}}));

}  // namespace
}  // namespace mgsfm
