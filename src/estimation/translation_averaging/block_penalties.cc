// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/block_penalties.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/parallel.h"

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

// The factor by which the prox of a norm shrinks its argument.
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

}  // namespace mgsfm
