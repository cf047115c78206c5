// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "mapper/candidates.h"
#include "mapper/model_extension.h"
#include "mapper/stage.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/mapper/mapper.h"

namespace mgsfm {

MapperResult TriangulatePoints(const MapperInput& input,
                               const MapperOptions& options,
                               const Context& context) {
  MGSFM_CHECK_MSG(input.existing_model.has_value(),
                  "the poses of an existing model are required");
  const Scene& scene = input.scene;
  const Reconstruction& start = *input.existing_model;
  MapperResult result;
  MapperModel model;
  const RunningStage verification("view graph", context);
  const ViewGraphResult verified =
      EstimateViewGraph(scene, ComputeBearings(scene, context.num_threads),
                        input.view_graph, options.view_graph, context);
  verification.Finish(&result.times);
  result.view_graph = verified.summary;
  const CandidateSource candidates = MakeCandidateSource(
      scene, verified.estimate, input.view_graph,
      Mask(verified.estimate.pairs.size(), true), options, context);
  const RunningStage triangulation("triangulation", context);
  Reconstruction initial = TriangulateCandidates(
      scene, candidates, start, options.bundle_adjustment, context);
  triangulation.Finish(&model.times);
  const RunningStage refinement("refinement", context);
  BundleResult bundle =
      RefineReconstruction(scene, candidates, std::move(initial),
                           options.bundle_adjustment, context);
  refinement.Finish(&model.times);
  model.bundle = std::move(bundle.summary);
  model.reconstruction = std::move(bundle.estimate);
  model.extension = ExtensionSummary();
  model.extension->frames_are_fixed =
      !options.bundle_adjustment.refine_rig_from_world;
  std::vector<std::string> reasons(scene.frames.size(),
                                   "it is not in the input model");
  for (const DroppedFrame& frame : model.bundle.dropped_frames) {
    reasons[frame.frame_idx] = frame.reason;
  }
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    model.extension->num_existing_frames += start.rig_from_world[i].has_value();
    if (model.reconstruction.rig_from_world[i]) continue;
    result.unregistered_frames.push_back({static_cast<int>(i), reasons[i]});
  }
  model.num_frames_in_component = model.extension->num_existing_frames;
  DescribeSensors(scene, start, {}, &model, &result);
  if (!model.reconstruction.points.empty()) {
    result.models.push_back(std::move(model));
  }
  return result;
}

}  // namespace mgsfm
