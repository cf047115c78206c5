// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/incremental/incremental_mapping.h"

#include <algorithm>
#include <cstddef>
#include <optional>

#include "base/format.h"
#include "base/ranges.h"
#include "incremental/growing_model.h"
#include "incremental/growth_steps.h"
#include "mgsfm/base/mask.h"
#include "pair_filtering/triplet_consistency.h"
#include "scene/track_coverage.h"

namespace mgsfm {
namespace {

using Observer = std::function<void(const Reconstruction&)>;

// No position error of KITTI 06, EuRoC and nuScenes changes by more than 2 %
// with other values (docs/maths/incremental.md).
//
// Tracks per image that let a model grow.
constexpr int kTracksPerImage = 300;
// Everything is adjusted when the model has grown by this factor.
constexpr double kGrowthFactor = 1.25;
// Frames with this share of the most visible points compete by their spread.
constexpr double kMinVisibleShare = 0.8;
// A frame that failed is tried again when it sees this much more.
constexpr double kRetryFactor = 1.2;
// A frame that adjustments leave without points is registered again, but not
// forever.
constexpr int kMaxNumRegistrations = 3;

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
        attempts_(input.scene.frames.size()) {}

  void Run() {
    do {
      AdjustEverything();
    } while (GrowUntilStuck());
  }

  // The same for a model that is adjusted.
  void Continue() {
    num_adjusted_frames_ = model_.num_frames();
    while (GrowUntilStuck() && !ListRejected().empty()) AdjustEverything();
  }

  // The frames that the model lacks, with the points that they see.
  std::vector<ResectedFrame> ListRejected() const {
    std::vector<ResectedFrame> rejected;
    for (size_t i = 0; i < attempts_.size(); ++i) {
      const int frame_idx = static_cast<int>(i);
      if (frame_is_taken_[i] || model_.HasFrame(frame_idx)) continue;
      ResectedFrame frame;
      frame.frame_idx = frame_idx;
      for (const int image_idx : input_.scene.frames[i].image_idxs) {
        frame.num_images +=
            model_.HasSensor(input_.scene.images[image_idx].sensor_idx);
      }
      frame.num_keypoints = model_.NumVisibleInFrame(frame_idx);
      frame.num_inliers = attempts_[i].num_inliers;
      rejected.push_back(frame);
    }
    return rejected;
  }

 private:
  // The attempts to register a frame.
  struct Attempts {
    int num_visible = 0;  // in the last one since everything was adjusted
    int num_inliers = 0;  // of the last one
    int num_registrations = 0;
  };

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
    model_.DropFramesWithFewPoints();
    placement_.Restart();
    ++result_.summary.num_adjustments;
    num_adjusted_frames_ = model_.num_frames();
    may_close_loop_ = true;
    for (Attempts& attempts : attempts_) attempts.num_visible = 0;
    if (observer_) observer_(model_.WithPoints());
  }

  bool PlaceSensors(bool is_last_resort) {
    const std::vector<PlacedSensor> placed =
        placement_.Place(is_last_resort, &model_);
    if (placed.empty()) return false;
    auto& all = result_.summary.placed_sensors;
    all.insert(all.end(), placed.begin(), placed.end());
    // The first adjustment triangulates with the new sensors, which the second
    // one refines.
    AdjustEverything();
    AdjustEverything();
    return true;
  }

  bool CanTry(int frame_idx, int num_visible) const {
    return num_visible >= model_.MinNumInliers(frame_idx) &&
           num_visible >= kRetryFactor * attempts_[frame_idx].num_visible &&
           attempts_[frame_idx].num_registrations < kMaxNumRegistrations;
  }

  std::optional<int> NextFrame() const {
    std::vector<int> num_visible(attempts_.size(), 0);
    std::vector<int> num_visible_beside = num_visible;
    for (size_t i = 0; i < num_visible.size(); ++i) {
      const int frame_idx = static_cast<int>(i);
      if (frame_is_taken_[i] || model_.HasFrame(frame_idx)) continue;
      const int num = model_.NumVisibleInFrame(frame_idx);
      if (num == 0 || !CanTry(frame_idx, num)) continue;
      num_visible[i] = num;
      if (model_.HasNeighborInModel(frame_idx)) num_visible_beside[i] = num;
    }
    const std::optional<int> beside = WidestOf(num_visible_beside);
    return beside ? beside : WidestOf(num_visible);
  }

