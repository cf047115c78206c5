// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/verified_pairs.h"

#include <cstddef>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "mapper/stage.h"
#include "moving_objects/fixed_regions.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {
namespace {

void VerifyMatches(const MapperOptions& options, const Context& context,
                   VerifiedPairs* pairs, MapperResult* result) {
  ViewGraphResult verified =
      EstimateViewGraph(pairs->scene, pairs->bearings, pairs->matches(),
                        options.view_graph, context);
  pairs->view_graph = std::move(verified.estimate);
  result->view_graph = verified.summary;
}

// The pairs that the visible matches do not verify, with the outliers of the
// database. What is fixed to the rig can have decided their geometry, so that
// matches of the scenery are among its outliers.
ViewGraph UnverifiedPairs(const ViewGraph& visible, const ViewGraph& verified) {
  ViewGraph unverified;
  for (const ImagePair& pair : visible.pairs) {
    if (pair.outliers.empty() ||
        FindPair(verified, pair.image_idx1, pair.image_idx2) != nullptr) {
      continue;
    }
    ImagePair& added = unverified.pairs.emplace_back(pair);
    added.matches = AllMatches(pair);
    added.outliers.clear();
  }
  return unverified;
}

void VerifyOutliers(const MapperOptions& options, const Context& context,
                    VerifiedPairs* pairs, MapperResult* result) {
  const ViewGraph unverified =
      UnverifiedPairs(*pairs->visible_matches, pairs->view_graph);
  ViewGraphResult added = EstimateViewGraph(
      pairs->scene, pairs->bearings, unverified, options.view_graph, context);
  result->view_graph.AddSecond(added.summary);
  std::vector<ImagePair>& all = pairs->view_graph.pairs;
  for (ImagePair& pair : added.estimate.pairs) {
    result->view_graph.num_matches +=
        FindPair(*pairs->visible_matches, pair.image_idx1, pair.image_idx2)
            ->outliers.size();
    all.push_back(std::move(pair));
  }
  SortBy(&all, [](const ImagePair& pair) {
    return std::pair(pair.image_idx1, pair.image_idx2);
  });
}

std::vector<FixedRegion> ListFixedRegions(const FixedRegions& regions) {
  std::vector<FixedRegion> list;
  for (size_t s = 0; s < regions.of_sensor.size(); ++s) {
    if (regions.of_sensor[s].empty()) continue;
    list.push_back({static_cast<int>(s), FixedRegions::kNumRows,
                    FixedRegions::kNumColumns, regions.of_sensor[s]});
  }
  return list;
}

}  // namespace

VerifiedPairs VerifyAllPairs(const Scene& scene, const ViewGraph& matches,
                             const MapperOptions& options,
                             const Context& context, MapperResult* result) {
  VerifiedPairs pairs{scene, matches};
  {
    const RunningStage stage("rays", context);
    pairs.bearings = ComputeBearings(scene, context.num_threads);
    stage.Finish(&result->times);
  }
  {
    const RunningStage stage("view graph", context);
    VerifyMatches(options, stage.context(), &pairs, result);
    stage.Finish(&result->times);
  }
  if (!IsRuleOn(RejectionReason::kFixedRegion, options.pair_filtering)) {
    return pairs;
  }
  FixedRegions regions;
  const auto add_cells = [&] {
    return regions.Add(
        FindFixedRegions(scene, pairs.bearings,
                         FramePairIndex(scene, pairs.view_graph,
                                        options.pair_filtering.is_sequence),
                         pairs.view_graph, options.view_graph.max_error_px));
  };
  if (!add_cells()) return pairs;
  const RunningStage stage("visible view graph", context);
  const ViewGraph with_regions = std::move(pairs.view_graph);
  do {
    pairs.visible_matches = DropFixedRegions(scene, regions, matches);
    VerifyMatches(options, stage.context(), &pairs, result);
    VerifyOutliers(options, stage.context(), &pairs, result);
  } while (add_cells());
  stage.Finish(&result->times);
  LogFixedRegions(scene, regions, context);
  result->fixed_regions = ListFixedRegions(regions);
  for (const ImagePair& pair : with_regions.pairs) {
    pairs.num_of_fixed_regions +=
        FindPair(pairs.view_graph, pair.image_idx1, pair.image_idx2) == nullptr;
  }
  return pairs;
}

}  // namespace mgsfm
