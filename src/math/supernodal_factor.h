// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cholmod.h>

#include <Eigen/SparseCore>
#include <cstddef>
#include <vector>

#include "math/panel_kernels.h"

namespace mgsfm {

// The numeric part of a sparse Cholesky factorisation P H P^T = L L^T, over the
// supernodes that CHOLMOD's analysis found: columns of L with the same rows,
// stored as dense matrices.
//
// Supernodes are cut into panels of some columns. A panel is the work of one
// thread (left-looking):
//
//   X = entries of H; X -= L_K L_K^T for all panels K before it that have rows
//   in its columns; L = X with its square on top factorised.
//
// Updates come in ascending order, whatever thread made K, so that the factor
// does not depend on the number of threads. Subtrees of the elimination tree
// need nothing from each other and are done first, each by one thread; the
// panels above them follow in order, where a thread that needs a panel still in
// work waits for it. As at most num_threads - 1 panels are in work elsewhere,
// waits are short also where one dense supernode is all there is.
// Cost: that of the factorisation; memory: the rows of a panel in each thread,
// and for an order that is not the given one, two numbers for each entry of H.
class SupernodalFactor {
 public:
  // `symbolic` is a supernodal factor by cholmod_analyze() of the lower
  // triangle of H.
  SupernodalFactor(const cholmod_factor& symbolic,
                   const Eigen::SparseMatrix<double>& H);

  // Fills the values of the factor that was analysed, which must have memory
  // for them. False if H is not positive definite to working precision.
  [[nodiscard]] bool Factorize(const Eigen::SparseMatrix<double>& H,
                               int num_threads, cholmod_factor* factor);

 private:
  friend class SupernodalRun;

  struct Panel {
    int supernode = 0;
    int offset = 0;  // of its first column in the supernode
    int width = 0;
  };
  // Rows [first, last) of a supernode are columns of a panel.
  struct Update {
    int supernode = 0;
    int first = 0;
    int last = 0;
  };

  struct Workspace {
    std::vector<int> position;         // of a row in the panel
    std::vector<int> update_position;  // of a row of an update
    PanelScratch scratch;
  };

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

  std::vector<int> first_column_;  // of each supernode, and the end
  std::vector<int> row_begin_;     // in rows_
  std::vector<int> rows_;
  std::vector<size_t> value_begin_;
  std::vector<int> supernode_of_column_;

  // Lower triangle of P H P^T: rows by column, and where in the values of H;
  // empty if P is the identity.
  std::vector<int> column_begin_;
  std::vector<int> entry_row_;
  std::vector<int> entry_source_;

  std::vector<Panel> panels_;
  std::vector<int> panel_begin_;      // per supernode
  std::vector<size_t> update_begin_;  // per panel
  std::vector<Update> updates_;       // ascending by supernode
  int max_num_rows_ = 0;
  // Panels that one thread does in a row: of the subtrees, largest first, then
  // those above.
  std::vector<size_t> task_begin_;
  std::vector<int> task_panels_;
  std::vector<Workspace> workspaces_;  // of the threads
};

}  // namespace mgsfm
