// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/position_initialization.h"

#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "geometry/decompositions.h"
#include "math/l1_admm.h"
#include "math/sparse_solver.h"
#include "math/statistics.h"
#include "math/union_find.h"
#include "mgsfm/base/mask.h"
#include "translation_averaging/arrow_least_squares.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;

double BlockCost(const BlockPenalty& block, const Vector3d& z) {
  switch (block.kind) {
    case BlockPenalty::Kind::kScaleAndNormal:
      return block.scale_slope * std::abs(z[0]) +
             (1.0 - block.scale_slope) * std::max(block.bound - z[0], 0.0) +
             z.tail<2>().norm();
    case BlockPenalty::Kind::kNorm:
      return z.norm();
    case BlockPenalty::Kind::kSum:
      break;
  }
  return z.lpNorm<1>();
}

// The factor by which the proximal map of a norm shrinks its argument.
double Shrunk(double norm, double rho) {
  return norm * rho > 1.0 ? 1.0 - 1.0 / (rho * norm) : 0.0;
}

Vector3d BlockProx(const BlockPenalty& block, double rho, const Vector3d& v) {
  Vector3d z;
  switch (block.kind) {
    case BlockPenalty::Kind::kScaleAndNormal:
      z[0] = ProxOfScaleResidual(v[0], rho / block.scale_slope, block.bound,
                                 1.0 / block.scale_slope);
      z.tail<2>() = Shrunk(v.tail<2>().norm(), rho) * v.tail<2>();
      return z;
    case BlockPenalty::Kind::kNorm:
      return Shrunk(v.norm(), rho) * v;
    case BlockPenalty::Kind::kSum:
      break;
  }
  for (int i = 0; i < 3; ++i) z[i] = Shrunk(std::abs(v[i]), rho) * v[i];
  return z;
}

}  // namespace

double ProxOfScaleResidual(double v, double rho, double bound, double steep) {
  // Minimizes phi(z) + rho/2 (z - v)^2: z = v - phi'(z) / rho.
  const double step = 1.0 / rho;
  if (v > step) return v - step;
  if (v >= -step) return 0.0;
  if (v + step >= bound) return v + step;
  if (v + steep * step >= bound) return bound;
  return v + steep * step;
}

double BlockFunction::Cost(const MatrixXd& z) const {
  double cost = 0.0;
  for (size_t k = 0; k < blocks.size(); ++k) {
    cost += blocks[k].weight * BlockCost(blocks[k], z.block<3, 1>(3 * k, 0));
  }
  return cost;
}

void BlockFunction::Prox(double rho, const MatrixXd& v, MatrixXd* z) const {
  ParallelFor(
      blocks.size(), num_threads,
      [&](size_t k) {
        z->block<3, 1>(3 * k, 0) = BlockProx(blocks[k], rho / blocks[k].weight,
                                             v.block<3, 1>(3 * k, 0));
      },
      /*block_size=*/16384);  // less work does not justify a thread
}

namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

// docs/results/constants.md shows the sensitivity to these thresholds.
//
// Lengths known this well have the weight of directions. With less weight,
// wrong directions could shorten good baselines instead of being outliers.
constexpr double kGoodScaleSigma = 0.15;
// Standard deviation of log(median depth) between groups: depths differ by a
// factor of two. The groups share no measurement.
constexpr double kGroupSigma = 0.7;
// Lower bound of a baseline, relative to its estimated length.
constexpr double kLowerBound = 0.1;
// A sensor translation is not determined beyond this standard deviation, in
// units of the median baseline: two of them reach the baseline itself.
constexpr double kMaxSensorSigma = 0.5;
// Ridge rows kRidge x with weight kRidge make A^T A definite. Their pull is
// 1e-8 times that of a pair with a baseline of one unit.
constexpr double kRidge = 1e-4;

// The frames of the largest set that pairs connect; ties go to the set of the
// first frame.
Mask LargestConnectedSet(const InitializationInput& in) {
  const int num_frames = in.problem.num_frames;
  UnionFind sets(num_frames);
  for (size_t i = 0; i < in.baselines.size(); ++i) {
    if (in.KindOf(i) == BaselineKind::kUnused) continue;
    const auto [frame1, frame2] = in.FramesOf(i);
    sets.Union(frame1, frame2);
  }
  const Mask has_rotation = in.problem.FramesWithRotation();
  std::vector<int> num_of_root(num_frames, 0);
  for (int f = 0; f < num_frames; ++f) {
    if (has_rotation[f]) ++num_of_root[sets.Find(f)];
  }
  size_t best = 0;
  int best_size = 0;
  for (int f = 0; f < num_frames; ++f) {
    const size_t root = sets.Find(f);
    if (has_rotation[f] && num_of_root[root] > best_size) {
      best = root;
      best_size = num_of_root[root];
    }
  }
  Mask is_in_set(num_frames, false);
  for (int f = 0; f < num_frames; ++f) {
    is_in_set[f] = has_rotation[f] && sets.Find(f) == best;
  }
  return is_in_set;
}

