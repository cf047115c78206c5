// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/worlds/motion.h"

#include <cmath>
#include <utility>

#include "base/random.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

constexpr int kNumWaves = 6;

// The slope at a key that keeps the curve monotonic (Fritsch and Butland).
double Slope(double before, double after) {
  return before * after <= 0.0 ? 0.0 : 2.0 * before * after / (before + after);
}

}  // namespace

Attitude At(double x, double y, double z, double yaw_deg, double pitch_deg,
            double roll_deg) {
  Attitude attitude;
  attitude << x, y, z, DegToRad(yaw_deg), DegToRad(pitch_deg),
      DegToRad(roll_deg);
  return attitude;
}

Rigid3 WorldFromRig(const Attitude& a) {
  Eigen::Matrix3d axes;
  axes.col(0) << std::sin(a[3]), -std::cos(a[3]), 0.0;
  axes.col(2) << std::cos(a[3]) * std::cos(a[4]),
      std::sin(a[3]) * std::cos(a[4]), -std::sin(a[4]);
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return {Eigen::Quaterniond(axes) * ExpSO3(Eigen::Vector3d(0.0, 0.0, a[5])),
          a.head<3>()};
}

Attitude LookAt(const Eigen::Vector3d& eye, const Eigen::Vector3d& target) {
  const Eigen::Vector3d view = target - eye;
  Attitude attitude;
  attitude << eye, std::atan2(view.y(), view.x()),
      std::atan2(-view.z(), view.head<2>().norm()), 0.0;
  return attitude;
}

std::function<Attitude(double)> Follow(std::vector<Key> keys) {
  return [keys = std::move(keys)](double time_s) -> Attitude {
    if (time_s <= keys.front().time_s) return keys.front().attitude;
    if (time_s >= keys.back().time_s) return keys.back().attitude;
    size_t i = 0;
    while (keys[i + 1].time_s <= time_s) ++i;
    const double length = keys[i + 1].time_s - keys[i].time_s;
    const double u = (time_s - keys[i].time_s) / length;
    const auto rate = [&](size_t j, int k) {
      const Attitude step = keys[j + 1].attitude - keys[j].attitude;
      return step[k] / (keys[j + 1].time_s - keys[j].time_s);
    };
    Attitude result;
    for (int k = 0; k < 6; ++k) {
      const double here = rate(i, k);
      const double m0 = i == 0 ? 0.0 : Slope(rate(i - 1, k), here);
      const double m1 =
          i + 2 == keys.size() ? 0.0 : Slope(here, rate(i + 1, k));
      const double p0 = keys[i].attitude[k], p1 = keys[i + 1].attitude[k];
      result[k] = p0 + u * u * (3.0 - 2.0 * u) * (p1 - p0) +
                  length * u * (1.0 - u) * ((1.0 - u) * m0 - u * m1);
    }
    return result;
  };
}

Tremor::Tremor(double position_m, double angle_deg, double min_frequency_hz,
               double max_frequency_hz, uint64_t seed) {
  Random random(seed, 77);
  for (int i = 0; i < kNumWaves; ++i) {
    Wave wave;
    wave.frequency_hz = random.Uniform(min_frequency_hz, max_frequency_hz);
    for (int k = 0; k < 6; ++k) {
      const double size = k < 3 ? position_m : DegToRad(angle_deg);
      wave.amplitude[k] = size * random.Normal() / std::sqrt(0.5 * kNumWaves);
      wave.phase[k] = random.Uniform(0.0, 2.0 * kPi);
    }
    waves_.push_back(wave);
  }
}

Attitude Tremor::operator()(double time_s) const {
  Attitude sum = Attitude::Zero();
  for (const Wave& wave : waves_) {
    const double angle = 2.0 * kPi * wave.frequency_hz * time_s;
    sum += wave.amplitude.cwiseProduct(
        (wave.phase.array() + angle).sin().matrix());
  }
  return sum;
}

}  // namespace mgsfm
