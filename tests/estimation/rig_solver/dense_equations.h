// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "estimation/rig_solver/rig_fixtures.h"
#include "geometry/so3.h"
#include "mgsfm/geometry/camera_models.h"
#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {

// The equations of a step by another route: residuals as rig_problem.h defines
// them, derivatives as differences, all unknowns in one dense matrix. Unknowns
// are those of the structure, then the points of the problem in its own order.
struct ResidualGroup {
  Eigen::VectorXd value;
  RobustLoss loss;
};

inline Eigen::VectorXd ObservationResidual(const RigProblemBase& problem,
                                           const RigState& state,
                                           const PixelObservation& o,
                                           const Eigen::Vector3d& point) {
  const int camera = problem.images[o.image].camera;
  return ProjectToPixel(problem.cameras[camera].model,
                        state.cameras[camera].data(),
                        PointInCamera(problem, state, o.image, point))
             .value() -
         o.pixel.cast<double>();
}

inline Eigen::VectorXd ObservationResidual(const RigProblemBase& problem,
                                           const RigState& state,
                                           const RayObservation& o,
                                           const Eigen::Vector3d& point) {
  return PointInCamera(problem, state, o.image, point).normalized() - o.ray;
}

inline Eigen::VectorXd BaselineTermResidual(const RigProblemBase& problem,
                                            const RigState& state,
                                            const BaselineTerm& term) {
  const auto center = [&](int image_idx) -> Eigen::Vector3d {
    const RigProblemBase::Image& image = problem.images[image_idx];
    const FramePose frame =
        Move(state.frames[image.frame], problem.MotionOf(image_idx));
    return frame.center + frame.rig_from_world.conjugate() *
                              state.sensors[image.sensor].Center();
  };
  const Eigen::Vector3d C = center(term.image2) - center(term.image1);
  const double L =
      std::sqrt(C.squaredNorm() + term.min_length * term.min_length);
  switch (term.kind) {
    case BaselineTerm::Kind::kDirection:
      return term.weight * (C / L - term.direction);
    case BaselineTerm::Kind::kLength:
      return Eigen::VectorXd::Constant(1,
                                       term.weight * std::log(L / term.length));
    default:
      return term.weight * C;
  }
}

template <class Observation>
std::vector<ResidualGroup> AllResiduals(const RigProblem<Observation>& problem,
                                        const RigState& state) {
  std::vector<ResidualGroup> groups;
  for (size_t p = 0; p < problem.num_points(); ++p) {
    RobustLoss loss = problem.loss;
    if (problem.loss_follows_freedom && problem.points_are_free) {
      const auto num_observations = static_cast<double>(
          problem.point_begin[p + 1] - problem.point_begin[p]);
      loss.scale =
          std::sqrt(loss.scale * loss.scale * (1.0 - 1.5 / num_observations));
    }
    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      const Observation& observation = problem.observations[o];
      groups.push_back(
          {ObservationResidual(problem, state, observation, state.points[p]),
           loss});
    }
  }
  for (const BaselineTerm& term : problem.baselines) {
    groups.push_back(
        {BaselineTermResidual(problem, state, term), problem.loss});
  }
  for (const LinearTerm& term : problem.linear_terms) {
    double sum = -term.value;
    for (const LinearTerm::Part& part : term.parts) {
      sum += part.coefficients.dot(part.is_frame
                                       ? state.frames[part.idx].center
                                       : state.sensors[part.idx].translation);
    }
    groups.push_back({Eigen::VectorXd::Constant(1, term.weight * sum), {}});
  }
  for (const RigProblemBase::ParameterPrior& prior : problem.priors) {
    const double value = state.cameras[prior.camera][prior.param];
    groups.push_back(
        {Eigen::VectorXd::Constant(1, (value - prior.value) / prior.sigma),
         {}});
  }
  for (const PositionPrior& prior : problem.position_priors) {
    const RigProblemBase::Image& image = problem.images[prior.image];
    const FramePose frame =
        Move(state.frames[image.frame], problem.MotionOf(prior.image));
    const Rigid3 cam_from_world =
        state.sensors[image.sensor] *
        Rigid3::FromRotationAndCenter(frame.rig_from_world, frame.center);
    groups.push_back(
        {prior.sqrt_information *
             (cam_from_world.Inverse() * prior.point_in_cam - prior.position),
         problem.position_loss});
  }
  for (const GravityPrior& prior : problem.gravity_priors) {
    const RigProblemBase::Image& image = problem.images[prior.image];
    const Eigen::Quaterniond cam_from_world =
        state.sensors[image.sensor].rotation *
        problem.MotionOf(prior.image).rotation *
        state.frames[image.frame].rig_from_world;
    groups.push_back(
        {(cam_from_world * prior.down - prior.direction) / prior.sigma_rad,
         problem.gravity_loss});
  }
  for (const SensorPrior& prior : problem.sensor_priors) {
    const Rigid3& sensor = state.sensors[prior.sensor];
    Eigen::VectorXd value(6);
    value << LogSO3(sensor.rotation *
                    prior.sensor_from_rig.rotation.conjugate()) /
                 prior.sigma_rad,
        (sensor.translation - prior.sensor_from_rig.translation) /
            prior.sigma_length;
    groups.push_back({prior.factor * value, {}});
  }
  return groups;
}

