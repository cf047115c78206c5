// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace mgsfm {

// The dense inner loops of supernodal_factor.h, for matrices that are stored
// column by column. They are our own, not those of BLAS, as several threads
// need them at a time (not every BLAS allows that), and as blocks of a few
// columns are common.

// A matrix within a larger one.
struct PanelView {
  const double* values;
  int stride;  // from column to column
};

// Where a product is subtracted: entry (i, j) from row rows[i] of column
// columns[j], or from row i of column j where there are no lists.
struct PanelTarget {
  double* values;
  int stride;
  const int* rows = nullptr;
  const int* columns = nullptr;
};

// Memory of one thread.
struct PanelScratch {
  std::vector<double> left, right;
};

// target -= A B^T, A of m and B of n <= m rows and k columns. B is the top of
// A; of the target, entries over the diagonal of A B^T may get any value.
void SubtractProduct(const PanelView& A, int m, int n, int k,
                     const PanelTarget& target, PanelScratch* scratch);

// The Cholesky factor L of the square on top of a panel takes its place, and
// what is below is multiplied by L^-T. False if a pivot is not positive.
bool FactorizePanel(int num_rows, int width, int stride, double* values,
                    PanelScratch* scratch);

}  // namespace mgsfm
