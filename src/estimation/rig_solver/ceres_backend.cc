// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/ceres_backend.h"

#include <ceres/cost_function.h>
#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/ordered_groups.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "rig_solver/baseline_terms.h"
#include "rig_solver/ceres_solving.h"
#include "rig_solver/image_poses.h"
#include "rig_solver/pose_priors.h"
#include "rig_solver/residuals.h"
#include "rig_solver/schur_kernels.h"

namespace mgsfm {
namespace {

// The residuals of a rig problem as Ceres cost functions, with the derivatives
// of the native solver.

using RowMajor3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

// A rotation (x, y, z, w), then a translation or center.
using PoseBlock = std::array<double, 7>;

inline PoseBlock MakePoseBlock(const Eigen::Quaterniond& q,
                               const Eigen::Vector3d& t) {
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()};
}
inline Eigen::Quaterniond RotationOf(const double* block) {
  return Eigen::Quaterniond(block[3], block[0], block[1], block[2]);
}

// The pose changes of rig_problem.h that a mask leaves free. Cost functions
// write derivatives with respect to all six as the first six columns, so that
// the derivative of Plus selects columns.
class PoseManifold : public CeresManifold {
 public:
  explicit PoseManifold(const PoseMask& mask) {
    for (int i = 0; i < 6; ++i) {
      if (mask[i] != 0.0) free_.push_back(i);
    }
  }
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return static_cast<int>(free_.size()); }
  bool Plus(const double* x, const double* delta,
            double* x_plus_delta) const override {
    PoseVector d = PoseVector::Zero();
    for (size_t i = 0; i < free_.size(); ++i) d[free_[i]] = delta[i];
    Eigen::Quaterniond q = RotationOf(x);
    if (!d.head<3>().isZero(0.0)) q = (ExpSO3(d.head<3>()) * q).normalized();
    const PoseBlock moved =
        MakePoseBlock(q, Eigen::Vector3d::Map(x + 4) + d.tail<3>());
    std::copy(moved.begin(), moved.end(), x_plus_delta);
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    std::fill_n(jacobian, 7 * free_.size(), 0.0);
    for (size_t i = 0; i < free_.size(); ++i) {
      jacobian[free_[i] * free_.size() + i] = 1.0;
    }
    return true;
  }
  // Ceres needs these functions only for bounds and covariances.
  bool Minus(const double*, const double*, double*) const override {
    return false;
  }
  bool MinusJacobian(const double*, double*) const override { return false; }

 private:
  std::vector<int> free_;
};

inline ImagePose MakeImagePose(const RigProblemBase& problem, int image_idx,
                               const double* frame, const double* sensor,
                               const double* params) {
  const RigProblemBase::Image& image = problem.images[image_idx];
  const RigMotion motion = problem.MotionOf(image_idx);
  ImagePose pose;
  if (problem.held_cam_from_world.empty()) {
    const Eigen::Matrix3d S =
        (RotationOf(sensor) * motion.rotation).toRotationMatrix();
    RowMajor3d::Map(pose.sensor_from_frame) = S;
    RowMajor3d::Map(pose.cam_from_world).noalias() =
        S * RotationOf(frame).toRotationMatrix();
  } else {
    RowMajor3d::Map(pose.sensor_from_frame).setZero();
    RowMajor3d::Map(pose.cam_from_world) =
        problem.held_cam_from_world[image_idx];
  }
  Eigen::Vector3d::Map(pose.center) =
      Eigen::Vector3d::Map(frame + 4) + motion.shift_in_world;
  std::copy_n(sensor + 4, 3, pose.translation);
  if (image.camera >= 0) {
    const RigProblemBase::Camera& camera = problem.cameras[image.camera];
    pose.params = params;
    pose.projection = FindPixelProjection(camera.model);
    pose.free_params = camera.free_params.data();
    pose.num_free_params = static_cast<int>(camera.free_params.size());
    pose.num_params = InfoOf(camera.model).num_params;
  }
  return pose;
}

