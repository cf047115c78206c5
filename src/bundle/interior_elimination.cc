// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/interior_elimination.h"

#include <algorithm>
#include <optional>
#include <utility>

namespace mgsfm {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::SparseMatrix;
using Eigen::VectorXd;

InteriorElimination::InteriorElimination(std::vector<int> interior,
                                         std::vector<int> shared,
                                         int num_threads)
    : interior_(std::move(interior)),
      shared_(std::move(shared)),
      solver_(num_threads) {}

// The lower triangle in the order interior, shared, up to `size` unknowns.
SparseMatrix<double> InteriorElimination::Permute(const SparseMatrix<double>& H,
                                                  Index size) const {
  std::vector<std::optional<int>> position(static_cast<size_t>(H.cols()));
  int next = 0;
  for (const int k : interior_) position[k] = next++;
  for (const int k : shared_) position[k] = next++;
  const auto visit = [&](auto&& add) {
    for (Index k = 0; k < H.outerSize(); ++k) {
      for (SparseMatrix<double>::InnerIterator it(H, k); it; ++it) {
        const auto row = position[it.row()];
        const auto column = position[it.col()];
        if (it.row() < it.col() || !row || !column) continue;
        if (std::max(*row, *column) >= size) continue;
        add(std::max(*row, *column), std::min(*row, *column), it.value());
      }
    }
  };
  Eigen::VectorXi counts = Eigen::VectorXi::Zero(size);
  visit([&](int, int column, double) { ++counts[column]; });
  SparseMatrix<double> permuted(size, size);
  permuted.reserve(counts);
  visit([&](int row, int column, double value) {
    permuted.insert(row, column) = value;
  });
  permuted.makeCompressed();
  return permuted;
}

VectorXd InteriorElimination::Select(const VectorXd& b) const {
  VectorXd selected(static_cast<Index>(interior_.size() + shared_.size()));
  Index next = 0;
  for (const int k : interior_) selected[next++] = b[k];
  for (const int k : shared_) selected[next++] = b[k];
  return selected;
}

bool InteriorElimination::Reduce(const SparseMatrix<double>& H,
                                 const VectorXd& b, MatrixXd* reduced,
                                 VectorXd* reduced_b) {
  const auto num_interior = static_cast<Index>(interior_.size());
  const auto num_shared = static_cast<Index>(shared_.size());
  reduced->setZero(num_shared, num_shared);
  reduced_b->setZero(num_shared);
  if (num_interior + num_shared == 0) return true;
  SparseMatrix<double> permuted = Permute(H, num_interior + num_shared);
  // The block alone leaves its gauge free. Twice the diagonal makes the corner
  // of the factor definite without loss of accuracy.
  VectorXd diagonal(num_shared);
  for (Index i = 0; i < num_shared; ++i) {
    double& entry = permuted.coeffRef(num_interior + i, num_interior + i);
    diagonal[i] = entry;
    entry *= 2.0;
  }
  solver_.Analyze(permuted, SparseCholesky::Order::kNatural);
  if (!solver_.Factorize(permuted)) return false;
  const MatrixXd corner = solver_.FactorCorner(num_interior);
  reduced->selfadjointView<Eigen::Lower>().rankUpdate(corner);
  // With b_s = 0, the solution has corner corner^T z_s = -H_si H_ii^-1 b_i.
  const VectorXd selected = Select(b);
  VectorXd z = selected;
  z.tail(num_shared).setZero();
  solver_.Solve(z, z);
  const auto L = corner.triangularView<Eigen::Lower>();
  *reduced_b = L.transpose() * z.tail(num_shared);
  *reduced_b = selected.tail(num_shared) + L * *reduced_b;
  reduced->diagonal() -= diagonal;
  return true;
}

bool InteriorElimination::Expand(const SparseMatrix<double>& H,
                                 const VectorXd& b, const VectorXd& z_shared,
                                 VectorXd* z) {
  z->setZero(b.size());
  for (size_t i = 0; i < shared_.size(); ++i) {
    (*z)[shared_[i]] = z_shared[static_cast<Index>(i)];
  }
  if (interior_.empty()) return true;
  const auto num_interior = static_cast<Index>(interior_.size());
  const VectorXd moved = H.selfadjointView<Eigen::Lower>() * *z;
  VectorXd rest = Select(b - moved).head(num_interior);
  const SparseMatrix<double> permuted = Permute(H, num_interior);
  solver_.Analyze(permuted, SparseCholesky::Order::kNatural);
  if (!solver_.Factorize(permuted)) return false;
  solver_.Solve(rest, rest);
  for (Index i = 0; i < num_interior; ++i) {
    (*z)[interior_[static_cast<size_t>(i)]] = rest[i];
  }
  return true;
}

}  // namespace mgsfm
