// SPDX-License-Identifier: BSD-3-Clause
#include "translation/position_initialization.h"

#include <Eigen/Eigenvalues>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <cmath>

#include "base/parallel.h"
#include "geometry/so3.h"
#include "math/l1_admm.h"
#include "math/sparse_solver.h"
#include "math/statistics.h"
#include "math/union_find.h"
#include "mgsfm/base/mask.h"
#include "translation/arrow_least_squares.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;

// Error of directions that remains whatever their own estimates say. The unit
// of residuals.
constexpr double kDirectionSigma = DegToRad(0.5);
// Lengths known this well weigh as much as directions: were they weaker, wrong
// directions could make good baselines collapse rather than be outliers.
constexpr double kGoodScaleSigma = 0.15;
constexpr double kGroupSigma = 0.7;  // of log(median depth) between groups
constexpr double kLowerBound = 0.1;  // of the estimated length of a baseline
// Of undetermined directions, in units of the median baseline.
constexpr double kMaxSensorSigma = 0.5;
constexpr double kRidge = 1e-4;
// A pair counts as if it were at least this long, compared with the lower
// quartile of its frames' pairs. Were it free to count by its own length, one
// that is wrongly found to be hardly any would outvote all others.
constexpr double kMinRelativeLength = 0.5;
// Unknowns that are not frames; with more, products with them would be dense.
constexpr int kMaxSizeOfBorder = 100;

// What the three rows of a block cost.
struct BlockPenalty {
  enum class Kind { kScaleAndNormal, kNorm, kSum };
  Kind kind = Kind::kSum;
  double weight = 1.0;  // of the whole block
  // Of kScaleAndNormal: what the first row costs above the bound, compared
  // with the others, and below, as much as these.
  double scale_slope = 1.0;
  double bound = 0.0;
};

// f of the ADMM: a sum over blocks of three rows.
struct BlockFunction {
  std::vector<BlockPenalty> blocks;
  int num_threads = 1;

  double Cost(const MatrixXd& z) const {
    double cost = 0.0;
    for (size_t k = 0; k < blocks.size(); ++k) {
      cost += blocks[k].weight * BlockCost(blocks[k], z.block<3, 1>(3 * k, 0));
    }
    return cost;
  }

