// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

namespace mgsfm {

// Dense kernels of supernodal_factor.h on column-major matrices. They replace
// BLAS because several threads call them concurrently, which not every BLAS
// supports, and because blocks of a few columns are common.

// A block of a larger matrix.
struct PanelView {
  const double* values;
  int stride;  // between columns
};

// The destination of a product: entry (i, j) is subtracted from entry
// (rows[i], columns[j]), or from entry (i, j) if the lists are null.
struct PanelTarget {
  double* values;
  int stride;
  const int* rows = nullptr;
  const int* columns = nullptr;
};

// Workspace of one thread.
struct PanelScratch {
  std::vector<double> left, right;
};

// target -= A B^T, where A is m x k and B, the first n <= m rows of A, is n x
// k. Target entries above the diagonal of A B^T have unspecified values
// afterwards.
void SubtractProduct(const PanelView& A, int m, int n, int k,
                     const PanelTarget& target, PanelScratch* scratch);

// Factorizes the square at the top of a panel in place, S = L L^T, and
// multiplies the rows below by L^-T. Returns false if a pivot is not positive.
bool FactorizePanel(int num_rows, int width, int stride, double* values,
                    PanelScratch* scratch);

}  // namespace mgsfm
