// SPDX-License-Identifier: BSD-3-Clause
#include "math/supernodal_factor.h"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <numeric>
#include <queue>
#include <utility>

#include "base/parallel.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// Wide panels give efficient products; narrow panels reduce waiting between
// threads. A multiple of both sides of a tile, 8 and 6 (panel_kernels.cc).
constexpr int kPanelWidth = 96;

using ConstPanel = Eigen::Map<const Eigen::MatrixXd, 0, Eigen::OuterStride<>>;

}  // namespace

SupernodalFactor::SupernodalFactor(const cholmod_factor& symbolic,
                                   const Eigen::SparseMatrix<double>& H) {
  MGSFM_CHECK(symbolic.is_super);
  const auto num_supernodes = static_cast<int>(symbolic.nsuper);
  const auto copy = [](const void* from, size_t size) {
    const int* begin = static_cast<const int*>(from);
    return std::vector<int>(begin, begin + size);
  };
  first_column_ = copy(symbolic.super, num_supernodes + 1);
  row_begin_ = copy(symbolic.pi, num_supernodes + 1);
  rows_ = copy(symbolic.s, row_begin_.back());
  const std::vector<int> value_begin = copy(symbolic.px, num_supernodes + 1);
  value_begin_.assign(value_begin.begin(), value_begin.end());
  supernode_of_column_.resize(symbolic.n);
  for (int s = 0; s < num_supernodes; ++s) {
    std::fill(supernode_of_column_.begin() + first_column_[s],
              supernode_of_column_.begin() + first_column_[s + 1], s);
  }
  MakePanels();
  ListUpdates();
  ChooseSubtrees();
  PermuteEntries(H, static_cast<const int*>(symbolic.Perm));
}

void SupernodalFactor::PermuteEntries(const Eigen::SparseMatrix<double>& H,
                                      const int* order) {
  const int size = static_cast<int>(H.cols());
  std::vector<int> position(size);
  bool is_identity = true;
  for (int i = 0; i < size; ++i) {
    position[order[i]] = i;
    is_identity = is_identity && order[i] == i;
  }
  if (is_identity) return;
  const auto visit = [&](const auto& function) {
    for (int j = 0; j < size; ++j) {
      for (int k = H.outerIndexPtr()[j]; k < H.outerIndexPtr()[j + 1]; ++k) {
        const int i = H.innerIndexPtr()[k];
        if (i < j) continue;
        const auto [column, row] = std::minmax({position[i], position[j]});
        function(column, row, k);
      }
    }
  };
  column_begin_.assign(size + 1, 0);
  visit([&](int column, int, int) { ++column_begin_[column + 1]; });
  std::partial_sum(column_begin_.begin(), column_begin_.end(),
                   column_begin_.begin());
  entry_row_.resize(column_begin_.back());
  entry_source_.resize(column_begin_.back());
  std::vector<int> next(column_begin_.begin(), column_begin_.end() - 1);
  visit([&](int column, int row, int source) {
    entry_row_[next[column]] = row;
    entry_source_[next[column]++] = source;
  });
}

void SupernodalFactor::MakePanels() {
  for (int s = 0; s < NumSupernodes(); ++s) {
    panel_begin_.push_back(static_cast<int>(panels_.size()));
    const int num_columns = NumColumns(s);
    for (int offset = 0; offset < num_columns; offset += kPanelWidth) {
      panels_.push_back(
          {s, offset, std::min(kPanelWidth, num_columns - offset)});
    }
  }
  panel_begin_.push_back(static_cast<int>(panels_.size()));
}

void SupernodalFactor::ListUpdates() {
  updates_ = GroupItems<Update>(panels_.size(), [this](const auto& add) {
    for (int s = 0; s < NumSupernodes(); ++s) {
      const int* rows = rows_.data() + row_begin_[s];
      const int num_rows = NumRows(s);
      for (int first = NumColumns(s); first < num_rows;) {
        const int target = supernode_of_column_[rows[first]];
        const int offset = rows[first] - first_column_[target];
        const int panel = panel_begin_[target] + offset / kPanelWidth;
        const int end = first_column_[target] + panels_[panel].offset +
                        panels_[panel].width;
        int last = first;
        while (last < num_rows && rows[last] < end) ++last;
        max_num_rows_ = std::max(max_num_rows_, num_rows - first);
        add(panel, Update{s, first, last});
        first = last;
      }
    }
  });
}