// Blocks: frame, sensor, point, and the camera if there is one.
template <class R>
class ObservationCost : public ceres::CostFunction {
 public:
  ObservationCost(const RigProblemBase& problem, int image,
                  const typename R::Scalar* measured)
      : problem_(problem), image_(image) {
    std::copy_n(measured, R::kDim, measured_);
    set_num_residuals(R::kDim);
    *mutable_parameter_block_sizes() = {7, 7, 3};
    if (R::kHasCamera) {
      mutable_parameter_block_sizes()->push_back(kMaxNumCameraParams);
    }
  }

  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    const ImagePose pose = MakeImagePose(problem_, image_, blocks[0], blocks[1],
                                         R::kHasCamera ? blocks[3] : nullptr);
    if (jacobians == nullptr) {
      double y[3], x[3];
      TransformPoint(pose, blocks[2], y, x);
      return R::Evaluate(pose, x, measured_, residuals);
    }
    ObservationTerms<R::kDim> o;
    if (!LinearizeObservation<R>({RobustLossType::kTrivial, 1.0}, pose,
                                 blocks[2], measured_, &o)) {
      return false;
    }
    std::copy_n(o.residual, R::kDim, residuals);
    WriteJacobians(pose, o, jacobians);
    return true;
  }

 private:
  void WriteJacobians(const ImagePose& pose, const ObservationTerms<R::kDim>& o,
                      double** jacobians) const {
    constexpr int kDim = R::kDim;
    double Q[3 * kDim], turn[3 * kDim], J[3 * kDim];
    RotationRows<kDim>(o.y, o.P, 3, Q);
    MultiplyRows<kDim>(Q, 3, pose.sensor_from_frame, 3, turn);
    MultiplyRows<kDim>(o.P, 3, pose.cam_from_world, 3, J);
    for (int k = 0; k < kDim; ++k) {
      for (int i = 0; i < 3; ++i) {
        if (jacobians[0] != nullptr) {
          jacobians[0][7 * k + i] = turn[3 * k + i];
          jacobians[0][7 * k + 3 + i] = -J[3 * k + i];
          jacobians[0][7 * k + 6] = 0.0;
        }
        if (jacobians[1] != nullptr) {
          jacobians[1][7 * k + i] = Q[3 * k + i];
          jacobians[1][7 * k + 3 + i] = o.P[3 * k + i];
          jacobians[1][7 * k + 6] = 0.0;
        }
        if (jacobians[2] != nullptr) jacobians[2][3 * k + i] = J[3 * k + i];
      }
      if (!R::kHasCamera || jacobians[3] == nullptr) continue;
      double* row = jacobians[3] + kMaxNumCameraParams * k;
      std::fill_n(row, kMaxNumCameraParams, 0.0);
      for (int i = 0; i < pose.num_free_params; ++i) {
        row[pose.free_params[i]] = o.K[k * pose.num_free_params + i];
      }
    }
  }

  const RigProblemBase& problem_;
  const int image_;
  typename R::Scalar measured_[R::kDim];
};

// Blocks: frames and sensors of both images, each once.
class BaselineCost : public ceres::CostFunction {
 public:
  // Block indices of frame and sensor of image 1, then of image 2.
  using Positions = std::array<int, 4>;

  BaselineCost(const RigProblemBase& problem, const BaselineTerm& term,
               const Positions& positions, size_t num_poses)
      : problem_(problem),
        term_(term),
        positions_(positions),
        num_poses_(num_poses) {
    set_num_residuals(term.kind == BaselineTerm::Kind::kLength ? 1 : 3);
    mutable_parameter_block_sizes()->assign(num_poses, 7);
  }

  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    Eigen::Vector3d baseline = Eigen::Vector3d::Zero();
    std::array<Eigen::Matrix3d, 4> coefficients;
    for (int side = 0; side < 2; ++side) {
      const double sign = side == 0 ? -1.0 : 1.0;
      const int frame = positions_[2 * side], sensor = positions_[2 * side + 1];
      const ImagePose pose =
          MakeImagePose(problem_, side == 0 ? term_.image1 : term_.image2,
                        blocks[frame], blocks[sensor], nullptr);
      coefficients[2 * side] = sign * Eigen::Matrix3d::Identity();
      coefficients[2 * side + 1] =
          -sign * RowMajor3d::Map(pose.cam_from_world).transpose();
      for (int k : {2 * side, 2 * side + 1}) {
        baseline +=
            coefficients[k] * Eigen::Vector3d::Map(blocks[positions_[k]] + 4);
      }
    }
    const BaselineResidual r = EvaluateBaselineTerm(term_, baseline);
    for (int i = 0; i < r.size; ++i) residuals[i] = r.value[i];
    if (jacobians == nullptr) return true;
    for (size_t b = 0; b < num_poses_; ++b) {
      if (jacobians[b] != nullptr) std::fill_n(jacobians[b], 7 * r.size, 0.0);
    }
    for (int k = 0; k < 4; ++k) {
      double* jacobian = jacobians[positions_[k]];
      if (jacobian == nullptr) continue;
      const Eigen::Matrix3d J = r.by_baseline * coefficients[k];
      for (int i = 0; i < r.size; ++i) {
        for (int j = 0; j < 3; ++j) jacobian[7 * i + 3 + j] += J(i, j);
      }
    }
    return true;
  }

 private:
  const RigProblemBase& problem_;
  const BaselineTerm& term_;
  const Positions positions_;
  const size_t num_poses_;
};