  static double BlockCost(const BlockPenalty& block, const Vector3d& z) {
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

  void Prox(double rho, const MatrixXd& v, MatrixXd* z) const {
    constexpr size_t kBlocksPerItem = 16384;
    ParallelFor(
        blocks.size(), num_threads,
        [&](size_t k) {
          z->block<3, 1>(3 * k, 0) = BlockProx(
              blocks[k], rho / blocks[k].weight, v.block<3, 1>(3 * k, 0));
        },
        kBlocksPerItem);
  }

  static double Shrunk(double norm, double rho) {
    return norm * rho > 1.0 ? 1.0 - 1.0 / (rho * norm) : 0.0;
  }

  static Vector3d BlockProx(const BlockPenalty& block, double rho,
                            const Vector3d& v) {
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
};

// Rows A x - b in blocks of three, with their penalties. Of the frames all rows
// of a block are alike but for a turn, so that A^T A is that of
// arrow_least_squares.h.
struct BlockSystem {
  std::vector<Eigen::Triplet<double>> triplets;
  std::vector<double> rhs;
  BlockFunction function;

  int num_rows() const { return static_cast<int>(rhs.size()); }
  void FinishBlock(const Vector3d& b, const BlockPenalty& penalty) {
    rhs.insert(rhs.end(), {b[0], b[1], b[2]});
    function.blocks.push_back(penalty);
  }
};

class PositionInitializer {
 public:
  PositionInitializer(const PositionProblem& problem,
                      const std::vector<BaselineDirection>& motions,
                      const PairScales& scales, double min_parallax_deg,
                      const InitializationOptions& options,
                      const Context& context)
      : problem_(problem),
        motions_(motions),
        scales_(scales),
        options_(options),
        context_(context),
        // A baseline of this length would be seen as parallax at typical depth.
        zero_baseline_sigma_(3.0 * std::sin(DegToRad(min_parallax_deg)) *
                             std::max(scales.typical_depth, 1e-3)) {}

  InitialPositions Run() {
    PlaceFrames();
    BoundLengths();
    ListFreeSensors();
    estimate_baseline_unit_ = HasGivenBaseline() && !scales_.scale.empty() &&
                              !scales_.group_sizes.empty();
    if (!Solve()) estimate_baseline_unit_ = false;
    if (!estimate_baseline_unit_) Solve();
    Extract();
    return std::move(result_);
  }

 private:
  void PlaceFrames();
  void BoundLengths();
  void ListFreeSensors();
  bool HasGivenBaseline() const;
  // False if the unit of given baselines turned out not to be determined.
  bool Solve();
  void NumberUnknowns();
  BlockSystem AssembleData() const;
  void AddBaseline(const BaselineDirection& motion, const Matrix3d& rows,
                   int first_row, BlockSystem* system) const;
  void AddDirection(size_t motion_idx, BlockSystem* system) const;
  void AddNoParallax(const BaselineDirection& motion,
                     BlockSystem* system) const;
  void AddGroupPriors(BlockSystem* system) const;
  void AddRidge(BlockSystem* system) const;
  // Covariance of the internal translations and the unit of given ones; of no
  // size if the equations are not definite.
  MatrixXd ExtrinsicCovariance(const BlockSystem& system) const;
  void FindUnobservable(const MatrixXd& covariance);
  void AddUnobservable(BlockSystem* system) const;
  void Extract();
  SolveSummary Minimize(const BlockSystem& system);

  const PositionProblem& problem_;
  const std::vector<BaselineDirection>& motions_;
  const PairScales& scales_;
  const InitializationOptions& options_;
  const Context& context_;
  const double zero_baseline_sigma_;
  bool estimate_baseline_unit_ = false;
  InitialPositions result_;
  // Per motion: the length it counts with at least.
  std::vector<double> min_length_;
  // First unknown of each frame, sensor and group; -1 if it is constant.
  std::vector<int> frame_column_;
  std::vector<int> sensor_column_;
  std::vector<int> group_column_;
  int unit_column_ = -1;
  int num_frame_columns_ = 0;  // the first ones
  int num_unknowns_ = 0;
  AdmmState state_;
};

// The largest set of frames that pairs connect.
void PositionInitializer::PlaceFrames() {
  UnionFind sets(problem_.num_frames);
  for (const BaselineDirection& motion : motions_) {
    if (motion.kind == BaselineKind::kUnused) continue;
    sets.Union(problem_.frame_idx[motion.image_idx1],
               problem_.frame_idx[motion.image_idx2]);
  }
  Mask has_image(problem_.num_frames, false);
  for (size_t i = 0; i < problem_.frame_idx.size(); ++i) {
    if (problem_.IsUsed(static_cast<int>(i))) {
      has_image[problem_.frame_idx[i]] = true;
    }
  }
  std::vector<int> num_of_root(problem_.num_frames, 0);
  size_t best = 0;
  for (int f = 0; f < problem_.num_frames; ++f) {
    if (has_image[f]) ++num_of_root[sets.Find(f)];
  }
  // The first frame of equally large sets decides.
  int best_size = 0;
  for (int f = 0; f < problem_.num_frames; ++f) {
    const size_t root = sets.Find(f);
    if (has_image[f] && num_of_root[root] > best_size) {
      best = root;
      best_size = num_of_root[root];
    }
  }
  Positions& positions = result_.positions;
  positions.frame_center.assign(problem_.num_frames, Vector3d::Zero());
  positions.frame_is_placed.assign(problem_.num_frames, false);
  for (int f = 0; f < problem_.num_frames; ++f) {
    positions.frame_is_placed[f] = has_image[f] && sets.Find(f) == best;
  }
}

// Pairs in a frame have baselines of the rig, which frames do not tell.
void PositionInitializer::BoundLengths() {
  const auto frames = [&](size_t i) {
    return std::array{problem_.frame_idx[motions_[i].image_idx1],
                      problem_.frame_idx[motions_[i].image_idx2]};
  };
  const auto is_between_frames = [&](size_t i) {
    return motions_[i].kind == BaselineKind::kDirection &&
           frames(i)[0] != frames(i)[1];
  };
  std::vector<std::vector<double>> lengths(problem_.num_frames);
  for (size_t i = 0; i < motions_.size(); ++i) {
    if (!is_between_frames(i)) continue;
    for (const int f : frames(i)) lengths[f].push_back(scales_.scale[i]);
  }
  std::vector<double> quartile(problem_.num_frames, 0.0);
  for (int f = 0; f < problem_.num_frames; ++f) {
    if (!lengths[f].empty()) {
      quartile[f] = Quantile(std::move(lengths[f]), 0.25);
    }
  }
  min_length_.assign(motions_.size(), 0.0);
  for (size_t i = 0; i < motions_.size(); ++i) {
    if (!is_between_frames(i)) continue;
    const auto [f1, f2] = frames(i);
    min_length_[i] = kMinRelativeLength * std::min(quartile[f1], quartile[f2]);
  }
}

void PositionInitializer::ListFreeSensors() {
  for (size_t s = 0; s < problem_.sensor_kind.size(); ++s) {
    if (problem_.sensor_kind[s] == SensorKind::kFree) {
      result_.free_sensors.push_back(static_cast<int>(s));
    }
  }
  result_.unobservable.resize(0, 3 * result_.free_sensors.size());
}

bool PositionInitializer::HasGivenBaseline() const {
  for (const Vector3d& t : problem_.fixed_translation) {
    if (t.squaredNorm() > 0.0) return true;
  }
  return false;
}

void PositionInitializer::NumberUnknowns() {
  num_unknowns_ = 0;
  frame_column_.assign(problem_.num_frames, -1);
  bool is_first = true;
  for (int f = 0; f < problem_.num_frames; ++f) {
    if (!result_.positions.frame_is_placed[f]) continue;
    if (!is_first) {
      frame_column_[f] = num_unknowns_;
      num_unknowns_ += 3;
    }
    is_first = false;
  }
  num_frame_columns_ = num_unknowns_;
  sensor_column_.assign(problem_.sensor_kind.size(), -1);
  for (const int s : result_.free_sensors) {
    sensor_column_[s] = num_unknowns_;
    num_unknowns_ += 3;
  }
  unit_column_ = estimate_baseline_unit_ ? num_unknowns_++ : -1;
  group_column_.assign(scales_.group_sizes.size(), -1);
  for (size_t g = 1; g < group_column_.size(); ++g) {
    group_column_[g] = num_unknowns_++;
  }
}

// Rows `rows * C` of the baseline C of a pair.
void PositionInitializer::AddBaseline(const BaselineDirection& motion,
                                      const Matrix3d& rows, int first_row,
                                      BlockSystem* system) const {
  const auto add = [&](int column, const Matrix3d& block) {
    for (int r = 0; r < 3; ++r) {
      for (int c = 0; c < 3; ++c) {
        system->triplets.emplace_back(first_row + r, column + c, block(r, c));
      }
    }
  };
  const int images[2] = {motion.image_idx1, motion.image_idx2};
  for (int side = 0; side < 2; ++side) {
    const Matrix3d signed_rows = side == 0 ? Matrix3d(-rows) : rows;
    const int frame_column = frame_column_[problem_.frame_idx[images[side]]];
    const int sensor = problem_.sensor_idx[images[side]];
    const Matrix3d sensor_rows =
        -signed_rows * *problem_.world_from_cam[images[side]];
    if (frame_column >= 0) add(frame_column, signed_rows);
    if (sensor_column_[sensor] >= 0) add(sensor_column_[sensor], sensor_rows);
    if (unit_column_ < 0) continue;
    const Vector3d given = sensor_rows * problem_.fixed_translation[sensor];
    for (int r = 0; r < 3; ++r) {
      system->triplets.emplace_back(first_row + r, unit_column_, given[r]);
    }
  }
}

void PositionInitializer::AddDirection(size_t motion_idx,
                                       BlockSystem* system) const {
  const BaselineDirection& motion = motions_[motion_idx];
  const double scale = scales_.scale[motion_idx];
  const double normal_weight =
      kDirectionSigma / (std::max(scale, min_length_[motion_idx]) *
                         std::hypot(motion.sigma_rad, kDirectionSigma));
  const Vector3d& b = motion.direction;
  const Vector3d normal = b.unitOrthogonal();
  Matrix3d rows;
  rows.row(0) = normal_weight * b;
  rows.row(1) = normal_weight * normal;
  rows.row(2) = normal_weight * b.cross(normal);
  const int first_row = system->num_rows();
  AddBaseline(motion, rows, first_row, system);
  Vector3d rhs = Vector3d::Zero();
  const int column = group_column_[scales_.group[motion_idx]];
  if (column < 0) {
    rhs[0] = normal_weight * scale;
  } else {
    system->triplets.emplace_back(first_row, column, -normal_weight * scale);
  }
  BlockPenalty penalty;
  penalty.kind = BlockPenalty::Kind::kScaleAndNormal;
  penalty.scale_slope =
      std::min(kGoodScaleSigma / scales_.sigma_log[motion_idx], 1.0);
  penalty.bound = -normal_weight * (1.0 - kLowerBound) * scale;
  system->FinishBlock(rhs, penalty);
}

void PositionInitializer::AddNoParallax(const BaselineDirection& motion,
                                        BlockSystem* system) const {
  const Matrix3d rows =
      kDirectionSigma / zero_baseline_sigma_ * Matrix3d::Identity();
  AddBaseline(motion, rows, system->num_rows(), system);
  BlockPenalty penalty;
  penalty.kind = BlockPenalty::Kind::kNorm;
  system->FinishBlock(Vector3d::Zero(), penalty);
}

void PositionInitializer::AddGroupPriors(BlockSystem* system) const {
  constexpr double kWeight = kDirectionSigma / kGroupSigma;
  for (size_t g = 1; g < group_column_.size(); ++g) {
    // As strong as the rows of the group would pull if they only had noise.
    BlockPenalty penalty;
    penalty.weight = scales_.group_sizes[g];
    system->triplets.emplace_back(system->num_rows(), group_column_[g],
                                  kWeight);
    system->FinishBlock(Vector3d(kWeight, 0.0, 0.0), penalty);
  }
}

// Makes A^T A definite whatever the data are; costs nothing that matters.
void PositionInitializer::AddRidge(BlockSystem* system) const {
  BlockPenalty penalty;
  penalty.weight = 1e-4;
  for (int column = 0; column < num_unknowns_; ++column) {
    system->triplets.emplace_back(system->num_rows() + column % 3, column,
                                  kRidge);
    if (column % 3 == 2 || column + 1 == num_unknowns_) {
      system->FinishBlock(Vector3d::Zero(), penalty);
    }
  }
}

BlockSystem PositionInitializer::AssembleData() const {
  BlockSystem system;
  system.function.num_threads = context_.num_threads;
  for (size_t i = 0; i < motions_.size(); ++i) {
    const BaselineDirection& motion = motions_[i];
    if (motion.kind == BaselineKind::kUnused ||
        !result_.positions.IsPlaced(problem_, motion.image_idx1)) {
      continue;
    }
    if (motion.kind == BaselineKind::kDirection) {
      AddDirection(i, &system);
    } else {
      AddNoParallax(motion, &system);
    }
  }
  AddGroupPriors(&system);
  AddRidge(&system);
  return system;
}

MatrixXd PositionInitializer::ExtrinsicCovariance(
    const BlockSystem& system) const {
  const int num_free = 3 * static_cast<int>(result_.free_sensors.size());
  const int size = num_free + (unit_column_ >= 0);
  std::vector<Eigen::Triplet<double>> triplets;
  triplets.reserve(system.triplets.size());
  for (const auto& t : system.triplets) {
    const BlockPenalty& penalty = system.function.blocks[t.row() / 3];
    const double slope = t.row() % 3 == 0 ? penalty.scale_slope : 1.0;
    triplets.emplace_back(t.row(), t.col(), slope * t.value());
  }
  Eigen::SparseMatrix<double> A(system.num_rows(), num_unknowns_);
  A.setFromTriplets(triplets.begin(), triplets.end());
  const SparseLeastSquares op(A, context_.num_threads);
  if (!op.IsPositiveDefinite()) return MatrixXd(0, 0);
  // Their columns are consecutive.
  const int first =
      num_free > 0 ? sensor_column_[result_.free_sensors[0]] : unit_column_;
  MatrixXd selection = MatrixXd::Zero(num_unknowns_, size);
  selection.middleRows(first, size).setIdentity();
  MatrixXd inverse;
  op.SolveNormal(selection, &inverse);
  const MatrixXd block = inverse.middleRows(first, size);
  return kDirectionSigma * kDirectionSigma * 0.5 * (block + block.transpose());
}

void PositionInitializer::FindUnobservable(const MatrixXd& covariance) {
  const Eigen::Index size = 3 * result_.free_sensors.size();
  result_.unobservable.resize(0, size);
  if (size == 0) return;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(
      covariance.topLeftCorner(size, size));
  Eigen::Index num_weak = 0;
  while (num_weak < size && eigen.eigenvalues()[size - 1 - num_weak] >
                                kMaxSensorSigma * kMaxSensorSigma) {
    ++num_weak;
  }
  result_.unobservable = eigen.eigenvectors().rightCols(num_weak).transpose();
}

void PositionInitializer::AddUnobservable(BlockSystem* system) const {
  if (result_.free_sensors.empty()) return;
  const int first = sensor_column_[result_.free_sensors[0]];
  // Heavier than all data rows can pull, so that it holds exactly.
  const double weight = 0.1 * std::sqrt(system->num_rows());
  for (Eigen::Index k = 0; k < result_.unobservable.rows(); ++k) {
    for (Eigen::Index c = 0; c < result_.unobservable.cols(); ++c) {
      system->triplets.emplace_back(system->num_rows(),
                                    first + static_cast<int>(c),
                                    weight * result_.unobservable(k, c));
    }
    system->FinishBlock(Vector3d::Zero(), BlockPenalty());
  }
}

SolveSummary PositionInitializer::Minimize(const BlockSystem& system) {
  Eigen::SparseMatrix<double> A(system.num_rows(), num_unknowns_);
  A.setFromTriplets(system.triplets.begin(), system.triplets.end());
  const MatrixXd b =
      Eigen::Map<const Eigen::VectorXd>(system.rhs.data(), system.num_rows());
  AdmmOptions options;
  options.context = context_;
  options.max_num_iterations = options_.max_num_iterations;
  options.relative_tolerance = options_.relative_tolerance;
  const auto minimize = [&](const auto& op) {
    if (op.IsPositiveDefinite()) {
      return MinimizeByAdmm(op, b, system.function, options, &state_);
    }
    SolveSummary summary;
    summary.message = "The normal equations are not definite.";
    return summary;
  };
  if (num_unknowns_ - num_frame_columns_ > kMaxSizeOfBorder) {
    return minimize(SparseLeastSquares(A, context_.num_threads));
  }
  return minimize(
      ArrowLeastSquares(A, num_frame_columns_ / 3, context_.num_threads));
}

bool PositionInitializer::Solve() {
  NumberUnknowns();
  if (num_unknowns_ == 0) {
    state_.x.resize(0, 1);
    result_.solve.termination = Termination::kConverged;
    result_.solve.message = "Nothing is unknown.";
    return true;
  }
  BlockSystem system = AssembleData();
  MatrixXd covariance(0, 0);
  if (unit_column_ >= 0 || !result_.free_sensors.empty()) {
    covariance = ExtrinsicCovariance(system);
    if (covariance.size() == 0) {
      result_.solve.message = "The normal equations are not definite.";
      return true;
    }
  }
  FindUnobservable(covariance);
  AddUnobservable(&system);
  state_ = AdmmState();
  result_.solve = Minimize(system);
  if (unit_column_ < 0 || state_.x.size() == 0) return true;
  const double unit = state_.x(unit_column_, 0);
  const double variance =
      covariance(covariance.rows() - 1, covariance.cols() - 1);
  return unit > 3.0 * std::sqrt(variance);
}

void PositionInitializer::Extract() {
  const MatrixXd& x = state_.x;
  const bool is_usable = result_.solve.IsUsable() && x.allFinite();
  double unit = 1.0;
  if (is_usable && unit_column_ >= 0) {
    unit = x(unit_column_, 0);
    result_.is_metric = true;
  }
  Positions& positions = result_.positions;
  positions.sensor_translation = problem_.fixed_translation;
  result_.group_factor.assign(group_column_.size(), 1.0 / unit);
  if (!is_usable) return;
  for (int f = 0; f < problem_.num_frames; ++f) {
    if (frame_column_[f] < 0) continue;
    positions.frame_center[f] = x.block<3, 1>(frame_column_[f], 0) / unit;
  }
  for (const int s : result_.free_sensors) {
    positions.sensor_translation[s] =
        x.block<3, 1>(sensor_column_[s], 0) / unit;
  }
  for (size_t g = 1; g < group_column_.size(); ++g) {
    result_.group_factor[g] =
        std::max(x(group_column_[g], 0), kLowerBound) / unit;
  }
}

}  // namespace

double ProxOfScaleResidual(double v, double rho, double bound, double steep) {
  // Minimises phi(z) + rho/2 (z - v)^2: z = v - phi'(z) / rho.
  const double step = 1.0 / rho;
  if (v > step) return v - step;
  if (v >= -step) return 0.0;
  if (v + step >= bound) return v + step;
  if (v + steep * step >= bound) return bound;
  return v + steep * step;
}

InitialPositions InitializePositions(
    const PositionProblem& problem,
    const std::vector<BaselineDirection>& motions, const PairScales& scales,
    double min_parallax_deg, const InitializationOptions& options,
    const Context& context) {
  return PositionInitializer(problem, motions, scales, min_parallax_deg,
                             options, context)
      .Run();
}

}  // namespace mgsfm
