// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/weak_seams.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "bundle_adjustment/relative_covariance.h"
#include "geometry/so3.h"
#include "mapper/model_adjustment.h"
#include "mapper/stage.h"
#include "mgsfm/base/mask.h"
#include "registration/side_motion.h"
#include "seams/motion_jumps.h"

namespace mgsfm {
namespace {

std::string Count(size_t number, const std::string& noun) {
  return std::to_string(number) + " " + noun + (number == 1 ? "" : "s");
}

// Per frame: the set of frames that no seam separates from it. Sets are
// numbered in the order of their first frames.
std::vector<int> SegmentsOfFrames(const Scene& scene,
                                  const std::vector<Seam>& seams) {
  std::vector<int> segments(scene.frames.size(), 0);
  for (const Seam& seam : seams) {
    Mask is_beyond(segments.size(), false);
    for (const int i : seam.frame_idxs_beyond) is_beyond[i] = true;
    std::map<std::pair<int, bool>, int> numbers;
    for (size_t i = 0; i < segments.size(); ++i) {
      const std::pair<int, bool> key(segments[i], is_beyond[i]);
      segments[i] =
          numbers.emplace(key, static_cast<int>(numbers.size())).first->second;
    }
  }
  return segments;
}

Reconstruction KeepSegment(const Scene& scene,
                           const std::vector<int>& segment_of_frame,
                           int segment, Reconstruction model) {
  for (size_t i = 0; i < segment_of_frame.size(); ++i) {
    if (segment_of_frame[i] != segment) model.rig_from_world[i].reset();
  }
  std::vector<Point3D> points;
  for (Point3D& point : model.points) {
    const auto is_elsewhere = [&](const Observation& observation) {
      return !model.IsRegistered(scene, observation.image_idx);
    };
    EraseIf(&point.track, is_elsewhere);
    if (point.track.size() >= 2) points.push_back(std::move(point));
  }
  model.points = std::move(points);
  return model;
}

int NumFrames(const MapperModel& model) {
  const auto& poses = model.reconstruction.rig_from_world;
  return static_cast<int>(
      CountIf(poses, [](const auto& pose) { return pose.has_value(); }));
}

// Segments and their numbers of registered frames.
std::map<int, int> CountFrames(const MapperModel& model,
                               const std::vector<int>& segment_of_frame) {
  std::map<int, int> num_frames;
  for (size_t i = 0; i < segment_of_frame.size(); ++i) {
    if (model.reconstruction.rig_from_world[i]) {
      ++num_frames[segment_of_frame[i]];
    }
  }
  return num_frames;
}

// The number of registered frames in segments of at least min_num_frames.
int NumFramesInSegments(const Scene& scene, const MapperModel& model,
                        const std::vector<Seam>& seams, int min_num_frames) {
  int num_left = 0;
  for (const auto& [segment, number] :
       CountFrames(model, SegmentsOfFrames(scene, seams))) {
    if (number >= min_num_frames) num_left += number;
  }
  return num_left;
}

// The used pairs of a segment.
Mask PairsOfSegment(const AdjustmentInput& input, Mask pair_is_used,
                    const std::vector<int>& segment_of_frame, int segment) {
  const auto is_elsewhere = [&](int image_idx) {
    return segment_of_frame[input.scene.images[image_idx].frame_idx] != segment;
  };
  for (size_t i = 0; i < pair_is_used.size(); ++i) {
    const ImagePair& pair = input.view_graph.pairs[i];
    if (is_elsewhere(pair.image_idx1) || is_elsewhere(pair.image_idx2)) {
      pair_is_used[i] = false;
    }
  }
  return pair_is_used;
}

// A part of a model, and the used pairs within it.
struct Part {
  MapperModel model;
  Mask pair_is_used;
};

// The parts that no seam divides and that are large enough, the largest last.
std::vector<Part> Divide(const Part& whole, const std::vector<Seam>& seams,
                         const AdjustmentInput& input,
                         const MapperOptions& options) {
  const Scene& scene = input.scene;
  const std::vector<int> segment_of_frame = SegmentsOfFrames(scene, seams);
  const std::map<int, int> counts = CountFrames(whole.model, segment_of_frame);
  std::vector<std::pair<int, int>> segments(counts.begin(), counts.end());
  StableSortDescendingBy(&segments, [](const auto& a) { return a.second; });
  std::reverse(segments.begin(), segments.end());
  std::vector<Part> parts;
  for (const auto& [segment, num_frames] : segments) {
    MapperModel model = whole.model;
    model.reconstruction = KeepSegment(scene, segment_of_frame, segment,
                                       std::move(model.reconstruction));
    if (!IsLargeEnough(model, options)) continue;
    parts.push_back(
        {std::move(model),
         PairsOfSegment(input, whole.pair_is_used, segment_of_frame, segment)});
  }
  return parts;
}

// Parts are adjusted, and divided until none has such a seam: pairs of other
// parts can hide one.
std::vector<MapperModel> SplitAtSeams(const AdjustmentInput& input,
                                      const MapperOptions& options,
                                      const Context& context,
                                      const std::vector<Seam>& seams,
                                      const ConfidenceFunction& confidence_of,
                                      MapperModel model) {
  std::vector<Part> waiting =
      Divide({std::move(model), input.pair_is_used}, seams, input, options);
  std::vector<MapperModel> finished;
  size_t num_learned = 0;
  while (!waiting.empty()) {
    Part part = std::move(waiting.back());
    waiting.pop_back();
    for (; input.calibration && num_learned < finished.size(); ++num_learned) {
      PassOn(finished[num_learned], input.positions, options, context,
             input.calibration);
    }
    AdjustmentInput of_part = input;
    of_part.pair_is_used = part.pair_is_used;
    Reconstruction initial = std::move(part.model.reconstruction);
    AdjustModel(of_part, options, context, std::move(initial), &part.model);
    if (!IsLargeEnough(part.model, options)) continue;
    part.model.confidence = confidence_of(part.pair_is_used, part.model);
    const std::vector<Seam> of_part_seams =
        SeamsToSplit(input.scene, part.model, options);
    if (of_part_seams.empty()) {
      finished.push_back(std::move(part.model));
      continue;
    }
    for (Part& smaller : Divide(part, of_part_seams, input, options)) {
      waiting.push_back(std::move(smaller));
    }
  }
  return finished;
}

// The pairs of neighbors in time across a seam.
std::vector<size_t> FindCrossing(const FramePairIndex& index,
                                 const Mask& frame_is_beyond,
                                 const Reconstruction& model) {
  std::vector<size_t> crossing;
  for (size_t i = 0; i < index.num_pairs(); ++i) {
    const FramePair& frames = index.Of(i);
    if (index.AreNeighbors(frames) &&
        frame_is_beyond[frames.frame_idx1] !=
            frame_is_beyond[frames.frame_idx2] &&
        model.rig_from_world[frames.frame_idx1] &&
        model.rig_from_world[frames.frame_idx2]) {
      crossing.push_back(i);
    }
  }
  return crossing;
}

// Their matches before verification.
ViewGraph MatchesAcross(const AdjustmentInput& input,
                        const std::vector<size_t>& crossing) {
  ViewGraph matches;
  for (const size_t i : crossing) {
    const ImagePair& pair = input.view_graph.pairs[i];
    const ImagePair* source =
        FindPair(input.matches, pair.image_idx1, pair.image_idx2);
    if (source != nullptr) matches.pairs.push_back(*source);
  }
  return matches;
}

// The model with the side beyond the seam moved, and triangulated again.
MapperModel Realign(const AdjustmentInput& input, const MapperOptions& options,
                    const Context& context, const Mask& frame_is_beyond,
                    const Rigid3& beyond_from_core, const MapperModel& model) {
  MapperModel realigned = model;
  Reconstruction initial = model.reconstruction;
  for (size_t i = 0; i < initial.rig_from_world.size(); ++i) {
    auto& pose = initial.rig_from_world[i];
    if (pose && frame_is_beyond[i]) pose = *pose * beyond_from_core;
  }
  initial = TriangulateCandidates(
      input.scene,
      MakeCandidateSource(input.scene, input.view_graph, input.matches,
                          input.pair_is_used, options, context),
      initial, options.bundle_adjustment, context);
  AdjustModel(input, options, context, std::move(initial), &realigned);
  return realigned;
}

}  // namespace

Confidence EstimateModelConfidence(const ConfidenceInput& input,
                                   const MapperOptions& options,
                                   const Context& context) {
  Confidence confidence = EstimateConfidence(input, options.confidence);
  const std::vector<std::pair<int, int>> frame_pairs =
      Transformed(confidence.seams, [](const Seam& seam) {
        return std::pair<int, int>(seam.frame_idx_core, seam.frame_idx_beyond);
      });
  const auto covariances = ComputeRelativeCovariances(
      input.scene, input.reconstruction, options.bundle_adjustment, frame_pairs,
      context);
  for (size_t i = 0; i < covariances.size(); ++i) {
    if (!covariances[i]) continue;
    const PoseMatrix& covariance = *covariances[i];
    confidence.seams[i].sigma_rotation_deg =
        RadToDeg(std::sqrt(covariance.topLeftCorner<3, 3>().trace()));
    confidence.seams[i].sigma_position =
        std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
  }
  return confidence;
}

std::optional<Finding> DescribeSeams(const Scene& scene,
                                     const Confidence& confidence) {
  if (confidence.seams.empty()) return std::nullopt;
  const Seam& weakest = confidence.seams.front();
  const size_t num_seams = confidence.seams.size();
  const size_t num_beyond = weakest.frame_idxs_beyond.size();
  const std::string& core = scene.frames[weakest.frame_idx_core].name;
  const std::string& beyond = scene.frames[weakest.frame_idx_beyond].name;
  const std::string text =
      "the model can be wrong at " + Count(num_seams, "weak seam") +
      "; at the weakest, between frames '" + core + "' and '" + beyond + "', " +
      Count(weakest.num_tracks, "point") + " (" +
      std::to_string(weakest.num_ties) + " of at least two frames on either " +
      "side) and " + std::to_string(weakest.num_confirmed) +
      " matches connect " + Count(num_beyond, "frame") + " to the others, " +
      std::to_string(weakest.num_against) + " matches contradict them";
  return Finding{Cause::kWeakSeams,
                 {},
                 {core, beyond},
                 {{"num_seams", static_cast<double>(num_seams)},
                  {"num_tracks", weakest.num_tracks},
                  {"num_ties", weakest.num_ties},
                  {"num_confirmed_matches", weakest.num_confirmed},
                  {"num_matches_against", weakest.num_against}},
                 text,
                 "look at the images there, match more frames across the seam, "
                 "or split the model at its seams"};
}

std::vector<Seam> SeamsToSplit(const Scene& scene, const MapperModel& model,
                               const MapperOptions& options) {
  if (options.weak_seams == WeakSeams::kSplit) return model.confidence.seams;
  std::vector<Seam> unconnected, wrong;
  for (const Seam& seam : model.confidence.seams) {
    const bool is_unconnected =
        (!seam.sigma_position || seam.reason == SeamReason::kOnePlace ||
         seam.reason == SeamReason::kRefutedLoops) &&
        !model.IsAtPositions();
    if (is_unconnected) unconnected.push_back(seam);
    if (is_unconnected || seam.reason == SeamReason::kJump) {
      wrong.push_back(seam);
    }
  }
  if (options.weak_seams == WeakSeams::kKeep) return unconnected;
  const int num_left =
      NumFramesInSegments(scene, model, wrong, options.min_num_frames);
  return 2 * num_left < NumFrames(model) ? unconnected : wrong;
}

std::vector<MapperModel> TestSeams(
    const FramePairIndex& index,
    const std::vector<std::optional<Rigid3>>& pair_on_path,
    const MapperOptions& options, const Context& context, AdjustmentInput input,
    MapperModel model) {
  const auto compare = [&](const MapperModel& adjusted) {
    return CompareMotions(input.scene, index, input.view_graph, pair_on_path,
                          adjusted.reconstruction,
                          options.pair_filtering.max_relative_baseline_error);
  };
  const auto confidence_of = [&](const Mask& pair_is_used,
                                 const MapperModel& adjusted) {
    return EstimateModelConfidence(
        {input.scene, index, input.view_graph, pair_is_used,
         adjusted.rejected_groups, adjusted.reconstruction, compare(adjusted)},
        options, context);
  };
  {
    const RunningStage stage("seams", context);
    model.confidence = confidence_of(input.pair_is_used, model);
    model.refutes_motion = compare(model).AreRefuted();
    stage.Finish(&model.times);
  }
  if (model.refutes_motion) return {std::move(model)};
  RealignSides(index, options, context, confidence_of, &input, &model);
  const std::vector<Seam> seams = SeamsToSplit(input.scene, model, options);
  if (seams.empty()) return {std::move(model)};
  context.Info("the model is split at " + std::to_string(seams.size()) +
               " of its weak seams");
  return SplitAtSeams(input, options, context, seams, confidence_of,
                      std::move(model));
}

bool IsLargeEnough(const MapperModel& model, const MapperOptions& options) {
  return NumFrames(model) >= options.min_num_frames &&
         !model.reconstruction.points.empty();
}

void RealignSides(const FramePairIndex& index, const MapperOptions& options,
                  const Context& context,
                  const ConfidenceFunction& confidence_of,
                  AdjustmentInput* input, MapperModel* model) {
  if (model->confidence.seams.empty()) return;
  const Bearings bearings = ComputeBearings(
      input->scene, model->reconstruction.cameras, context.num_threads);
  std::set<std::vector<int>> tested;  // sides, so that the test ends
  for (size_t k = 0; k < model->confidence.seams.size();) {
    const Seam& seam = model->confidence.seams[k];
    if (!tested.insert(seam.frame_idxs_beyond).second) {
      ++k;
      continue;
    }
    Mask frame_is_beyond(input->scene.frames.size(), false);
    for (const int i : seam.frame_idxs_beyond) frame_is_beyond[i] = true;
    std::vector<int> core;
    for (size_t i = 0; i < frame_is_beyond.size(); ++i) {
      if (!frame_is_beyond[i]) core.push_back(static_cast<int>(i));
    }
    const auto count_ties = [&](const MapperModel& m) {
      return CountTies(input->scene, m.reconstruction, core,
                       seam.frame_idxs_beyond);
    };
    const std::vector<size_t> crossing =
        FindCrossing(index, frame_is_beyond, model->reconstruction);
    const auto motion = FindMotionOfSide(
        {input->scene, bearings, MatchesAcross(*input, crossing),
         model->reconstruction, frame_is_beyond,
         options.bundle_adjustment.max_max_error_px,
         options.view_graph.min_num_inliers},
        context);
    ++k;
    if (!motion) continue;
    AdjustmentInput with_crossing = *input;
    for (const size_t i : crossing) with_crossing.pair_is_used[i] = true;
    MapperModel realigned = Realign(with_crossing, options, context,
                                    frame_is_beyond, *motion, *model);
    if (!IsSignificantlyMore(count_ties(realigned), count_ties(*model))) {
      continue;
    }
    realigned.confidence = confidence_of(with_crossing.pair_is_used, realigned);
    context.Info("the side of " +
                 std::to_string(seam.frame_idxs_beyond.size()) +
                 " frames beyond a weak seam is moved to where more matches "
                 "agree");
    *model = std::move(realigned);
    input->pair_is_used = std::move(with_crossing.pair_is_used);
    k = 0;  // of the new seams
  }
}

}  // namespace mgsfm
