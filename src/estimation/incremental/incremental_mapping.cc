// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/incremental/incremental_mapping.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <utility>

#include "base/format.h"
#include "incremental/growing_model.h"
#include "incremental/loop_closure.h"
#include "incremental/sensor_placement.h"
#include "incremental/start.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

using Observer = std::function<void(const Reconstruction&)>;

// Tracks per image that let a model grow: ten times the inliers of a frame.
constexpr int kTracksPerImage = 300;
// Everything is adjusted when the model has grown by this factor.
constexpr double kGrowthFactor = 1.25;
// Frames with this share of the most visible points compete by their spread.
constexpr double kMinVisibleShare = 0.8;
// A frame that failed is tried again when it sees this much more.
constexpr double kRetryFactor = 1.2;

// The growth of one model.
class Growth {
 public:
  Growth(const GrowthInput& input, const Observer& observer,
         const Mask& frame_is_taken, GrowingModel* model,
         IncrementalResult* result)
      : input_(input),
        observer_(observer),
        frame_is_taken_(frame_is_taken),
        model_(*model),
        result_(*result),
        placement_(input),
        attempts_(input.scene.frames.size()) {
    for (size_t i = 0; i < attempts_.size(); ++i) {
      attempts_[i].frame_idx = static_cast<int>(i);
    }
  }

  void Run() {
    do {
      AdjustEverything();
    } while (GrowUntilStuck());
  }

  const std::vector<ResectedFrame>& attempts() const { return attempts_; }

 private:
  // Returns whether anything was added.
  bool GrowUntilStuck() {
    bool has_grown = PlaceSensors(false);
    while (true) {
      if (const std::optional<int> frame_idx = NextFrame()) {
        if (!Add(*frame_idx)) continue;
        has_grown = true;
        PlaceSensors(false);
        if (model_.num_frames() >= kGrowthFactor * num_adjusted_frames_) {
          AdjustEverything();
        }
      } else if (PlaceSensors(true)) {
        has_grown = true;
      } else {
        return has_grown;
      }
    }
  }

  void AdjustEverything() {
    input_.context.CheckInterrupted();
    model_.AdjustAll();
    placement_.Restart();
    ++result_.summary.num_adjustments;
    num_adjusted_frames_ = model_.num_frames();
    for (ResectedFrame& attempt : attempts_) attempt.num_keypoints = 0;
    if (observer_) observer_(model_.WithPoints());
  }

  bool PlaceSensors(bool is_last_resort) {
    const std::vector<PlacedSensor> placed =
        placement_.Place(is_last_resort, &model_);
    if (placed.empty()) return false;
    auto& all = result_.summary.placed_sensors;
    all.insert(all.end(), placed.begin(), placed.end());
    AdjustEverything();
    AdjustEverything();
    return true;
  }

  bool CanTry(int frame_idx, int num_visible) const {
    return num_visible >= input_.options.resection.abs_pose_min_num_inliers &&
           num_visible >= kRetryFactor * attempts_[frame_idx].num_keypoints;
  }

  std::optional<int> NextFrame() const {
    int most = 0;
    std::vector<int> num_visible(attempts_.size(), 0);
    for (size_t i = 0; i < num_visible.size(); ++i) {
      const int frame_idx = static_cast<int>(i);
      if (frame_is_taken_[i] || model_.HasFrame(frame_idx)) continue;
      const int num = model_.NumVisibleInFrame(frame_idx);
      if (!CanTry(frame_idx, num)) continue;
      num_visible[i] = num;
      most = std::max(most, num);
    }
    if (most == 0) return std::nullopt;
    std::optional<int> next;
    int widest = -1;
    for (size_t i = 0; i < num_visible.size(); ++i) {
      if (num_visible[i] < kMinVisibleShare * most) continue;
      const int spread = model_.Spread(static_cast<int>(i));
      if (spread <= widest) continue;
      widest = spread;
      next = static_cast<int>(i);
    }
    return next;
  }

