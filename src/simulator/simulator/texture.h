// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstdint>

// Procedural non-repeating textures over two coordinates in meters. They depend
// on a seed and are band-limited to the footprint of a pixel (meters), which
// avoids aliasing and flicker between views.
namespace mgsfm::texture {

struct Place {
  double u_m;
  double v_m;
  double footprint_m;
};

// Pseudo-random bits of a cell, or of a seed and a number.
uint32_t HashCell(int32_t column, int32_t row, uint32_t seed);
inline uint32_t HashSeed(uint32_t seed, uint32_t number) {
  return HashCell(static_cast<int32_t>(number), 77, seed);
}

// A number in [0, 1) from byte `part` (0 to 3) of 32 random bits.
inline float Fraction(uint32_t bits, int part) {
  return static_cast<float>((bits >> (8 * part)) & 255u) * (1.0f / 256.0f);
}

// The contrast of a detail of the given size: 0 up to the size of the
// footprint, 1 from twice that size.
inline float Visible(double size_m, double footprint_m) {
  return static_cast<float>(std::clamp(size_m / footprint_m - 1.0, 0.0, 1.0));
}

// 1 inside and 0 outside of an edge, blurred by the footprint.
inline float Edge(double inside_m, double footprint_m) {
  return static_cast<float>(std::clamp(inside_m / footprint_m + 0.5, 0.0, 1.0));
}

// Smooth noise in about [-1, 1]: octaves of value noise with cell sizes from
// `coarsest_m` to `finest_m`. Each octave halves the cell size and multiplies
// the amplitude by `persistence`.
float Noise(const Place& place, double coarsest_m, double finest_m,
            float persistence, uint32_t seed);

// Round spots in [-1, 1] with random size, position and brightness, at most one
// per cell; 0 elsewhere.
float Spots(const Place& place, double cell_m, float density, uint32_t seed);

// A wall of stones with random brightness in [-1, 1], in randomly shifted rows.
float Stones(const Place& place, double width_m, double height_m,
             uint32_t seed);

// A random rectangle within a cell. Not every cell has one.
struct Window {
  float cover = 0.0f;       // 1 inside, 0 outside
  float pane = 0.0f;        // 1 on the glass, 0 on the frame
  float brightness = 0.0f;  // in [0, 1)
};
Window Windows(const Place& place, double cell_width_m, double cell_height_m,
               uint32_t seed);

}  // namespace mgsfm::texture
