// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/block_solve.h"

#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "bundle/block_reduction.h"
#include "bundle/point_filters.h"
#include "bundle/solve.h"
#include "least_squares/levenberg_marquardt.h"
#include "least_squares/residuals.h"
#include "math/sparse_solver.h"

namespace mgsfm {
namespace {

// Before Linearize() has set another one; that of the trust-region loop.
constexpr double kInitialLambda = 1e-4;

struct Block {
  std::vector<int> point_idxs;
  bool has_shared_frame = false;
};

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
      blocks[block].point_idxs.push_back(static_cast<int>(i));
    }
  }
  blocks.erase(std::remove_if(
                   blocks.begin(), blocks.end(),
                   [](const Block& block) { return block.point_idxs.empty(); }),
               blocks.end());
  return blocks;
}

// The blocks that observe each frame, as far as they matter.
constexpr int kNone = -1, kSeveral = -2;

std::vector<int> BlocksOfFrames(const Scene& scene, const Reconstruction& model,
                                const std::vector<Block>& blocks) {
  std::vector<int> block_of(scene.frames.size(), kNone);
  for (size_t b = 0; b < blocks.size(); ++b) {
    for (const int point_idx : blocks[b].point_idxs) {
      for (const Observation& o : model.points[point_idx].track) {
        if (!model.IsRegistered(scene, o.image_idx)) continue;
        int& of_frame = block_of[scene.images[o.image_idx].frame_idx];
        const int block = static_cast<int>(b);
        if (of_frame == kNone) of_frame = block;
        if (of_frame != block) of_frame = kSeveral;
      }
    }
  }
  return block_of;
}

void MarkSharedFrames(const Scene& scene, const Reconstruction& model,
                      const std::vector<int>& block_of_frame,
                      std::vector<Block>* blocks) {
  for (Block& block : *blocks) {
    for (const int point_idx : block.point_idxs) {
      for (const Observation& o : model.points[point_idx].track) {
        block.has_shared_frame |=
            block_of_frame[scene.images[o.image_idx].frame_idx] == kSeveral;
      }
    }
  }
}

SharedUnknowns NumberShared(const Scene& scene,
                            const std::vector<int>& block_of_frame) {
  SharedUnknowns shared;
  const auto take = [&](size_t count) {
    const int first = shared.num_unknowns;
    shared.num_unknowns += static_cast<int>(count);
    return first;
  };
  for (const int block : block_of_frame) {
    shared.first_of_frame.push_back(block == kSeveral ? take(6) : -1);
  }
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    shared.first_of_sensor.push_back(take(6));
  }
  for (const Camera& camera : scene.cameras) {
    shared.first_of_camera.push_back(take(camera.params.size()));
  }
  return shared;
}

// The unknowns that fix the gauge, by FixGauge() of a problem that has only the
// shared frames.
Mask FindHeldUnknowns(const Scene& scene, const Reconstruction& model,
                      const BundleAdjustmentOptions& options,
                      const SharedUnknowns& shared) {
  Mask is_held(shared.num_unknowns, false);
  BundleProblem problem;
  BundleState state;
  std::vector<int> first;
  std::vector<int> number_of_frame(scene.frames.size(), -1);
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (shared.first_of_frame[i] < 0) continue;
    const Rigid3& pose = *model.rig_from_world[i];
    number_of_frame[i] = static_cast<int>(state.frames.size());
    state.frames.push_back({pose.rotation, pose.Center()});
    problem.frame_masks.push_back(PoseMask::Ones());
    first.push_back(shared.first_of_frame[i]);
  }
  if (state.frames.empty()) return is_held;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    state.sensors.push_back(model.sensor_from_rig[i].value_or(Rigid3()));
    RefinedSensor refined = RefineSensor(scene, static_cast<int>(i), options);
    problem.sensor_masks.push_back(refined.mask);
    if (refined.prior) problem.sensor_priors.push_back(*refined.prior);
  }
  for (const Image& image : scene.images) {
    const int frame = number_of_frame[image.frame_idx];
    if (frame < 0 || !model.sensor_from_rig[image.sensor_idx]) continue;
    problem.images.push_back({frame, image.sensor_idx, image.camera_idx});
  }
  const std::vector<PoseMask> sensor_masks = problem.sensor_masks;
  FixGauge(state, &problem);
  const auto hold = [&](const PoseMask& before, const PoseMask& after,
                        int first_unknown) {
    for (int k = 0; k < 6; ++k) {
      if (before[k] != after[k]) is_held[first_unknown + k] = true;
    }
  };
  for (size_t i = 0; i < first.size(); ++i) {
    hold(PoseMask::Ones(), problem.frame_masks[i], first[i]);
  }
  for (size_t i = 0; i < sensor_masks.size(); ++i) {
    hold(sensor_masks[i], problem.sensor_masks[i], shared.first_of_sensor[i]);
  }
  return is_held;
}