  // The frame of the widest spread among those that see the most; nullopt if
  // all see nothing.
  std::optional<int> WidestOf(const std::vector<int>& num_visible) const {
    int most = 0;
    for (const int num : num_visible) most = std::max(most, num);
    std::optional<int> next;
    int widest = -1;
    for (size_t i = 0; most > 0 && i < num_visible.size(); ++i) {
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
    if (found.loop && may_close_loop_ && input_.held.frames.empty()) {
      // A loop that cannot be closed would show in the next frames, too.
      may_close_loop_ = CloseLoop(input_, frame_idx, found, &model_);
      if (may_close_loop_) {
        ++result_.summary.num_loop_closures;
        input_.context.Info("a loop is closed at frame '" +
                            input_.scene.frames[frame_idx].name + "'");
      }
      found = RegisterFrame(input_, model_, frame_idx);
    }
    Attempts& attempts = attempts_[frame_idx];
    attempts.num_visible = model_.NumVisibleInFrame(frame_idx);
    attempts.num_inliers = found.num_inliers;
    if (!found.rig_from_world) return false;
    ++attempts.num_registrations;
    model_.SetFrame(frame_idx, found.rig_from_world);
    model_.Triangulate({frame_idx});
    model_.AdjustAround(frame_idx);
    result_.added.push_back(
        {frame_idx, true, 0, found.num_keypoints, found.num_inliers});
    return true;
  }

  const GrowthInput& input_;
  const Observer& observer_;
  const Mask& frame_is_taken_;
  GrowingModel& model_;
  IncrementalResult& result_;
  SensorPlacement placement_;
  std::vector<Attempts> attempts_;  // per frame
  int num_adjusted_frames_ = 0;
  bool may_close_loop_ = true;
};

// The longest tracks that cover all images, from triplet-consistent matches.
// Pairs that no triplet confirms keep all matches: cameras of a rig may be
// matched within frames only.
TrackResult EstablishGrowthTracks(const IncrementalInput& input,
                                  const IncrementalOptions& options,
                                  const Context& context) {
  const ViewGraph& view_graph = input.view_graph;
  MatchSelection selection{input.pair_is_used, {}};
  selection.match_is_used = FindTripletConsistentMatches(
      view_graph, selection.pair_is_used, context.num_threads);
  size_t begin = 0;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const size_t end = begin + view_graph.pairs[i].matches.size();
    const Mask& used = selection.match_is_used;
    if (input.pair_is_used[i] &&
        std::none_of(used.begin() + begin, used.begin() + end,
                     [](bool is_used) { return is_used; })) {
      selection.match_is_used.Fill(begin, end, true);
    }
    begin = end;
  }
  const ObservationGroups candidates = EstablishCandidates(
      input.scene, view_graph, selection, options.tracks, context);
  TrackCoverage coverage(candidates, input.scene.images.size());
  const int max_num = options.tracks.max_tracks_per_image;
  coverage.Select(2, max_num > 0 ? max_num : kTracksPerImage);
  TrackResult result{coverage.Selected(), {}};
  TrackSummary& summary = result.summary;
  summary.num_components = candidates.size();
  summary.num_tracks = result.estimate.size();
  summary.num_observations = coverage.num_observations();
  summary.mean_track_length =
      static_cast<double>(summary.num_observations) /
      static_cast<double>(std::max<size_t>(summary.num_tracks, 1));
  return result;
}

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

std::vector<std::vector<int>> NeighborsOfFrames(const IncrementalInput& input) {
  std::vector<std::vector<int>> neighbors(input.scene.frames.size());
  for (size_t i = 0; i < input.view_graph.pairs.size(); ++i) {
    if (!input.pair_is_used[i] || !input.pair_is_of_neighbors[i]) continue;
    const ImagePair& pair = input.view_graph.pairs[i];
    const int a = input.scene.images[pair.image_idx1].frame_idx;
    const int b = input.scene.images[pair.image_idx2].frame_idx;
    if (a == b) continue;
    neighbors[a].push_back(b);
    neighbors[b].push_back(a);
  }
  for (std::vector<int>& of_frame : neighbors) SortUnique(&of_frame);
  return neighbors;
}

