// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

namespace mgsfm {

class SupernodalFactor;

// Solves H x = b for a sparse symmetric positive definite H, as SparseCholesky
// does, but the values of H are set in the memory of its factor, which
// overwrites them. This takes 8 bytes per entry of the factor, instead of
// these and 12 per entry of H. The rows must be in the order of elimination,
// which must be a postorder, as that of FindEliminationOrder is.
//
//   InPlaceCholesky solver(num_threads);
//   solver.Analyze(column_begin, rows);
//   fill all values() with zeros, then set those at Find(row, column);
//   if (!solver.Factorize()) ...
//   solver.Solve(x);  // any number of times
class InPlaceCholesky {
 public:
  explicit InPlaceCholesky(int num_threads);
  ~InPlaceCholesky();

  // The rows of each column of the lower triangle, ascending: column j has
  // rows[column_begin[j]] to rows[column_begin[j + 1] - 1]. Entries above the
  // diagonal are ignored. The arrays and other freed memory return to the
  // system before the values are allocated.
  void Analyze(std::vector<int> column_begin, std::vector<int> rows);

  // The position of an entry of the lower triangle of H in the values. In a
  // block of columns that all have the same rows below it, the next column is
  // `stride` further. Logarithmic in the rows of the column.
  struct Place {
    size_t position = 0;
    int stride = 0;
  };
  Place Find(int row, int column) const;

  double* values() { return values_.data(); }
  size_t num_values() const { return values_.size(); }

  // Replaces H by its factor. Returns false if H is not finite or not
  // numerically positive definite; Solve() must not be called then.
  [[nodiscard]] bool Factorize();

  // x = H^-1 x. Changes the values that x refers to.
  void Solve(const Eigen::Ref<Eigen::MatrixXd>& x) const;

 private:
  const int num_threads_;
  std::unique_ptr<SupernodalFactor> factor_;
  std::vector<double> values_;
};

}  // namespace mgsfm
