// SPDX-License-Identifier: BSD-3-Clause
#include "matching/descriptor_products.h"

#include <algorithm>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "base/cpu_features.h"

namespace mgsfm {
namespace {

using Four = float __attribute__((vector_size(16)));

// Rows whose sums stay in 8 of 16 registers.
constexpr int kPortableRows = 2;

// The sums are vectors, because compilers do not vectorize loops over numbers
// here.
template <class Vector, int kNumRows>
MGSFM_ALWAYS_INLINE void MultiplyFloats(const float* rows, const float* columns,
                                        int32_t* tile) {
  constexpr int kSize = sizeof(Vector) / sizeof(float);
  constexpr int kNumVectors = kTileColumns / kSize;
  Vector sums[kNumRows][kNumVectors] = {};
  for (int k = 0; k < kNumDims; ++k) {
    for (int v = 0; v < kNumVectors; ++v) {
      Vector b;
      std::memcpy(&b, columns + kTileColumns * k + v * kSize, sizeof(b));
      for (int r = 0; r < kNumRows; ++r) {
        sums[r][v] += rows[r * kNumDims + k] * b;
      }
    }
  }
  for (const auto& row : sums) {
    for (const Vector& sum : row) {
      float dots[kSize];
      std::memcpy(dots, &sum, sizeof(dots));
      tile = std::copy_n(dots, kSize, tile);
    }
  }
}

void MultiplyPortable(const float* rows, const float* columns, int32_t* tile) {
  MultiplyFloats<Four, kPortableRows>(rows, columns, tile);
}

// Free of branches, so that compilers vectorize the inner loop.
MGSFM_ALWAYS_INLINE void UpdateTopTwo(const int32_t* __restrict tile,
                                      int first_row, int block,
                                      TopTwoLanes* __restrict of_rows,
                                      TopTwoLanes* __restrict of_columns) {
  const int32_t block_code = 255 - block;
  for (int r = 0; r < kTileRows; ++r) {
    const int32_t row_code = 255 - first_row - r;
    TopTwoLanes& of_row = of_rows[r];
    for (int c = 0; c < kTileColumns; ++c) {
      const int32_t shifted = tile[r * kTileColumns + c] * 256;
      const int32_t in_column = shifted + row_code;
      const int32_t in_row = shifted + block_code;
      of_columns->second[c] = std::max(
          of_columns->second[c], std::min(in_column, of_columns->best[c]));
      of_columns->best[c] = std::max(of_columns->best[c], in_column);
      of_row.second[c] =
          std::max(of_row.second[c], std::min(in_row, of_row.best[c]));
      of_row.best[c] = std::max(of_row.best[c], in_row);
    }
  }
}

void UpdatePortable(const int32_t* tile, int first_row, int block,
                    TopTwoLanes* of_rows, TopTwoLanes* of_columns) {
  UpdateTopTwo(tile, first_row, block, of_rows, of_columns);
}

#if defined(__x86_64__)

using Eight = float __attribute__((vector_size(32)));

// Rows whose sums stay in 8 of the 16 registers.
constexpr int kAvx2Rows = 4;

MGSFM_TARGET_AVX2 void MultiplyAvx2(const float* rows, const float* columns,
                                    int32_t* tile) {
  MultiplyFloats<Eight, kAvx2Rows>(rows, columns, tile);
}

// One group of dimensions.
int32_t LoadGroup(const void* values) {
  int32_t group;
  std::memcpy(&group, values, sizeof(group));
  return group;
}

// Adds four products to two unsigned 16-bit sums, whose total is below 2^16.
MGSFM_TARGET_AVX2 void MultiplyRoughAvx2(const uint8_t* rows,
                                         const int8_t* columns, int32_t* tile) {
  __m256i sums[kAvx2Rows][2];
  for (auto& row : sums) row[0] = row[1] = _mm256_setzero_si256();
  for (int k = 0; k < kNumDims / 4; ++k) {
    const auto* b =
        reinterpret_cast<const __m256i*>(columns + 4 * kTileColumns * k);
    const __m256i b0 = _mm256_loadu_si256(b);
    const __m256i b1 = _mm256_loadu_si256(b + 1);
    for (int r = 0; r < kAvx2Rows; ++r) {
      const __m256i group =
          _mm256_set1_epi32(LoadGroup(rows + r * kNumDims + 4 * k));
      sums[r][0] =
          _mm256_add_epi16(sums[r][0], _mm256_maddubs_epi16(group, b0));
      sums[r][1] =
          _mm256_add_epi16(sums[r][1], _mm256_maddubs_epi16(group, b1));
    }
  }
  const auto* factors = reinterpret_cast<const __m256i*>(
      columns + RoughTileFunctions::kNumValues);
  const __m256i low_half = _mm256_set1_epi32(0xffff);
  for (int half = 0; half < 2; ++half) {
    const __m256i factor = _mm256_loadu_si256(factors + half);
    for (int r = 0; r < kAvx2Rows; ++r) {
      const __m256i sum = sums[r][half];
      const __m256i dot = _mm256_add_epi32(_mm256_and_si256(sum, low_half),
                                           _mm256_srli_epi32(sum, 16));
      _mm256_storeu_si256(
          reinterpret_cast<__m256i*>(tile + r * kTileColumns + 8 * half),
          _mm256_srli_epi32(_mm256_mullo_epi32(dot, factor), kFactorBits));
    }
  }
}

__attribute__((target("avx512f,avx512vnni"))) void MultiplyAvx512Vnni(
    const int8_t* rows, const uint8_t* columns, int32_t* tile) {
  __m512i sums[kTileRows];
  for (__m512i& sum : sums) {
    sum = _mm512_loadu_si512(columns + ByteTileFunctions::kNumValues);
  }
  for (int k = 0; k < kNumDims / 4; ++k) {
    const __m512i b = _mm512_loadu_si512(columns + 4 * kTileColumns * k);
    for (int r = 0; r < kTileRows; ++r) {
      sums[r] = _mm512_dpbusd_epi32(
          sums[r], b,
          _mm512_set1_epi32(LoadGroup(rows + r * kNumDims + 4 * k)));
    }
  }
  for (int r = 0; r < kTileRows; ++r) {
    _mm512_storeu_si512(tile + r * kTileColumns, sums[r]);
  }
}

MGSFM_TARGET_AVX2 void UpdateAvx2(const int32_t* tile, int first_row, int block,
                                  TopTwoLanes* of_rows,
                                  TopTwoLanes* of_columns) {
  UpdateTopTwo(tile, first_row, block, of_rows, of_columns);
}

__attribute__((target("avx512f"))) void UpdateAvx512(const int32_t* tile,
                                                     int first_row, int block,
                                                     TopTwoLanes* of_rows,
                                                     TopTwoLanes* of_columns) {
  UpdateTopTwo(tile, first_row, block, of_rows, of_columns);
}

#endif

}  // namespace

std::vector<InstructionSet> InstructionSets() {
  std::vector<InstructionSet> sets = {InstructionSet::kPortable};
#if defined(__x86_64__)
  if (HasAvx2()) sets.push_back(InstructionSet::kAvx2);
  if (HasAvx2() && __builtin_cpu_supports("avx512vnni")) {
    sets.push_back(InstructionSet::kAvx512Vnni);
  }
#endif
  return sets;
}

InstructionSet FastestInstructionSet() { return InstructionSets().back(); }

TileKernels KernelsOf(InstructionSet set) {
  TileKernels kernels;
  kernels.floats = {kPortableRows, MultiplyPortable, UpdatePortable};
#if defined(__x86_64__)
  if (set == InstructionSet::kAvx2) {
    kernels.floats = {kAvx2Rows, MultiplyAvx2, UpdateAvx2};
    kernels.rough = {kAvx2Rows, MultiplyRoughAvx2, UpdateAvx2};
  } else if (set == InstructionSet::kAvx512Vnni) {
    kernels.bytes = {kTileRows, MultiplyAvx512Vnni, UpdateAvx512};
  }
#endif
  return kernels;
}

}  // namespace mgsfm
