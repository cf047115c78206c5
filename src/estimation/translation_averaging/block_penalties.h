// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

namespace mgsfm {

// The non-smooth function of the position initialization
// (position_initialization.h) as math/l1_admm.h wants it: a sum over blocks of
// three rows.

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

// The prox of phi at v with step 1 / rho, where phi(v) = |v| for v >= bound and
// rises with slope `steep` >= 1 below bound <= 0.
double ProxOfScaleResidual(double v, double rho, double bound, double steep);

// f of the ADMM.
struct BlockFunction {
  std::vector<BlockPenalty> blocks;
  int num_threads = 1;

  double Cost(const Eigen::MatrixXd& z) const;
  void Prox(double rho, const Eigen::MatrixXd& v, Eigen::MatrixXd* z) const;
};

// Rows A x - b in blocks of three, with their penalties. The coefficients of a
// frame in a block are a multiple of a rotation, so that A^T A has the form
// that arrow_least_squares.h needs.
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

}  // namespace mgsfm
