// SPDX-License-Identifier: BSD-3-Clause
#include "translation_averaging/arrow_least_squares.h"

#include <algorithm>

#include "base/parallel.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using SparseMatrix = Eigen::SparseMatrix<double>;
using Coordinates = Eigen::Matrix<double, Eigen::Dynamic, 3, Eigen::RowMajor>;

constexpr Eigen::Index kRowsPerRange = kItemsPerTask;

// The sum of the products of a compressed row or column with x.
template <class Matrix>
double SumOfProducts(const Matrix& matrix, Eigen::Index outer,
                     const double* x) {
  const int end = matrix.outerIndexPtr()[outer + 1];
  double sum = 0.0;
  for (int k = matrix.outerIndexPtr()[outer]; k < end; ++k) {
    sum += matrix.valuePtr()[k] * x[matrix.innerIndexPtr()[k]];
  }
  return sum;
}

}  // namespace

ArrowLeastSquares::ArrowLeastSquares(const SparseMatrix& A, int num_points,
                                     int num_threads)
    : num_points_(num_points),
      num_threads_(num_threads),
      A_(A),
      points_(num_threads) {
  MGSFM_CHECK_LE(3 * static_cast<Eigen::Index>(num_points), A_.cols());
  A_.makeCompressed();
  by_row_ = A_;
  int num_entries = 0;
  range_begin_.push_back(static_cast<int>(A_.cols()));
  for (int column = static_cast<int>(A_.cols()) - 1; column >= 0; --column) {
    num_entries += A_.outerIndexPtr()[column + 1] - A_.outerIndexPtr()[column];
    if (num_entries < (1 << 17) && column > 0) continue;
    range_begin_.push_back(column);
    num_entries = 0;
  }
  is_positive_definite_ = Factorize();
}

bool ArrowLeastSquares::Factorize() {
  const Eigen::Index num_point_columns = 3 * num_points_;
  const Eigen::Index num_border = A_.cols() - num_point_columns;
  if (num_points_ > 0) {
    std::vector<Eigen::Triplet<double>> triplets;
    for (int i = 0; i < num_points_; ++i) {
      for (SparseMatrix::InnerIterator it(A_, 3 * i); it; ++it) {
        triplets.emplace_back(it.row(), i, it.value());
      }
    }
    SparseMatrix first_coordinates(A_.rows(), num_points_);
    first_coordinates.setFromTriplets(triplets.begin(), triplets.end());
    SparseMatrix L = first_coordinates.transpose() * first_coordinates;
    L.makeCompressed();
    points_.Analyze(L);
    if (!points_.Factorize(L)) return false;
  }
  const SparseMatrix border_columns = A_.rightCols(num_border);
  border_ = A_.leftCols(num_point_columns).transpose() * border_columns;
  MatrixXd S = border_columns.transpose() * border_columns;
  solved_border_.resize(num_point_columns, num_border);
  for (Eigen::Index k = 0; k < num_border; ++k) {
    SolvePoints(border_.col(k), solved_border_.col(k));
  }
  S.noalias() -= border_.transpose() * solved_border_;
  schur_.compute(S);
  return num_border == 0 ||
         (schur_.info() == Eigen::Success &&
          schur_.matrixLLT().diagonal().array().isFinite().all());
}

void ArrowLeastSquares::Apply(const MatrixXd& x, MatrixXd* y) const {
  MGSFM_CHECK_EQ(x.cols(), 1);
  y->resize(rows(), 1);
  const Eigen::Index num_ranges = (rows() + kRowsPerRange - 1) / kRowsPerRange;
  ParallelFor(
      num_ranges, num_threads_,
      [&](size_t range) {
        const Eigen::Index begin = range * kRowsPerRange;
        const Eigen::Index end = std::min(begin + kRowsPerRange, rows());
        for (Eigen::Index i = begin; i < end; ++i) {
          (*y)(i, 0) = SumOfProducts(by_row_, i, x.data());
        }
      },
      1);
}

void ArrowLeastSquares::ApplyTranspose(const MatrixXd& y, MatrixXd* x) const {
  MGSFM_CHECK_EQ(y.cols(), 1);
  x->resize(cols(), 1);
  ParallelFor(
      range_begin_.size() - 1, num_threads_,
      [&](size_t range) {
        for (int j = range_begin_[range + 1]; j < range_begin_[range]; ++j) {
          (*x)(j, 0) = SumOfProducts(A_, j, y.data());
        }
      },
      1);
}

void ArrowLeastSquares::SolvePoints(const Eigen::Ref<const VectorXd>& g,
                                    Eigen::Ref<VectorXd> x) const {
  if (num_points_ == 0) return;
  MatrixXd solution = Coordinates::Map(g.data(), num_points_, 3);
  points_.Solve(solution, solution);
  Eigen::Map<Coordinates>(x.data(), num_points_, 3) = solution;
}

void ArrowLeastSquares::SolveNormal(const MatrixXd& g, MatrixXd* x) const {
  MGSFM_CHECK_EQ(g.cols(), 1);
  const Eigen::Index num_point_columns = 3 * num_points_;
  const Eigen::Index num_border = cols() - num_point_columns;
  x->resize(cols(), 1);
  auto points = x->col(0).head(num_point_columns);
  SolvePoints(g.col(0).head(num_point_columns), points);
  if (num_border == 0) return;
  VectorXd border = g.col(0).tail(num_border);
  border.noalias() -= border_.transpose() * points;
  schur_.solveInPlace(border);
  points.noalias() -= solved_border_ * border;
  x->col(0).tail(num_border) = border;
}

}  // namespace mgsfm