// A state, or a trial one, of all blocks.
struct BlockStates {
  Reconstruction poses;  // without points
  std::vector<Eigen::Vector3d> points;
  std::vector<ReducedBlock> reduced;
  double lambda = kInitialLambda;  // of `reduced`
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
        blocks_(MakeBlocks(scene, block_of, *model)) {
    const std::vector<int> block_of_frame =
        BlocksOfFrames(scene, model_, blocks_);
    MarkSharedFrames(scene, model_, block_of_frame, &blocks_);
    shared_ = NumberShared(scene, block_of_frame);
    is_held_ = FindHeldUnknowns(scene, model_, options, shared_);
    trial_.points.resize(model_.points.size());
  }

  double Cost() override { return VisitAll(nullptr).new_cost; }

  bool Linearize(double lambda) override {
    if (!is_linearized_) AcceptStep();  // the state of Cost()
    lambda_ = lambda;
    return true;
  }

  bool Solve() override;

  TrialStep TryStep(double) override { return VisitAll(&step_); }

  void AcceptStep() override;

  size_t num_invisible_observations() const { return num_invisible_; }

 private:
  TrialStep VisitAll(const Eigen::VectorXd* step);
  bool Visit(size_t b, const Eigen::VectorXd* step, TrialStep* sum);
  bool Step(const Eigen::VectorXd* step, const BuiltProblem& built,
            RigEquations<PixelResidual>* equations, TrialStep* sum) const;
  BuiltProblem BuildBlock(size_t b, Reconstruction* part);
  void KeepTrial(size_t b, const BuiltProblem& built,
                 const Reconstruction& part);

  const Scene& scene_;
  const BundleAdjustmentOptions& options_;
  const RefinedParts parts_;
  const Context& context_;
  Reconstruction& model_;
  std::vector<Block> blocks_;
  SharedUnknowns shared_;
  Mask is_held_;
  Mask has_prior_;  // sensors, then cameras whose priors a block has
  std::vector<ReducedBlock> reduced_;
  double reduced_lambda_ = kInitialLambda;
  BlockStates trial_;
  Eigen::VectorXd step_;
  double lambda_ = kInitialLambda;
  bool is_linearized_ = false;
  size_t num_invisible_ = 0;
};

