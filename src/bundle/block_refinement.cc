// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <utility>

#include "bundle/block_solve.h"
#include "bundle/point_filters.h"
#include "bundle/retriangulation.h"
#include "bundle/solve.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

class BlockedRefinement {
 public:
  BlockedRefinement(const Scene& scene, const BundleAdjustmentOptions& options,
                    const Context& context, BlockedModel* model)
      : scene_(scene), options_(options), context_(context), model_(*model) {}

  BundleSummary Run() {
    RemoveGrossErrors();
    if (SolveAndTriangulate()) {
      FilterFinalPoints();
      DropFramesWithoutObservations();
    }
    return std::move(summary_);
  }

 private:
  bool SolveAndTriangulate();
  bool Solve(RefinedParts parts, double function_tolerance);
  void RemoveGrossErrors();
  void Retriangulate(int num_rounds_left);
  void FilterFinalPoints();
  void DropFramesWithoutObservations();
  BundleRound StartRound(int num_rounds_left) const;
  PointFilterOptions FilterOf(const BundleRound& round) const;
  // Changes the points of each block, and ends the round.
  template <class Change>
  void ChangePoints(BundleRound round, Change&& change);

  const Scene& scene_;
  const BundleAdjustmentOptions& options_;
  const Context& context_;
  BlockedModel& model_;
  BundleSummary summary_;
};

BundleRound BlockedRefinement::StartRound(int num_rounds_left) const {
  std::vector<double> errors;
  for (size_t b = 0; b < model_.blocks.size(); ++b) {
    AppendNoiseErrors(scene_, model_.Part(b), context_.num_threads, &errors);
  }
  BundleRound round;
  round.num_points_before = model_.NumPoints();
  round.num_observations_before = model_.NumObservations();
  round.sigma_px = NoiseSigmaPx(std::move(errors));
  round.max_error_px = MaxErrorPx(options_, round.sigma_px, num_rounds_left);
  return round;
}

template <class Change>
void BlockedRefinement::ChangePoints(BundleRound round, Change&& change) {
  for (size_t b = 0; b < model_.blocks.size(); ++b) {
    context_.CheckInterrupted();
    Reconstruction part = model_.Part(b);
    change(&part);
    model_.blocks[b] = PackPoints(part.points);
  }
  round.num_points_after = model_.NumPoints();
  round.num_observations_after = model_.NumObservations();
  summary_.rounds.push_back(round);
}

PointFilterOptions BlockedRefinement::FilterOf(const BundleRound& round) const {
  std::vector<double> distances;
  for (size_t b = 0; b < model_.blocks.size(); ++b) {
    AppendDistances(scene_, model_.Part(b), context_.num_threads, &distances);
  }
  return MakeFilterOptions(options_, round.max_error_px,
                           MedianDistance(std::move(distances)));
}

void BlockedRefinement::RemoveGrossErrors() {
  BundleRound round = StartRound(options_.num_rounds);
  round.max_error_px = GrossErrorPx(options_, round.sigma_px);
  PointFilterOptions filter;
  filter.max_error_px = round.max_error_px;
  ChangePoints(round, [&](Reconstruction* part) {
    FilterPoints(scene_, filter, context_.num_threads, part);
  });
}

void BlockedRefinement::Retriangulate(int num_rounds_left) {
  const BundleRound round = StartRound(num_rounds_left);
  const PointFilterOptions filter = FilterOf(round);
  ChangePoints(round, [&](Reconstruction* part) {
    const ObservationGroups tracks = PackPoints(part->points).tracks;
    mgsfm::Retriangulate(scene_, tracks, filter, context_.num_threads, part);
  });
}

void BlockedRefinement::FilterFinalPoints() {
  const BundleRound round = StartRound(0);
  const PointFilterOptions filter = FilterOf(round);
  ChangePoints(round, [&](Reconstruction* part) {
    FilterPoints(scene_, filter, context_.num_threads, part);
  });
}

bool BlockedRefinement::Solve(RefinedParts parts, double function_tolerance) {
  BundleAdjustmentOptions options = options_;
  options.loss_scale_px =
      LossScalePx(options_, summary_.rounds.back().sigma_px);
  const bool is_usable = SolveInBlocks(
      scene_, options, parts, function_tolerance, context_, &model_, &summary_);
  context_.Debug(DescribeSolve(summary_));
  return is_usable;
}

bool BlockedRefinement::SolveAndTriangulate() {
  const double rough = RoughTolerance(options_);
  if (!Solve(RefinedParts::kTranslations, rough)) return false;
  for (int round = 1; round <= options_.num_rounds; ++round) {
    if (!Solve(RefinedParts::kAll, rough)) return false;
    Retriangulate(options_.num_rounds - round);
  }
  return Solve(RefinedParts::kAll, options_.function_tolerance);
}

void BlockedRefinement::DropFramesWithoutObservations() {
  if (!options_.refine_rig_from_world) return;
  Mask is_observed(scene_.frames.size(), false);
  for (const PointBlock& block : model_.blocks) {
    for (const Observation& o : block.tracks.observations) {
      is_observed[scene_.images[o.image_idx].frame_idx] = true;
    }
  }
  for (size_t i = 0; i < is_observed.size(); ++i) {
    if (is_observed[i] || !model_.poses.rig_from_world[i]) continue;
    model_.poses.rig_from_world[i].reset();
    summary_.dropped_frames.push_back(
        {static_cast<int>(i), "no point agrees with its images"});
  }
}

}  // namespace

BundleSummary RefineInBlocks(const Scene& scene,
                             const BundleAdjustmentOptions& options,
                             const Context& context, BlockedModel* model) {
  return BlockedRefinement(scene, options, context, model).Run();
}

}  // namespace mgsfm
