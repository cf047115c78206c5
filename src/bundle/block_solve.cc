// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/block_solve.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "bundle/block_reduction.h"
#include "bundle/interior_elimination.h"
#include "least_squares/levenberg_marquardt.h"
#include "least_squares/residuals.h"

namespace mgsfm {
namespace {

// The trust-region loop starts with this value, before Linearize() sets
// another.
constexpr double kInitialLambda = 1e-4;

// Frames that points of several blocks observe.
Mask FindSharedFrames(const Scene& scene, const BlockedModel& model) {
  Mask is_shared(scene.frames.size(), false);
  std::vector<std::optional<size_t>> block_of(scene.frames.size());
  for (size_t b = 0; b < model.blocks.size(); ++b) {
    for (const Observation& o : model.blocks[b].tracks.observations) {
      const int frame = scene.images[o.image_idx].frame_idx;
      if (!model.poses.rig_from_world[frame]) continue;
      is_shared[frame] |= block_of[frame].value_or(b) != b;
      block_of[frame] = b;
    }
  }
  return is_shared;
}

// The coordinates of frames and sensors that fix the gauge.
struct HeldPoses {
  std::vector<PoseMask> frames, sensors;  // 1 if held
};

// The poses that FixGauge() holds in a problem of all frames, which needs no
// observations.
HeldPoses FindHeldPoses(const Scene& scene, const Reconstruction& poses,
                        const BundleAdjustmentOptions& options) {
  BundleProblem problem;
  BundleState state;
  std::vector<int> number_of_frame, frame_idxs;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    number_of_frame.push_back(static_cast<int>(state.frames.size()));
    if (!poses.rig_from_world[i]) continue;
    const Rigid3& pose = *poses.rig_from_world[i];
    state.frames.push_back({pose.rotation, pose.Center()});
    problem.frame_masks.emplace_back(PoseMask::Ones());
    frame_idxs.push_back(static_cast<int>(i));
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    state.sensors.push_back(poses.sensor_from_rig[i].value_or(Rigid3()));
    RefinedSensor refined = RefineSensor(scene, static_cast<int>(i), options);
    problem.sensor_masks.push_back(refined.mask);
    if (refined.prior) problem.sensor_priors.push_back(*refined.prior);
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    if (!poses.IsRegistered(scene, static_cast<int>(i))) continue;
    problem.images.push_back(
        {number_of_frame[image.frame_idx], image.sensor_idx, image.camera_idx});
  }
  const std::vector<PoseMask> sensors_before = problem.sensor_masks;
  FixGauge(state, &problem);
  HeldPoses held;
  held.frames.assign(scene.frames.size(), PoseMask::Zero());
  for (size_t k = 0; k < frame_idxs.size(); ++k) {
    held.frames[frame_idxs[k]] = PoseMask::Ones() - problem.frame_masks[k];
  }
  for (size_t i = 0; i < sensors_before.size(); ++i) {
    held.sensors.emplace_back(sensors_before[i] - problem.sensor_masks[i]);
  }
  return held;
}

Mask FindHeldUnknowns(const HeldPoses& held, const SharedUnknowns& unknowns) {
  Mask is_held(static_cast<size_t>(unknowns.num_unknowns), false);
  const auto hold = [&](const PoseMask& mask, int first) {
    for (int k = 0; k < 6; ++k) {
      if (mask[k] != 0.0) is_held[first + k] = true;
    }
  };
  for (size_t i = 0; i < held.frames.size(); ++i) {
    const auto first = unknowns.first_of_frame[i];
    if (first) hold(held.frames[i], *first);
  }
  for (size_t i = 0; i < held.sensors.size(); ++i) {
    hold(held.sensors[i], unknowns.first_of_sensor[i]);
  }
  return is_held;
}

// The trial state.
struct TrialState {
  Reconstruction poses;
  std::vector<std::vector<Eigen::Vector3d>> positions;  // per block
};

class BlockedProblem : public DampedProblem {
 public:
  BlockedProblem(const Scene& scene, const BundleAdjustmentOptions& options,
                 RefinedParts parts, const Context& context,
                 BlockedModel* model)
      : scene_(scene),
        options_(options),
        parts_(parts),
        context_(context),
        model_(*model),
        solver_(context.num_threads) {
    const HeldPoses held = FindHeldPoses(scene, model_.poses, options);
    Mask frame_is_shared = FindSharedFrames(scene, model_);
    for (size_t i = 0; i < held.frames.size(); ++i) {
      frame_is_shared[i] |= !held.frames[i].isZero(0.0);
    }
    unknowns_ = NumberUnknowns(scene, frame_is_shared);
    is_held_ = FindHeldUnknowns(held, unknowns_);
    trial_.positions.resize(model_.blocks.size());
  }

