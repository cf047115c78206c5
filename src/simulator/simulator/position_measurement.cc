// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/position_measurement.h"

#include "base/random.h"
#include "geometry/so3.h"
#include "math/random_vector.h"

namespace mgsfm {
namespace {

// Errors of outliers, as stated in the help of prior_outlier_ratio.
constexpr double kMinOutlier_m = 20.0;
constexpr double kMaxOutlier_m = 200.0;
// Separates these random numbers from those of other effects.
constexpr uint64_t kStream = 0x6d656173;
constexpr uint64_t kGravityStream = 0x67726176;

}  // namespace

PositionPriors MeasurePositions(const Simulation& simulation,
                                const PositionMeasurementOptions& options,
                                uint64_t random_seed) {
  PositionPriors priors;
  if (options.sigma_m == 0.0) return priors;
  const Scene& scene = simulation.scene;
  priors.images.resize(scene.images.size());
  const uint64_t seed = Random(random_seed, kStream).NextBits();
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    Random random(seed, f);
    const int image_idx = scene.frames[f].image_idxs.front();
    PositionMeasurement measured;
    measured.position = simulation.cam_from_world[image_idx].Center() +
                        options.sigma_m * NormalVector(&random);
    measured.covariance *= options.sigma_m * options.sigma_m;
    const Eigen::Vector3d direction = NormalVector(&random).normalized();
    const double distance = random.Uniform(kMinOutlier_m, kMaxOutlier_m);
    if (random.Uniform() < options.outlier_ratio) {
      measured.position += distance * direction;
    }
    priors.images[image_idx] = measured;
  }
  return priors;
}

GravityPriors MeasureGravity(const Simulation& simulation,
                             const GravityMeasurementOptions& options,
                             uint64_t random_seed) {
  GravityPriors gravity;
  if (options.sigma_deg == 0.0) return gravity;
  const Scene& scene = simulation.scene;
  gravity.images.resize(scene.images.size());
  const uint64_t seed = Random(random_seed, kGravityStream).NextBits();
  for (size_t f = 0; f < scene.frames.size(); ++f) {
    Random random(seed, f);
    const int image_idx = scene.frames[f].image_idxs.front();
    const Eigen::Vector3d turn =
        DegToRad(options.sigma_deg) * NormalVector(&random);
    const Eigen::Vector3d wrong = NormalVector(&random).normalized();
    const bool is_wrong = random.Uniform() < options.outlier_ratio;
    const Eigen::Vector3d in_world =
        is_wrong ? wrong : ExpSO3(turn) * Eigen::Vector3d::UnitY();
    gravity.images[image_idx] =
        simulation.cam_from_world[image_idx].rotation * in_world;
  }
  return gravity;
}

}  // namespace mgsfm
