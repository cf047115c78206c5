// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/scene_rotations.h"

#include <cstddef>
#include <string>
#include <utility>

#include "pipeline/motion_recipe.h"
#include "pipeline/timed.h"

namespace mgsfm {
namespace {

// Replaces the pairs of a view graph of which the static scene is known.
void ReplacePairs(std::vector<std::optional<ImagePair>> pair_of_scene,
                  ViewGraph* view_graph) {
  for (size_t i = 0; i < pair_of_scene.size(); ++i) {
    if (pair_of_scene[i]) view_graph->pairs[i] = std::move(*pair_of_scene[i]);
  }
}

// The lengths of pairs between frames; nullopt without a baseline.
std::vector<std::optional<double>> BaselineLengths(
    const FramePairIndex& index,
    const std::vector<std::optional<Rigid3>>& poses) {
  std::vector<std::optional<double>> lengths(poses.size());
  for (size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i] || !index.Of(i).IsBetweenFrames()) continue;
    const double length = poses[i]->translation.norm();
    if (length > 0.0) lengths[i] = length;
  }
  return lengths;
}

}  // namespace

RotationsOfScene EstimateRotationsOfScene(
    const Scene& scene, const Bearings& bearings, const FramePairIndex& index,
    const ViewGraph& matches, const GravityPriors& gravity_priors,
    const MapperOptions& options, const Context& context, ViewGraph* view_graph,
    std::vector<StageTime>* times) {
  const auto average = [&](const Mask& pair_is_discontinuous,
                           const Mask& loop_contradicts_path) {
    return Timed("rotation averaging", context, times, [&] {
      return EstimateRotations(scene, index, *view_graph, gravity_priors,
                               options.rotation_averaging,
                               options.pair_filtering, context,
                               pair_is_discontinuous, loop_contradicts_path);
    });
  };
  RotationsOfScene result{average({}, {}), {}, {}, {}};
  if (!index.is_sequence() || !options.pair_filtering.use_motion_continuity) {
    return result;
  }
  MotionOfScene motion = Timed("moving objects", context, times, [&] {
    return FindMotionOfScene(
        scene, bearings, index, *view_graph, matches, result.rotation.estimate,
        options.translation_averaging.min_parallax_deg, options.view_graph,
        options.pair_filtering, context);
  });
  if (motion.pair_is_discontinuous.empty()) return result;
  result.frame_is_ambiguous = std::move(motion.frame_is_ambiguous);
  ReplacePairs(std::move(motion.pair_of_scene), view_graph);
  const size_t num_pairs = motion.pair_is_discontinuous.Count();
  if (num_pairs > 0) {
    context.Info(std::to_string(num_pairs) + " of " +
                 std::to_string(view_graph->pairs.size()) +
                 " image pairs contradict the motion of the rig between their "
                 "frames and are not used");
  }
  result.rotation =
      average(motion.pair_is_discontinuous, motion.loop_contradicts_path);
  result.length_hints.expected = BaselineLengths(index, motion.pair_on_path);
  result.pair_on_path = std::move(motion.pair_on_path);
  return result;
}

}  // namespace mgsfm
