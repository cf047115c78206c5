// SPDX-License-Identifier: BSD-3-Clause
#include "seams/motion_jumps.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include "base/ranges.h"
#include "math/statistics.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

// The expected motion is less certain where a rig brakes: with 0.2, the end of
// a correct drive was a jump.
constexpr double kMinErrorInSteps = 1.0;

// Relative to the longer baseline: the noise of motions measured by depths.
constexpr double kMaxErrorOfConfirmed = 0.2;

using Eigen::Vector3d;

// The baseline of a pair of images, in the frame of the earlier one.
struct Baseline {
  Vector3d expected;
  Vector3d actual;
};

std::optional<Baseline> BaselineOf(const Scene& scene, const ImagePair& pair,
                                   bool is_reversed,
                                   const std::optional<Rigid3>& expected,
                                   const Reconstruction& reconstruction) {
  const auto cam1 = reconstruction.CamFromWorld(scene, pair.image_idx1);
  const auto cam2 = reconstruction.CamFromWorld(scene, pair.image_idx2);
  if (!expected || !cam1 || !cam2) return std::nullopt;
  const auto baseline = [&](const Rigid3& cam2_from_cam1) {
    return is_reversed ? cam2_from_cam1.translation : cam2_from_cam1.Center();
  };
  return Baseline{baseline(*expected), baseline(*cam2 * cam1->Inverse())};
}

// The difference of a step in the model from the expected one.
struct StepError {
  double error = 0.0;
  double longer = 0.0;  // of both baselines

  double Relative() const { return longer > 0.0 ? error / longer : 0.0; }
};

// Neighbors in time.
struct Step {
  int earlier = 0, later = 0;
  int time_gap = 0;
  double duration = 0.0;
  std::vector<Baseline> baselines;  // of image pairs of equal sensors

