// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/joined_model.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "bundle_adjustment/solve.h"
#include "mapper/components.h"
#include "mapper/input_check.h"
#include "mapper/model_adjustment.h"
#include "mapper/model_extension.h"
#include "mapper/model_world.h"
#include "mapper/stage.h"
#include "mapper/weak_seams.h"
#include "mgsfm/bundle_adjustment/uncertainty.h"
#include "pair_filtering/frame_pair_index.h"
#include "registration/known_lengths.h"
#include "scene/observations.h"
#include "scene/point_lookup.h"

namespace mgsfm {
namespace {

using Color = decltype(Point3D::color);

// Matches along each track, from frame to frame: as many as observations.
ViewGraph LinkObservations(const Scene& scene,
                           const std::vector<Point3D>& points) {
  std::map<std::pair<int, int>, std::vector<Match>> matches;
  for (const Point3D& point : points) {
    std::vector<Observation> track = point.track;
    StableSortBy(&track, [&](const Observation& a) {
      return scene.images[a.image_idx].frame_idx;
    });
    for (size_t i = 1; i < track.size(); ++i) {
      const auto& [a, b] = std::minmax(track[i - 1], track[i]);
      matches[{a.image_idx, b.image_idx}].push_back(
          {static_cast<uint32_t>(a.keypoint_idx),
           static_cast<uint32_t>(b.keypoint_idx)});
    }
  }
  ViewGraph view_graph;
  for (auto& [images, of_images] : matches) {
    ImagePair pair;
    pair.image_idx1 = images.first;
    pair.image_idx2 = images.second;
    pair.matches = std::move(of_images);
    view_graph.pairs.push_back(std::move(pair));
  }
  return view_graph;
}

// Points that bundle adjustment makes have the colors of their keypoints in the
// points of before.
class KeypointColors {
 public:
  KeypointColors(const Scene& scene, const Reconstruction& model) {
    const auto is_colored = [](const Point3D& point) {
      return point.color != Color::Zero();
    };
    if (NoneOf(model.points, is_colored)) {
      return;
    }
    lookup_.emplace(scene, model);
    for (const Point3D& point : model.points) colors_.push_back(point.color);
  }
  void Apply(std::vector<Point3D>* points) const {
    if (!lookup_) return;
    for (Point3D& point : *points) {
      for (const Observation& o : point.track) {
        const auto found = lookup_->Find(o.image_idx, o.keypoint_idx);
        if (!found) continue;
        point.color = colors_[*found];
        break;
      }
    }
  }

 private:
  std::optional<PointLookup> lookup_;
  std::vector<Color> colors_;
};

BundleResult Refine(const JoinedModel& input, Reconstruction joined,
                    const BundleAdjustmentOptions& options,
                    const RefinementConditions& conditions,
                    const Context& context) {
  if (input.max_num_observations) {
    return RefineBySelectedTracks(input.scene, std::move(joined), options,
                                  *input.max_num_observations, context,
                                  conditions);
  }
  const CandidateSource tracks = FixedCandidates(GroupTracks(joined.points));
  return RefineReconstruction(input.scene, tracks, std::move(joined), options,
                              context, conditions);
}

void AddConfidence(const Scene& scene, const MapperOptions& options,
                   const Context& context, MapperModel* model) {
  const RunningStage stage("seams", context);
  const ViewGraph tracks =
      LinkObservations(scene, model->reconstruction.points);
  const FramePairIndex index(scene, tracks);
  const Mask all(tracks.pairs.size(), true);
  model->confidence =
      EstimateModelConfidence({scene, index, tracks, all,
                               model->rejected_groups, model->reconstruction},
                              options, stage.context());
  stage.Finish(&model->times);
}

}  // namespace

MapperResult AdjustJoinedModel(const JoinedModel& input,
                               const MapperOptions& options,
                               const Context& context, Reconstruction joined) {
  const Scene& scene = input.scene;
  const ViewGraph tracks = LinkObservations(scene, joined.points);
  AdjustmentInput adjustment{scene, tracks, tracks, input.positions,
                             input.gravity};
  adjustment.pair_is_used.assign(tracks.pairs.size(), true);
  adjustment.is_metric = AnyOf(scene.sensors, HasKnownLength);
  adjustment.start = input.parts;
  MapperResult result;
  MapperModel model;
  model.num_frames_in_component = static_cast<int>(scene.frames.size());
  BundlePriors priors;
  UsePriors(adjustment, options, context, &joined, &priors, &model);
  const KeypointColors colors(scene, joined);
  Reconstruction start;
  start.sensor_from_rig = joined.sensor_from_rig;
  model.reconstruction = std::move(joined);
  if (input.is_refined) {
    const RunningStage stage("bundle adjustment", context);
    BundleResult bundle =
        Refine(input, std::move(model.reconstruction),
               options.bundle_adjustment, {priors, {}}, stage.context());
    model.bundle = std::move(bundle.summary);
    model.reconstruction = std::move(bundle.estimate);
    stage.Finish(&model.times);
  }
  colors.Apply(&model.reconstruction.points);
  PlaceModelInWorld(adjustment, priors, options, context, &model);
  if (options.compute_covariances) {
    const RunningStage stage("covariances", context);
    model.covariances =
        ComputeCovariances(scene, model.reconstruction,
                           options.bundle_adjustment, stage.context(), priors);
    stage.Finish(&model.times);
  }
  AddConfidence(scene, options, context, &model);
  if (auto seams = DescribeSeams(scene, model.confidence)) {
    result.findings.push_back(std::move(*seams));
  }
  DescribeSensors(scene, start, {}, &model, &result);
  result.models.push_back(std::move(model));
  ListFramesWithoutPose(
      result.models.front(),
      std::vector<std::string>(scene.frames.size(), "no sub-map has its pose"),
      &result);
  LogFindings(result, context);
  return result;
}

}  // namespace mgsfm