// Per pair: lower bound of the length used in its weight. Zero for pairs within
// a frame, whose baselines belong to the rig.
std::vector<double> MinCountedLengths(const InitializationInput& in) {
  const int num_frames = in.problem.num_frames;
  std::vector<std::vector<double>> lengths(num_frames);
  for (size_t i = 0; i < in.baselines.size(); ++i) {
    if (!in.IsDirectionBetweenFrames(i)) continue;
    for (const int f : in.FramesOf(i)) {
      lengths[f].push_back(in.scales.pairs[i]->scale);
    }
  }
  std::vector<double> quartile(num_frames, 0.0);
  for (int f = 0; f < num_frames; ++f) {
    if (!lengths[f].empty()) {
      quartile[f] = Quantile(std::move(lengths[f]), 0.25);
    }
  }
  std::vector<double> min_length(in.baselines.size(), 0.0);
  for (size_t i = 0; i < in.baselines.size(); ++i) {
    if (!in.IsDirectionBetweenFrames(i)) continue;
    const auto [f1, f2] = in.FramesOf(i);
    // The length is at least this fraction of the lower quartile of its frames'
    // lengths. Otherwise, pairs that match a vehicle ahead, with 1/50 to 1/100
    // of the true length, outvote the others: on KITTI 01 with the cube6 rig
    // the error was 8 m instead of 0.8 m (docs/maths/translation_averaging.md,
    // section 3).
    min_length[i] = 0.5 * std::min(quartile[f1], quartile[f2]);
  }
  return min_length;
}

std::vector<int> FreeSensors(const PositionProblem& problem) {
  std::vector<int> free_sensors;
  for (size_t s = 0; s < problem.sensor_kind.size(); ++s) {
    if (problem.sensor_kind[s] == SensorKind::kFree) {
      free_sensors.push_back(static_cast<int>(s));
    }
  }
  return free_sensors;
}

// Numbers of the unknowns: the frames first, then sensors, unit and groups.
struct Unknowns {
  // First column of each element; nullopt if constant.
  std::vector<std::optional<int>> frame_column;
  std::vector<std::optional<int>> sensor_column;
  std::vector<std::optional<int>> group_column;
  std::optional<int> unit_column;  // of known sensor offsets
  int num_frame_columns = 0;
  int first_sensor_column = 0;
  int size = 0;
};

Unknowns NumberUnknowns(const InitializationInput& in,
                        const Mask& frame_is_placed,
                        const std::vector<int>& free_sensors,
                        bool estimate_unit) {
  Unknowns unknowns;
  unknowns.frame_column.resize(in.problem.num_frames);
  bool is_first = true;
  for (int f = 0; f < in.problem.num_frames; ++f) {
    if (!frame_is_placed[f]) continue;
    if (!is_first) {
      unknowns.frame_column[f] = unknowns.size;
      unknowns.size += 3;
    }
    is_first = false;
  }
  unknowns.num_frame_columns = unknowns.size;
  unknowns.first_sensor_column = unknowns.size;
  unknowns.sensor_column.resize(in.problem.sensor_kind.size());
  for (const int s : free_sensors) {
    unknowns.sensor_column[s] = unknowns.size;
    unknowns.size += 3;
  }
  if (estimate_unit) unknowns.unit_column = unknowns.size++;
  unknowns.group_column.resize(in.scales.group_sizes.size());
  for (size_t g = 1; g < unknowns.group_column.size(); ++g) {
    unknowns.group_column[g] = unknowns.size++;
  }
  return unknowns;
}

// Adds the rows `rows * C` of the baseline C of a pair.
void AddBaseline(const PositionProblem& problem, const Unknowns& unknowns,
                 const BaselineDirection& baseline, const Matrix3d& rows,
                 int first_row, BlockSystem* system) {
  const auto add = [&](int column, const Matrix3d& block) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        system->triplets.emplace_back(first_row + r, column + c, block(r, c));
      }
    }
  };
  const int images[2] = {baseline.image_idx1, baseline.image_idx2};
  for (int side = 0; side < 2; ++side) {
    const Matrix3d signed_rows = side == 0 ? Matrix3d(-rows) : rows;
    const auto& frame_column =
        unknowns.frame_column[problem.frame_idx[images[side]]];
    const int sensor = problem.sensor_idx[images[side]];
    const Matrix3d sensor_rows =
        -signed_rows * *problem.world_from_cam[images[side]];
    if (frame_column) add(*frame_column, signed_rows);
    if (unknowns.sensor_column[sensor]) {
      add(*unknowns.sensor_column[sensor], sensor_rows);
    }
    if (!unknowns.unit_column) continue;
    const Vector3d known = sensor_rows * problem.fixed_translation[sensor];
    for (int r = 0; r < 3; ++r) {
      system->triplets.emplace_back(first_row + r, *unknowns.unit_column,
                                    known[r]);
    }
  }
}

