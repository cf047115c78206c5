// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/block_solve.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "bundle/block_reduction.h"
#include "bundle/solve.h"
#include "least_squares/levenberg_marquardt.h"
#include "least_squares/residuals.h"

namespace mgsfm {
namespace {

// The trust-region loop starts with this value, before Linearize() sets
// another.
constexpr double kInitialLambda = 1e-4;

// The points of a block.
using Block = std::vector<int>;

// Distributes the points.
std::vector<Block> MakeBlocks(const Scene& scene, const FrameBlocks& block_of,
                              const Reconstruction& model) {
  const int num_blocks =
      1 + *std::max_element(block_of.begin(), block_of.end());
  std::vector<Block> blocks(num_blocks);
  for (size_t i = 0; i < model.points.size(); ++i) {
    int block = num_blocks;
    for (const Observation& o : model.points[i].track) {
      if (!model.IsRegistered(scene, o.image_idx)) continue;
      block = std::min(block, block_of[scene.images[o.image_idx].frame_idx]);
    }
    if (block < num_blocks) {
      blocks[block].push_back(static_cast<int>(i));
    }
  }
  blocks.erase(std::remove_if(blocks.begin(), blocks.end(),
                              [](const Block& block) { return block.empty(); }),
               blocks.end());
  return blocks;
}

// The unknowns that fix the gauge, by FixGauge() of a problem that has all
// frames and no observations.
Mask FindHeldUnknowns(const Scene& scene, const Reconstruction& model,
                      const BundleAdjustmentOptions& options,
                      const ModelUnknowns& unknowns) {
  BundleProblem problem;
  BundleState state;
  std::vector<int> first, number_of_frame;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    number_of_frame.push_back(static_cast<int>(state.frames.size()));
    if (!model.rig_from_world[i]) continue;
    const Rigid3& pose = *model.rig_from_world[i];
    state.frames.push_back({pose.rotation, pose.Center()});
    problem.frame_masks.emplace_back(PoseMask::Ones());
    first.push_back(unknowns.first_of_frame[i]);
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    state.sensors.push_back(model.sensor_from_rig[i].value_or(Rigid3()));
    RefinedSensor refined = RefineSensor(scene, static_cast<int>(i), options);
    problem.sensor_masks.push_back(refined.mask);
    if (refined.prior) problem.sensor_priors.push_back(*refined.prior);
    first.push_back(unknowns.first_of_sensor[i]);
  }
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    if (!model.IsRegistered(scene, static_cast<int>(i))) continue;
    problem.images.push_back(
        {number_of_frame[image.frame_idx], image.sensor_idx, image.camera_idx});
  }
  std::vector<PoseMask> before = problem.frame_masks;
  before.insert(before.end(), problem.sensor_masks.begin(),
                problem.sensor_masks.end());
  FixGauge(state, &problem);
  std::vector<PoseMask> after = problem.frame_masks;
  after.insert(after.end(), problem.sensor_masks.begin(),
               problem.sensor_masks.end());
  Mask is_held(unknowns.num_unknowns, false);
  for (size_t i = 0; i < first.size(); ++i) {
    for (int k = 0; k < 6; ++k) {
      if (before[i][k] != after[i][k]) is_held[first[i] + k] = true;
    }
  }
  return is_held;
}

// The trial state.
struct TrialState {
  Reconstruction poses;  // without points
  std::vector<Eigen::Vector3d> points;
};

