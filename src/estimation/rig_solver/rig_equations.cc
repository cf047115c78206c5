// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/rig_equations.h"

#include <Eigen/Core>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "rig_solver/pose_priors.h"
#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {
namespace {

std::vector<size_t> FindDiagonal(const RigStructure& structure) {
  std::vector<size_t> positions(structure.num_unknowns);
  for (size_t b = 0; b < structure.block_size.size(); ++b) {
    const int rank = structure.block_rank[b];
    const auto [position, stride] = structure.pattern.Find(rank, rank);
    for (int i = 0; i < structure.block_size[b]; ++i) {
      positions[structure.block_first[b] + i] =
          position + static_cast<size_t>(i) * stride + i;
    }
  }
  return positions;
}

}  // namespace

SchurComplement::SchurComplement(int num_threads)
    : num_threads_(num_threads), solver_(num_threads) {}

void SchurComplement::Allocate(const RigStructure& structure) {
  if (is_allocated_ || structure.num_unknowns == 0) return;
  is_allocated_ = true;
  matrix_ = structure.pattern.MakeMatrix();
  solver_.Analyze(matrix_, SparseCholesky::Order::kNatural);
  diagonal_position_ = FindDiagonal(structure);
}

void SchurComplement::SetZero() {
  double* const begin = values();
  const size_t size = num_values();
  ParallelFor((size + kItemsPerTask - 1) / kItemsPerTask, num_threads_,
              [&](size_t part) {
                std::fill(begin + part * kItemsPerTask,
                          begin + std::min(size, (part + 1) * kItemsPerTask),
                          0.0);
              },
              1);
}

namespace {

// Linear terms and parameter priors of a problem. They have no loss.

using Eigen::Vector3d;

double TermResidual(const LinearTerm& term, const RigState& state) {
  double sum = -term.value;
  for (const LinearTerm::Part& part : term.parts) {
    sum += part.coefficients.dot(part.is_frame
                                     ? state.frames[part.idx].center
                                     : state.sensors[part.idx].translation);
  }
  return term.weight * sum;
}

double PriorResidual(const RigProblemBase::ParameterPrior& prior,
                     const RigState& state) {
  return (state.cameras[prior.camera][prior.param] - prior.value) / prior.sigma;
}

// The derivative of a term with respect to one of its parts.
struct PartColumns {
  int block = kNoBlock;
  int first = 0;  // unknown of its first coordinate
  Vector3d values = Vector3d::Zero();
};

PartColumns ColumnsOf(const RigProblemBase& problem, const RigStructure& s,
                      const LinearTerm& term, const LinearTerm::Part& part) {
  const auto& blocks = part.is_frame ? s.frame_block : s.sensor_block;
  const auto& masks =
      part.is_frame ? problem.frame_masks : problem.sensor_masks;
  PartColumns columns;
  columns.block = blocks[part.idx];
  if (columns.block == kNoBlock) return columns;
  columns.first = s.block_first[columns.block] + s.pose_size - 3;
  columns.values =
      term.weight * part.coefficients.cwiseProduct(masks[part.idx].tail<3>());
  return columns;
}

// The unknown of a prior; nullopt if the parameter is constant.
std::optional<int> UnknownOf(const RigProblemBase& problem,
                             const RigStructure& s,
                             const RigProblemBase::ParameterPrior& prior) {
  const int block = s.camera_block[prior.camera];
  const std::vector<int>& params = problem.cameras[prior.camera].free_params;
  const auto it = std::find(params.begin(), params.end(), prior.param);
  if (block == kNoBlock || it == params.end()) return std::nullopt;
  return s.block_first[block] + static_cast<int>(it - params.begin());
}

void AddProduct(const RigStructure& s, const PartColumns& a,
                const PartColumns& b, double* matrix) {
  const int row = s.block_rank[a.block], column = s.block_rank[b.block];
  if (row < column || !s.pattern.Contains(column, row)) return;
  const auto [position, stride] = s.pattern.Find(column, row);
  const int offset = s.pose_size - 3;
  double* values = matrix + position + offset;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      values[static_cast<size_t>(j + offset) * stride + i] +=
          a.values[i] * b.values[j];
    }
  }
}

