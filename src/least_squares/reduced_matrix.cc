// SPDX-License-Identifier: BSD-3-Clause
#include "least_squares/reduced_matrix.h"

#include <algorithm>
#include <utility>

#include "base/memory.h"
#include "base/parallel.h"

namespace mgsfm {
namespace {

std::vector<size_t> FindDiagonal(const RigStructure& structure) {
  std::vector<size_t> positions(structure.num_unknowns);
  for (size_t b = 0; b < structure.block_size.size(); ++b) {
    const int rank = structure.block_rank[b];
    const auto [position, stride] = structure.pattern.Find(rank, rank);
    for (int i = 0; i < structure.block_size[b]; ++i) {
      positions[structure.block_first[b] + i] =
          position + static_cast<size_t>(i) * stride + i;
    }
  }
  return positions;
}

}  // namespace

ReducedMatrix::ReducedMatrix(bool is_in_place, int num_threads)
    : is_in_place_(is_in_place),
      num_threads_(num_threads),
      solver_(num_threads),
      in_place_(num_threads) {}

void ReducedMatrix::Allocate(RigStructure* structure) {
  if (is_allocated_ || structure->num_unknowns == 0) return;
  is_allocated_ = true;
  if (is_in_place_) {
    ReturnFreedMemory();  // many small blocks of the structure
    BlockPattern::Rows rows = structure->pattern.MakeRows();
    in_place_.Analyze(std::move(rows.column_begin), std::move(rows.rows));
    structure->MoveValues([this](int row, int column) {
      const auto [position, stride] = in_place_.Find(row, column);
      return BlockPattern::Place{position, stride};
    });
  } else {
    matrix_ = structure->pattern.MakeMatrix();
    solver_.Analyze(matrix_, SparseCholesky::Order::kNatural);
  }
  diagonal_position_ = FindDiagonal(*structure);
}

void ReducedMatrix::SetZero() {
  constexpr size_t kValuesAtATime = size_t{1} << 16;
  double* const begin = values();
  const size_t size = num_values();
  ParallelFor((size + kValuesAtATime - 1) / kValuesAtATime, num_threads_,
              [&](size_t part) {
                std::fill(begin + part * kValuesAtATime,
                          begin + std::min(size, (part + 1) * kValuesAtATime),
                          0.0);
              },
              1);
}

void ReducedMatrix::Solve(const Eigen::Ref<const Eigen::MatrixXd>& B,
                          Eigen::Ref<Eigen::MatrixXd> X) const {
  if (!is_in_place_) {
    solver_.Solve(B, X);
    return;
  }
  if (X.data() != B.data()) X = B;
  in_place_.Solve(X);
}

}  // namespace mgsfm
