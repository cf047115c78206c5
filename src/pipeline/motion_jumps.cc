// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/motion_jumps.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "math/statistics.h"

namespace mgsfm {
namespace {

// The bound on the baselines of pairs (pair_filtering.h).
constexpr double kMaxRelativeError = 0.5;
// The expected motion is less certain where a rig brakes: with 0.2, the end of
// a sound drive was a jump.
constexpr double kMinErrorInSteps = 1.0;

struct Step {
  std::pair<int, int> frames;
  int time_gap = 0;
  double expected = 0.0;  // medians over the image pairs
  double actual = 0.0;
};

// The pairs of frames with an expected length.
std::vector<Step> CollectSteps(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph,
    const std::vector<std::optional<double>>& expected_length,
    const Reconstruction& reconstruction) {
  std::vector<Step> steps;
  for (const FramePairIndex::FramePair& frames : index.frame_pairs()) {
    if (!frames.IsBetweenFrames() || !frames.time_gap) continue;
    std::vector<double> expected, actual;
    for (const size_t i : frames.pair_idxs) {
      const ImagePair& pair = view_graph.pairs[i];
      if (scene.images[pair.image_idx1].sensor_idx !=
          scene.images[pair.image_idx2].sensor_idx) {
        continue;
      }
      const auto cam1 = reconstruction.CamFromWorld(scene, pair.image_idx1);
      const auto cam2 = reconstruction.CamFromWorld(scene, pair.image_idx2);
      if (!expected_length[i] || !cam1 || !cam2) continue;
      expected.push_back(*expected_length[i]);
      actual.push_back((cam2->Center() - cam1->Center()).norm());
    }
    if (expected.empty()) continue;
    steps.push_back({{frames.frame_idx1, frames.frame_idx2},
                     *frames.time_gap,
                     Median(std::move(expected)),
                     Median(std::move(actual))});
  }
  return steps;
}

}  // namespace

std::vector<std::pair<int, int>> FindMotionJumps(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph,
    const std::vector<std::optional<double>>& expected_length,
    const Reconstruction& reconstruction) {
  if (expected_length.empty()) return {};
  std::vector<Step> steps =
      CollectSteps(scene, index, view_graph, expected_length, reconstruction);
  if (steps.empty()) return {};
  std::vector<double> units, lengths;
  for (const Step& step : steps) units.push_back(step.actual / step.expected);
  const double unit = Median(std::move(units));
  for (Step& step : steps) {
    step.expected *= unit;
    lengths.push_back(step.expected / step.time_gap);
  }
  const double min_error = kMinErrorInSteps * Median(std::move(lengths));
  std::vector<std::pair<int, int>> jumps;
  for (const Step& step : steps) {
    if (std::abs(step.actual - step.expected) >
        std::max(min_error,
                 kMaxRelativeError * std::max(step.actual, step.expected))) {
      jumps.push_back(step.frames);
    }
  }
  return jumps;
}

}  // namespace mgsfm