void SupernodalFactor::ChooseSubtrees() {
  const int size = NumSupernodes();
  std::vector<int> parent(size, -1);
  std::vector<double> work(size, 0.0);  // per subtree
  std::vector<std::vector<int>> children(size);
  std::priority_queue<std::pair<double, int>> roots;
  double all_work = 0.0;
  for (int s = 0; s < size; ++s) {
    const double num_rows = NumRows(s);
    work[s] += num_rows * num_rows * NumColumns(s);
    if (NumRows(s) > NumColumns(s)) {
      parent[s] = supernode_of_column_[rows_[row_begin_[s] + NumColumns(s)]];
      work[parent[s]] += work[s];
      children[parent[s]].push_back(s);
    } else {
      all_work += work[s];
      roots.push({work[s], -s});
    }
  }
  Mask is_above(size, false);
  // For load balancing, a subtree has at most this fraction of the work.
  while (!roots.empty() && roots.top().first > all_work / 16.0) {
    const int s = -roots.top().second;
    roots.pop();
    is_above[s] = true;
    for (const int child : children[s]) roots.push({work[child], -child});
  }
  std::vector<int> task_of_root(size, -1);
  int num_tasks = 0;
  for (; !roots.empty(); roots.pop()) {
    task_of_root[-roots.top().second] = num_tasks++;
  }
  // Propagate the tasks from the roots to all supernodes.
  std::vector<int>& task = task_of_root;
  for (int s = size - 1; s >= 0; --s) {
    if (!is_above[s] && task[s] < 0) task[s] = task[parent[s]];
  }
  std::vector<std::vector<int>> panels_of_task(num_tasks);
  for (size_t p = 0; p < panels_.size(); ++p) {
    const int s = panels_[p].supernode;
    if (is_above[s]) {
      panels_of_task.push_back({static_cast<int>(p)});
    } else {
      panels_of_task[task[s]].push_back(static_cast<int>(p));
    }
  }
  task_begin_.push_back(0);
  for (const std::vector<int>& panels : panels_of_task) {
    task_panels_.insert(task_panels_.end(), panels.begin(), panels.end());
    task_begin_.push_back(task_panels_.size());
  }
}

// One numeric factorization.
class SupernodalRun {
 public:
  using Workspace = SupernodalFactor::Workspace;

  SupernodalRun(const SupernodalFactor& structure,
                const Eigen::SparseMatrix<double>& H, double* values,
                std::vector<Workspace>* workspaces)
      : f_(structure), H_(H), values_(values), is_done_(f_.panels_.size()) {
    for (Workspace& w : *workspaces) free_.push_back(&w);
  }

  bool Run() {
    ParallelFor(
        f_.task_begin_.size() - 1, static_cast<int>(free_.size()),
        [this](size_t task) {
          Workspace* w = Take();
          for (size_t k = f_.task_begin_[task]; k < f_.task_begin_[task + 1];
               ++k) {
            const int panel = f_.task_panels_[k];
            TryToCompute(panel, w);
            Finish(panel);
          }
          PutBack(w);
        },
        1);
    if (exception_) std::rethrow_exception(exception_);
    return !has_failed_;
  }

 private:
  // Columns of the supernode, starting at the first row of the panel.
  struct Target {
    double* values;
    int num_rows;
    int stride;
    int first_row;
  };

  double* ValuesOf(const SupernodalFactor::Panel& panel) {
    return values_ + f_.value_begin_[panel.supernode] +
           static_cast<size_t>(panel.offset) * f_.NumRows(panel.supernode);
  }