class LinearTermCost : public ceres::CostFunction {
 public:
  explicit LinearTermCost(const LinearTerm& term) : term_(term) {
    set_num_residuals(1);
    mutable_parameter_block_sizes()->assign(term.parts.size(), 7);
  }
  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    residuals[0] = -term_.weight * term_.value;
    for (size_t k = 0; k < term_.parts.size(); ++k) {
      const Eigen::Vector3d row = term_.weight * term_.parts[k].coefficients;
      residuals[0] += row.dot(Eigen::Vector3d::Map(blocks[k] + 4));
      if (jacobians == nullptr || jacobians[k] == nullptr) continue;
      std::fill_n(jacobians[k], 7, 0.0);
      Eigen::Vector3d::Map(jacobians[k] + 3) = row;
    }
    return true;
  }

 private:
  const LinearTerm& term_;
};

class PriorCost : public ceres::CostFunction {
 public:
  explicit PriorCost(const RigProblemBase::ParameterPrior& prior)
      : prior_(prior) {
    set_num_residuals(1);
    *mutable_parameter_block_sizes() = {kMaxNumCameraParams};
  }
  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    residuals[0] = (blocks[0][prior_.param] - prior_.value) / prior_.sigma;
    if (jacobians == nullptr || jacobians[0] == nullptr) return true;
    std::fill_n(jacobians[0], kMaxNumCameraParams, 0.0);
    jacobians[0][prior_.param] = 1.0 / prior_.sigma;
    return true;
  }

 private:
  const RigProblemBase::ParameterPrior& prior_;
};

// Writes the derivatives of a prior with respect to one of its blocks.
inline void WriteJacobian(const PoseMatrix& derivative, int size,
                          double* jacobian) {
  if (jacobian == nullptr) return;
  for (int i = 0; i < size; ++i) {
    for (int j = 0; j < 6; ++j) jacobian[7 * i + j] = derivative(i, j);
    jacobian[7 * i + 6] = 0.0;
  }
}

// A prior of an image. Blocks: frame, sensor.
template <class Prior, auto kEvaluate>
class ImagePriorCost : public ceres::CostFunction {
 public:
  ImagePriorCost(const Prior& prior, const RigMotion& motion)
      : prior_(prior), motion_(motion) {
    set_num_residuals(3);
    *mutable_parameter_block_sizes() = {7, 7};
  }
  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    const PosePriorResidual r = kEvaluate(
        prior_, {RotationOf(blocks[0]), Eigen::Vector3d::Map(blocks[0] + 4)},
        motion_, {RotationOf(blocks[1]), Eigen::Vector3d::Map(blocks[1] + 4)});
    std::copy_n(r.value.data(), r.size, residuals);
    if (jacobians == nullptr) return true;
    WriteJacobian(r.by_frame, r.size, jacobians[0]);
    WriteJacobian(r.by_sensor, r.size, jacobians[1]);
    return true;
  }

 private:
  const Prior& prior_;
  const RigMotion motion_;
};
using PositionPriorCost = ImagePriorCost<PositionPrior, EvaluatePositionPrior>;
using GravityPriorCost = ImagePriorCost<GravityPrior, EvaluateGravityPrior>;

class SensorPriorCost : public ceres::CostFunction {
 public:
  explicit SensorPriorCost(const SensorPrior& prior) : prior_(prior) {
    set_num_residuals(6);
    *mutable_parameter_block_sizes() = {7};
  }
  bool Evaluate(double const* const* blocks, double* residuals,
                double** jacobians) const override {
    const PosePriorResidual r = EvaluateSensorPrior(
        prior_, {RotationOf(blocks[0]), Eigen::Vector3d::Map(blocks[0] + 4)});
    std::copy_n(r.value.data(), r.size, residuals);
    if (jacobians != nullptr) WriteJacobian(r.by_sensor, r.size, jacobians[0]);
    return true;
  }

 private:
  const SensorPrior& prior_;
};

using Eigen::Vector3d;

template <class R>
class CeresRigProblem {
 public:
  using Problem = RigProblem<typename R::Observation>;

