// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cholmod.h>

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <vector>

#include "math/item_groups.h"
#include "math/panel_kernels.h"

namespace mgsfm {

// The numeric phase of a sparse Cholesky factorization P H P^T = L L^T on the
// supernodes of CHOLMOD's symbolic analysis. A supernode is a set of columns of
// L with the same rows, stored as a dense matrix.
//
// Supernodes are split into panels of columns. One thread computes a panel by a
// left-looking update:
//
//   X = entries of H; X -= L_K L_K^T for all previous panels K with rows in its
//   columns; L = X with its top square factorized.
//
// Updates are applied in ascending order, so the factor does not depend on the
// number of threads. Independent subtrees of the elimination tree come first,
// each on one thread. The panels above them follow in order; a thread waits for
// panels that others are still computing. At most num_threads - 1 panels are in
// progress elsewhere, so waits are short even for a single dense supernode.
// Cost: the flops of the factorization. Memory: the rows of a panel per thread
// and, unless P is the identity, two numbers per entry of H.
class SupernodalFactor {
 public:
  // `symbolic` is the supernodal factor that cholmod_analyze() returns for the
  // lower triangle of H.
  SupernodalFactor(const cholmod_factor& symbolic,
                   const Eigen::SparseMatrix<double>& H);

  // Computes the values of the analyzed factor, which must be allocated.
  // Returns false if H is not numerically positive definite.
  [[nodiscard]] bool Factorize(const Eigen::SparseMatrix<double>& H,
                               int num_threads, cholmod_factor* factor);

  // X = (L L^T)^-1 X, where `values` are those of the factor and the rows of X
  // are in the order of elimination.
  void Solve(const double* values, Eigen::Ref<Eigen::MatrixXd> X) const;

 private:
  friend class SupernodalRun;

  struct Panel {
    int supernode = 0;
    int offset = 0;  // first column, relative to the supernode
    int width = 0;
  };
  // Rows [first, last) of a supernode correspond to columns of a panel.
  struct Update {
    int supernode = 0;
    int first = 0;
    int last = 0;
  };

  struct Workspace {
    std::vector<int> position;         // index of a row in the panel
    std::vector<int> update_position;  // the same for the rows of an update
    PanelScratch scratch;
  };

  template <class Matrix>
  void SolveLower(const double* values, Matrix&& X) const;
  template <class Matrix>
  void SolveUpper(const double* values, Matrix&& X) const;
  void PermuteEntries(const Eigen::SparseMatrix<double>& H, const int* order);
  void MakePanels();
  void ListUpdates();
  void ChooseSubtrees();

  int NumRows(int s) const { return row_begin_[s + 1] - row_begin_[s]; }
  int NumColumns(int s) const {
    return first_column_[s + 1] - first_column_[s];
  }
  int NumSupernodes() const {
    return static_cast<int>(first_column_.size()) - 1;
  }

  std::vector<int> first_column_;  // per supernode, plus the end
  std::vector<int> row_begin_;     // index into rows_, per supernode
  std::vector<int> rows_;
  std::vector<size_t> value_begin_;
  std::vector<int> supernode_of_column_;

  // Lower triangle of P H P^T: rows by column and their indices into the values
  // of H. Empty if P is the identity.
  std::vector<int> column_begin_;
  std::vector<int> entry_row_;
  std::vector<int> entry_source_;

  std::vector<Panel> panels_;
  std::vector<int> panel_begin_;  // per supernode
  ItemGroups<Update> updates_;    // per panel, ascending by supernode
  int max_num_rows_ = 0;
  // Panels that one thread computes in sequence: one task per subtree, largest
  // first, then one task per panel above the subtrees.
  std::vector<size_t> task_begin_;
  std::vector<int> task_panels_;
  std::vector<Workspace> workspaces_;  // per thread
};

}  // namespace mgsfm
