// SPDX-License-Identifier: BSD-3-Clause
#include "matching/descriptor_products.h"

#include <algorithm>
#include <cstring>

#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace mgsfm {
namespace {

constexpr int kNumPairs = kNumDims / 2;

void MultiplyPortable(const int16_t* rows, const int16_t* columns,
                      int32_t* tile) {
  for (int r = 0; r < kTileRows; ++r) {
    int32_t sums[kTileColumns] = {};
    for (int k = 0; k < kNumPairs; ++k) {
      const int32_t a0 = rows[r * kNumDims + 2 * k];
      const int32_t a1 = rows[r * kNumDims + 2 * k + 1];
      const int16_t* b = columns + 2 * kTileColumns * k;
      for (int c = 0; c < kTileColumns; ++c) {
        sums[c] += a0 * b[2 * c] + a1 * b[2 * c + 1];
      }
    }
    std::memcpy(tile + r * kTileColumns, sums, sizeof(sums));
  }
}

// Free of branches, so that compilers vectorize the inner loop.
inline __attribute__((always_inline)) void UpdateTopTwo(
    const int32_t* __restrict tile, int first_row, int block,
    TopTwoLanes* __restrict of_rows, TopTwoLanes* __restrict of_columns) {
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

// One group of dimensions.
int32_t LoadGroup(const void* values) {
  int32_t group;
  std::memcpy(&group, values, sizeof(group));
  return group;
}

// Only half of the rows fit into the 16 registers at a time.
void MultiplySse2(const int16_t* rows, const int16_t* columns, int32_t* tile) {
  constexpr int kNumRows = kTileRows / 2;
  for (int half = 0; half < 2; ++half) {
    __m128i sums[kNumRows][4];
    for (auto& row : sums) {
      for (__m128i& sum : row) sum = _mm_setzero_si128();
    }
    const int16_t* a = rows + half * kNumRows * kNumDims;
    for (int k = 0; k < kNumPairs; ++k) {
      const auto* b =
          reinterpret_cast<const __m128i*>(columns + 2 * kTileColumns * k);
      for (int r = 0; r < kNumRows; ++r) {
        const __m128i pair =
            _mm_set1_epi32(LoadGroup(a + r * kNumDims + 2 * k));
        for (int c = 0; c < 4; ++c) {
          sums[r][c] = _mm_add_epi32(
              sums[r][c], _mm_madd_epi16(pair, _mm_loadu_si128(b + c)));
        }
      }
    }
    auto* out =
        reinterpret_cast<__m128i*>(tile + half * kNumRows * kTileColumns);
    for (const auto& row : sums) {
      for (const __m128i& sum : row) _mm_storeu_si128(out++, sum);
    }
  }
}

__attribute__((target("avx2"))) void MultiplyAvx2(const int16_t* rows,
                                                  const int16_t* columns,
                                                  int32_t* tile) {
  __m256i sums[kTileRows][2];
  for (auto& row : sums) row[0] = row[1] = _mm256_setzero_si256();
  for (int k = 0; k < kNumPairs; ++k) {
    const auto* b =
        reinterpret_cast<const __m256i*>(columns + 2 * kTileColumns * k);
    const __m256i b0 = _mm256_loadu_si256(b);
    const __m256i b1 = _mm256_loadu_si256(b + 1);
    for (int r = 0; r < kTileRows; ++r) {
      const __m256i pair =
          _mm256_set1_epi32(LoadGroup(rows + r * kNumDims + 2 * k));
      sums[r][0] = _mm256_add_epi32(sums[r][0], _mm256_madd_epi16(pair, b0));
      sums[r][1] = _mm256_add_epi32(sums[r][1], _mm256_madd_epi16(pair, b1));
    }
  }
  for (int r = 0; r < kTileRows; ++r) {
    auto* out = reinterpret_cast<__m256i*>(tile + r * kTileColumns);
    _mm256_storeu_si256(out, sums[r][0]);
    _mm256_storeu_si256(out + 1, sums[r][1]);
  }
}

// Adds four products to two unsigned 16-bit sums, whose total is below 2^16.
__attribute__((target("avx2"))) void MultiplyRoughAvx2(const uint8_t* rows,
                                                       const int8_t* columns,
                                                       int32_t* tile) {
  __m256i sums[kTileRows][2];
  for (auto& row : sums) row[0] = row[1] = _mm256_setzero_si256();
  for (int k = 0; k < kNumDims / 4; ++k) {
    const auto* b =
        reinterpret_cast<const __m256i*>(columns + 4 * kTileColumns * k);
    const __m256i b0 = _mm256_loadu_si256(b);
    const __m256i b1 = _mm256_loadu_si256(b + 1);
    for (int r = 0; r < kTileRows; ++r) {
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
    for (int r = 0; r < kTileRows; ++r) {
      const __m256i sum = sums[r][half];
      const __m256i dot = _mm256_add_epi32(_mm256_and_si256(sum, low_half),
                                           _mm256_srli_epi32(sum, 16));
      _mm256_storeu_si256(
          reinterpret_cast<__m256i*>(tile + r * kTileColumns + 8 * half),
          _mm256_srli_epi32(_mm256_mullo_epi32(dot, factor), kFactorBits));
    }
  }
}

__attribute__((target("avx2"))) void UpdateAvx2(const int32_t* tile,
                                                int first_row, int block,
                                                TopTwoLanes* of_rows,
                                                TopTwoLanes* of_columns) {
  UpdateTopTwo(tile, first_row, block, of_rows, of_columns);
}

#endif

}  // namespace

void TopTwoLanes::Clear() {
  std::fill_n(best, kTileColumns, -1);
  std::fill_n(second, kTileColumns, -1);
}

ExactTileFunctions PortableTileFunctions() {
  return {MultiplyPortable, UpdatePortable};
}

ExactTileFunctions FastestTileFunctions() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) return {MultiplyAvx2, UpdateAvx2};
  return {MultiplySse2, UpdatePortable};
#else
  return PortableTileFunctions();
#endif
}

std::optional<RoughTileFunctions> FindRoughTileFunctions() {
#if defined(__x86_64__)
  if (__builtin_cpu_supports("avx2")) {
    return RoughTileFunctions{MultiplyRoughAvx2, UpdateAvx2};
  }
#endif
  return std::nullopt;
}

}  // namespace mgsfm
