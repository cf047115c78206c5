// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/street_painter.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "simulator/random_streams.h"
#include "simulator/ray_grid.h"

namespace mgsfm {
namespace {

// Resolution of the height map and of the distance to the road.
constexpr double kHeightCell_m = 4.0;
constexpr double kDistanceCell_m = 1.0;
// Larger than the rounding of coordinates of 100 km.
constexpr double kMargin_m = 1e-9;

// The smallest root of a t^2 + b t + c in [begin, end].
std::optional<double> FirstRoot(double a, double b, double c, double begin,
                                double end) {
  const double discriminant = b * b - 4.0 * a * c;
  if (discriminant < 0.0) return std::nullopt;
  const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
  const double roots[] = {std::abs(a) > 0.0 ? q / a : end + 1.0,
                          std::abs(q) > 0.0 ? c / q : end + 1.0};
  std::optional<double> first;
  for (const double root : roots) {
    if (root >= begin && root <= end && (!first || root < *first)) first = root;
  }
  return first;
}

}  // namespace

Ground::Field::Field(const Eigen::AlignedBox2d& box, double cell_size_m)
    : grid(box, cell_size_m),
      values((grid.num_columns() + 1) * (grid.num_rows() + 1), 0.0) {}

Eigen::Vector2d Ground::Field::Corner(int column, int row) const {
  return grid.min() + grid.cell_size_m() * Eigen::Vector2d(column, row);
}

double Ground::Field::Interpolate(const Eigen::Vector2d& position) const {
  const int column = grid.Column(position.x()), row = grid.Row(position.y());
  const Eigen::Vector2d offset =
      (position - Corner(column, row)) / grid.cell_size_m();
  const double x = std::clamp(offset.x(), 0.0, 1.0);
  const double y = std::clamp(offset.y(), 0.0, 1.0);
  return (1.0 - y) * ((1.0 - x) * At(column, row) + x * At(column + 1, row)) +
         y * ((1.0 - x) * At(column, row + 1) + x * At(column + 1, row + 1));
}

Ground::Ground(const Road& road, const Eigen::AlignedBox2d& box)
    : heights_(box, kHeightCell_m), road_distances_(box, kDistanceCell_m) {
  heights_.Fill([&](const Eigen::Vector2d& corner) {
    double sum = 0.0, weight_sum = 0.0;
    for (const RoadNode& node : road.nodes()) {
      const double distance =
          (node.ground.head<2>() - corner).squaredNorm() + 2.0;
      const double weight = 1.0 / (distance * distance * distance);
      sum += weight * node.ground.z();
      weight_sum += weight;
    }
    return sum / weight_sum;
  });
  max_height_m_ =
      *std::max_element(heights_.values.begin(), heights_.values.end());

  const std::vector<Eigen::Vector2d> positions = road.Positions();
  const CellGrid nodes = CellGrid::OfPoints(positions, kMaxRoadDistance_m);
  road_distances_.Fill([&](const Eigen::Vector2d& corner) {
    double distance = kMaxRoadDistance_m;
    nodes.ForEachNear(corner, kMaxRoadDistance_m, [&](int i) {
      distance = std::min(distance, (positions[i] - corner).norm());
    });
    return distance;
  });
}

double Ground::HeightAt(const Eigen::Vector2d& position) const {
  return heights_.Interpolate(position);
}

double Ground::RoadDistanceAt(const Eigen::Vector2d& position) const {
  return road_distances_.Interpolate(position);
}

// Within a cell, the height of a ray above the ground is quadratic in the
// distance along the ray.
std::optional<double> Ground::MeetCell(int cell, const Eigen::Vector3d& origin,
                                       const Eigen::Vector3d& direction,
                                       double begin_m, double end_m) const {
  const CellGrid& grid = heights_.grid;
  const int row = cell / grid.num_columns();
  const int column = cell % grid.num_columns();
  const Eigen::Vector2d start =
      (origin.head<2>() - heights_.Corner(column, row)) / grid.cell_size_m();
  const Eigen::Vector2d step = direction.head<2>() / grid.cell_size_m();
  const double h = heights_.At(column, row);
  const double hx = heights_.At(column + 1, row) - h;
  const double hy = heights_.At(column, row + 1) - h;
  const double hxy = heights_.At(column + 1, row + 1) - h - hx - hy;
  const double a = -hxy * step.x() * step.y();
  const double b = direction.z() - hx * step.x() - hy * step.y() -
                   hxy * (start.x() * step.y() + start.y() * step.x());
  const double c = origin.z() - h - hx * start.x() - hy * start.y() -
                   hxy * start.x() * start.y();
  return FirstRoot(a, b, c, begin_m, end_m);
}

std::optional<double> Ground::Cast(const Eigen::Vector3d& origin,
                                   const Eigen::Vector3d& direction,
                                   double max_distance_m) const {
  // Skip the part of the ray above the highest ground.
  double skipped = 0.0;
  if (origin.z() > max_height_m_) {
    if (direction.z() >= 0.0) return std::nullopt;
    skipped = (max_height_m_ - origin.z()) / direction.z();
    if (skipped >= max_distance_m) return std::nullopt;
  }
  const Eigen::Vector3d start = origin + skipped * direction;
  const double max_rest = max_distance_m - skipped;
  CellWalk walk(heights_.grid, start.head<2>(), direction.head<2>());
  while (walk.IsInside() && walk.Entry() < max_rest) {
    const int cell = walk.Cell();
    const double begin = walk.Entry();
    walk.Next();
    // The margin avoids gaps between cells due to rounding.
    const auto rest = MeetCell(cell, start, direction, begin - kMargin_m,
                               std::min(walk.Entry(), max_rest) + kMargin_m);
    if (rest) return skipped + *rest;
  }
  return std::nullopt;
}

namespace {

// Procedural non-repeating textures over two coordinates in meters. They depend
// on a seed and are band-limited to the footprint of a pixel (meters), which
// avoids aliasing and flicker between views.
namespace texture {

struct Place {
  double u_m;
  double v_m;
  double footprint_m;
};

// Pseudo-random bits of a cell, or of a seed and a number, by the mixing steps
// of MurmurHash3 (A. Appleby, public domain).
uint32_t HashCell(int32_t column, int32_t row, uint32_t seed) {
  uint32_t h = static_cast<uint32_t>(column) * 0x9E3779B1u +
               static_cast<uint32_t>(row) * 0x85EBCA77u + seed * 0xC2B2AE3Du;
  h ^= h >> 16;
  h *= 0x85EBCA6Bu;
  h ^= h >> 13;
  h *= 0xC2B2AE35u;
  return h ^ (h >> 16);
}

uint32_t HashSeed(uint32_t seed, uint32_t number) {
  return HashCell(static_cast<int32_t>(number), 77, seed);
}

// A number in [0, 1) from byte `part` (0 to 3) of 32 random bits.
float Fraction(uint32_t bits, int part) {
  return static_cast<float>((bits >> (8 * part)) & 255u) * (1.0f / 256.0f);
}

// The contrast of a detail of the given size: 0 up to the size of the
// footprint, 1 from twice that size.
float Visible(double size_m, double footprint_m) {
  return static_cast<float>(std::clamp(size_m / footprint_m - 1.0, 0.0, 1.0));
}

// 1 inside and 0 outside of an edge, blurred by the footprint.
float Edge(double inside_m, double footprint_m) {
  return static_cast<float>(std::clamp(inside_m / footprint_m + 0.5, 0.0, 1.0));
}

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

// Smooth noise in about [-1, 1]: octaves of value noise with cell sizes from
// `coarsest_m` to `finest_m`. Each octave halves the cell size and multiplies
// the amplitude by `persistence`.
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

// Round spots in [-1, 1] with random size, position and brightness, at most one
// per cell; 0 elsewhere.
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

// A wall of stones with random brightness in [-1, 1], in randomly shifted rows.
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

// A random rectangle within a cell. Not every cell has one.
struct Window {
  float cover = 0.0f;       // 1 inside, 0 outside
  float pane = 0.0f;        // 1 on the glass, 0 on the frame
  float brightness = 0.0f;  // in [0, 1)
};

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

}  // namespace texture

using texture::Fraction;
using texture::HashSeed;
using texture::Place;

// Walls below this height are cars, others are houses.
constexpr double kMaxCarHeight_m = 2.0;
// Cylinders are poles, trunks or crowns, by increasing radius.
constexpr double kMaxPoleRadius_m = 0.15;
constexpr double kMaxTrunkRadius_m = 0.5;

Color Mix(const Color& a, const Color& b, float share) {
  return a + share * (b - a);
}

Color Gray(float level) { return Color::Constant(level); }

// A random muted color.
Color RandomColor(uint32_t bits, float darkest, float brightest, float tint) {
  const float level = darkest + (brightest - darkest) * Fraction(bits, 0);
  return Gray(level) + tint * (Color(Fraction(bits, 1), Fraction(bits, 2),
                                     Fraction(bits, 3)) -
                               Gray(0.5f));
}

// Shading by a fixed sun.
float Light(const Eigen::Vector3d& normal) {
  const Eigen::Vector3d sun(0.48, 0.36, 0.8);
  return static_cast<float>(0.78 + 0.22 * normal.dot(sun));
}

// Spots of several sizes, on which features are detected.
float SpotsOfAllSizes(const Place& place, double largest_m, double smallest_m,
                      uint32_t seed) {
  float sum = 0.0f;
  uint32_t layer = 0;
  for (double size = largest_m; size >= smallest_m; size *= 0.47) {
    // Rotated, so that the cells of different layers are not parallel.
    const double turn = 0.6 * layer + 0.2;
    const double c = std::cos(turn), s = std::sin(turn);
    const Place turned{c * place.u_m - s * place.v_m,
                       s * place.u_m + c * place.v_m, place.footprint_m};
    sum += texture::Spots(turned, size, 0.6f, HashSeed(seed, layer));
    ++layer;
  }
  return sum;
}

}  // namespace

StreetPainter::StreetPainter(const std::vector<Surface>& surfaces,
                             const Ground& ground, uint64_t seed)
    : surfaces_(surfaces),
      ground_(ground),
      seed_(
          static_cast<uint32_t>(RandomOf(seed, Effect::kTextures).NextBits())) {
  coats_.reserve(surfaces.size());
  for (size_t i = 0; i < surfaces.size(); ++i) {
    const Surface& surface = surfaces[i];
    Coat coat = FirstCoat(surface, static_cast<uint32_t>(i));
    if (i > 0) {
      const Surface& before = surfaces[i - 1];
      const bool goes_on = surface.radius_m == 0.0 && before.radius_m == 0.0 &&
                           surface.side == before.side &&
                           coat.look == coats_.back().look &&
                           (surface.a - before.b).norm() < 1e-9;
      if (goes_on) {
        coat = coats_.back();
        coat.begin_m += (before.b - before.a).norm();
      }
    }
    coats_.push_back(coat);
  }
}

StreetPainter::Coat StreetPainter::FirstCoat(const Surface& surface,
                                             uint32_t number) const {
  const double ground = ground_.HeightAt(0.5 * (surface.a + surface.b));
  Look look = Look::kHouse;
  if (surface.radius_m > kMaxTrunkRadius_m) {
    look = Look::kCrown;
  } else if (surface.radius_m > kMaxPoleRadius_m) {
    look = Look::kTrunk;
  } else if (surface.radius_m > 0.0) {
    look = Look::kPole;
  } else if (surface.side == 0 && surface.top_m - ground < kMaxCarHeight_m) {
    look = Look::kCar;
  }
  return {look, HashSeed(seed_, number), 0.0, ground};
}

Color StreetPainter::PaintHouse(const Coat& coat, double u, double v,
                                double footprint_m) const {
  const uint32_t kind = HashSeed(coat.seed, 1);
  const Place place{u, v, footprint_m};
  float change =
      0.10f * texture::Noise(place, 2.0, 0.03, 0.8f, HashSeed(coat.seed, 10)) +
      0.16f * SpotsOfAllSizes(place, 1.7, 0.12, HashSeed(coat.seed, 20));
  change += 0.12f * texture::Stones(place, 0.3 + 0.5 * Fraction(kind, 0),
                                    0.2 + 0.25 * Fraction(kind, 1),
                                    HashSeed(coat.seed, 30));
  Color color =
      RandomColor(HashSeed(coat.seed, 2), 0.4f, 0.7f, 0.25f) + Gray(change);
  const texture::Window window =
      texture::Windows(place, 2.0 + 1.4 * Fraction(kind, 2),
                       2.6 + 0.6 * Fraction(kind, 3), HashSeed(coat.seed, 40));
  if (window.cover == 0.0f) return color;
  const Color frame = RandomColor(HashSeed(coat.seed, 3), 0.7f, 0.95f, 0.1f);
  const Color glass =
      Color(0.08f, 0.11f, 0.15f) + Gray(0.35f * window.brightness) +
      Gray(0.08f *
           texture::Noise(place, 0.8, 0.05, 0.8f, HashSeed(coat.seed, 50)));
  return Mix(color, Mix(frame, glass, window.pane), window.cover);
}

Color StreetPainter::PaintCar(const Coat& coat, double length_m, double piece_u,
                              double v, double footprint_m) const {
  constexpr double kMinSide_m = 3.0;  // sides of 4 m have wheels, ends do not
  const Place place{coat.begin_m + piece_u, v, footprint_m};
  Color color =
      RandomColor(HashSeed(coat.seed, 1), 0.2f, 0.7f, 0.6f) +
      Gray(0.12f * SpotsOfAllSizes(place, 0.7, 0.1, HashSeed(coat.seed, 20)));
  const float band = texture::Edge(v - 0.85, footprint_m) *
                     texture::Edge(1.3 - v, footprint_m);
  const float shine =
      0.15f * texture::Noise(place, 0.7, 0.05, 0.8f, HashSeed(coat.seed, 10));
  color = Mix(color, Color(0.15f, 0.17f, 0.2f) + Gray(shine), band);
  if (length_m < kMinSide_m) return color;
  const double wheel =
      std::min(std::abs(piece_u - 0.8), std::abs(piece_u - length_m + 0.8));
  const float tyre =
      texture::Edge(0.32 - std::hypot(wheel, v - 0.32), footprint_m);
  return Mix(color, Gray(0.08f), tyre);
}

Color StreetPainter::PaintPlant(const Coat& coat, double u, double v,
                                double footprint_m) const {
  const Place place{u, v, footprint_m};
  const float noise =
      texture::Noise(place, 1.0, 0.04, 0.85f, HashSeed(coat.seed, 10));
  if (coat.look == Look::kCrown) {
    const float leaves =
        SpotsOfAllSizes(place, 0.9, 0.15, HashSeed(coat.seed, 20));
    return Color(0.25f, 0.38f, 0.16f) + Gray(0.11f * noise + 0.10f * leaves);
  }
  const Color base =
      coat.look == Look::kTrunk
          ? Color(0.36f, 0.28f, 0.2f)
          : RandomColor(HashSeed(coat.seed, 1), 0.3f, 0.8f, 0.2f);
  const float spots = SpotsOfAllSizes(place, 0.4, 0.1, HashSeed(coat.seed, 20));
  return base + Gray(0.08f * noise + 0.12f * spots);
}

Color StreetPainter::PaintSurface(const SurfaceHit& hit,
                                  const Eigen::Vector3d& point,
                                  double footprint_m) const {
  const Surface& surface = surfaces_[hit.surface];
  const Coat& coat = coats_[hit.surface];
  const Eigen::Vector2d offset = point.head<2>() - surface.a;
  const double v = point.z() - coat.ground_m;
  Color color;
  if (surface.radius_m > 0.0) {
    const double u = surface.radius_m * std::atan2(offset.y(), offset.x());
    color = PaintPlant(coat, u, v, footprint_m);
  } else {
    const double piece_u = offset.norm();
    const double length = (surface.b - surface.a).norm();
    color = coat.look == Look::kHouse
                ? PaintHouse(coat, coat.begin_m + piece_u, v, footprint_m)
                : PaintCar(coat, length, piece_u, v, footprint_m);
  }
  return Light(hit.normal) * color;
}

Color StreetPainter::PaintGround(const Eigen::Vector3d& point,
                                 double footprint_m) const {
  // The dimensions only need to be plausible.
  constexpr double kLane_m = 3.0, kKerb_m = 0.2, kPavement_m = 2.2;
  const Place place{point.x(), point.y(), footprint_m};
  const uint32_t seed = HashSeed(seed_, 0xFFFF0000u);
  const double distance = ground_.RoadDistanceAt(point.head<2>());
  const float noise =
      texture::Noise(place, 3.0, 0.04, 0.85f, HashSeed(seed, 10));
  const float spots = SpotsOfAllSizes(place, 2.0, 0.15, HashSeed(seed, 20));
  const Color asphalt = Gray(0.33f + 0.07f * noise + 0.10f * spots);
  const Color kerb = Gray(0.62f + 0.05f * noise + 0.05f * spots);
  const Color pavement =
      Color(0.48f, 0.46f, 0.42f) +
      Gray(0.05f * noise + 0.07f * spots +
           0.09f * texture::Stones(place, 0.6, 0.5, HashSeed(seed, 30)));
  const Color grass =
      Color(0.27f, 0.36f, 0.17f) + Gray(0.08f * noise + 0.07f * spots);
  const auto beyond = [&](double border) {
    return texture::Edge(distance - border, footprint_m);
  };
  Color color = Mix(asphalt, kerb, beyond(kLane_m));
  color = Mix(color, pavement, beyond(kLane_m + kKerb_m));
  return Mix(color, grass, beyond(kLane_m + kKerb_m + kPavement_m));
}

Color StreetPainter::PaintBackdrop(const Eigen::Vector3d& direction,
                                   double footprint_rad) const {
  // Hills on a cylinder, clouds on a plane above.
  const double level = std::max(direction.head<2>().norm(), 1e-6);
  const double azimuth = std::atan2(direction.y(), direction.x());
  const double slope = direction.z() / level;
  const uint32_t seed = HashSeed(seed_, 0xFFFF0001u);
  // A function on a circle, so that the horizon is periodic.
  const Place around{3.0 * direction.x() / level, 3.0 * direction.y() / level,
                     footprint_rad};
  const double crest =
      0.07 + 0.025 * texture::Noise(around, 1.0, 0.05, 0.6f, seed);
  const Place cloud{direction.x() / (std::max(slope, 0.0) + 0.3),
                    direction.y() / (std::max(slope, 0.0) + 0.3),
                    4.0 * footprint_rad};
  const float white =
      0.5f + 0.5f * texture::Noise(cloud, 1.2, 0.08, 0.5f, HashSeed(seed, 40));
  const Color sky = Mix(Color(0.6f, 0.72f, 0.86f), Gray(0.88f),
                        std::clamp(white, 0.0f, 1.0f));
  const Place on_hill{azimuth, slope, footprint_rad};
  const Color hill = Color(0.4f, 0.46f, 0.44f) +
                     Gray(0.07f * texture::Noise(on_hill, 0.12, 0.005, 0.85f,
                                                 HashSeed(seed, 80)));
  return Mix(sky, hill, texture::Edge(crest - slope, footprint_rad));
}

}  // namespace mgsfm
