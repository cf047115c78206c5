// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/pair_judgement.h"

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>

#include "base/ranges.h"
#include "mapper/components.h"
#include "mapper/stage.h"
#include "math/union_find.h"
#include "mgsfm/tracks/track_establishment.h"
#include "moving_objects/moving_objects.h"
#include "translation_averaging/position_estimation.h"

namespace mgsfm {
namespace {

// Duplicate structures join places that time separates.
bool HasLoops(const FramePairIndex& index, const PairVerdicts& verdicts) {
  if (!index.is_sequence()) return true;
  for (size_t i = 0; i < verdicts.size(); ++i) {
    if (!verdicts[i] && index.IsLoop(index.Of(i))) return true;
  }
  return false;
}

// Positions by a single forest drift: on the simulated drive 00, they
// contradict right loops, and an extension is 0.098 m off. With two, three or
// five forests, it is 0.062 m off.
constexpr int kNumForests = 2;

// Maximum spanning forests of the pairs of the model, weighted by matches.
// Loops come last: the rules know the parts of a sequence by its neighbors.
Mask SelectForests(const std::vector<MatchedImages>& of_model,
                   const MapperRunInput& run) {
  const FramePairIndex index(run.scene, of_model,
                             run.options.pair_filtering.is_sequence);
  std::vector<size_t> order = Indices<size_t>(of_model.size());
  StableSortDescendingBy(&order, [&](size_t i) {
    return std::pair(!index.IsLoop(index.Of(i)), of_model[i].num_matches);
  });
  std::vector<UnionFind> forests(kNumForests,
                                 UnionFind(run.scene.images.size()));
  Mask is_selected(of_model.size());
  for (const size_t i : order) {
    is_selected[i] =
        std::any_of(forests.begin(), forests.end(), [&](UnionFind& connected) {
          return connected.Union(of_model[i].image_idx1,
                                 of_model[i].image_idx2);
        });
  }
  return is_selected;
}

// The verified pairs and those of the model, each once.
std::vector<MatchedImages> AllPairs(std::vector<MatchedImages> of_model,
                                    const ViewGraph& verified) {
  std::vector<MatchedImages> all = std::move(of_model);
  for (const ImagePair& pair : verified.pairs) {
    all.push_back({pair.image_idx1, pair.image_idx2, pair.matches.size()});
  }
  const auto images_of = [](const MatchedImages& pair) {
    return std::pair(pair.image_idx1, pair.image_idx2);
  };
  StableSortBy(&all, images_of);
  all.erase(std::unique(all.begin(), all.end(),
                        [&](const auto& a, const auto& b) {
                          return images_of(a) == images_of(b);
                        }),
            all.end());
  return all;
}

ViewGraph SelectPairs(const ViewGraph& view_graph,
                      const std::vector<size_t>& pair_idxs) {
  ViewGraph selected;
  for (const size_t i : pair_idxs) {
    selected.pairs.push_back(view_graph.pairs[i]);
  }
  return selected;
}

std::vector<size_t> PairsOfFrames(const Scene& scene,
                                  const ViewGraph& view_graph,
                                  const Mask& frames) {
  std::vector<size_t> pair_idxs;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (frames[scene.images[pair.image_idx1].frame_idx] &&
        frames[scene.images[pair.image_idx2].frame_idx]) {
      pair_idxs.push_back(i);
    }
  }
  return pair_idxs;
}

// Replaces the values of some pairs, if there are any, by values of all pairs:
// those at `pair_idxs` are the given ones.
template <class T>
void ExpandToWhole(const std::vector<size_t>& pair_idxs, size_t num_pairs,
                   std::vector<T>* values) {
  if (values->empty()) return;
  std::vector<T> of_whole(num_pairs);
  for (size_t k = 0; k < pair_idxs.size(); ++k) {
    of_whole[pair_idxs[k]] = std::move((*values)[k]);
  }
  *values = std::move(of_whole);
}

MotionOfScene FindObjectsAmong(const Mask& frames, const MotionInput& input,
                               const MotionOptions& options,
                               const Context& context) {
  const std::vector<size_t> pair_idxs =
      PairsOfFrames(input.scene, input.view_graph, frames);
  const ViewGraph view_graph = SelectPairs(input.view_graph, pair_idxs);
  const ViewGraph matches = SelectPairs(
      input.matches, PairsOfFrames(input.scene, input.matches, frames));
  const FramePairIndex index(input.scene, view_graph, input.index);
  MotionOfScene motion =
      FindMovingObjects({input.scene, input.bearings, index, view_graph,
                         matches, input.rotations},
                        options, context);
  const size_t num_pairs = input.view_graph.pairs.size();
  ExpandToWhole(pair_idxs, num_pairs, &motion.verdicts);
  ExpandToWhole(pair_idxs, num_pairs, &motion.pair_of_scene);
  ExpandToWhole(pair_idxs, num_pairs, &motion.pair_on_path);
  return motion;
}

// The frames with images that the model lacks, and those that share a pair with
// one.
Mask FindFramesNearNew(const Scene& scene, const Reconstruction& model,
                       const FramePairIndex& index) {
  Mask is_new(scene.frames.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (!model.IsRegistered(scene, static_cast<int>(i))) {
      is_new[scene.images[i].frame_idx] = true;
    }
  }
  Mask is_near(scene.frames.size());
  for (const FramePair& pair : index.frame_pairs()) {
    if (is_new[pair.frame_idx1] || is_new[pair.frame_idx2]) {
      is_near[pair.frame_idx1] = true;
      is_near[pair.frame_idx2] = true;
    }
  }
  return is_near;
}

}  // namespace

