// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/ceres_backend.h"

#include <ceres/iteration_callback.h>
#include <ceres/ordered_groups.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "rig_solver/ceres_costs.h"
#include "rig_solver/ceres_manifolds.h"
#include "rig_solver/ceres_solving.h"

namespace mgsfm {
namespace {

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
