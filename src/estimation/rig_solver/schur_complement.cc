// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/schur_complement.h"

#include <algorithm>

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

SchurComplement::SchurComplement(int num_threads)
    : num_threads_(num_threads), solver_(num_threads) {}

void SchurComplement::Allocate(const RigStructure& structure) {
  if (is_allocated_ || structure.num_unknowns == 0) return;
  is_allocated_ = true;
  matrix_ = structure.pattern.MakeMatrix();
  solver_.Analyze(matrix_, SparseCholesky::Order::kNatural);
  diagonal_position_ = FindDiagonal(structure);
}

void SchurComplement::SetZero() {
  double* const begin = values();
  const size_t size = num_values();
  ParallelFor((size + kItemsPerTask - 1) / kItemsPerTask, num_threads_,
              [&](size_t part) {
                std::fill(begin + part * kItemsPerTask,
                          begin + std::min(size, (part + 1) * kItemsPerTask),
                          0.0);
              },
              1);
}

}  // namespace mgsfm