class BlockedProblem : public DampedProblem {
 public:
  BlockedProblem(const Scene& scene, const FrameBlocks& block_of,
                 const BundleAdjustmentOptions& options, RefinedParts parts,
                 const Context& context, Reconstruction* model)
      : scene_(scene),
        options_(options),
        parts_(parts),
        context_(context),
        model_(*model),
        blocks_(MakeBlocks(scene, block_of, *model)),
        solver_(context.num_threads) {
    unknowns_ = NumberUnknowns(scene, model_);
    is_held_ = FindHeldUnknowns(scene, model_, options, unknowns_);
    trial_.points.resize(model_.points.size());
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
  TrialStep VisitAll(const Eigen::VectorXd* step);
  bool Visit(size_t b, const Eigen::VectorXd* step, TrialStep* sum);
  bool Step(const Eigen::VectorXd* step, const std::vector<int>& unknowns,
            RigEquationsBase* equations, TrialStep* sum) const;
  BuiltProblem BuildBlock(size_t b, Reconstruction* part);
  void KeepTrial(size_t b, const BuiltProblem& built,
                 const Reconstruction& part);

  const Scene& scene_;
  const BundleAdjustmentOptions& options_;
  const RefinedParts parts_;
  const Context& context_;
  Reconstruction& model_;
  std::vector<Block> blocks_;
  ModelUnknowns unknowns_;
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
BuiltProblem BlockedProblem::BuildBlock(size_t b, Reconstruction* part) {
  *part = PosesOf(model_);
  part->points.reserve(blocks_[b].size());
  for (const int i : blocks_[b]) {
    part->points.push_back(model_.points[i]);
  }
  BuiltProblem built = BuildFreeProblem(scene_, *part, options_, parts_);
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
                          const std::vector<int>& unknowns,
                          RigEquationsBase* equations, TrialStep* sum) const {
  if (step == nullptr) {
    sum->new_cost += equations->Cost();
    return std::isfinite(sum->new_cost);
  }
  if (!equations->Linearize(lambda_)) return false;
  Eigen::VectorXd of_block(static_cast<Eigen::Index>(unknowns.size()));
  for (Eigen::Index i = 0; i < of_block.size(); ++i) {
    of_block[i] = (*step)[unknowns[static_cast<size_t>(i)]];
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

void BlockedProblem::KeepTrial(size_t b, const BuiltProblem& built,
                               const Reconstruction& part) {
  for (const int i : built.frame_idxs) {
    trial_.poses.rig_from_world[i] = part.rig_from_world[i];
  }
  for (const int i : built.sensor_idxs) {
    trial_.poses.sensor_from_rig[i] = part.sensor_from_rig[i];
  }
  for (const int i : built.camera_idxs) {
    trial_.poses.cameras[i] = part.cameras[i];
  }
  for (size_t k = 0; k < blocks_[b].size(); ++k) {
    trial_.points[blocks_[b][k]] = part.points[k].point_in_world;
  }
}

bool BlockedProblem::Visit(size_t b, const Eigen::VectorXd* step,
                           TrialStep* sum) {
  context_.CheckInterrupted();
  Reconstruction part;
  BuiltProblem built = BuildBlock(b, &part);
  num_invisible_ += built.num_invisible_observations;
  RigEquations<PixelResidual> equations(built.problem, ReducedSolver::kDirect,
                                        context_);
  equations.SetState(built.state);
  const std::vector<int> unknowns =
      FindUnknowns(built, unknowns_, equations.structure());
  if (!Step(step, unknowns, &equations, sum)) return false;
  if (!equations.Linearize(lambda_)) return false;
  trial_system_.Add(unknowns, equations, is_held_);
  equations.GetState(&built.state);
  WriteBack(built, &part);
  KeepTrial(b, built, part);
  return true;
}

TrialStep BlockedProblem::VisitAll(const Eigen::VectorXd* step) {
  has_prior_.assign(scene_.sensors.size() + scene_.cameras.size(), false);
  num_invisible_ = 0;
  trial_.poses = PosesOf(model_);
  for (size_t i = 0; i < model_.points.size(); ++i) {
    trial_.points[i] = model_.points[i].point_in_world;
  }
  trial_system_.Start(unknowns_.num_unknowns, lambda_);
  TrialStep sum;
  for (size_t b = 0; b < blocks_.size(); ++b) {
    if (Visit(b, step, &sum)) continue;
    sum.new_cost = std::numeric_limits<double>::infinity();
    break;
  }
  trial_system_.Finish();
  return sum;
}

void BlockedProblem::AcceptStep() {
  model_.cameras = trial_.poses.cameras;
  model_.sensor_from_rig = trial_.poses.sensor_from_rig;
  model_.rig_from_world = trial_.poses.rig_from_world;
  for (size_t i = 0; i < model_.points.size(); ++i) {
    model_.points[i].point_in_world = trial_.points[i];
  }
  std::swap(system_, trial_system_);
  is_linearized_ = true;
}

}  // namespace

Reconstruction PosesOf(const Reconstruction& model) {
  return {model.cameras, model.sensor_from_rig, model.rig_from_world, {}};
}

bool SolveInBlocks(const Scene& scene, const FrameBlocks& blocks,
                   const BundleAdjustmentOptions& options, RefinedParts parts,
                   double function_tolerance, const Context& context,
                   BundleResult* result) {
  RigSolverOptions solver_options;
  solver_options.function_tolerance = function_tolerance;
  BlockedProblem problem(scene, blocks, options, parts, context,
                         &result->estimate);
  SolveSummary summary = MinimizeByLevenbergMarquardt(
      solver_options, options.max_num_iterations, context, &problem);
  result->summary.num_invisible_observations =
      problem.num_invisible_observations();
  const bool is_usable = summary.IsUsable();
  result->summary.solves.push_back(std::move(summary));
  return is_usable;
}

}  // namespace mgsfm
