// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/unknown_lenses.h"

#include <utility>
#include <vector>

#include "mapper/lens_calibration.h"
#include "mapper/stage.h"

namespace mgsfm {

MapperResult MapWithUnknownLenses(const MapperInput& input,
                                  const SceneMapper& map_scene,
                                  const MapperOptions& options,
                                  const Context& context) {
  Scene scene = input.scene;
  scene.cameras = WithoutExif(std::move(scene.cameras));
  std::vector<StageTime> times;
  const RunningStage pair_stage("focal lengths", context);
  FocalLengthResult focal_lengths = CalibrateFocalLengths(
      scene, input.view_graph, options.focal_lengths, context);
  pair_stage.Finish(&times);
  LogFocalLengths(scene, focal_lengths, context);
  const std::vector<Camera> start =
      StartOfLenses(input.scene.cameras, focal_lengths);
  const ViewGraph uncalibrated =
      DropUncalibratedGeometry(scene, input.view_graph);
  const LensMapper map = [&](const Lenses& lenses, const ViewGraph& matches,
                             const MapperOptions& of_round,
                             const Context& context_of_round) {
    scene.cameras = lenses.cameras;
    return map_scene(scene, matches, lenses.prior, of_round, context_of_round);
  };
  LensResult lenses{{start}, {}};
  if (!input.existing_model) {
    const RunningStage lens_stage("lenses", context);
    lenses = CalibrateLenses({scene, input.scene.cameras, start, uncalibrated},
                             map, options, context);
    lens_stage.Finish(&times);
  }
  MapperResult result =
      MapWithLenses(uncalibrated, map, options, context, &lenses);
  for (MapperModel& model : result.models) {
    StateInitialFocalLengths(input.scene, &model);
  }
  result.focal_lengths = std::move(focal_lengths.estimates);
  if (!lenses.summary.lenses.empty()) {
    result.lenses = std::move(lenses.summary);
  }
  result.times.insert(result.times.begin(), times.begin(), times.end());
  return result;
}

}  // namespace mgsfm
