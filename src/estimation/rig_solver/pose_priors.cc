// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/pose_priors.h"

#include <array>
#include <optional>

#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// The weight rho' of a prior and the columns of its blocks, with zeros for
// constant coordinates.
struct WeightedPrior {
  double weight = 1.0;
  PoseVector value;
  std::array<int, 2> blocks = {kNoBlock, kNoBlock};
  std::array<PoseMatrix, 2> columns;
};

void SetColumns(int block, const PoseMask& mask, const PoseMatrix& derivative,
                int part, WeightedPrior* prior) {
  prior->blocks[part] = block;
  prior->columns[part] = derivative * mask.asDiagonal();
}

// Calls function(residual, loss, frame, sensor) for each prior; the priors of
// sensors have no frame.
template <class Function>
void VisitResiduals(const RigProblemBase& problem, const RigState& state,
                    const Function& function) {
  const auto visit = [&](const auto& priors, const RobustLoss& loss,
                         const auto& evaluate) {
    for (const auto& prior : priors) {
      const RigProblemBase::Image& image = problem.images[prior.image];
      function(
          evaluate(prior, state.frames[image.frame],
                   problem.MotionOf(prior.image), state.sensors[image.sensor]),
          loss, std::optional<int>(image.frame), image.sensor);
    }
  };
  visit(problem.position_priors, problem.position_loss, EvaluatePositionPrior);
  visit(problem.gravity_priors, problem.gravity_loss, EvaluateGravityPrior);
  for (const SensorPrior& prior : problem.sensor_priors) {
    function(EvaluateSensorPrior(prior, state.sensors[prior.sensor]),
             RobustLoss(), std::nullopt, prior.sensor);
  }
}

// Calls function(WeightedPrior) for each prior.
template <class Function>
void VisitPriors(const RigProblemBase& problem, const RigStructure& s,
                 const RigState& state, const Function& function) {
  VisitResiduals(
      problem, state,
      [&](const PosePriorResidual& r, const RobustLoss& loss,
          const std::optional<int>& frame, int sensor) {
        WeightedPrior weighted;
        weighted.weight = loss.Weight(r.value.squaredNorm());
        weighted.value = r.value;
        if (frame) {
          SetColumns(s.frame_block[*frame], problem.frame_masks[*frame],
                     r.by_frame, 0, &weighted);
        }
        SetColumns(s.sensor_block[sensor], problem.sensor_masks[sensor],
                   r.by_sensor, 1, &weighted);
        function(weighted);
      });
}

// The columns of the unknowns of a block.
auto UsedColumns(const RigStructure& s, const WeightedPrior& prior, int part) {
  return prior.columns[part].rightCols(s.pose_size);
}

void AddProduct(const RigStructure& s, const WeightedPrior& prior, int a, int b,
                double* matrix) {
  const int row = s.block_rank[prior.blocks[a]];
  const int column = s.block_rank[prior.blocks[b]];
  if (row < column || !s.pattern.Contains(column, row)) return;
  const auto [position, stride] = s.pattern.Find(column, row);
  const Eigen::MatrixXd product =
      prior.weight *
      (UsedColumns(s, prior, a).transpose() * UsedColumns(s, prior, b));
  double* values = matrix + position;
  for (int j = 0; j < s.pose_size; ++j) {
    for (int i = 0; i < s.pose_size; ++i) {
      values[static_cast<size_t>(j) * stride + i] += product(i, j);
    }
  }
}

}  // namespace

PosePriorResidual EvaluatePositionPrior(const PositionPrior& prior,
                                        const FramePose& frame,
                                        const RigMotion& motion,
                                        const Rigid3& sensor_from_rig) {
  const FramePose moved = Move(frame, motion);
  const Matrix3d Rt = moved.rig_from_world.conjugate().toRotationMatrix();
  const Matrix3d St = sensor_from_rig.rotation.conjugate().toRotationMatrix();
  const Vector3d t = sensor_from_rig.translation - prior.point_in_cam;
  const Matrix3d& A = prior.sqrt_information;
  const Vector3d point = moved.center - Rt * (St * t);
  PosePriorResidual r;
  r.size = 3;
  r.value.head<3>() = A * (point - prior.position);
  // M Exp(w) R = Exp(M w) M R moves the point by (M R)^T (M w x S^T t), Exp(w)
  // S by (M R)^T S^T (w x t).
  r.by_frame.topLeftCorner<3, 3>() =
      -A * Rt * CrossMatrix(St * t) * motion.rotation.toRotationMatrix();
  r.by_frame.topRightCorner<3, 3>() = A;
  r.by_sensor.topLeftCorner<3, 3>() = -A * Rt * St * CrossMatrix(t);
  r.by_sensor.topRightCorner<3, 3>() = -A * Rt * St;
  return r;
}

