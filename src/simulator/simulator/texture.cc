// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/texture.h"

#include <cmath>

namespace mgsfm::texture {
namespace {

// A position as cell index and offset, in units of cells.
struct CellPlace {
  int32_t column, row;
  float x, y;
};

CellPlace CellOf(double u, double v) {
  const double column = std::floor(u), row = std::floor(v);
  return {static_cast<int32_t>(column), static_cast<int32_t>(row),
          static_cast<float>(u - column), static_cast<float>(v - row)};
}

float Lattice(int32_t column, int32_t row, uint32_t seed) {
  return static_cast<float>(HashCell(column, row, seed)) * 0x1.0p-31f - 1.0f;
}

float Smooth(float x) { return x * x * (3.0f - 2.0f * x); }

float ValueNoise(double u, double v, uint32_t seed) {
  const CellPlace at = CellOf(u, v);
  const float x = Smooth(at.x), y = Smooth(at.y);
  const float a = Lattice(at.column, at.row, seed);
  const float b = Lattice(at.column + 1, at.row, seed);
  const float c = Lattice(at.column, at.row + 1, seed);
  const float d = Lattice(at.column + 1, at.row + 1, seed);
  return (1.0f - y) * (a + x * (b - a)) + y * (c + x * (d - c));
}

}  // namespace

// The mixing steps of MurmurHash3 (A. Appleby, public domain).
uint32_t HashCell(int32_t column, int32_t row, uint32_t seed) {
  uint32_t h = static_cast<uint32_t>(column) * 0x9E3779B1u +
               static_cast<uint32_t>(row) * 0x85EBCA77u + seed * 0xC2B2AE3Du;
  h ^= h >> 16;
  h *= 0x85EBCA6Bu;
  h ^= h >> 13;
  h *= 0xC2B2AE35u;
  return h ^ (h >> 16);
}

float Noise(const Place& place, double coarsest_m, double finest_m,
            float persistence, uint32_t seed) {
  float sum = 0.0f, strength = 1.0f;
  uint32_t octave = 0;
  for (double size = coarsest_m; size >= finest_m; size *= 0.5) {
    const float visible = Visible(size, place.footprint_m);
    if (visible == 0.0f) break;
    sum += visible * strength *
           ValueNoise(place.u_m / size, place.v_m / size, seed + octave);
    strength *= persistence;
    ++octave;
  }
  return sum;
}

float Spots(const Place& place, double cell_m, float density, uint32_t seed) {
  const float visible = Visible(0.3 * cell_m, place.footprint_m);
  if (visible == 0.0f) return 0.0f;
  const CellPlace at = CellOf(place.u_m / cell_m, place.v_m / cell_m);
  const uint32_t bits = HashCell(at.column, at.row, seed);
  if (Fraction(bits, 0) >= density) return 0.0f;
  // Spots lie within their cell, so neighboring cells are irrelevant.
  const float radius = 0.12f + 0.26f * Fraction(bits, 1);
  const uint32_t more = HashSeed(bits, seed);
  const float room = 1.0f - 2.0f * radius;
  const float dx = at.x - radius - room * Fraction(more, 0);
  const float dy = at.y - radius - room * Fraction(more, 1);
  const double inside = cell_m * (radius - std::sqrt(dx * dx + dy * dy));
  // Dark or bright with equal probability, never faint.
  const float level = 0.4f + 0.6f * Fraction(more, 2);
  return visible * Edge(inside, place.footprint_m) *
         (Fraction(more, 3) < 0.5f ? -level : level);
}

float Stones(const Place& place, double width_m, double height_m,
             uint32_t seed) {
  const float visible = Visible(0.5 * height_m, place.footprint_m);
  if (visible == 0.0f) return 0.0f;
  const double row = std::floor(place.v_m / height_m);
  const uint32_t row_bits = HashCell(static_cast<int32_t>(row), 5, seed);
  const double width = width_m * (0.7 + 0.6 * Fraction(row_bits, 1));
  const double shifted = place.u_m / width + Fraction(row_bits, 0);
  const double column = std::floor(shifted);
  const double inside_u =
      width * std::min(shifted - column, column + 1.0 - shifted);
  const double inside_v =
      std::min(place.v_m - row * height_m, (row + 1.0) * height_m - place.v_m);
  // Zero at the joints, so that stones blend there.
  const double inside = std::min(inside_u, inside_v);
  const auto full = static_cast<float>(
      std::clamp(inside / std::max(0.015, place.footprint_m), 0.0, 1.0));
  return visible * full *
         Lattice(static_cast<int32_t>(column), static_cast<int32_t>(row),
                 seed + 1);
}

Window Windows(const Place& place, double cell_width_m, double cell_height_m,
               uint32_t seed) {
  constexpr double kFrame_m = 0.08;  // only needs to be plausible
  const CellPlace at =
      CellOf(place.u_m / cell_width_m, place.v_m / cell_height_m);
  const uint32_t bits = HashCell(at.column, at.row, seed);
  if (Fraction(bits, 0) > 0.75f) return {};
  const uint32_t more = HashSeed(bits, seed);
  const double width = cell_width_m * (0.3 + 0.35 * Fraction(bits, 1));
  const double height = cell_height_m * (0.35 + 0.3 * Fraction(bits, 2));
  const double x =
      at.x * cell_width_m - (cell_width_m - width) * Fraction(more, 0);
  const double y =
      at.y * cell_height_m - (cell_height_m - height) * Fraction(more, 1);
  const double inside =
      std::min(std::min(x, width - x), std::min(y, height - y));
  const double bar =
      std::abs(x - width * (0.25 + 0.5 * Fraction(more, 2))) - 0.5 * kFrame_m;
  Window window;
  window.cover = Edge(inside, place.footprint_m);
  window.pane = Edge(std::min(inside - kFrame_m, bar), place.footprint_m);
  window.brightness = Fraction(more, 3);
  return window;
}

}  // namespace mgsfm::texture