double CostOfLinearTerms(const RigProblemBase& problem, const RigState& state) {
  double cost = 0.0;
  for (const LinearTerm& term : problem.linear_terms) {
    const double r = TermResidual(term, state);
    cost += 0.5 * r * r;
  }
  for (const RigProblemBase::ParameterPrior& prior : problem.priors) {
    const double r = PriorResidual(prior, state);
    cost += 0.5 * r * r;
  }
  return cost;
}

// Adds J^T r, the diagonal of J^T J, and the blocks of J^T J that are in the
// pattern. `matrix`: the values of the Schur complement, at the positions of
// the pattern.
void AddLinearTerms(const RigProblemBase& problem, const RigStructure& s,
                    const RigState& state, Eigen::VectorXd* gradient,
                    Eigen::VectorXd* diagonal, double* matrix) {
  for (const LinearTerm& term : problem.linear_terms) {
    const double r = TermResidual(term, state);
    for (const LinearTerm::Part& part : term.parts) {
      const PartColumns a = ColumnsOf(problem, s, term, part);
      if (a.block == kNoBlock) continue;
      gradient->segment<3>(a.first) += r * a.values;
      diagonal->segment<3>(a.first) += a.values.cwiseAbs2();
      for (const LinearTerm::Part& other : term.parts) {
        const PartColumns b = ColumnsOf(problem, s, term, other);
        if (b.block != kNoBlock) AddProduct(s, a, b, matrix);
      }
    }
  }
  for (const RigProblemBase::ParameterPrior& prior : problem.priors) {
    const std::optional<int> unknown = UnknownOf(problem, s, prior);
    if (!unknown) continue;
    const int i = *unknown;
    const double weight = 1.0 / (prior.sigma * prior.sigma);
    (*gradient)[i] += PriorResidual(prior, state) / prior.sigma;
    (*diagonal)[i] += weight;
    const int block = s.camera_block[prior.camera];
    const int rank = s.block_rank[block];
    const auto [position, stride] = s.pattern.Find(rank, rank);
    const auto offset = static_cast<size_t>(i - s.block_first[block]);
    matrix[position + offset * stride + offset] += weight;
  }
}

// y += J^T J x.
void MultiplyLinearTerms(const RigProblemBase& problem, const RigStructure& s,
                         const Eigen::VectorXd& x, Eigen::VectorXd* y) {
  for (const LinearTerm& term : problem.linear_terms) {
    double sum = 0.0;
    for (const LinearTerm::Part& part : term.parts) {
      const PartColumns a = ColumnsOf(problem, s, term, part);
      if (a.block != kNoBlock) sum += a.values.dot(x.segment<3>(a.first));
    }
    for (const LinearTerm::Part& part : term.parts) {
      const PartColumns a = ColumnsOf(problem, s, term, part);
      if (a.block != kNoBlock) y->segment<3>(a.first) += sum * a.values;
    }
  }
  for (const RigProblemBase::ParameterPrior& prior : problem.priors) {
    const std::optional<int> i = UnknownOf(problem, s, prior);
    if (i) (*y)[*i] += x[*i] / (prior.sigma * prior.sigma);
  }
}

// Preconditioned conjugate gradients (Hestenes and Stiefel 1952): solves A x =
// b for a symmetric positive definite A, starting at zero. multiply(x, &y) sets
// y = A x, precondition(r, &z) sets z = M^-1 r. Stops when sqrt(r^T M^-1 r) has
// decreased by the factor `tolerance`, or after max_num_iterations. Returns
// whether the result is finite, and b - A x in `residual`.
template <class Multiply, class Precondition>
bool SolveByConjugateGradient(const Eigen::VectorXd& b, double tolerance,
                              int max_num_iterations, const Multiply& multiply,
                              const Precondition& precondition,
                              Eigen::VectorXd* x, Eigen::VectorXd* residual) {
  Eigen::VectorXd& r = *residual;
  Eigen::VectorXd z(b.size()), Ap(b.size());
  x->setZero(b.size());
  r = b;
  precondition(r, &z);
  Eigen::VectorXd p = z;
  double rz = r.dot(z);
  const double target = tolerance * tolerance * rz;
  for (int i = 0; i < max_num_iterations && rz > target; ++i) {
    multiply(p, &Ap);
    const double curvature = p.dot(Ap);
    if (!(curvature > 0.0)) break;
    const double alpha = rz / curvature;
    *x += alpha * p;
    r -= alpha * Ap;
    precondition(r, &z);
    const double next = r.dot(z);
    p = z + next / rz * p;
    rz = next;
  }
  return x->allFinite();
}

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
