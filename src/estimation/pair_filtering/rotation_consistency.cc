// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/rotation_consistency.h"

#include <cstddef>
#include <optional>
#include <vector>

#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/statistics.h"
#include "mgsfm/base/error.h"
#include "pair_filtering/drift_bound.h"

namespace mgsfm {
namespace {

// Angle between the measured relative rotation and that of the skeleton;
// nullopt if the skeleton does not connect the images.
std::optional<double> DeviationFromSkeleton(
    const Scene& scene, const ImagePair& pair,
    const RotationEstimate& by_skeleton) {
  const auto rotation1 = by_skeleton.CamFromWorld(scene, pair.image_idx1);
  const auto rotation2 = by_skeleton.CamFromWorld(scene, pair.image_idx2);
  const auto component = [&](int image_idx) {
    return by_skeleton.component[scene.images[image_idx].frame_idx];
  };
  if (!rotation1 || !rotation2 ||
      component(pair.image_idx1) != component(pair.image_idx2)) {
    return std::nullopt;
  }
  return AngleBetween(pair.relative_pose->cam2_from_cam1 * *rotation1,
                      *rotation2);
}

}  // namespace

Mask FindInconsistentRotations(const PairEvidence& evidence,
                               const Mask& is_in_skeleton,
                               const RotationEstimate& by_skeleton) {
  const auto& [scene, index, view_graph, pair_is_used, options, num_threads] =
      evidence;
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  std::vector<std::optional<double>> deviations(pair_is_used.size());
  std::vector<double> known;
  for (size_t i = 0; i < deviations.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (!pair_is_used[i] || !pair.relative_pose) continue;
    deviations[i] = DeviationFromSkeleton(scene, pair, by_skeleton);
    if (deviations[i]) known.push_back(*deviations[i]);
  }
  Mask is_inconsistent(pair_is_used.size(), false);
  if (known.empty()) return is_inconsistent;
  const DriftBound bound(
      index, view_graph, is_in_skeleton, [](size_t) { return 1.0; },
      {DriftGrowth::kRandomWalk,
       options.rotation_drift_in_sigmas * RobustSigma<3>(known),
       DegToRad(options.max_rotation_drift_deg)});
  for (size_t i = 0; i < deviations.size(); ++i) {
    if (!deviations[i] || is_in_skeleton[i]) continue;
    is_inconsistent[i] =
        *deviations[i] >
        DegToRad(options.max_rotation_error_deg) + bound.Of(index.Of(i));
  }
  if (RejectsTooMany(is_inconsistent.Count(), known.size())) {
    is_inconsistent.assign(is_inconsistent.size(), false);
  }
  return is_inconsistent;
}

}  // namespace mgsfm