void AddDirection(const InitializationInput& in, const Unknowns& unknowns,
                  size_t pair_idx, double min_length, BlockSystem* system) {
  const BaselineDirection& baseline = in.baselines[pair_idx];
  const PairScale& pair = *in.scales.pairs[pair_idx];
  const double normal_weight =
      kDirectionSigma / (std::max(pair.scale, min_length) *
                         std::hypot(baseline.sigma_rad, kDirectionSigma));
  const Vector3d& b = baseline.direction;
  const Vector3d normal = b.unitOrthogonal();
  Matrix3d rows;
  rows.row(0) = normal_weight * b;
  rows.row(1) = normal_weight * normal;
  rows.row(2) = normal_weight * b.cross(normal);
  const int first_row = system->num_rows();
  AddBaseline(in.problem, unknowns, baseline, rows, first_row, system);
  Vector3d rhs = Vector3d::Zero();
  const std::optional<int>& column = unknowns.group_column[pair.group];
  if (!column) {
    rhs[0] = normal_weight * pair.scale;
  } else {
    system->triplets.emplace_back(first_row, *column,
                                  -normal_weight * pair.scale);
  }
  BlockPenalty penalty;
  penalty.kind = BlockPenalty::Kind::kScaleAndNormal;
  penalty.scale_slope = std::min(kGoodScaleSigma / pair.sigma_log, 1.0);
  penalty.bound = -normal_weight * (1.0 - kLowerBound) * pair.scale;
  system->FinishBlock(rhs, penalty);
}

void AddNoParallax(const InitializationInput& in, const Unknowns& unknowns,
                   const BaselineDirection& baseline, double sigma,
                   BlockSystem* system) {
  const Matrix3d rows = kDirectionSigma / sigma * Matrix3d::Identity();
  AddBaseline(in.problem, unknowns, baseline, rows, system->num_rows(), system);
  BlockPenalty penalty;
  penalty.kind = BlockPenalty::Kind::kNorm;
  system->FinishBlock(Vector3d::Zero(), penalty);
}

void AddGroupPriors(const PairScales& scales, const Unknowns& unknowns,
                    BlockSystem* system) {
  constexpr double kWeight = kDirectionSigma / kGroupSigma;
  for (size_t g = 1; g < unknowns.group_column.size(); ++g) {
    // The weight equals the pull of the rows of the group if they were pure
    // noise.
    BlockPenalty penalty;
    penalty.weight = scales.group_sizes[g];
    system->triplets.emplace_back(system->num_rows(), *unknowns.group_column[g],
                                  kWeight);
    system->FinishBlock(Vector3d(kWeight, 0.0, 0.0), penalty);
  }
}

void AddRidge(int num_unknowns, BlockSystem* system) {
  BlockPenalty penalty;
  penalty.weight = kRidge;
  for (int column = 0; column < num_unknowns; ++column) {
    system->triplets.emplace_back(system->num_rows() + column % 3, column,
                                  kRidge);
    if (column % 3 == 2 || column + 1 == num_unknowns) {
      system->FinishBlock(Vector3d::Zero(), penalty);
    }
  }
}

BlockSystem AssembleSystem(const InitializationInput& in,
                           const Unknowns& unknowns, const Positions& placed,
                           double min_parallax_deg, int num_threads) {
  const std::vector<double> min_length = MinCountedLengths(in);
  const double zero_baseline_sigma =
      ZeroBaselineSigma(in.scales, min_parallax_deg);
  BlockSystem system;
  system.function.num_threads = num_threads;
  for (size_t i = 0; i < in.baselines.size(); ++i) {
    const BaselineKind kind = in.KindOf(i);
    if (kind == BaselineKind::kUnused ||
        !placed.IsPlaced(in.problem, in.baselines[i].image_idx1)) {
      continue;
    }
    if (kind == BaselineKind::kDirection) {
      AddDirection(in, unknowns, i, min_length[i], &system);
    } else {
      AddNoParallax(in, unknowns, in.baselines[i], zero_baseline_sigma,
                    &system);
    }
  }
  AddGroupPriors(in.scales, unknowns, &system);
  AddRidge(unknowns.size, &system);
  return system;
}