  CeresRigProblem(const Problem& rig, RigState* state)
      : rig_(rig),
        state_(*state),
        loss_(rig.loss),
        position_loss_(rig.position_loss),
        gravity_loss_(rig.gravity_loss),
        problem_(Options()) {
    for (const FramePose& f : state->frames) {
      frames_.push_back(MakePoseBlock(f.rig_from_world, f.center));
    }
    for (const Rigid3& s : state->sensors) {
      sensors_.push_back(MakePoseBlock(s.rotation, s.translation));
    }
    AddObservations();
    AddBaselines();
    for (const LinearTerm& term : rig.linear_terms) AddLinearTerm(term);
    for (const RigProblemBase::ParameterPrior& prior : rig.priors) {
      problem_.AddResidualBlock(new PriorCost(prior), nullptr,
                                state_.cameras[prior.camera].data());
    }
    AddPosePriors();
    HoldPoses(rig.frame_masks, &frames_);
    HoldPoses(rig.sensor_masks, &sensors_);
    HoldParams();
  }

  ceres::Solver::Summary Solve(ceres::Solver::Options options) {
    options.linear_solver_type = rig_.num_points() > 0 && rig_.points_are_free
                                     ? ceres::SPARSE_SCHUR
                                     : ceres::SPARSE_NORMAL_CHOLESKY;
    SetOrder(&options);
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    return summary;
  }

  void WriteBack() {
    for (size_t i = 0; i < frames_.size(); ++i) {
      state_.frames[i].rig_from_world = RotationOf(frames_[i].data());
      state_.frames[i].center = Vector3d::Map(frames_[i].data() + 4);
    }
    for (size_t i = 0; i < sensors_.size(); ++i) {
      state_.sensors[i].rotation = RotationOf(sensors_[i].data());
      state_.sensors[i].translation = Vector3d::Map(sensors_[i].data() + 4);
    }
  }

 private:
  static ceres::Problem::Options Options() {
    ceres::Problem::Options options;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  // Within a group, Ceres orders by address. Each group is one array, so that
  // the order does not depend on where arrays are allocated.
  void SetOrder(ceres::Solver::Options* options) {
    auto* ordering = new ceres::ParameterBlockOrdering;
    const auto add = [&](double* block, int group) {
      if (problem_.HasParameterBlock(block)) {
        ordering->AddElementToGroup(block, group);
      }
    };
    for (Vector3d& point : state_.points) add(point.data(), 0);
    for (PoseBlock& frame : frames_) add(frame.data(), 1);
    for (PoseBlock& sensor : sensors_) add(sensor.data(), 2);
    for (CameraParams& camera : state_.cameras) add(camera.data(), 3);
    options->linear_solver_ordering.reset(ordering);
  }

  ceres::LossFunction* LossOfPoint(size_t num_observations) {
    auto& loss = loss_of_size_[num_observations];
    if (!loss) {
      loss = std::make_unique<CeresLoss>(rig_.LossOfPoint(num_observations));
    }
    return loss.get();
  }

  void AddObservations() {
    for (size_t p = 0; p < rig_.num_points(); ++p) {
      ceres::LossFunction* loss =
          LossOfPoint(rig_.point_begin[p + 1] - rig_.point_begin[p]);
      for (size_t o = rig_.point_begin[p]; o < rig_.point_begin[p + 1]; ++o) {
        const auto& observation = rig_.observations[o];
        const RigProblemBase::Image& image = rig_.images[observation.image];
        std::vector<double*> blocks = {frames_[image.frame].data(),
                                       sensors_[image.sensor].data(),
                                       state_.points[p].data()};
        if (R::kHasCamera) {
          blocks.push_back(state_.cameras[image.camera].data());
        }
        problem_.AddResidualBlock(
            new ObservationCost<R>(rig_, observation.image,
                                   R::Measured(observation)),
            loss, blocks);
      }
      if (!rig_.points_are_free &&
          problem_.HasParameterBlock(state_.points[p].data())) {
        problem_.SetParameterBlockConstant(state_.points[p].data());
      }
    }
  }

  void AddBaselines() {
    for (const BaselineTerm& term : rig_.baselines) {
      std::vector<double*> blocks;
      BaselineCost::Positions positions;
      int k = 0;
      for (const int idx : {term.image1, term.image2}) {
        const RigProblemBase::Image& image = rig_.images[idx];
        for (double* block :
             {frames_[image.frame].data(), sensors_[image.sensor].data()}) {
          const auto it = std::find(blocks.begin(), blocks.end(), block);
          positions[k++] = static_cast<int>(it - blocks.begin());
          if (it == blocks.end()) blocks.push_back(block);
        }
      }
      problem_.AddResidualBlock(
          new BaselineCost(rig_, term, positions, blocks.size()), &loss_,
          blocks);
    }
  }

  void AddLinearTerm(const LinearTerm& term) {
    std::vector<double*> blocks;
    for (const LinearTerm::Part& part : term.parts) {
      blocks.push_back((part.is_frame ? frames_ : sensors_)[part.idx].data());
    }
    problem_.AddResidualBlock(new LinearTermCost(term), nullptr, blocks);
  }

  void AddPosePriors() {
    for (const PositionPrior& prior : rig_.position_priors) {
      const RigProblemBase::Image& image = rig_.images[prior.image];
      problem_.AddResidualBlock(
          new PositionPriorCost(prior, rig_.MotionOf(prior.image)),
          &position_loss_, frames_[image.frame].data(),
          sensors_[image.sensor].data());
    }
    for (const GravityPrior& prior : rig_.gravity_priors) {
      const RigProblemBase::Image& image = rig_.images[prior.image];
      problem_.AddResidualBlock(
          new GravityPriorCost(prior, rig_.MotionOf(prior.image)),
          &gravity_loss_, frames_[image.frame].data(),
          sensors_[image.sensor].data());
    }
    for (const SensorPrior& prior : rig_.sensor_priors) {
      problem_.AddResidualBlock(new SensorPriorCost(prior), nullptr,
                                sensors_[prior.sensor].data());
    }
  }

  void HoldPoses(const std::vector<PoseMask>& masks,
                 std::vector<PoseBlock>* blocks) {
    for (size_t i = 0; i < blocks->size(); ++i) {
      double* block = (*blocks)[i].data();
      if (!problem_.HasParameterBlock(block)) continue;
      if (masks[i].isZero(0.0)) {
        problem_.SetParameterBlockConstant(block);
      } else {
        SetManifold(block, new PoseManifold(masks[i]), &problem_);
      }
    }
  }

  void HoldParams() {
    for (size_t i = 0; i < rig_.cameras.size(); ++i) {
      double* block = state_.cameras[i].data();
      if (!problem_.HasParameterBlock(block)) continue;
      const std::vector<int>& free = rig_.cameras[i].free_params;
      std::vector<int> held;
      for (int k = 0; k < kMaxNumCameraParams; ++k) {
        if (!std::binary_search(free.begin(), free.end(), k)) held.push_back(k);
      }
      if (free.empty()) {
        problem_.SetParameterBlockConstant(block);
      } else if (!held.empty()) {
        SetManifold(block, new CeresSubsetManifold(kMaxNumCameraParams, held),
                    &problem_);
      }
    }
  }

  const Problem& rig_;
  RigState& state_;
  std::vector<PoseBlock> frames_, sensors_;
  CeresLoss loss_, position_loss_, gravity_loss_;
  std::map<size_t, std::unique_ptr<CeresLoss>>
      loss_of_size_;  // by observations
  ceres::Problem problem_;
};

}  // namespace

