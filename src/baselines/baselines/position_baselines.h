// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <utility>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "translation_averaging/position_estimation.h"

namespace mgsfm {

// The ablation of the paper: replaces EstimatePositions()
// (translation_averaging/position_estimation.h) by other inputs and objectives.
// The mapper uses `hybrid` with `non_bilinear`.

enum class TranslationSource {
  kAuto,  // hybrid; relative_translations for the objective distance
  kRelativeTranslations,  // pairs alone; the tracks are triangulated
  kTracks,                // no pairs: everything starts at random and is
                          // solved for once
  kHybrid,                // pairs, then tracks
};

template <>
struct EnumTable<TranslationSource> {
  static constexpr std::pair<std::string_view, TranslationSource> kNames[] = {
      {"auto", TranslationSource::kAuto},
      {"relative_translations", TranslationSource::kRelativeTranslations},
      {"tracks", TranslationSource::kTracks},
      {"hybrid", TranslationSource::kHybrid}};
};

enum class TranslationObjective {
  kAuto,         // non_bilinear
  kDistance,     // L1 positions without refinement, as in MMA
  kBilinear,     // residuals v - d C with a scale d (bilinear_refinement.h)
  kNonBilinear,  // angles, as in the product
};

template <>
struct EnumTable<TranslationObjective> {
  static constexpr std::pair<std::string_view, TranslationObjective> kNames[] =
      {{"auto", TranslationObjective::kAuto},
       {"distance", TranslationObjective::kDistance},
       {"bilinear", TranslationObjective::kBilinear},
       {"non_bilinear", TranslationObjective::kNonBilinear}};
};

struct PositionBaselineOptions {
  Option<TranslationSource> input{
      "input", TranslationSource::kAuto,
      "Choose the measurements that determine positions: relative translations "
      "of pairs, tracks from a random start, or both (hybrid). auto: as the "
      "method of the mapper, by default hybrid."};
  Option<TranslationObjective> objective{
      "objective", TranslationObjective::kAuto,
      "Choose the objective of the refinement: angles (non_bilinear), angles "
      "with one scale per observation (bilinear), or none (distance, for "
      "relative_translations). auto: as the method of the mapper, by default "
      "non_bilinear."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input, objective);
  }
};

// Throws Error if input and objective contradict each other.
void CheckPositionBaseline(const PositionBaselineOptions& options);

[[nodiscard]] PositionResult EstimatePositionsByBaseline(
    const PositionBaselineOptions& baseline, const PositionInput& input,
    const PositionOptions& options, const Context& context);

}  // namespace mgsfm
