// SPDX-License-Identifier: BSD-3-Clause
#include "math/panel_kernels.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/cpu_features.h"

namespace mgsfm {
namespace {

// A tile of the product fills 12 of the 16 AVX2 registers.
constexpr int kTileRows = 8;
constexpr int kTileColumns = 6;

// Four numbers in a register, and at any address. `auto` would deduce the first
// from the second.
typedef double Four __attribute__((vector_size(32)));
typedef double StoredFour
    __attribute__((vector_size(32), aligned(8), may_alias));

struct Tile {
  Four fours[kTileColumns][2];
};

// The product of 8 rows with distance `stride` between columns and 6 rows of B
// that are contiguous per column.
MGSFM_ALWAYS_INLINE void ComputeTile(const double* rows, int stride,
                                     const double* b, int k, Tile* tile) {
  Four sums[kTileColumns][2] = {};
  for (int p = 0; p < k; ++p) {
    const StoredFour* fours = reinterpret_cast<const StoredFour*>(rows);
    const Four low = fours[0], high = fours[1];
    for (int j = 0; j < kTileColumns; ++j) {
      sums[j][0] += low * b[j];
      sums[j][1] += high * b[j];
    }
    rows += stride;
    b += kTileColumns;
  }
  for (int j = 0; j < kTileColumns; ++j) {
    tile->fours[j][0] = sums[j][0];
    tile->fours[j][1] = sums[j][1];
  }
}

// Subtracts the tile at (i, j) of an m x n product.
MGSFM_ALWAYS_INLINE void SubtractTile(const Tile& tile, int i, int j, int m,
                                      int n, const PanelTarget& target) {
  const int num_rows = std::min(kTileRows, m - i);
  const int num_columns = std::min(kTileColumns, n - j);
  const int* rows = target.rows == nullptr ? nullptr : target.rows + i;
  const int first = rows == nullptr ? i : rows[0];
  const bool is_contiguous =
      rows == nullptr || rows[num_rows - 1] - first == num_rows - 1;
  for (int c = 0; c < num_columns; ++c) {
    const int column =
        target.columns == nullptr ? j + c : target.columns[j + c];
    double* to = target.values + static_cast<size_t>(column) * target.stride;
    if (is_contiguous && num_rows == kTileRows) {
      StoredFour* fours = reinterpret_cast<StoredFour*>(to + first);
      fours[0] -= tile.fours[c][0];
      fours[1] -= tile.fours[c][1];
      continue;
    }
    double values[kTileRows];
    std::memcpy(values, tile.fours[c], sizeof(values));
    if (is_contiguous) {
      for (int r = 0; r < num_rows; ++r) to[first + r] -= values[r];
    } else {
      for (int r = 0; r < num_rows; ++r) to[rows[r]] -= values[r];
    }
  }
}

// Packs strips of six rows column by column and pads the last strip with zeros.
MGSFM_ALWAYS_INLINE void CopySixes(const PanelView& B, int n, int k,
                                   double* to) {
  for (int j = 0; j < n; j += kTileColumns) {
    const int count = std::min(kTileColumns, n - j);
    for (int p = 0; p < k; ++p, to += kTileColumns) {
      const double* from = B.values + static_cast<size_t>(p) * B.stride + j;
      for (int c = 0; c < count; ++c) to[c] = from[c];
      for (int c = count; c < kTileColumns; ++c) to[c] = 0.0;
    }
  }
}

MGSFM_ALWAYS_INLINE void CopyEight(const double* from, int stride, int count,
                                   int k, double* to) {
  for (int p = 0; p < k; ++p, from += stride, to += kTileRows) {
    for (int r = 0; r < count; ++r) to[r] = from[r];
    for (int r = count; r < kTileRows; ++r) to[r] = 0.0;
  }
}

MGSFM_ALWAYS_INLINE void SubtractProductBody(const PanelView& A, int m, int n,
                                             int k, const PanelTarget& target,
                                             double* left, double* right) {
  CopySixes(A, n, k, right);
  for (int i = 0; i < m; i += kTileRows) {
    const double* rows = A.values + i;
    int stride = A.stride;
    // Products with more columns reuse a tile often enough to amortize copying
    // its rows to contiguous memory.
    if (m - i < kTileRows || n > 2 * kTileColumns) {
      CopyEight(rows, A.stride, std::min(kTileRows, m - i), k, left);
      rows = left;
      stride = kTileRows;
    }
    for (int j = 0; j < n && j < i + kTileRows; j += kTileColumns) {
      Tile tile;
      ComputeTile(rows, stride, right + static_cast<size_t>(j) * k, k, &tile);
      SubtractTile(tile, i, j, m, n, target);
    }
  }
}

// Processes strips of six columns; all previous strips update each.
MGSFM_ALWAYS_INLINE bool FactorizePanelBody(int num_rows, int width, int stride,
                                            double* values, double* left,
                                            double* right) {
  for (int first = 0; first < width; first += kTileColumns) {
    const int last = std::min(first + kTileColumns, width);
    const PanelView before = {values + first, stride};
    const PanelTarget strip = {
        values + static_cast<size_t>(first) * stride + first, stride};
    SubtractProductBody(before, num_rows - first, last - first, first, strip,
                        left, right);
    for (int j = first; j < last; ++j) {
      double* column = values + static_cast<size_t>(j) * stride;
      for (int i = first; i < j; ++i) {
        const double* other = values + static_cast<size_t>(i) * stride;
        const double factor = other[j];
        for (int r = j; r < num_rows; ++r) column[r] -= factor * other[r];
      }
      if (!(column[j] > 0.0)) return false;
      const double pivot = std::sqrt(column[j]);
      const double inverse = 1.0 / pivot;
      column[j] = pivot;
      for (int r = j + 1; r < num_rows; ++r) column[r] *= inverse;
    }
  }
  return true;
}

using SubtractProductFunction = void(const PanelView&, int, int, int,
                                     const PanelTarget&, double*, double*);
using FactorizePanelFunction = bool(int, int, int, double*, double*, double*);

void SubtractProductAny(const PanelView& A, int m, int n, int k,
                        const PanelTarget& target, double* left,
                        double* right) {
  SubtractProductBody(A, m, n, k, target, left, right);
}
MGSFM_TARGET_AVX2 void SubtractProductAvx2(const PanelView& A, int m, int n,
                                           int k, const PanelTarget& target,
                                           double* left, double* right) {
  SubtractProductBody(A, m, n, k, target, left, right);
}

bool FactorizePanelAny(int num_rows, int width, int stride, double* values,
                       double* left, double* right) {
  return FactorizePanelBody(num_rows, width, stride, values, left, right);
}
MGSFM_TARGET_AVX2 bool FactorizePanelAvx2(int num_rows, int width, int stride,
                                          double* values, double* left,
                                          double* right) {
  return FactorizePanelBody(num_rows, width, stride, values, left, right);
}

void Reserve(int n, int k, PanelScratch* scratch) {
  const size_t left = static_cast<size_t>(kTileRows) * k;
  const size_t right = static_cast<size_t>(n + kTileColumns) * k;
  if (scratch->left.size() < left) scratch->left.resize(left);
  if (scratch->right.size() < right) scratch->right.resize(right);
}

}  // namespace

void SubtractProduct(const PanelView& A, int m, int n, int k,
                     const PanelTarget& target, PanelScratch* scratch) {
  Reserve(n, k, scratch);
  SubtractProductFunction* const function =
      HasAvx2() ? SubtractProductAvx2 : SubtractProductAny;
  function(A, m, n, k, target, scratch->left.data(), scratch->right.data());
}

bool FactorizePanel(int num_rows, int width, int stride, double* values,
                    PanelScratch* scratch) {
  Reserve(kTileColumns, width, scratch);
  FactorizePanelFunction* const function =
      HasAvx2() ? FactorizePanelAvx2 : FactorizePanelAny;
  return function(num_rows, width, stride, values, scratch->left.data(),
                  scratch->right.data());
}

}  // namespace mgsfm
