// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <utility>

#include "baselines/position_baselines.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/mapper/mapper.h"

namespace mgsfm {

// Methods to compare the mapper with. They replace rotation averaging, the step
// from rotations to positions, or both, and share all other stages.
enum class MapperMethod {
  kMgsfm,        // the product
  kDmraMgp,      // decoupled rotations; tracks, bilinear: global positioning
  kMma,          // joint rotations; relative_translations, distance
  kIncremental,  // rigs grow frame by frame, as in MCSfM
  kSingle,       // every image a frame of its own, see SeparateImages(); then
                 // tracks, bilinear, as in GLOMAP
};

template <>
struct EnumTable<MapperMethod> {
  static constexpr std::pair<std::string_view, MapperMethod> kNames[] = {
      {"mgsfm", MapperMethod::kMgsfm},
      {"dmra_mgp", MapperMethod::kDmraMgp},
      {"mma", MapperMethod::kMma},
      {"incremental", MapperMethod::kIncremental},
      {"single", MapperMethod::kSingle}};
};

struct BaselineOptions {
  Option<MapperMethod> method{
      "method", MapperMethod::kMgsfm,
      "Choose mgsfm; incremental, which adds frame by frame; or a method to "
      "compare with: dmra_mgp (global positioning of rigs), mma (joint "
      "rotations, distances), single (global positioning of single images, "
      "without rigs). It sets the options that are auto; others keep their "
      "values."};
  PositionBaselineOptions positions;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(method);
    visit.Group("TranslationAveraging", positions);
  }
};

// Replaces `auto` in options.positions and in
// mapper->rotation_averaging.strategy by the values of the method. Throws Error
// if the result is contradictory.
BaselineOptions ResolveBaseline(const BaselineOptions& options,
                                MapperOptions* mapper);

// RunMapper() with another method. For kSingle, all rigs of the scene must have
// one sensor.
[[nodiscard]] MapperResult RunBaseline(const BaselineOptions& baseline,
                                       const MapperInput& input,
                                       const MapperOptions& options,
                                       const Context& context);

}  // namespace mgsfm