// Known poses, and the reference sensors.
std::vector<std::optional<Rigid3>> KnownSensors(const Scene& scene) {
  std::vector<std::optional<Rigid3>> poses =
      Transformed(scene.sensors, &Sensor::sensor_from_rig);
  for (const Rig& rig : scene.rigs) poses[rig.ref_sensor_idx] = Rigid3();
  return poses;
}

// A start can place a sensor by the pair of images of one frame.
void NotePlaced(int sensor_idx, IncrementalSummary* summary) {
  auto& placed = summary->placed_sensors;
  const bool is_noted = AnyOf(placed, [&](const PlacedSensor& s) {
    return s.sensor_idx == sensor_idx;
  });
  if (!is_noted) placed.push_back({sensor_idx, 1});
}

}  // namespace

IncrementalResult MapIncrementally(
    const IncrementalInput& input, const IncrementalOptions& options,
    const Context& context,
    const std::function<void(const Reconstruction&)>& observer) {
  IncrementalResult result;
  const TrackResult tracks = EstablishGrowthTracks(input, options, context);
  result.summary.tracks = tracks.summary;
  const GrowthInput growth_input{input,
                                 options,
                                 context,
                                 tracks.estimate,
                                 KeypointsOf(input.scene, tracks.estimate),
                                 NeighborsOfFrames(input)};
  StartFinder starts(growth_input);
  std::vector<std::optional<Rigid3>> sensors = KnownSensors(input.scene);
  Mask frame_is_taken(input.scene.frames.size());
  while (const auto model = starts.Start(sensors, frame_is_taken)) {
    Growth growth(growth_input, observer, frame_is_taken, model.get(), &result);
    growth.Run();
    context.Info(Formatted("model %zu: %d frames, %zu points",
                           result.estimate.size(), model->num_frames(),
                           model->num_points()));
    if (result.rejected.empty()) result.rejected = growth.ListRejected();
    if (model->num_frames() < options.min_num_frames) continue;
    for (size_t i = 0; i < sensors.size(); ++i) {
      const auto& pose = model->poses().sensor_from_rig[i];
      if (pose && !sensors[i]) NotePlaced(static_cast<int>(i), &result.summary);
      sensors[i] = pose;
    }
    result.estimate.push_back(model->WithPoints());
    for (size_t i = 0; i < frame_is_taken.size(); ++i) {
      if (model->HasFrame(static_cast<int>(i))) frame_is_taken[i] = true;
    }
  }
  auto& rejected = result.rejected;
  EraseIf(&rejected, [&](const ResectedFrame& frame) {
    return frame_is_taken[frame.frame_idx];
  });
  return result;
}

IncrementalResult GrowModel(
    const IncrementalInput& input, const ExistingModel& existing,
    const IncrementalOptions& options, const Context& context,
    const std::function<void(const Reconstruction&)>& observer) {
  const auto& [start, held] = existing;
  IncrementalResult result;
  const TrackResult tracks = EstablishGrowthTracks(input, options, context);
  result.summary.tracks = tracks.summary;
  const ObservationGroups joined =
      JoinPoints(input.scene, tracks.estimate, start.points,
                 /*with_others=*/true);
  const GrowthInput growth_input{input,
                                 options,
                                 context,
                                 joined,
                                 KeypointsOf(input.scene, joined),
                                 NeighborsOfFrames(input),
                                 held};
  Reconstruction poses = start;
  poses.sensor_from_rig = KnownSensors(input.scene);
  for (size_t i = 0; i < poses.sensor_from_rig.size(); ++i) {
    if (start.sensor_from_rig[i]) {
      poses.sensor_from_rig[i] = start.sensor_from_rig[i];
    }
  }
  GrowingModel model(growth_input, poses.sensor_from_rig);
  model.StartFrom(poses);
  const Mask no_frames(input.scene.frames.size());
  Growth growth(growth_input, observer, no_frames, &model, &result);
  growth.Continue();
  result.rejected = growth.ListRejected();
  EraseIf(&result.added, [&](const ResectedFrame& frame) {
    return !model.HasFrame(frame.frame_idx);
  });
  result.estimate.push_back(model.WithPoints());
  return result;
}

}  // namespace mgsfm
