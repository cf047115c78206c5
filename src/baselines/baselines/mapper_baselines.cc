// SPDX-License-Identifier: BSD-3-Clause
#include "baselines/mapper_baselines.h"

#include "mapper/mapper_recipe.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

struct MethodDefaults {
  RotationStrategy rotations;
  TranslationSource input;
  TranslationObjective objective;
};

MethodDefaults DefaultsOf(MapperMethod method) {
  switch (method) {
    case MapperMethod::kDmraMgp:
    case MapperMethod::kSingle:
      return {RotationStrategy::kDecoupled, TranslationSource::kTracks,
              TranslationObjective::kBilinear};
    case MapperMethod::kMma:
      return {RotationStrategy::kJoint,
              TranslationSource::kRelativeTranslations,
              TranslationObjective::kDistance};
    case MapperMethod::kIncremental:
    case MapperMethod::kMgsfm:
      break;
  }
  return {RotationStrategy::kAuto, TranslationSource::kAuto,
          TranslationObjective::kAuto};
}

// The mapper uses EstimatePositions().
bool IsProduct(const PositionBaselineOptions& positions) {
  return (positions.input == TranslationSource::kAuto ||
          positions.input == TranslationSource::kHybrid) &&
         (positions.objective == TranslationObjective::kAuto ||
          positions.objective == TranslationObjective::kNonBilinear);
}

}  // namespace

BaselineOptions ResolveBaseline(const BaselineOptions& options,
                                MapperOptions* mapper) {
  const MethodDefaults defaults = DefaultsOf(options.method);
  BaselineOptions resolved = options;
  PositionBaselineOptions& positions = resolved.positions;
  if (positions.input == TranslationSource::kAuto) {
    positions.input = defaults.input;
  }
  if (positions.objective == TranslationObjective::kAuto) {
    positions.objective = defaults.objective;
  }
  CheckPositionBaseline(positions);
  Option<RotationStrategy>& strategy = mapper->rotation_averaging.strategy;
  if (strategy == RotationStrategy::kAuto) strategy = defaults.rotations;
  return resolved;
}

MapperResult RunBaseline(const BaselineOptions& baseline,
                         const MapperInput& input, const MapperOptions& options,
                         const Context& context) {
  if (baseline.method == MapperMethod::kSingle) {
    MGSFM_CHECK_EQ(input.scene.rigs.size(), input.scene.sensors.size());
  }
  MapperOptions resolved = options;
  const PositionBaselineOptions positions =
      ResolveBaseline(baseline, &resolved).positions;
  if (baseline.method == MapperMethod::kIncremental) {
    return RunIncrementalMapper(input, resolved, context);
  }
  if (IsProduct(positions)) {
    return RunMapper(input, resolved, context);
  }
  const auto estimate_positions = [&positions](
                                      const PositionInput& position_input,
                                      const PositionOptions& position_options,
                                      const Context& position_context) {
    return EstimatePositionsByBaseline(positions, position_input,
                                       position_options, position_context);
  };
  return RunMapperWith(estimate_positions, input, resolved, context);
}

}  // namespace mgsfm
