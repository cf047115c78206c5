// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/view_graph/view_graph_estimation.h"

#include <utility>
#include <vector>

#include "base/parallel.h"
#include "view_graph/pair_estimation.h"

namespace mgsfm {
namespace {

using internal::PairEstimate;
using internal::PairOutcome;

void Count(const PairEstimate& estimate, ViewGraphSummary* summary) {
  switch (estimate.outcome) {
    case PairOutcome::kFromRow:
      ++summary->num_from_row;
      break;
    case PairOutcome::kDecomposed:
      ++summary->num_decomposed;
      break;
    case PairOutcome::kReestimated:
      ++summary->num_reestimated;
      break;
    case PairOutcome::kDroppedFewInliers:
      ++summary->num_dropped_few_inliers;
      break;
    case PairOutcome::kDroppedConfig:
      ++summary->num_dropped_config;
      break;
  }
  if (!estimate.IsKept()) return;
  summary->num_inliers += estimate.pair.matches.size();
  summary->num_low_parallax +=
      !estimate.pair.relative_pose->translation_direction.has_value();
}

// The random stream of an image pair, independent of other pairs.
uint64_t PairStream(const Scene& scene, const ImagePair& pair) {
  return static_cast<uint64_t>(pair.image_idx1) * scene.images.size() +
         pair.image_idx2;
}

}  // namespace

void ViewGraphSummary::AddSecond(const ViewGraphSummary& second) {
  num_from_row += second.num_from_row;
  num_decomposed += second.num_decomposed;
  num_reestimated += second.num_reestimated;
  num_low_parallax += second.num_low_parallax;
  num_inliers += second.num_inliers;
  num_dropped_few_inliers += second.num_dropped_few_inliers +
                             second.num_dropped_config - second.num_pairs;
}

ViewGraphResult EstimateViewGraph(const Scene& scene, const Bearings& bearings,
                                  const ViewGraph& view_graph,
                                  const ViewGraphOptions& options,
                                  const Context& context) {
  const size_t num_pairs = view_graph.pairs.size();
  std::vector<PairEstimate> estimates(num_pairs);
  ParallelFor(
      num_pairs, context.num_threads,
      [&](size_t i) {
        const ImagePair& pair = view_graph.pairs[i];
        estimates[i] = internal::EstimatePair(
            scene, bearings, pair, options,
            Random(context.random_seed, PairStream(scene, pair)));
      },
      /*block_size=*/4,
      [&](size_t num_done) {
        context.ReportProgress("view_graph", num_done, num_pairs);
      });

  internal::ChooseTwins(&estimates);
  ViewGraphResult result;
  result.summary.num_pairs = static_cast<int>(num_pairs);
  for (size_t i = 0; i < num_pairs; ++i) {
    result.summary.num_matches += view_graph.pairs[i].matches.size();
    Count(estimates[i], &result.summary);
    if (estimates[i].IsKept()) {
      result.estimate.pairs.push_back(std::move(estimates[i].pair));
    }
  }
  return result;
}

}  // namespace mgsfm