  bool Add(int frame_idx) {
    input_.context.ReportProgress("incremental mapping", model_.num_frames(),
                                  attempts_.size());
    FrameRegistration found = RegisterFrame(input_, model_, frame_idx);
    if (found.loop && CloseLoop(input_, frame_idx, found, &model_)) {
      ++result_.summary.num_loop_closures;
      input_.context.Info("a loop is closed at frame '" +
                          input_.scene.frames[frame_idx].name + "'");
      found = RegisterFrame(input_, model_, frame_idx);
    }
    ResectedFrame& attempt = attempts_[frame_idx];
    attempt.num_images = 1;
    attempt.num_keypoints = found.num_keypoints;
    attempt.num_inliers = found.num_inliers;
    if (!found.rig_from_world) return false;
    model_.SetFrame(frame_idx, found.rig_from_world);
    model_.Triangulate({frame_idx});
    model_.AdjustAround(frame_idx);
    return true;
  }

  const GrowthInput& input_;
  const Observer& observer_;
  const Mask& frame_is_taken_;
  GrowingModel& model_;
  IncrementalResult& result_;
  SensorPlacement placement_;
  std::vector<ResectedFrame> attempts_;  // the last one, per frame
  int num_adjusted_frames_ = 0;
};

std::vector<std::vector<TrackKeypoint>> KeypointsOf(
    const Scene& scene, const ObservationGroups& tracks) {
  std::vector<std::vector<TrackKeypoint>> keypoints(scene.images.size());
  for (size_t t = 0; t < tracks.size(); ++t) {
    for (const Observation* o = tracks.begin(t); o != tracks.end(t); ++o) {
      keypoints[o->image_idx].push_back({o->keypoint_idx, static_cast<int>(t)});
    }
  }
  return keypoints;
}

// Known poses, and the reference sensors.
std::vector<std::optional<Rigid3>> KnownSensors(const Scene& scene) {
  std::vector<std::optional<Rigid3>> poses;
  for (const Sensor& sensor : scene.sensors) {
    poses.push_back(sensor.sensor_from_rig);
  }
  for (const Rig& rig : scene.rigs) poses[rig.ref_sensor_idx] = Rigid3();
  return poses;
}

}  // namespace

IncrementalResult MapIncrementally(
    const IncrementalInput& input, const IncrementalOptions& options,
    const Context& context,
    const std::function<void(const Reconstruction&)>& observer) {
  IncrementalResult result;
  TrackOptions track_options = options.tracks;
  if (track_options.max_tracks_per_image == 0) {
    track_options.max_tracks_per_image = kTracksPerImage;
  }
  const TrackResult tracks = EstablishTracks(
      input.scene, input.view_graph, Mask(input.view_graph.pairs.size(), true),
      track_options, context);
  result.summary.tracks = tracks.summary;
  const GrowthInput growth_input{input, options, context, tracks.estimate,
                                 KeypointsOf(input.scene, tracks.estimate)};
  StartFinder starts(growth_input);
  std::vector<std::optional<Rigid3>> sensors = KnownSensors(input.scene);
  Mask frame_is_taken(input.scene.frames.size());
  while (const auto model = starts.Start(sensors, frame_is_taken)) {
    Growth growth(growth_input, observer, frame_is_taken, model.get(), &result);
    growth.Run();
    context.Info(Formatted("model %zu: %d frames, %zu points",
                           result.estimate.size(), model->num_frames(),
                           model->num_points()));
    if (result.rejected.empty()) result.rejected = growth.attempts();
    if (model->num_frames() < options.min_num_frames) continue;
    sensors = model->poses().sensor_from_rig;
    result.estimate.push_back(model->WithPoints());
    for (size_t i = 0; i < frame_is_taken.size(); ++i) {
      if (model->HasFrame(static_cast<int>(i))) frame_is_taken[i] = true;
    }
  }
  std::vector<ResectedFrame>& rejected = result.rejected;
  rejected.erase(std::remove_if(rejected.begin(), rejected.end(),
                                [&](const ResectedFrame& frame) {
                                  return frame_is_taken[frame.frame_idx];
                                }),
                 rejected.end());
  return result;
}

}  // namespace mgsfm
