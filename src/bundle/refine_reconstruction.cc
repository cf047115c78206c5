// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdio>
#include <string>

#include "bundle/point_filters.h"
#include "bundle/retriangulation.h"
#include "bundle/solve.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/bundle/bundle_adjustment.h"

namespace mgsfm {
namespace {

class ReconstructionRefiner {
 public:
  ReconstructionRefiner(const Scene& scene, const CandidateSource& candidates,
                        const Reconstruction& initial,
                        const BundleAdjustmentOptions& options,
                        const Context& context, const BundlePriors& priors,
                        const FixedPoses& held)
      : scene_(scene),
        candidates_(candidates),
        initial_(initial),
        options_(options),
        context_(context),
        priors_(priors),
        held_(held) {
    result_.estimate = initial;
  }

  BundleResult Run() {
    const bool is_usable = Refine();
    if (is_usable) {
      FilterAtLast();
      DropFramesWithoutObservations();
    }
    ComputePointErrors(scene_, context_.num_threads, &result_.estimate);
    FinishSummary(scene_, initial_, options_, &result_);
    return std::move(result_);
  }

 private:
  bool Refine() {
    FilterGrossErrors();
    // All solves but the last prepare a triangulation, which needs less.
    const double rough =
        std::min(1.0, kRoughToleranceFactor * options_.function_tolerance);
    if (!Solve(RefinedParts::kTranslations, rough)) return false;
    for (int round = 0; round < options_.num_rounds; ++round) {
      if (!Solve(RefinedParts::kAll, rough)) return false;
      TriangulateAnew(options_.num_rounds - 1 - round);
    }
    return Solve(RefinedParts::kAll, options_.function_tolerance);
  }

  static constexpr double kRoughToleranceFactor = 100.0;

  bool Solve(RefinedParts parts, double function_tolerance);
  void FilterGrossErrors();
  void TriangulateAnew(int num_rounds_left);
  void FilterAtLast();
  void DropFramesWithoutObservations();
  BundleRound StartRound(int num_rounds_left) const;
  void FinishRound(BundleRound round);
  PointFilterOptions FilterOf(const BundleRound& round) const {
    return MakeFilterOptions(scene_, result_.estimate, options_,
                             round.max_error_px, context_);
  }

  const Scene& scene_;
  const CandidateSource& candidates_;
  const Reconstruction& initial_;
  const BundleAdjustmentOptions& options_;
  const Context& context_;
  const BundlePriors& priors_;
  const FixedPoses& held_;
  BundleResult result_;
};

bool ReconstructionRefiner::Solve(RefinedParts parts,
                                  double function_tolerance) {
  context_.ReportProgress("bundle adjustment", result_.summary.solves.size(),
                          static_cast<size_t>(options_.num_rounds) + 2);
  BundleAdjustmentOptions options = options_;
  if (!result_.summary.rounds.empty()) {
    options.loss_scale_px =
        LossScalePx(options_, result_.summary.rounds.back().sigma_px);
  }
  const bool is_usable = SolveOnce(scene_, priors_, held_, options, parts,
                                   function_tolerance, context_, &result_);
  const SolveSummary& summary = result_.summary.solves.back();
  char line[160];
  std::snprintf(line, sizeof(line),
                "solve %zu: %d iterations, cost %.6g to %.6g, %s",
                result_.summary.solves.size(), summary.num_iterations,
                summary.initial_cost, summary.final_cost,
                std::string(TerminationName(summary.termination)).c_str());
  context_.Debug(line);
  return is_usable;
}

void ReconstructionRefiner::FilterGrossErrors() {
  BundleRound round = StartRound(options_.num_rounds);
  // Poses may be rough yet: no upper bound.
  round.max_error_px = std::max(4.0 * options_.max_max_error_px,
                                options_.error_sigma_factor * round.sigma_px);
  PointFilterOptions filter;
  filter.max_error_px = round.max_error_px;
  FilterPoints(scene_, filter, context_.num_threads, &result_.estimate);
  FinishRound(round);
}

BundleRound ReconstructionRefiner::StartRound(int num_rounds_left) const {
  BundleRound round;
  round.num_points_before = result_.estimate.points.size();
  round.num_observations_before = NumObservations(result_.estimate);
  round.sigma_px = NoiseSigmaPx(scene_, result_.estimate, context_.num_threads);
  round.max_error_px = MaxErrorPx(options_, round.sigma_px, num_rounds_left);
  return round;
}

void ReconstructionRefiner::FinishRound(BundleRound round) {
  round.num_points_after = result_.estimate.points.size();
  round.num_observations_after = NumObservations(result_.estimate);
  char line[160];
  std::snprintf(line, sizeof(line),
                "points %zu to %zu, observations %zu to %zu, up to %.2f px",
                round.num_points_before, round.num_points_after,
                round.num_observations_before, round.num_observations_after,
                round.max_error_px);
  context_.Debug(line);
  result_.summary.rounds.push_back(round);
}

void ReconstructionRefiner::TriangulateAnew(int num_rounds_left) {
  context_.CheckInterrupted();
  const BundleRound round = StartRound(num_rounds_left);
  Retriangulate(scene_, candidates_(result_.estimate, round.max_error_px),
                FilterOf(round), context_.num_threads, &result_.estimate);
  FinishRound(round);
}

void ReconstructionRefiner::FilterAtLast() {
  const BundleRound round = StartRound(0);
  FilterPoints(scene_, FilterOf(round), context_.num_threads,
               &result_.estimate);
  FinishRound(round);
}

void ReconstructionRefiner::DropFramesWithoutObservations() {
  if (!options_.refine_rig_from_world) return;
  Mask is_seen(scene_.frames.size(), false);
  for (const Point3D& point : result_.estimate.points) {
    for (const Observation& o : point.track) {
      is_seen[scene_.images[o.image_idx].frame_idx] = true;
    }
  }
  for (size_t i = 0; i < is_seen.size(); ++i) {
    if (is_seen[i] || !result_.estimate.rig_from_world[i]) continue;
    if (!held_.frames.empty() && held_.frames[i]) continue;
    result_.estimate.rig_from_world[i].reset();
    result_.summary.dropped_frames.push_back(
        {static_cast<int>(i), "no point agrees with its images"});
  }
}

}  // namespace

BundleResult RefineReconstruction(const Scene& scene,
                                  const CandidateSource& candidates,
                                  const Reconstruction& initial,
                                  const BundleAdjustmentOptions& options,
                                  const Context& context,
                                  const BundlePriors& priors,
                                  const FixedPoses& held) {
  return ReconstructionRefiner(scene, candidates, initial, options, context,
                               priors, held)
      .Run();
}

Reconstruction TriangulateCandidates(const Scene& scene,
                                     const CandidateSource& candidates,
                                     const Reconstruction& initial,
                                     const BundleAdjustmentOptions& options,
                                     const Context& context) {
  Reconstruction model = initial;
  const double max_error_px = options.max_max_error_px;
  Retriangulate(scene, candidates(model, max_error_px),
                MakeFilterOptions(scene, model, options, max_error_px, context),
                context.num_threads, &model);
  return model;
}

}  // namespace mgsfm