  // The median of a function of a baseline.
  template <class Function>
  double MedianOf(const Function& function) const {
    return Median(Transformed(baselines, function));
  }
  double ExpectedLength() const {
    return MedianOf([](const Baseline& b) { return b.expected.norm(); });
  }
  double ActualLength() const {
    return MedianOf([](const Baseline& b) { return b.actual.norm(); });
  }
  StepError ErrorOf(double unit) const {
    return {MedianOf([&](const Baseline& b) {
              return (b.actual - unit * b.expected).norm();
            }),
            std::max(ActualLength(), unit * ExpectedLength())};
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
  for (const FramePair& frames : index.frame_pairs()) {
    if (frames.IsBetweenFrames() && !frames.time_gap) continue;
    Step step;
    step.earlier = frames.frame_idx1;
    step.later = frames.frame_idx2;
    if (frames.IsBetweenFrames()) {
      if (index.order()->IsBefore(step.later, step.earlier)) {
        std::swap(step.earlier, step.later);
      }
      step.time_gap = *frames.time_gap;
      step.duration = index.order()->Duration(step.earlier, step.later);
    }
    for (const size_t i : frames.pair_idxs) {
      const ImagePair& pair = view_graph.pairs[i];
      const bool is_equal_sensor = IsOfOneSensor(scene, pair);
      if (frames.IsBetweenFrames() && !is_equal_sensor) continue;
      const auto baseline = BaselineOf(
          scene, pair, scene.images[pair.image_idx1].frame_idx != step.earlier,
          expected[i], reconstruction);
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
  std::vector<double> units = Transformed(
      baselines.within_frames,
      [](const Baseline& b) { return b.actual.norm() / b.expected.norm(); });
  if (units.empty()) {
    for (const Step& step : baselines.steps) {
      units.push_back(step.ActualLength() / step.ExpectedLength());
    }
  }
  return Median(std::move(units));
}

// The confirmed step that ends last before a step, or the first confirmed step
// after it; null if there is none.
const Step* FindConfirmed(const std::vector<const Step*>& confirmed,
                          const TemporalOrder& order, const Step& step,
                          bool is_before) {
  const Step* nearest = nullptr;
  for (const Step* candidate : confirmed) {
    const int from = is_before ? candidate->later : step.later;
    const int to = is_before ? step.earlier : candidate->earlier;
    const auto gap = order.Gap(from, to);
    if (!gap || order.IsBefore(to, from)) continue;
    const int nearest_gap =
        nearest == nullptr
            ? std::numeric_limits<int>::max()
            : *order.Gap(is_before ? nearest->later : step.later,
                         is_before ? step.earlier : nearest->earlier);
    if (*gap < nearest_gap) nearest = candidate;
  }
  return nearest;
}

// Whether the model continues a confirmed step, or leads to it, more smoothly
// than the expected motion.
bool IsSmoother(const Step& step, const Step& confirmed, double unit) {
  Vector3d reference = Vector3d::Zero();
  for (const Baseline& b : confirmed.baselines) reference += b.actual;
  reference *= step.duration / confirmed.duration /
               static_cast<double>(confirmed.baselines.size());
  return step.MedianOf([&](const Baseline& b) {
    return (b.actual - reference).norm() -
           (unit * b.expected - reference).norm();
  }) <= 0.0;
}

// Whether the model moves like the confirmed steps on both sides, and the
// expected motion does not.
bool IsRefuted(const Step& step, const std::vector<const Step*>& confirmed,
               const TemporalOrder& order, double unit) {
  const Step* before = FindConfirmed(confirmed, order, step, true);
  const Step* after = FindConfirmed(confirmed, order, step, false);
  return (before != nullptr || after != nullptr) &&
         (before == nullptr || IsSmoother(step, *before, unit)) &&
         (after == nullptr || IsSmoother(step, *after, unit));
}

bool HasMostFrames(const Reconstruction& reconstruction) {
  const auto& poses = reconstruction.rig_from_world;
  const auto num_registered =
      CountIf(poses, [](const auto& pose) { return pose.has_value(); });
  return 2 * static_cast<size_t>(num_registered) > poses.size();
}

}  // namespace

bool ComparedMotions::AreRefuted() const {
  return typical_error > kMaxErrorOfConfirmed;
}

ComparedMotions CompareMotions(
    const Scene& scene, const FramePairIndex& index,
    const ViewGraph& view_graph,
    const std::vector<std::optional<Rigid3>>& expected,
    const Reconstruction& reconstruction, double max_relative_error) {
  if (expected.empty()) return {};
  const Baselines baselines =
      CollectBaselines(scene, index, view_graph, expected, reconstruction);
  if (baselines.steps.empty()) return {};
  const double unit = UnitInModel(baselines);
  const double min_error =
      kMinErrorInSteps *
      Median(Transformed(baselines.steps, [&](const Step& step) {
        return unit * step.ExpectedLength() / step.time_gap;
      }));
  const std::vector<StepError> errors = Transformed(
      baselines.steps, [&](const Step& step) { return step.ErrorOf(unit); });
  ComparedMotions result;
  if (HasMostFrames(reconstruction)) {
    result.typical_error = Median(Transformed(
        errors, [](const StepError& error) { return error.Relative(); }));
  }
  std::vector<const Step*> jumps, confirmed;
  for (size_t k = 0; k < errors.size(); ++k) {
    const Step& step = baselines.steps[k];
    const StepError& error = errors[k];
    if (error.error > std::max(min_error, max_relative_error * error.longer)) {
      jumps.push_back(&step);
    } else if (error.Relative() <= kMaxErrorOfConfirmed) {
      confirmed.push_back(&step);
      result.confirmed.emplace_back(std::minmax(step.earlier, step.later));
    }
  }
  if (result.AreRefuted()) return result;
  for (const Step* step : jumps) {
    if (!IsRefuted(*step, confirmed, *index.order(), unit)) {
      result.jumps.emplace_back(std::minmax(step->earlier, step->later));
    }
  }
  return result;
}

}  // namespace mgsfm