// Covariance of the sensor translations and the unit of known offsets; nullopt
// if the equations are not definite.
std::optional<MatrixXd> ExtrinsicCovariance(const BlockSystem& system,
                                            const Unknowns& unknowns,
                                            size_t num_free_sensors,
                                            int num_threads) {
  // The columns of both are consecutive.
  const int size = 3 * static_cast<int>(num_free_sensors) +
                   (unknowns.unit_column.has_value() ? 1 : 0);
  if (size == 0) return MatrixXd(0, 0);
  std::vector<Eigen::Triplet<double>> triplets;
  triplets.reserve(system.triplets.size());
  for (const auto& t : system.triplets) {
    const BlockPenalty& penalty = system.function.blocks[t.row() / 3];
    const double slope = t.row() % 3 == 0 ? penalty.scale_slope : 1.0;
    triplets.emplace_back(t.row(), t.col(), slope * t.value());
  }
  Eigen::SparseMatrix<double> A(system.num_rows(), unknowns.size);
  A.setFromTriplets(triplets.begin(), triplets.end());
  const SparseLeastSquares op(A, num_threads);
  if (!op.IsPositiveDefinite()) return std::nullopt;
  MatrixXd selection = MatrixXd::Zero(unknowns.size, size);
  selection.middleRows(unknowns.first_sensor_column, size).setIdentity();
  MatrixXd inverse;
  op.SolveNormal(selection, &inverse);
  const MatrixXd block = inverse.middleRows(unknowns.first_sensor_column, size);
  return MatrixXd(kDirectionSigma * kDirectionSigma * 0.5 *
                  (block + block.transpose()));
}

// Rows over the free sensor translations that are not determined.
MatrixXd FindUnobservable(const MatrixXd& covariance, size_t num_free_sensors) {
  const auto size = static_cast<Eigen::Index>(3 * num_free_sensors);
  if (size == 0) return MatrixXd(0, 0);
  const SymmetricEigen<MatrixXd> eigen(covariance.topLeftCorner(size, size));
  Eigen::Index num_weak = 0;
  while (num_weak < size && eigen.values[size - 1 - num_weak] >
                                kMaxSensorSigma * kMaxSensorSigma) {
    ++num_weak;
  }
  return eigen.V.rightCols(num_weak).transpose();
}

// Fixes undetermined directions at zero.
void AddUnobservable(const MatrixXd& unobservable, const Unknowns& unknowns,
                     BlockSystem* system) {
  // Exceeds the pull of all data rows together
  // (docs/maths/translation_averaging.md, section 3), so that the constraint
  // holds exactly.
  const double weight = 0.1 * std::sqrt(system->num_rows());
  for (Eigen::Index k = 0; k < unobservable.rows(); ++k) {
    for (Eigen::Index c = 0; c < unobservable.cols(); ++c) {
      system->triplets.emplace_back(
          system->num_rows(),
          unknowns.first_sensor_column + static_cast<int>(c),
          weight * unobservable(k, c));
    }
    system->FinishBlock(Vector3d::Zero(), BlockPenalty());
  }
}

struct Solution {
  SolveSummary summary;
  MatrixXd x;  // one column
};

Solution Minimize(const BlockSystem& system, const Unknowns& unknowns,
                  const InitializationOptions& options,
                  const Context& context) {
  Eigen::SparseMatrix<double> A(system.num_rows(), unknowns.size);
  A.setFromTriplets(system.triplets.begin(), system.triplets.end());
  const MatrixXd b =
      Eigen::Map<const Eigen::VectorXd>(system.rhs.data(), system.num_rows());
  AdmmOptions admm_options;
  admm_options.context = context;
  admm_options.max_num_iterations = options.max_num_iterations;
  admm_options.relative_tolerance = options.relative_tolerance;
  const auto minimize = [&](const auto& op) {
    Solution solution;
    if (op.IsPositiveDefinite()) {
      AdmmState state;
      solution.summary =
          MinimizeByAdmm(op, b, system.function, admm_options, &state);
      solution.x = std::move(state.x);
    } else {
      solution.summary.message = "The normal equations are not definite.";
    }
    return solution;
  };
  // The border of the arrow solver is dense; larger borders use the sparse
  // solver.
  if (unknowns.size - unknowns.num_frame_columns > 100) {
    return minimize(SparseLeastSquares(A, context.num_threads));
  }
  return minimize(ArrowLeastSquares(A, unknowns.num_frame_columns / 3,
                                    context.num_threads));
}

