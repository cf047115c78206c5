// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/components.h"

#include <algorithm>
#include <string>

#include "base/ranges.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {
namespace {

void LogRejectedPairs(const Scene& scene,
                      const std::vector<RejectedGroup>& groups,
                      size_t num_pairs, const Context& context) {
  int num_rejected = 0;
  for (const RejectedGroup& group : groups) {
    num_rejected += static_cast<int>(group.pair_idxs.size());
    context.Debug(DescribeRejectedGroup(scene, group));
  }
  if (num_rejected == 0) return;
  context.Info(std::to_string(num_rejected) + " of " +
               std::to_string(num_pairs) +
               " image pairs contradict the others and are not used");
}

// Sorts by descending number of frames, which splitting a component changes.
void SortBySize(std::vector<MapperModel>* models) {
  const auto num_frames = [](const MapperModel& model) {
    const auto& poses = model.reconstruction.rig_from_world;
    return CountIf(poses, [](const auto& pose) { return pose.has_value(); });
  };
  StableSortDescendingBy(models, num_frames);
}

// Drops the models of fewer than min_model_size images, except for the first
// model. Returns which frames the models have.
Mask DropSmallModels(const Scene& scene, int min_model_size,
                     std::vector<MapperModel>* models) {
  Mask is_dropped(scene.frames.size(), false);
  if (models->empty()) return is_dropped;
  const auto small = std::stable_partition(
      models->begin() + 1, models->end(), [&](const MapperModel& model) {
        return model.reconstruction.NumRegisteredImages(scene) >=
               min_model_size;
      });
  for (auto model = small; model != models->end(); ++model) {
    for (size_t i = 0; i < is_dropped.size(); ++i) {
      if (model->reconstruction.rig_from_world[i]) is_dropped[i] = true;
    }
  }
  models->erase(small, models->end());
  return is_dropped;
}

// Why a frame is in no model.
std::string ReasonWithoutModel(
    const std::optional<int>& num_frames_of_component, bool is_ambiguous,
    bool is_in_small_model, const MapperOptions& options) {
  if (!num_frames_of_component) {
    return is_ambiguous ? "its motion is ambiguous: two rigid motions explain "
                          "its matches equally well"
                        : "no image pair with consistent geometry links it to "
                          "others";
  }
  if (*num_frames_of_component < options.min_num_frames) {
    return "its connected component has fewer than " +
           std::to_string(options.min_num_frames) + " frames";
  }
  if (is_in_small_model) {
    return "its model has fewer than " +
           std::to_string(options.min_model_size) + " images";
  }
  return options.weak_seams == WeakSeams::kKeep
             ? "too few points constrain its position"
             : "a weak seam separates it, or too few points constrain its "
               "position";
}

}  // namespace

std::vector<int> CountFramesOfComponents(const RotationEstimate& rotations) {
  std::vector<int> num_frames;
  for (const std::optional<int>& component : rotations.component) {
    if (!component) continue;
    if (*component >= static_cast<int>(num_frames.size())) {
      num_frames.resize(*component + 1, 0);
    }
    ++num_frames[*component];
  }
  return num_frames;
}

RotationEstimate SelectComponent(const VerifiedPairs& pairs,
                                 const RotationEstimate& all, int component) {
  RotationEstimate selected = all;
  for (size_t i = 0; i < pairs.scene.frames.size(); ++i) {
    if (all.component[i] == component) continue;
    selected.rig_from_world[i].reset();
    selected.component[i].reset();
  }
  for (size_t i = 0; i < pairs.view_graph.pairs.size(); ++i) {
    const int image_idx = pairs.view_graph.pairs[i].image_idx1;
    const int frame_idx = pairs.scene.images[image_idx].frame_idx;
    if (all.component[frame_idx] != component)
      selected.pair_is_inlier[i] = false;
  }
  return selected;
}

std::vector<RejectedGroup> FindRejectedGroups(const VerifiedPairs& pairs,
                                              const FramePairIndex& index,
                                              const RotationEstimate& rotations,
                                              const Mask& pair_is_inconsistent,
                                              const PairVerdicts& verdicts,
                                              const Context& context) {
  const Scene& scene = pairs.scene;
  Mask is_rejected = pair_is_inconsistent;
  for (size_t i = 0; i < is_rejected.size(); ++i) {
    const ImagePair& pair = pairs.view_graph.pairs[i];
    const bool is_rotation_known =
        pair.relative_pose && rotations.CamFromWorld(scene, pair.image_idx1) &&
        rotations.CamFromWorld(scene, pair.image_idx2);
    if (is_rotation_known && !rotations.pair_is_inlier[i] &&
        verdicts[i] != RejectionReason::kDiscontinuousMotion &&
        verdicts[i] != RejectionReason::kAmbiguousMotion) {
      is_rejected[i] = true;
    }
  }
  std::vector<RejectedGroup> groups = GroupRejectedPairs(index, is_rejected);
  LogRejectedPairs(scene, groups, is_rejected.size(), context);
  return groups;
}

Mask KeepLargeModels(const Scene& scene, const MapperOptions& options,
                     std::vector<MapperModel>* models) {
  SortBySize(models);
  return DropSmallModels(scene, options.min_model_size, models);
}

void ListFramesWithoutPose(const MapperModel& model,
                           std::vector<std::string> reasons,
                           MapperResult* result) {
  for (const DroppedFrame& frame : model.bundle.dropped_frames) {
    reasons[frame.frame_idx] = frame.reason;
  }
  for (size_t i = 0; i < reasons.size(); ++i) {
    if (model.reconstruction.rig_from_world[i]) continue;
    result->unregistered_frames.push_back({static_cast<int>(i), reasons[i]});
  }
}

bool IsInModel(const std::vector<MapperModel>& models, size_t frame_idx) {
  return AnyOf(models, [&](const MapperModel& m) {
    return m.reconstruction.rig_from_world[frame_idx].has_value();
  });
}

void ListUnregistered(const Scene& scene, const EstimatedRotations& rotations,
                      const Mask& frame_is_ambiguous,
                      const Mask& is_in_small_model,
                      const MapperOptions& options, MapperResult* result) {
  const std::vector<int> num_frames =
      CountFramesOfComponents(rotations.estimate);
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    if (IsInModel(result->models, i)) continue;
    std::optional<int> num_frames_of_component;
    if (const auto& component = rotations.estimate.component[i]) {
      num_frames_of_component = num_frames[*component];
    }
    result->unregistered_frames.push_back(
        {static_cast<int>(i),
         ReasonWithoutModel(
             num_frames_of_component,
             !frame_is_ambiguous.empty() && frame_is_ambiguous[i],
             is_in_small_model[i], options)});
  }
}

}  // namespace mgsfm
