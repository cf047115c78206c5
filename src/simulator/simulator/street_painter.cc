// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/street_painter.h"

#include <algorithm>
#include <cmath>

#include "simulator/random_streams.h"
#include "simulator/texture.h"

namespace mgsfm {
namespace {

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