  double Cost() override { return VisitAll(nullptr).new_cost; }

  bool Linearize(double lambda) override {
    if (!is_linearized_) AcceptStep();  // the state of Cost()
    lambda_ = lambda;
    return true;
  }

  bool Solve() override {
    system_.Damp(lambda_);
    return solver_.Solve(system_, &step_);
  }

  TrialStep TryStep() override { return VisitAll(&step_); }

  void AcceptStep() override;

  size_t num_invisible_observations() const { return num_invisible_; }

 private:
  using Equations = RigEquations<PixelResidual>;

  TrialStep VisitAll(const Eigen::VectorXd* step);
  bool Visit(size_t b, const Eigen::VectorXd* step, TrialStep* sum);
  bool Step(const Eigen::VectorXd* step, const BlockUnknowns& unknowns,
            InteriorElimination* elimination, Equations* equations,
            TrialStep* sum) const;
  bool Reduce(const BlockUnknowns& unknowns, InteriorElimination* elimination,
              Equations* equations);
  BuiltProblem BuildBlock(size_t b);
  void KeepTrial(size_t b, const BuiltProblem& built);

  const Scene& scene_;
  const BundleAdjustmentOptions& options_;
  const RefinedParts parts_;
  const Context& context_;
  BlockedModel& model_;
  SharedUnknowns unknowns_;
  Mask is_held_;
  Mask has_prior_;  // sensors, then cameras whose priors a block has
  TrialState trial_;
  SummedSystem system_, trial_system_;
  SummedSystemSolver solver_;
  Eigen::VectorXd step_;
  double lambda_ = kInitialLambda;
  bool is_linearized_ = false;
  size_t num_invisible_ = 0;
};

// The block with its frames, and the priors of sensors and cameras that no
// earlier block has.
BuiltProblem BlockedProblem::BuildBlock(size_t b) {
  BuiltProblem built =
      BuildFreeProblem(scene_, model_.Part(b), options_, parts_);
  BundleProblem& problem = built.problem;
  const auto sensor_is_taken = [&](const SensorPrior& prior) {
    return has_prior_[built.sensor_idxs[prior.sensor]];
  };
  const auto camera_is_taken = [&](const RigProblemBase::ParameterPrior& p) {
    return has_prior_[scene_.sensors.size() + built.camera_idxs[p.camera]];
  };
  problem.sensor_priors.erase(
      std::remove_if(problem.sensor_priors.begin(), problem.sensor_priors.end(),
                     sensor_is_taken),
      problem.sensor_priors.end());
  problem.priors.erase(std::remove_if(problem.priors.begin(),
                                      problem.priors.end(), camera_is_taken),
                       problem.priors.end());
  for (const int i : built.sensor_idxs) has_prior_[i] = true;
  for (const int i : built.camera_idxs) {
    has_prior_[scene_.sensors.size() + i] = true;
  }
  return built;
}

// Moves the block by the step, if there is one, and adds its cost.
bool BlockedProblem::Step(const Eigen::VectorXd* step,
                          const BlockUnknowns& unknowns,
                          InteriorElimination* elimination,
                          Equations* equations, TrialStep* sum) const {
  Eigen::VectorXd of_shared(static_cast<Eigen::Index>(unknowns.shared.size()));
  for (Eigen::Index i = 0; i < of_shared.size(); ++i) {
    of_shared[i] = (*step)[unknowns.in_model[static_cast<size_t>(i)]];
  }
  Eigen::VectorXd of_block;
  if (!elimination->Expand(equations->matrix(), equations->RightHandSide(),
                           of_shared, &of_block)) {
    return false;
  }
  equations->SetStep(of_block);
  const TrialStep trial = equations->TryStep();
  equations->AcceptStep();
  sum->new_cost += trial.new_cost;
  sum->predicted_decrease += trial.predicted_decrease;
  sum->step_norm = std::hypot(sum->step_norm, trial.step_norm);
  sum->state_norm = std::hypot(sum->state_norm, trial.state_norm);
  return std::isfinite(sum->new_cost);
}

// Adds what the block leaves for the shared unknowns.
bool BlockedProblem::Reduce(const BlockUnknowns& unknowns,
                            InteriorElimination* elimination,
                            Equations* equations) {
  Eigen::MatrixXd reduced;
  Eigen::VectorXd rhs;
  if (!elimination->Reduce(equations->matrix(), equations->RightHandSide(),
                           &reduced, &rhs)) {
    return false;
  }
  Eigen::VectorXd diagonal(rhs.size());
  for (Eigen::Index i = 0; i < rhs.size(); ++i) {
    diagonal[i] =
        equations->diagonal()[unknowns.shared[static_cast<size_t>(i)]];
  }
  trial_system_.Add(unknowns.in_model, reduced, rhs, diagonal);
  return true;
}

void BlockedProblem::KeepTrial(size_t b, const BuiltProblem& built) {
  Reconstruction moved;  // the poses of the block, and nothing else
  std::swap(moved, trial_.poses);
  moved.points.resize(model_.blocks[b].size());
  for (size_t i = 0; i < moved.points.size(); ++i) {
    moved.points[i].point_in_world = model_.blocks[b].positions[i];
  }
  WriteBack(built, &moved);
  trial_.positions[b].clear();
  for (const Point3D& point : moved.points) {
    trial_.positions[b].push_back(point.point_in_world);
  }
  moved.points = {};
  std::swap(moved, trial_.poses);
}

bool BlockedProblem::Visit(size_t b, const Eigen::VectorXd* step,
                           TrialStep* sum) {
  context_.CheckInterrupted();
  BuiltProblem built = BuildBlock(b);
  num_invisible_ += built.num_invisible_observations;
  if (built.problem.observations.empty()) {
    trial_.positions[b] = model_.blocks[b].positions;
    return true;
  }
  Equations equations(built.problem, ReducedSolver::kDirect, context_);
  equations.SetState(built.state);
  if (!equations.Linearize(lambda_)) return false;
  const BlockUnknowns unknowns =
      SplitUnknowns(built, unknowns_, is_held_, equations);
  InteriorElimination elimination(unknowns.interior, unknowns.shared,
                                  context_.num_threads);
  if (step == nullptr) {
    sum->new_cost += equations.Cost();
  } else if (!Step(step, unknowns, &elimination, &equations, sum) ||
             !equations.Linearize(lambda_)) {
    return false;
  }
  if (!Reduce(unknowns, &elimination, &equations)) return false;
  equations.GetState(&built.state);
  KeepTrial(b, built);
  return std::isfinite(sum->new_cost);
}

TrialStep BlockedProblem::VisitAll(const Eigen::VectorXd* step) {
  has_prior_.assign(scene_.sensors.size() + scene_.cameras.size(), false);
  num_invisible_ = 0;
  trial_.poses = model_.poses;
  trial_system_.Start(unknowns_.num_unknowns, lambda_);
  TrialStep sum;
  for (size_t b = 0; b < model_.blocks.size(); ++b) {
    if (Visit(b, step, &sum)) continue;
    sum.new_cost = std::numeric_limits<double>::infinity();
    break;
  }
  trial_system_.Finish();
  return sum;
}

void BlockedProblem::AcceptStep() {
  model_.poses = trial_.poses;
  for (size_t b = 0; b < model_.blocks.size(); ++b) {
    std::swap(model_.blocks[b].positions, trial_.positions[b]);
  }
  std::swap(system_, trial_system_);
  is_linearized_ = true;
}

}  // namespace

bool SolveInBlocks(const Scene& scene, const BundleAdjustmentOptions& options,
                   RefinedParts parts, double function_tolerance,
                   const Context& context, BlockedModel* model,
                   BundleSummary* summary) {
  RigSolverOptions solver_options;
  solver_options.function_tolerance = function_tolerance;
  BlockedProblem problem(scene, options, parts, context, model);
  SolveSummary solve = MinimizeByLevenbergMarquardt(
      solver_options, options.max_num_iterations, context, &problem);
  summary->num_invisible_observations = problem.num_invisible_observations();
  const bool is_usable = solve.IsUsable();
  summary->solves.push_back(std::move(solve));
  return is_usable;
}

BundleSummary AdjustBundleInBlocks(const Scene& scene,
                                   const BundleAdjustmentOptions& options,
                                   const Context& context,
                                   BlockedModel* model) {
  BundleSummary summary;
  SolveInBlocks(scene, options, RefinedParts::kAll, options.function_tolerance,
                context, model, &summary);
  return summary;
}

}  // namespace mgsfm