  Workspace* Take() {
    const std::lock_guard<std::mutex> lock(mutex_);
    Workspace* w = free_.back();
    free_.pop_back();
    return w;
  }
  void PutBack(Workspace* w) {
    const std::lock_guard<std::mutex> lock(mutex_);
    free_.push_back(w);
  }
  void WaitFor(int panel) {
    if (is_done_[panel].load(std::memory_order_acquire)) return;
    std::unique_lock<std::mutex> lock(mutex_);
    panel_done_.wait(
        lock, [&] { return is_done_[panel].load(std::memory_order_relaxed); });
  }
  void Finish(int panel) {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      is_done_[panel].store(true, std::memory_order_release);
    }
    panel_done_.notify_all();
  }

  // Stores an exception for later, because other threads wait for the panel.
  void TryToCompute(int panel, Workspace* w) {
    if (has_failed_) return;
    try {
      ComputePanel(panel, w);
    } catch (...) {
      const std::lock_guard<std::mutex> lock(mutex_);
      exception_ = std::current_exception();
      has_failed_ = true;
    }
  }

  void ComputePanel(int panel_idx, Workspace* w) {
    const SupernodalFactor::Panel& panel = f_.panels_[panel_idx];
    const int s = panel.supernode;
    const int stride = f_.NumRows(s);
    const Target to = {ValuesOf(panel) + panel.offset, stride - panel.offset,
                       stride, f_.first_column_[s] + panel.offset};
    const int* rows = f_.rows_.data() + f_.row_begin_[s] + panel.offset;
    for (int i = 0; i < to.num_rows; ++i) w->position[rows[i]] = i;
    AddEntries(panel, to, *w);
    const auto& updates = f_.updates_;
    for (const SupernodalFactor::Update* update = updates.begin(panel_idx);
         update != updates.end(panel_idx); ++update) {
      SubtractUpdate(*update, to, w);
    }
    SubtractOwnPanels(panel_idx, to, w);
    if (!FactorizePanel(to.num_rows, panel.width, to.stride, to.values,
                        &w->scratch)) {
      has_failed_ = true;
    }
  }

  void AddEntries(const SupernodalFactor::Panel& panel, const Target& to,
                  const Workspace& w) {
    const bool is_permuted = !f_.column_begin_.empty();
    const int* begin =
        is_permuted ? f_.column_begin_.data() : H_.outerIndexPtr();
    const int* rows = is_permuted ? f_.entry_row_.data() : H_.innerIndexPtr();
    const double* values = H_.valuePtr();
    for (int j = 0; j < panel.width; ++j) {
      double* column = to.values + static_cast<size_t>(j) * to.stride;
      std::fill_n(column, to.num_rows, 0.0);
      const int first = to.first_row + j;
      for (int k = begin[first]; k < begin[first + 1]; ++k) {
        if (rows[k] < first) continue;
        column[w.position[rows[k]]] +=
            values[is_permuted ? f_.entry_source_[k] : k];
      }
    }
  }

  void SubtractUpdate(const SupernodalFactor::Update& update, const Target& to,
                      Workspace* w) {
    const int s = update.supernode;
    const int stride = f_.NumRows(s);
    const int num_rows = stride - update.first;
    const int num_columns = update.last - update.first;
    const int* rows = f_.rows_.data() + f_.row_begin_[s] + update.first;
    for (int i = 0; i < num_rows; ++i) {
      w->update_position[i] = w->position[rows[i]];
    }
    const PanelTarget target = {to.values, to.stride, w->update_position.data(),
                                w->update_position.data()};
    for (int p = f_.panel_begin_[s]; p < f_.panel_begin_[s + 1]; ++p) {
      WaitFor(p);
      const SupernodalFactor::Panel& panel = f_.panels_[p];
      SubtractProduct({ValuesOf(panel) + update.first, stride}, num_rows,
                      num_columns, panel.width, target, &w->scratch);
    }
  }

  void SubtractOwnPanels(int panel_idx, const Target& to, Workspace* w) {
    const SupernodalFactor::Panel& panel = f_.panels_[panel_idx];
    for (int p = f_.panel_begin_[panel.supernode]; p < panel_idx; ++p) {
      WaitFor(p);
      const SupernodalFactor::Panel& before = f_.panels_[p];
      SubtractProduct({ValuesOf(before) + panel.offset, to.stride}, to.num_rows,
                      panel.width, before.width, {to.values, to.stride},
                      &w->scratch);
    }
  }

  const SupernodalFactor& f_;
  const Eigen::SparseMatrix<double>& H_;
  double* const values_;
  std::vector<std::atomic<bool>> is_done_;
  std::atomic<bool> has_failed_{false};
  std::exception_ptr exception_;
  std::mutex mutex_;
  std::condition_variable panel_done_;
  std::vector<Workspace*> free_;
};

bool SupernodalFactor::Factorize(const Eigen::SparseMatrix<double>& H,
                                 int num_threads, cholmod_factor* factor) {
  workspaces_.resize(std::max(1, num_threads));
  for (Workspace& w : workspaces_) {
    w.position.resize(supernode_of_column_.size());
    w.update_position.resize(max_num_rows_);
  }
  return SupernodalRun(*this, H, static_cast<double*>(factor->x), &workspaces_)
      .Run();
}

// Forward substitution, X = L^-1 X.
template <class Matrix>
void SupernodalFactor::SolveLower(const double* values, Matrix&& X) const {
  Eigen::MatrixXd below;
  for (int s = 0; s < NumSupernodes(); ++s) {
    const int width = NumColumns(s), num_below = NumRows(s) - width;
    const ConstPanel L(values + value_begin_[s], NumRows(s), width,
                       Eigen::OuterStride<>(NumRows(s)));
    auto own = X.middleRows(first_column_[s], width);
    L.topRows(width).template triangularView<Eigen::Lower>().solveInPlace(own);
    below.noalias() = L.bottomRows(num_below) * own;
    const int* rows = rows_.data() + row_begin_[s] + width;
    for (int i = 0; i < num_below; ++i) X.row(rows[i]) -= below.row(i);
  }
}

// Backward substitution, X = L^-T X.
template <class Matrix>
void SupernodalFactor::SolveUpper(const double* values, Matrix&& X) const {
  Eigen::MatrixXd below;
  for (int s = NumSupernodes() - 1; s >= 0; --s) {
    const int width = NumColumns(s), num_below = NumRows(s) - width;
    const ConstPanel L(values + value_begin_[s], NumRows(s), width,
                       Eigen::OuterStride<>(NumRows(s)));
    const int* rows = rows_.data() + row_begin_[s] + width;
    below.resize(num_below, X.cols());
    for (int i = 0; i < num_below; ++i) below.row(i) = X.row(rows[i]);
    auto own = X.middleRows(first_column_[s], width);
    own.noalias() -= L.bottomRows(num_below).transpose() * below;
    L.topRows(width)
        .transpose()
        .template triangularView<Eigen::Upper>()
        .solveInPlace(own);
  }
}

void SupernodalFactor::Solve(const double* values,
                             Eigen::Ref<Eigen::MatrixXd> X) const {
  if (X.cols() == 1) {  // Eigen has faster kernels for vectors
    SolveLower(values, X.col(0));
    SolveUpper(values, X.col(0));
  } else {
    SolveLower(values, X);
    SolveUpper(values, X);
  }
}

}  // namespace mgsfm
