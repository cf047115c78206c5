// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>

// Procedural patterns of two coordinates in metres. They never repeat, differ
// with each seed, and have no detail finer than the footprint of a pixel, given
// in metres: so images neither alias nor flicker between views.
namespace mgsfm::texture {

struct Place {
  double u_m;
  double v_m;
  double footprint_m;
};

// Pseudo-random bits of a cell; of a seed and a number.
uint32_t HashCell(int32_t column, int32_t row, uint32_t seed);
inline uint32_t HashSeed(uint32_t seed, uint32_t number) {
  return HashCell(static_cast<int32_t>(number), 77, seed);
}

// In [0, 1), from 8 of 32 random bits; `part` is 0 to 3.
inline float Fraction(uint32_t bits, int part) {
  return static_cast<float>((bits >> (8 * part)) & 255u) * (1.0f / 256.0f);
}

// How much of a detail of that size is seen: 0 up to the size of the
// footprint, 1 from twice that.
inline float Visible(double size_m, double footprint_m) {
  return static_cast<float>(std::clamp(size_m / footprint_m - 1.0, 0.0, 1.0));
}

// 1 inside, 0 outside of an edge, blurred by the footprint.
inline float Edge(double inside_m, double footprint_m) {
  return static_cast<float>(std::clamp(inside_m / footprint_m + 0.5, 0.0, 1.0));
}

// Smooth noise in about [-1, 1]: octaves of value noise from cells of
// `coarsest_m` to those of `finest_m`, each half as large as the one before and
// `persistence` times as strong.
float Noise(const Place& place, double coarsest_m, double finest_m,
            float persistence, uint32_t seed);

// Round spots in [-1, 1], at most one in each cell, each of its own size,
// position and brightness; 0 between them.
float Spots(const Place& place, double cell_m, float density, uint32_t seed);

// A wall of stones in rows, each with a brightness in [-1, 1]. Rows are shifted
// at random.
float Stones(const Place& place, double width_m, double height_m,
             uint32_t seed);

// A rectangle at random within its cell; not every cell has one.
struct Window {
  float cover = 0.0f;       // 1 inside, 0 outside
  float pane = 0.0f;        // 1 on the glass, 0 on the frame
  float brightness = 0.0f;  // of this window, in [0, 1)
};
Window Windows(const Place& place, double cell_width_m, double cell_height_m,
               uint32_t seed);

}  // namespace mgsfm::texture