template <class R>
SolveSummary SolveByCeres(const RigProblem<typename R::Observation>& problem,
                          const RigSolverOptions& options,
                          int max_num_iterations, const Context& context,
                          RigState* state) {
  SolveSummary summary;
  if (problem.observations.empty() && problem.baselines.empty()) {
    summary.termination = Termination::kConverged;
    summary.message = "There is nothing to solve.";
    return summary;
  }
  ceres::Solver::Options ceres_options;
  ceres_options.max_num_iterations = max_num_iterations;
  ceres_options.function_tolerance = options.function_tolerance;
  ceres_options.parameter_tolerance = options.parameter_tolerance;
  ceres_options.gradient_tolerance = 1e-16;
  // With several threads, the order in which Ceres adds blocks, and thus the
  // last bits, would depend on the scheduler.
  ceres_options.num_threads = 1;
  ceres_options.logging_type = ceres::SILENT;
  StopWhenCanceled callback(context);
  ceres_options.callbacks.push_back(&callback);
  RigState solved = *state;
  CeresRigProblem<R> ceres_problem(problem, &solved);
  const ceres::Solver::Summary result = ceres_problem.Solve(ceres_options);
  context.CheckInterrupted();
  summary = SummarizeCeres(result);
  if (!summary.IsUsable()) return summary;
  ceres_problem.WriteBack();
  *state = std::move(solved);
  return summary;
}

template SolveSummary SolveByCeres<PixelResidual>(
    const RigProblem<PixelObservation>&, const RigSolverOptions&, int,
    const Context&, RigState*);
template SolveSummary SolveByCeres<RayResidual>(
    const RigProblem<RayObservation>&, const RigSolverOptions&, int,
    const Context&, RigState*);

}  // namespace mgsfm
