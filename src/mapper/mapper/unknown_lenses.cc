// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/unknown_lenses.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "lenses/lens_calibration.h"
#include "mapper/stage.h"

namespace mgsfm {
namespace {

// Lenses need only be accurate to the tolerance of the view graph.
constexpr int kNumBundleRounds = 2;
constexpr double kFunctionTolerance = 1e-5;

MapperOptions OptionsOfRounds(MapperOptions options) {
  options.is_for_lenses = true;
  options.pair_filtering.use_motion_continuity = false;
  options.bundle_adjustment.num_rounds =
      std::min<int>(options.bundle_adjustment.num_rounds, kNumBundleRounds);
  options.bundle_adjustment.function_tolerance = std::max<double>(
      options.bundle_adjustment.function_tolerance, kFunctionTolerance);
  return options;
}

}  // namespace

MapperResult MapWithLenses(const MapperInput& input,
                           const SceneMapper& map_scene,
                           const MapperOptions& options,
                           const Context& context) {
  if (!NeedsLenses(input.scene, options.focal_lengths)) {
    return map_scene(input.scene, input.view_graph, {}, options, context);
  }
  Scene scene = input.scene;
  scene.cameras = WithoutExif(std::move(scene.cameras));
  std::vector<StageTime> times;
  const RunningStage pair_stage("focal lengths", context);
  FocalLengthResult focal_lengths = CalibrateFocalLengths(
      scene, input.view_graph, options.focal_lengths, pair_stage.context());
  pair_stage.Finish(&times);
  LogFocalLengths(scene, focal_lengths, context);
  const std::vector<Camera> start =
      StartOfLenses(input.scene.cameras, focal_lengths);
  const auto uncalibrated = DropUncalibratedGeometry(scene, input.view_graph);
  const auto map = [&](const Lenses& lenses, const ViewGraph& matches,
                       const MapperOptions& of_round,
                       const Context& context_of_round) {
    scene.cameras = lenses.cameras;
    return map_scene(scene, matches, lenses.prior, of_round, context_of_round);
  };
  const LensOptions lens_options{options.focal_lengths,
                                 options.bundle_adjustment,
                                 options.view_graph.max_error_px};
  LensResult lenses{{start}, {}};
  if (!input.existing_model) {
    const RunningStage lens_stage("lenses", context);
    const MapperOptions of_rounds = OptionsOfRounds(options);
    Context quiet = lens_stage.context();
    quiet.log = nullptr;
    const LensMapper map_round = [&](const Lenses& of_round,
                                     const ViewGraph& matches) {
      MapperResult mapped = map(of_round, matches, of_rounds, quiet);
      std::optional<LensModel> model;
      if (!mapped.models.empty()) {
        model = {std::move(mapped.models[0].reconstruction),
                 std::move(mapped.models[0].focal_lengths)};
      }
      return model;
    };
    lenses = CalibrateLenses({scene, input.scene.cameras, start, uncalibrated},
                             map_round, lens_options, lens_stage.context());
    lens_stage.Finish(&times);
  }
  MapperResult result = map(lenses.lenses, uncalibrated, options, context);
  if (!result.models.empty() &&
      UpdateLenses(result.models[0].reconstruction,
                   result.models[0].focal_lengths, lens_options, &lenses)) {
    context.Info("the lenses changed; the scene is mapped again with them");
    result = map(lenses.lenses, uncalibrated, options, context);
  }
  for (MapperModel& model : result.models) {
    StateInitialFocalLengths(input.scene, &model.focal_lengths);
  }
  result.focal_lengths = std::move(focal_lengths.estimates);
  if (!lenses.summary.lenses.empty()) {
    result.lenses = std::move(lenses.summary);
  }
  result.times.insert(result.times.begin(), times.begin(), times.end());
  return result;
}

}  // namespace mgsfm