// The state after a step.
inline RigState Moved(const RigProblemBase& problem, const RigStructure& s,
                      RigState state, const Eigen::VectorXd& step) {
  const auto pose_step = [&](int block, const PoseMask& mask) {
    PoseVector d = PoseVector::Zero();
    if (block >= 0) {
      d.tail(s.pose_size) = step.segment(s.block_first[block], s.pose_size);
    }
    return PoseVector(d.cwiseProduct(mask));
  };
  for (size_t i = 0; i < state.frames.size(); ++i) {
    const PoseVector d = pose_step(s.frame_block[i], problem.frame_masks[i]);
    FramePose& pose = state.frames[i];
    pose.rig_from_world = ExpSO3(d.head<3>()) * pose.rig_from_world;
    pose.center += d.tail<3>();
  }
  for (size_t i = 0; i < state.sensors.size(); ++i) {
    const PoseVector d = pose_step(s.sensor_block[i], problem.sensor_masks[i]);
    Rigid3& pose = state.sensors[i];
    pose.rotation = ExpSO3(d.head<3>()) * pose.rotation;
    pose.translation += d.tail<3>();
  }
  for (size_t i = 0; i < state.cameras.size(); ++i) {
    if (s.camera_block[i] < 0) continue;
    int first = s.block_first[s.camera_block[i]];
    for (const int param : problem.cameras[i].free_params) {
      state.cameras[i][param] += step[first++];
    }
  }
  if (problem.points_are_free) {
    for (size_t p = 0; p < state.points.size(); ++p) {
      state.points[p] += step.segment<3>(s.num_unknowns + 3 * p);
    }
  }
  return state;
}

inline double CostOfResiduals(const std::vector<ResidualGroup>& groups) {
  double cost = 0.0;
  for (const ResidualGroup& group : groups) {
    cost += 0.5 * group.loss.Cost(group.value.squaredNorm());
  }
  return cost;
}

// The step of each unknown for a difference.
inline Eigen::VectorXd DifferenceSteps(const RigProblemBase& problem,
                                       const RigStructure& s,
                                       const RigState& state, int size) {
  constexpr double kStep = 1e-6;
  Eigen::VectorXd steps = Eigen::VectorXd::Constant(size, kStep);
  for (size_t i = 0; i < state.cameras.size(); ++i) {
    if (s.camera_block[i] < 0) continue;
    int first = s.block_first[s.camera_block[i]];
    for (const int param : problem.cameras[i].free_params) {
      steps[first++] *= std::max(1.0, std::abs(state.cameras[i][param]));
    }
  }
  return steps;
}

struct DenseEquations {
  double cost = 0.0;
  Eigen::MatrixXd hessian;   // J^T W J
  Eigen::VectorXd gradient;  // J^T W r

  Eigen::MatrixXd Damped(double lambda) const {
    Eigen::MatrixXd damped = hessian;
    const Eigen::VectorXd diagonal = hessian.diagonal();
    for (Eigen::Index i = 0; i < damped.rows(); ++i) {
      damped(i, i) +=
          diagonal[i] > 0.0 ? lambda * std::max(diagonal[i], 1e-6) : 1.0;
    }
    return damped;
  }
};

template <class Observation>
DenseEquations MakeDenseEquations(const RigProblem<Observation>& problem,
                                  const RigStructure& s,
                                  const RigState& state) {
  const int size =
      s.num_unknowns + (problem.points_are_free
                            ? 3 * static_cast<int>(problem.num_points())
                            : 0);
  const std::vector<ResidualGroup> groups = AllResiduals(problem, state);
  Eigen::Index num_rows = 0;
  for (const ResidualGroup& group : groups) num_rows += group.value.size();
  Eigen::MatrixXd J(num_rows, size);
  const Eigen::VectorXd h = DifferenceSteps(problem, s, state, size);
  for (int i = 0; i < size; ++i) {
    const Eigen::VectorXd step = h[i] * Eigen::VectorXd::Unit(size, i);
    const auto after = AllResiduals(problem, Moved(problem, s, state, step));
    const auto before = AllResiduals(problem, Moved(problem, s, state, -step));
    Eigen::Index row = 0;
    for (size_t g = 0; g < groups.size(); ++g) {
      const Eigen::Index n = groups[g].value.size();
      J.col(i).segment(row, n) =
          (after[g].value - before[g].value) / (2.0 * h[i]);
      row += n;
    }
  }
  Eigen::VectorXd r(num_rows);
  Eigen::Index row = 0;
  for (const ResidualGroup& group : groups) {
    const Eigen::Index n = group.value.size();
    const double weight = group.loss.Weight(group.value.squaredNorm());
    J.middleRows(row, n) *= std::sqrt(weight);
    r.segment(row, n) = std::sqrt(weight) * group.value;
    row += n;
  }
  return {CostOfResiduals(groups), J.transpose() * J, J.transpose() * r};
}

}  // namespace mgsfm