MotionOfScene RemoveMovingObjects(const MapperRunInput& run,
                                  const FramePairIndex& index,
                                  const Mask* frames,
                                  const RotationEstimate& rotations,
                                  VerifiedPairs* pairs,
                                  std::vector<StageTime>* times) {
  const MapperOptions& options = run.options;
  if (!index.is_sequence() || !IsRuleOn(RejectionReason::kDiscontinuousMotion,
                                        options.pair_filtering)) {
    return {};
  }
  ViewGraph& view_graph = pairs->view_graph;
  const MotionInput input{pairs->scene, pairs->bearings,  index,
                          view_graph,   pairs->matches(), rotations};
  const MotionOptions motion_options{
      options.translation_averaging.min_parallax_deg, options.view_graph,
      options.pair_filtering};
  const RunningStage stage("moving objects", run.context);
  MotionOfScene motion =
      frames ? FindObjectsAmong(*frames, input, motion_options, stage.context())
             : FindMovingObjects(input, motion_options, stage.context());
  stage.Finish(times);
  if (motion.verdicts.empty()) return {};
  auto pair_of_scene = std::exchange(motion.pair_of_scene, {});
  for (size_t i = 0; i < pair_of_scene.size(); ++i) {
    if (pair_of_scene[i]) view_graph.pairs[i] = std::move(*pair_of_scene[i]);
  }
  const auto num_pairs = CountIf(
      motion.verdicts, [](const auto& verdict) { return verdict.has_value(); });
  if (num_pairs > 0) {
    run.context.Info(std::to_string(num_pairs) + " of " +
                     std::to_string(view_graph.pairs.size()) +
                     " image pairs contradict the motion of the rig between "
                     "their frames and are not used");
  }
  return motion;
}

void RejectByPositions(const MapperRunInput& run, const VerifiedPairs& pairs,
                       const FramePairIndex& index, JudgedPairs* judged,
                       std::vector<StageTime>* times) {
  PairVerdicts& verdicts = judged->rotations.verdicts;
  const RotationEstimate& rotations = judged->rotations.estimate;
  if (!IsRuleOn(RejectionReason::kInconsistentBaseline,
                run.options.pair_filtering) ||
      !HasLoops(index, verdicts)) {
    return;
  }
  const RunningStage stage("translation averaging", run.context);
  PositionObjective objective = kNonBilinearObjective;
  objective.refine_cameras_and_points = nullptr;
  const std::vector<int> num_frames = CountFramesOfComponents(rotations);
  for (size_t k = 0; k < num_frames.size(); ++k) {
    if (num_frames[k] < run.options.min_num_frames) continue;
    const PositionResult positions = EstimatePositionsBy(
        objective,
        {run.scene, pairs.bearings, pairs.view_graph, index,
         SelectComponent(pairs, rotations, static_cast<int>(k)),
         ObservationGroups(), &judged->motion.pair_on_path},
        {run.options.translation_averaging, run.options.pair_filtering},
        stage.context());
    Reject(positions.pair_is_beyond_drift_bound,
           RejectionReason::kBaselineBeyondDriftBound, &verdicts);
    Reject(positions.pair_is_inconsistent,
           RejectionReason::kInconsistentBaseline, &verdicts);
  }
  stage.Finish(times);
}

