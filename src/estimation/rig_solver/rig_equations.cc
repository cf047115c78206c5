// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/rig_equations.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "base/parallel.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "rig_solver/conjugate_gradient.h"
#include "rig_solver/linear_terms.h"
#include "rig_solver/pose_priors.h"

namespace mgsfm {
namespace {

// Inexact steps converge almost as fast as exact ones. A step takes 17 products
// on average (docs/results/constants.md).
constexpr double kConjugateGradientTolerance = 1e-2;

// The elements of z for a pose block; zero if the block is constant.
PoseVector PosePart(const RigStructure& structure, const Eigen::VectorXd& z,
                    int block) {
  PoseVector part = PoseVector::Zero();
  if (block >= 0) {
    part.tail(structure.pose_size) =
        z.segment(structure.block_first[block], structure.pose_size);
  }
  return part;
}

// The squared norm of the state over all poses that are not constant.
double SquaredLength(const RigStructure& structure, const RigState& state) {
  double length = 0.0;
  for (size_t i = 0; i < state.frames.size(); ++i) {
    if (structure.frame_block[i] < 0) continue;
    length += 1.0 + state.frames[i].center.squaredNorm();
  }
  for (size_t i = 0; i < state.sensors.size(); ++i) {
    if (structure.sensor_block[i] < 0) continue;
    length += 1.0 + state.sensors[i].translation.squaredNorm();
  }
  return length;
}

}  // namespace

RigEquationsBase::RigEquationsBase(const RigProblemBase& problem,
                                   const std::vector<int>& image_of_observation,
                                   ReducedSolver solver, const Context& context)
    : problem_(problem),
      context_(context),
      structure_(problem, image_of_observation, solver, context.num_threads),
      chunks_(structure_, context.num_threads),
      chunk_costs_(structure_.chunks.size()),
      chunk_sums_(structure_.chunks.size()),
      matrix_(context.num_threads) {
  const size_t num_points = problem.num_points();
  points_.resize(num_points);
  steps_.twists.resize(problem.images.size());
  steps_.params.resize(problem.cameras.size());
  const int num_unknowns = structure_.num_unknowns;
  for (Eigen::VectorXd* v :
       {&gradient_, &correction_, &diagonal_, &rhs_, &step_, &residual_}) {
    v->setZero(num_unknowns);
  }
}

void RigEquationsBase::SetState(const RigState& state) {
  state_.frames = state.frames;
  state_.sensors = state.sensors;
  state_.cameras = state.cameras;
  trial_state_ = state_;
  MGSFM_CHECK_EQ(state.points.size(), points_.size());
  trial_points_.resize(points_.size());
  for (size_t p = 0; p < points_.size(); ++p) {
    points_[p] = state.points[structure_.point_order[p]];
  }
  ComputeImagePoses(problem_, state_, &poses_);
}

void RigEquationsBase::GetState(RigState* state) {
  trial_points_ = std::vector<Eigen::Vector3d>();
  state->frames = state_.frames;
  state->sensors = state_.sensors;
  state->cameras = state_.cameras;
  state->points.resize(points_.size());
  for (size_t p = 0; p < points_.size(); ++p) {
    state->points[structure_.point_order[p]] = points_[p];
  }
}

double RigEquationsBase::Cost() {
  ParallelFor(
      chunk_costs_.size(), context_.num_threads,
      [&](size_t c) {
        const ChunkRanges& chunk = structure_.chunks[c];
        chunk_costs_[c] = CostOfChunk(chunk) + CostOfTerms(Terms(), chunk);
      },
      1);
  double cost =
      CostOfLinearTerms(problem_, state_) + CostOfPosePriors(problem_, state_);
  for (const double chunk_cost : chunk_costs_) cost += chunk_cost;
  return cost;
}

bool RigEquationsBase::Linearize(double lambda) {
  lambda_ = lambda;
  // Allocated here so that the caller can free the observations first.
  matrix_.Allocate(structure_);
  matrix_.SetZero();
  gradient_.setZero();
  correction_.setZero();
  diagonal_.setZero();
  std::atomic<bool> is_valid{true};
  chunks_.Run(
      kNumParts,
      [&](size_t c, SchurWorkspace* workspace) {
        const ChunkRanges& chunk = structure_.chunks[c];
        workspace->Start(problem_, structure_, chunk, poses_);
        if (!LinearizeChunk(chunk, workspace)) is_valid = false;
        AddImagesToSystem(problem_, structure_, chunk, poses_, workspace);
        AddTermsToSystem(Terms(), chunk, workspace);
      },
      [&](size_t c, size_t section, SchurWorkspace* workspace) {
        MergeSystem(structure_.chunks[c], section, *workspace);
        if (section == 0) MergeVectors(structure_.chunks[c], *workspace);
      });
  AddLinearTerms(problem_, structure_, state_, &gradient_, &diagonal_,
                 matrix_.values());
  AddPosePriors(problem_, structure_, state_, &gradient_, &diagonal_,
                matrix_.values());
  DampMatrix();
  return is_valid && gradient_.allFinite() && diagonal_.allFinite();
}

// A section consists of the pairs that begin in one part of the values; pairs
// are in ascending order. Chunks are merged into several sections concurrently.
void RigEquationsBase::MergeSystem(const ChunkRanges& chunk, size_t section,
                                   const SchurWorkspace& w) {
  const size_t num_values = matrix_.num_values();
  const auto first = structure_.chunk_pairs.begin() + chunk.pairs.begin;
  const auto last = structure_.chunk_pairs.begin() + chunk.pairs.end;
  const auto find = [&](size_t bound) {
    return std::partition_point(first, last, [&](const ChunkPair& pair) {
      return size_t{pair.position} * kNumParts < bound * num_values;
    });
  };
  const auto end = find(section + 1);
  for (auto it = find(section); it != end; ++it) {
    const ChunkPair& pair = *it;
    const double* from = w.pair_values.data() +
                         w.pair_begin[pair.row * w.num_blocks + pair.column];
    const int rows = w.block_size[pair.row];
    const int columns = w.block_size[pair.column];
    double* to = matrix_.values() + pair.position;
    for (int j = 0; j < columns; ++j, from += rows, to += pair.stride) {
      for (int i = 0; i < rows; ++i) to[i] += from[i];
    }
  }
}

void RigEquationsBase::MergeVectors(const ChunkRanges& chunk,
                                    const SchurWorkspace& w) {
  for (size_t b = 0; b < chunk.blocks.size(); ++b) {
    const int block = structure_.chunk_blocks[chunk.blocks.begin + b];
    const int to = structure_.block_first[block];
    const int size = structure_.block_size[block];
    const auto add = [&](const std::vector<double>& part,
                         Eigen::VectorXd* sums) {
      sums->segment(to, size) += Eigen::Map<const Eigen::VectorXd>(
          part.data() + w.block_first[b], size);
    };
    add(w.gradient, &gradient_);
    add(w.correction, &correction_);
    add(w.diagonal, &diagonal_);
  }
}

void RigEquationsBase::DampMatrix() {
  for (Eigen::Index i = 0; i < diagonal_.size(); ++i) {
    // A constant coordinate has a zero row and column.
    matrix_.Diagonal(i) +=
        diagonal_[i] > 0.0 ? lambda_ * ClampDiagonal(diagonal_[i]) : 1.0;
  }
}

bool RigEquationsBase::Solve() {
  if (structure_.num_unknowns == 0) return true;
  rhs_ = correction_ - gradient_;
  if (!matrix_.Factorize()) return false;
  if (structure_.is_iterative) return SolveByConjugateGradients();
  matrix_.Solve(rhs_, &step_);
  return step_.allFinite();
}

bool RigEquationsBase::SolveByConjugateGradients() {
  return SolveByConjugateGradient(
      rhs_, kConjugateGradientTolerance, /*max_num_iterations=*/500,
      [this](const Eigen::VectorXd& x, Eigen::VectorXd* y) {
        context_.CheckInterrupted();
        Multiply(x, y);
      },
      [this](const Eigen::VectorXd& r, Eigen::VectorXd* z) {
        matrix_.Solve(r, z);
      },
      &step_, &residual_);
}

void RigEquationsBase::Multiply(const Eigen::VectorXd& x, Eigen::VectorXd* y) {
  SetImageSteps(x);
  for (Eigen::Index i = 0; i < x.size(); ++i) {
    (*y)[i] = diagonal_[i] > 0.0 ? lambda_ * ClampDiagonal(diagonal_[i]) * x[i]
                                 : x[i];
  }
  chunks_.Run(
      1,
      [&](size_t c, SchurWorkspace* workspace) {
        const ChunkRanges& chunk = structure_.chunks[c];
        workspace->StartVectors(problem_, structure_, chunk, poses_);
        MultiplyChunk(chunk, workspace);
        AddImageVectors(problem_, structure_, chunk, poses_, workspace);
        MultiplyTerms(Terms(), chunk, steps_.twists, workspace);
      },
      [&](size_t c, size_t, SchurWorkspace* workspace) {
        const IndexRange& blocks = structure_.chunks[c].blocks;
        for (size_t b = 0; b < blocks.size(); ++b) {
          const int block = structure_.chunk_blocks[blocks.begin + b];
          const int size = structure_.block_size[block];
          y->segment(structure_.block_first[block], size) +=
              Eigen::VectorXd::Map(
                  workspace->product.data() + workspace->block_first[b], size);
        }
      });
  MultiplyLinearTerms(problem_, structure_, x, y);
  MultiplyPosePriors(problem_, structure_, state_, x, y);
}

PoseVector RigEquationsBase::PoseStep(int block) const {
  return PosePart(structure_, step_, block);
}

void RigEquationsBase::SetImageSteps(const Eigen::VectorXd& z) {
  for (size_t i = 0; i < poses_.size(); ++i) {
    const RigProblemBase::Image& image = problem_.images[i];
    steps_.twists[i] = ComputeImageTwist(
        poses_[i], PosePart(structure_, z, structure_.frame_block[image.frame]),
        PosePart(structure_, z, structure_.sensor_block[image.sensor]));
  }
  for (size_t i = 0; i < steps_.params.size(); ++i) {
    const int block = structure_.camera_block[i];
    if (block < 0) {
      steps_.params[i].fill(0.0);
    } else {
      std::copy_n(z.data() + structure_.block_first[block],
                  structure_.block_size[block], steps_.params[i].begin());
    }
  }
}

void RigEquationsBase::MoveBlocks() {
  for (size_t i = 0; i < state_.frames.size(); ++i) {
    if (structure_.frame_block[i] < 0) continue;
    const PoseVector d = PoseStep(structure_.frame_block[i]);
    FramePose pose = state_.frames[i];
    if (structure_.pose_size == 6) {
      pose.rig_from_world =
          (ExpSO3(d.head<3>()) * pose.rig_from_world).normalized();
    }
    pose.center += d.tail<3>();
    trial_state_.frames[i] = pose;
  }
  for (size_t i = 0; i < state_.sensors.size(); ++i) {
    if (structure_.sensor_block[i] < 0) continue;
    const PoseVector d = PoseStep(structure_.sensor_block[i]);
    Rigid3 pose = state_.sensors[i];
    if (structure_.pose_size == 6) {
      pose.rotation = (ExpSO3(d.head<3>()) * pose.rotation).normalized();
    }
    pose.translation += d.tail<3>();
    trial_state_.sensors[i] = pose;
  }
  for (size_t i = 0; i < state_.cameras.size(); ++i) {
    trial_state_.cameras[i] = state_.cameras[i];
    if (structure_.camera_block[i] < 0) continue;
    const std::vector<int>& params = problem_.cameras[i].free_params;
    for (size_t k = 0; k < params.size(); ++k) {
      trial_state_.cameras[i][params[k]] += steps_.params[i][k];
    }
  }
}

TrialStep RigEquationsBase::TryStep() {
  SetImageSteps(step_);
  MoveBlocks();
  ComputeImagePoses(problem_, trial_state_, &trial_poses_);
  ParallelFor(
      chunk_sums_.size(), context_.num_threads,
      [this](size_t c) {
        const ChunkRanges& chunk = structure_.chunks[c];
        chunk_sums_[c] = StepChunk(chunk);
        chunk_sums_[c].cost += CostOfTerms(TrialTerms(), chunk);
      },
      1);
  TrialStep step;
  step.new_cost = TrialCost();
  // By (1), the model cost g^T d + d^T N d / 2 is (g^T d - lambda d^T D d) / 2,
  // minus d^T r / 2, where r is the residual of the reduced equations.
  double decrease = step_.dot(residual_);
  for (Eigen::Index i = 0; i < step_.size(); ++i) {
    decrease += step_[i] * (lambda_ * ClampDiagonal(diagonal_[i]) * step_[i] -
                            gradient_[i]);
  }
  double squared_state = SquaredLength(structure_, state_);
  double squared_step = step_.squaredNorm();
  for (const StepSums& sums : chunk_sums_) {
    decrease += sums.decrease;
    squared_step += sums.squared_step;
    squared_state += sums.squared_position;
  }
  step.predicted_decrease = 0.5 * decrease;
  step.step_norm = std::sqrt(squared_step);
  step.state_norm = std::sqrt(squared_state);
  return step;
}

double RigEquationsBase::TrialCost() const {
  double cost = CostOfLinearTerms(problem_, trial_state_) +
                CostOfPosePriors(problem_, trial_state_);
  for (const StepSums& sums : chunk_sums_) cost += sums.cost;
  return cost;
}

double RigEquationsBase::MinimizeTrialPoints(double cost, double tolerance) {
  if (!problem_.points_are_free || points_.empty()) return cost;
  const double tolerance_of_point =
      tolerance / static_cast<double>(points_.size());
  ParallelFor(
      chunk_sums_.size(), context_.num_threads,
      [&](size_t c) {
        const ChunkRanges& chunk = structure_.chunks[c];
        chunk_sums_[c].cost = MinimizeTrialChunk(chunk, tolerance_of_point) +
                              CostOfTerms(TrialTerms(), chunk);
      },
      1);
  return TrialCost();
}

void RigEquationsBase::AcceptStep() {
  std::swap(state_, trial_state_);
  std::swap(points_, trial_points_);
  std::swap(poses_, trial_poses_);
}

}  // namespace mgsfm
