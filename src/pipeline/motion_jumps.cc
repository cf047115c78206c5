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

// Of the longer of both baselines: the noise of motions that depths measure.
constexpr double kMaxErrorOfConfirmed = 0.2;

using Eigen::Vector3d;

// The baseline of a pair of images, in the frame of the second one.
struct Baseline {
  Vector3d expected;
  Vector3d actual;
};

std::optional<Baseline> BaselineOf(const Scene& scene, const ImagePair& pair,
                                   const std::optional<Rigid3>& expected,
                                   const Reconstruction& reconstruction) {
  const auto cam1 = reconstruction.CamFromWorld(scene, pair.image_idx1);
  const auto cam2 = reconstruction.CamFromWorld(scene, pair.image_idx2);
  if (!expected || !cam1 || !cam2) return std::nullopt;
  return Baseline{expected->translation, (*cam2 * cam1->Inverse()).translation};
}

// Neighbours in time.
struct Step {
  std::pair<int, int> frames;
  int time_gap = 0;
  std::vector<Baseline> baselines;  // of image pairs of equal sensors

  // The median of a function of a baseline.
  template <class Function>
  double MedianOf(const Function& function) const {
    std::vector<double> values;
    for (const Baseline& baseline : baselines)
      values.push_back(function(baseline));
    return Median(std::move(values));
  }
  double ExpectedLength() const {
    return MedianOf([](const Baseline& b) { return b.expected.norm(); });
  }
  double ActualLength() const {
    return MedianOf([](const Baseline& b) { return b.actual.norm(); });
  }
};

struct Baselines {
  std::vector<Step> steps;
  std::vector<Baseline> within_frames;
};

Baselines CollectBaselines(const Scene& scene, const FramePairIndex& index,
                           const ViewGraph& view_graph,
                           const std::vector<std::optional<Rigid3>>& expected,
                           const Reconstruction& reconstruction) {
  Baselines result;
  for (const FramePairIndex::FramePair& frames : index.frame_pairs()) {
    if (frames.IsBetweenFrames() && !frames.time_gap) continue;
    Step step{{frames.frame_idx1, frames.frame_idx2},
              frames.time_gap.value_or(0),
              {}};
    for (const size_t i : frames.pair_idxs) {
      const ImagePair& pair = view_graph.pairs[i];
      const bool is_equal_sensor = scene.images[pair.image_idx1].sensor_idx ==
                                   scene.images[pair.image_idx2].sensor_idx;
      if (frames.IsBetweenFrames() && !is_equal_sensor) continue;
      const auto baseline =
          BaselineOf(scene, pair, expected[i], reconstruction);
      if (!baseline || baseline->expected.isZero(0.0)) continue;
      (frames.IsBetweenFrames() ? step.baselines : result.within_frames)
          .push_back(*baseline);
    }
    if (!step.baselines.empty()) result.steps.push_back(std::move(step));
  }
  return result;
}

// The unit of length of the expected poses, in units of the model.
double UnitInModel(const Baselines& baselines) {
  std::vector<double> units;
  for (const Baseline& b : baselines.within_frames) {
    units.push_back(b.actual.norm() / b.expected.norm());
  }
  if (units.empty()) {
    for (const Step& step : baselines.steps) {
      units.push_back(step.ActualLength() / step.ExpectedLength());
    }
  }
  return Median(std::move(units));
}

}  // namespace

ComparedMotions CompareMotions(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph,
    const std::vector<std::optional<Rigid3>>& expected,
    const Reconstruction& reconstruction) {
  if (expected.empty()) return {};
  const Baselines baselines =
      CollectBaselines(scene, index, view_graph, expected, reconstruction);
  if (baselines.steps.empty()) return {};
  const double unit = UnitInModel(baselines);
  std::vector<double> lengths;
  for (const Step& step : baselines.steps) {
    lengths.push_back(unit * step.ExpectedLength() / step.time_gap);
  }
  const double min_error = kMinErrorInSteps * Median(std::move(lengths));
  ComparedMotions result;
  for (const Step& step : baselines.steps) {
    const double error = step.MedianOf([&](const Baseline& b) {
      return (b.actual - unit * b.expected).norm();
    });
    const double longer =
        std::max(step.ActualLength(), unit * step.ExpectedLength());
    if (error > std::max(min_error, kMaxRelativeError * longer)) {
      result.jumps.push_back(step.frames);
    } else if (error <= kMaxErrorOfConfirmed * longer) {
      result.confirmed.push_back(step.frames);
    }
  }
  return result;
}

}  // namespace mgsfm