Mask FindPairsOfNeighbors(const FramePairIndex& index) {
  Mask are_neighbors(index.num_pairs());
  if (!index.is_sequence()) return are_neighbors;
  std::vector<int> part_of_frame(index.num_frames(), 0);
  int part = 0;
  for (const std::vector<int>& sequence : index.order()->sequences()) {
    for (const int frame_idx : sequence) {
      if (index.order()->IsAfterBreak(frame_idx)) ++part;
      part_of_frame[frame_idx] = part;
    }
  }
  for (size_t i = 0; i < are_neighbors.size(); ++i) {
    const FramePair& frames = index.Of(i);
    are_neighbors[i] =
        frames.IsBetweenFrames() && index.AreNeighbors(frames) &&
        part_of_frame[frames.frame_idx1] == part_of_frame[frames.frame_idx2];
  }
  return are_neighbors;
}

std::optional<PairsOfExtension> SelectPairsOfExtension(
    const MapperRunInput& run) {
  const auto& model = run.input.existing_model;
  if (!model || model->points.empty()) return std::nullopt;
  Mask is_new(run.scene.images.size());
  for (size_t i = 0; i < run.scene.images.size(); ++i) {
    is_new[i] = !model->IsRegistered(run.scene, static_cast<int>(i));
  }
  if (is_new.Count() == 0) return std::nullopt;
  const std::vector<ImagePair>& pairs = run.matches.pairs;
  const std::vector<std::ptrdiff_t> num_matches =
      CountMatchesOfPoints(run.scene, run.matches, model->points);
  PairsOfExtension selected;
  Mask is_used(pairs.size());
  std::vector<size_t> pairs_of_model;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const auto [image_idx1, image_idx2] =
        std::pair(pairs[i].image_idx1, pairs[i].image_idx2);
    is_used[i] = is_new[image_idx1] || is_new[image_idx2];
    if (is_used[i] || num_matches[i] == 0) continue;
    pairs_of_model.push_back(i);
    selected.of_model.push_back(
        {image_idx1, image_idx2, static_cast<size_t>(num_matches[i])});
  }
  const Mask is_in_forest = SelectForests(selected.of_model, run);
  for (size_t k = 0; k < pairs_of_model.size(); ++k) {
    if (is_in_forest[k]) is_used[pairs_of_model[k]] = true;
  }
  for (size_t i = 0; i < pairs.size(); ++i) {
    if (is_used[i]) selected.matches.pairs.push_back(pairs[i]);
  }
  return selected;
}

PairsToGrowOn JudgePairsOfExtension(const MapperRunInput& run,
                                    const PairsOfExtension* selected,
                                    VerifiedPairs* pairs,
                                    std::vector<StageTime>* times) {
  const SequenceMode mode = run.options.pair_filtering.is_sequence;
  const FramePairIndex all(
      run.scene,
      AllPairs(selected ? selected->of_model : std::vector<MatchedImages>(),
               pairs->view_graph),
      mode);
  const FramePairIndex index(run.scene, pairs->view_graph, all);
  const Mask frames =
      FindFramesNearNew(run.scene, *run.input.existing_model, index);
  JudgedPairs judged =
      JudgePairs(run, index, selected ? &frames : nullptr, pairs, times);
  RejectByPositions(run, *pairs, index, &judged, times);
  return {std::move(judged.rotations.verdicts), FindPairsOfNeighbors(index)};
}

}  // namespace mgsfm