// The block with its frames, and the priors of sensors and cameras that no
// earlier block has.
BuiltProblem BlockedProblem::BuildBlock(size_t b, Reconstruction* part) {
  *part = PosesOf(model_);
  part->points.reserve(blocks_[b].point_idxs.size());
  for (const int i : blocks_[b].point_idxs) {
    part->points.push_back(model_.points[i]);
  }
  BuiltProblem built = BuildFreeProblem(scene_, *part, options_, parts_);
  BundleProblem& problem = built.problem;
  if (!blocks_[b].has_shared_frame) FixGauge(built.state, &problem);
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
                          const BuiltProblem& built,
                          RigEquations<PixelResidual>* equations,
                          TrialStep* sum) const {
  if (step == nullptr) {
    sum->new_cost += equations->Cost();
    return std::isfinite(sum->new_cost);
  }
  if (!equations->Linearize(lambda_)) return false;
  {
    const SplitSystem system(built, shared_, *equations, context_.num_threads);
    if (!system.IsUsable()) return false;
    equations->SetStep(system.CompleteStep(*step));
  }
  const TrialStep trial = equations->TryStep(1.0);
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
  for (size_t k = 0; k < blocks_[b].point_idxs.size(); ++k) {
    trial_.points[blocks_[b].point_idxs[k]] = part.points[k].point_in_world;
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
  if (!Step(step, built, &equations, sum)) return false;
  if (!equations.Linearize(lambda_)) return false;
  const SplitSystem system(built, shared_, equations, context_.num_threads);
  if (!system.IsUsable()) return false;
  trial_.reduced.push_back(system.Reduce());
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
  trial_.reduced.clear();
  trial_.lambda = lambda_;
  TrialStep sum;
  for (size_t b = 0; b < blocks_.size(); ++b) {
    if (Visit(b, step, &sum)) continue;
    sum.new_cost = std::numeric_limits<double>::infinity();
    break;
  }
  return sum;
}

// The sum of the reduced blocks. Their damping is that of the last visit.
bool BlockedProblem::Solve() {
  const int size = shared_.num_unknowns;
  std::vector<Eigen::Triplet<double>> triplets;
  Eigen::VectorXd rhs = Eigen::VectorXd::Zero(size);
  Eigen::VectorXd damping = Eigen::VectorXd::Zero(size);
  for (const ReducedBlock& block : reduced_) {
    for (size_t k = 0; k < block.unknowns.size(); ++k) {
      const int column = block.unknowns[k];
      if (is_held_[column]) continue;
      const auto c = static_cast<Eigen::Index>(k);
      rhs[column] += block.rhs[c];
      damping[column] += block.damping[c];
      for (size_t i = k; i < block.unknowns.size(); ++i) {
        const int row = block.unknowns[i];
        const double value = block.matrix(static_cast<Eigen::Index>(i), c);
        if (is_held_[row] || value == 0.0) continue;
        triplets.emplace_back(std::max(row, column), std::min(row, column),
                              value);
      }
    }
  }
  for (int i = 0; i < size; ++i) {
    const double value =
        damping[i] > 0.0 ? (lambda_ - reduced_lambda_) * damping[i] : 1.0;
    triplets.emplace_back(i, i, value);
    if (damping[i] == 0.0) rhs[i] = 0.0;
  }
  Eigen::SparseMatrix<double> matrix(size, size);
  matrix.setFromTriplets(triplets.begin(), triplets.end());
  SparseCholesky solver(context_.num_threads);
  solver.Analyze(matrix);
  if (!solver.Factorize(matrix)) return false;
  step_.resize(size);
  solver.Solve(rhs, step_);
  return step_.allFinite();
}

void BlockedProblem::AcceptStep() {
  model_.cameras = trial_.poses.cameras;
  model_.sensor_from_rig = trial_.poses.sensor_from_rig;
  model_.rig_from_world = trial_.poses.rig_from_world;
  for (size_t i = 0; i < model_.points.size(); ++i) {
    model_.points[i].point_in_world = trial_.points[i];
  }
  std::swap(reduced_, trial_.reduced);
  reduced_lambda_ = trial_.lambda;
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

BundleResult AdjustBundleInBlocks(const Scene& scene, const FrameBlocks& blocks,
                                  const Reconstruction& initial,
                                  const BundleAdjustmentOptions& options,
                                  const Context& context) {
  BundleResult result;
  result.estimate = initial;
  SolveInBlocks(scene, blocks, options, RefinedParts::kAll,
                options.function_tolerance, context, &result);
  ComputePointErrors(scene, context.num_threads, &result.estimate);
  FinishSummary(scene, initial, options, &result);
  return result;
}

}  // namespace mgsfm