struct Attempt {
  Unknowns unknowns;
  Solution solution;
  MatrixXd unobservable;
  // Whether the data determine the unit of known sensor offsets.
  bool unit_is_determined = false;
};

Attempt Solve(const InitializationInput& in, const Positions& placed,
              const std::vector<int>& free_sensors, bool estimate_unit,
              const InitializationOptions& options, const Context& context) {
  Attempt attempt;
  attempt.unknowns =
      NumberUnknowns(in, placed.frame_is_placed, free_sensors, estimate_unit);
  attempt.unobservable.resize(
      0, static_cast<Eigen::Index>(3 * free_sensors.size()));
  SolveSummary& summary = attempt.solution.summary;
  if (attempt.unknowns.size == 0) {
    attempt.solution.x.resize(0, 1);
    summary.termination = Termination::kConverged;
    summary.message = "Nothing is unknown.";
    return attempt;
  }
  BlockSystem system =
      AssembleSystem(in, attempt.unknowns, placed, options.min_parallax_deg,
                     context.num_threads);
  const auto covariance = ExtrinsicCovariance(
      system, attempt.unknowns, free_sensors.size(), context.num_threads);
  if (!covariance) {
    summary.message = "The normal equations are not definite.";
    return attempt;
  }
  attempt.unobservable = FindUnobservable(*covariance, free_sensors.size());
  AddUnobservable(attempt.unobservable, attempt.unknowns, &system);
  attempt.solution = Minimize(system, attempt.unknowns, options, context);
  const MatrixXd& x = attempt.solution.x;
  if (!estimate_unit || x.size() == 0) return attempt;
  // Whether the unit is three standard deviations from zero.
  const double variance =
      (*covariance)(covariance->rows() - 1, covariance->cols() - 1);
  attempt.unit_is_determined =
      x(*attempt.unknowns.unit_column, 0) > 3.0 * std::sqrt(variance);
  return attempt;
}

// Divides the solution by the unit of known sensor offsets.
void Extract(const PositionProblem& problem, const Attempt& attempt,
             InitialPositions* result) {
  const Unknowns& unknowns = attempt.unknowns;
  const MatrixXd& x = attempt.solution.x;
  const bool is_usable = attempt.solution.summary.IsUsable() && x.allFinite();
  double unit = 1.0;
  if (is_usable && unknowns.unit_column) {
    unit = x(*unknowns.unit_column, 0);
    result->is_metric = true;
  }
  Positions& positions = result->positions;
  result->group_factor.assign(unknowns.group_column.size(), 1.0 / unit);
  if (!is_usable) return;
  for (int f = 0; f < problem.num_frames; ++f) {
    if (!unknowns.frame_column[f]) continue;
    positions.frame_center[f] =
        x.block<3, 1>(*unknowns.frame_column[f], 0) / unit;
  }
  for (const int s : result->free_sensors) {
    positions.sensor_translation[s] =
        x.block<3, 1>(*unknowns.sensor_column[s], 0) / unit;
  }
  for (size_t g = 1; g < unknowns.group_column.size(); ++g) {
    result->group_factor[g] =
        std::max(x(*unknowns.group_column[g], 0), kLowerBound) / unit;
  }
}

}  // namespace

double ZeroBaselineSigma(const PairScales& scales, double min_parallax_deg) {
  return 3.0 * std::sin(DegToRad(min_parallax_deg)) *
         std::max(scales.typical_depth, 1e-3);
}

InitialPositions InitializePositions(const InitializationInput& in,
                                     const InitializationOptions& options,
                                     const Context& context) {
  const PositionProblem& problem = in.problem;
  InitialPositions result;
  result.free_sensors = FreeSensors(problem);
  Positions& positions = result.positions;
  positions.frame_is_placed = LargestConnectedSet(in);
  positions.frame_center.assign(problem.num_frames, Vector3d::Zero());
  positions.sensor_translation = problem.fixed_translation;
  const auto solve = [&](bool estimate_unit) {
    return Solve(in, positions, result.free_sensors, estimate_unit, options,
                 context);
  };
  const bool has_unit =
      problem.HasKnownOffset() && !in.scales.group_sizes.empty();
  Attempt attempt = solve(has_unit);
  const bool keeps_unit =
      attempt.unit_is_determined || attempt.solution.x.size() == 0;
  if (has_unit && !keeps_unit) attempt = solve(false);
  Extract(problem, attempt, &result);
  result.solve = attempt.solution.summary;
  result.unobservable = std::move(attempt.unobservable);
  return result;
}

}  // namespace mgsfm