PosePriorResidual EvaluateGravityPrior(const GravityPrior& prior,
                                       const FramePose& frame,
                                       const RigMotion& motion,
                                       const Rigid3& sensor_from_rig) {
  const Matrix3d S =
      (sensor_from_rig.rotation * motion.rotation).toRotationMatrix();
  const Vector3d in_rig = frame.rig_from_world * prior.down;
  const Vector3d in_camera = S * in_rig;
  PosePriorResidual r;
  r.size = 3;
  r.value.head<3>() = (in_camera - prior.direction) / prior.sigma_rad;
  // Exp(w) R changes R down by w x R down; likewise S.
  r.by_frame.topLeftCorner<3, 3>() = -S * CrossMatrix(in_rig) / prior.sigma_rad;
  r.by_sensor.topLeftCorner<3, 3>() = -CrossMatrix(in_camera) / prior.sigma_rad;
  return r;
}

PosePriorResidual EvaluateSensorPrior(const SensorPrior& prior,
                                      const Rigid3& sensor_from_rig) {
  const Vector3d rotation = LogSO3(sensor_from_rig.rotation *
                                   prior.sensor_from_rig.rotation.inverse());
  PosePriorResidual r;
  r.size = 6;
  r.value.head<3>() = rotation / prior.sigma_rad;
  r.value.tail<3>() =
      (sensor_from_rig.translation - prior.sensor_from_rig.translation) /
      prior.sigma_length;
  // Exp(w) is on the left, hence the left Jacobian: the right one at -rotation.
  r.by_sensor.topLeftCorner<3, 3>() =
      InverseRightJacobianSO3(-rotation) / prior.sigma_rad;
  r.by_sensor.bottomRightCorner<3, 3>() =
      Matrix3d::Identity() / prior.sigma_length;
  r.value = prior.factor * r.value;
  r.by_sensor = prior.factor * r.by_sensor;
  return r;
}

double CostOfPosePriors(const RigProblemBase& problem, const RigState& state) {
  double cost = 0.0;
  VisitResiduals(problem, state,
                 [&](const PosePriorResidual& r, const RobustLoss& loss,
                     const std::optional<int>&,
                     int) { cost += 0.5 * loss.Cost(r.value.squaredNorm()); });
  return cost;
}

void AddPosePriors(const RigProblemBase& problem, const RigStructure& s,
                   const RigState& state, Eigen::VectorXd* gradient,
                   Eigen::VectorXd* diagonal, double* matrix) {
  VisitPriors(problem, s, state, [&](const WeightedPrior& prior) {
    for (int a = 0; a < 2; ++a) {
      if (prior.blocks[a] == kNoBlock) continue;
      const int first = s.block_first[prior.blocks[a]];
      const auto columns = UsedColumns(s, prior, a);
      gradient->segment(first, s.pose_size) +=
          prior.weight * (columns.transpose() * prior.value);
      diagonal->segment(first, s.pose_size) +=
          prior.weight * columns.colwise().squaredNorm().transpose();
      for (int b = 0; b < 2; ++b) {
        if (prior.blocks[b] != kNoBlock) AddProduct(s, prior, a, b, matrix);
      }
    }
  });
}

void MultiplyPosePriors(const RigProblemBase& problem, const RigStructure& s,
                        const RigState& state, const Eigen::VectorXd& x,
                        Eigen::VectorXd* y) {
  VisitPriors(problem, s, state, [&](const WeightedPrior& prior) {
    PoseVector sum = PoseVector::Zero();
    for (int a = 0; a < 2; ++a) {
      if (prior.blocks[a] == kNoBlock) continue;
      sum += UsedColumns(s, prior, a) *
             x.segment(s.block_first[prior.blocks[a]], s.pose_size);
    }
    for (int a = 0; a < 2; ++a) {
      if (prior.blocks[a] == kNoBlock) continue;
      y->segment(s.block_first[prior.blocks[a]], s.pose_size) +=
          prior.weight * (UsedColumns(s, prior, a).transpose() * sum);
    }
  });
}

}  // namespace mgsfm
