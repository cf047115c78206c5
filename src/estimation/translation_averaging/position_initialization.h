// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <array>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/solver.h"
#include "translation_averaging/baseline_directions.h"
#include "translation_averaging/position_problem.h"
#include "translation_averaging/scale_averaging.h"

namespace mgsfm {

// The non-smooth function of the position initialization
// (position_initialization.h) in the form of math/l1_admm.h: a sum over blocks
// of three rows.

struct BlockPenalty {
  enum class Kind {
    kScaleAndNormal,  // scale_slope phi(z_0) + |(z_1, z_2)|, see below
    kNorm,            // |z|
    kSum,             // |z_0| + |z_1| + |z_2|
  };
  Kind kind = Kind::kSum;
  double weight = 1.0;  // of the whole block
  // kScaleAndNormal: slope of the first row above `bound`, relative to the
  // slope 1 of the other rows; below `bound` the slope is 1.
  double scale_slope = 1.0;
  double bound = 0.0;
};

// The proximal map of phi at v with step 1 / rho, where phi(v) = |v| for v >=
// bound and rises with slope `steep` >= 1 below bound <= 0.
double ProxOfScaleResidual(double v, double rho, double bound, double steep);

// The function f of the ADMM.
struct BlockFunction {
  std::vector<BlockPenalty> blocks;
  int num_threads = 1;

  double Cost(const Eigen::MatrixXd& z) const;
  void Prox(double rho, const Eigen::MatrixXd& v, Eigen::MatrixXd* z) const;
};

// Rows A x - b in blocks of three, with their penalties. The coefficients of a
// frame in a block are a multiple of a rotation, so that A^T A has the form
// required by arrow_least_squares.h.
struct BlockSystem {
  std::vector<Eigen::Triplet<double>> triplets;
  std::vector<double> rhs;
  BlockFunction function;

  int num_rows() const { return static_cast<int>(rhs.size()); }
  // Ends the block whose triplets were added.
  void FinishBlock(const Eigen::Vector3d& b, const BlockPenalty& penalty) {
    rhs.insert(rhs.end(), {b[0], b[1], b[2]});
    function.blocks.push_back(penalty);
  }
};

// Error of directions beyond their own estimates, and the unit of residuals.
inline constexpr double kDirectionSigma = DegToRad(0.5);

// Convex L1 estimate of all positions. With C_p the baseline c_j - c_i of pair
// p, b_p its measured direction and s_p = a_g scale_p its length (a_g the
// factor of its group of scales), it minimizes
//
//   sum_p  [ |(I - b b^T) C| / sigma_p + phi(b . C - s) ] / length_p
// + sum_q  |C_q| / sigma_0                          (pairs without parallax)
// + sum_g  n_g |a_g - 1| / sigma_g                  (groups but the first)
//
//   phi(v) = |v| min(0.15 / sigma_s,p, 1) / sigma_p for b . C >= scale_p / 10,
//   continued with slope 1 / sigma_p below,
//
//   length_p = max(scale_p, min(q_i, q_j) / 2), q the lower quartile of scale_p
//   of all pairs of a frame with other frames; scale_p of pairs in a frame,
//
// over the frame centers, the translations of free sensors, and the factors
// a_g. This is eq. (11) of MGSfM, min |s b - C| with s bounded from below, with
// the unknown s eliminated per pair, norms that do not depend on the axes, and
// measured lengths and bounds instead of the same bound 1 for all.
//
// Gauge: the first placed frame is at the origin, a_0 = 1. With known sensor
// offsets, their length in the unit of a_0 is a further unknown, and the result
// is in the unit of these offsets.
//
// Directions of sensor translations whose standard deviation exceeds half of
// the unit are not determined; they are set to zero and reported.
//
// Solved by the ADMM of math/l1_admm.h, which states the stopping criteria.
// Cost: one sparse factorization with one unknown per frame, at most two if
// sensor offsets are known, then solves that are linear in the pairs.
struct InitialPositions {
  Positions positions;
  SolveSummary solve;
  // The length of scale_p = 1 in each group.
  std::vector<double> group_factor;
  // Orthonormal rows over the stacked translations of free sensors (3 each, in
  // the order of free_sensors) that span the undetermined directions.
  std::vector<int> free_sensors;
  Eigen::MatrixXd unobservable;
  // Whether known sensor offsets determine the unit of length.
  bool is_metric = false;
};

// Standard deviation of the baseline of a pair without parallax: at typical
// depth, a longer one would be seen as parallax.
double ZeroBaselineSigma(const PairScales& scales, double min_parallax_deg);

struct InitializationInput {
  const PositionProblem& problem;
  const std::vector<BaselineDirection>& baselines;
  const PairScales& scales;
  const Mask& pair_is_used;  // per baseline

  BaselineKind KindOf(size_t pair_idx) const {
    return pair_is_used[pair_idx] ? baselines[pair_idx].kind
                                  : BaselineKind::kUnused;
  }
  std::array<int, 2> FramesOf(size_t pair_idx) const {
    return {problem.frame_idx[baselines[pair_idx].image_idx1],
            problem.frame_idx[baselines[pair_idx].image_idx2]};
  }
  bool IsDirectionBetweenFrames(size_t pair_idx) const {
    return KindOf(pair_idx) == BaselineKind::kDirection &&
           FramesOf(pair_idx)[0] != FramesOf(pair_idx)[1];
  }
};

struct InitializationOptions {
  double min_parallax_deg = 0.0;
  // Stopping criteria of the ADMM.
  int max_num_iterations = 2000;
  double relative_tolerance = 1e-4;
};

// Frames outside the largest connected component of the used pairs get no
// position.
InitialPositions InitializePositions(const InitializationInput& input,
                                     const InitializationOptions& options,
                                     const Context& context = {});

}  // namespace mgsfm
