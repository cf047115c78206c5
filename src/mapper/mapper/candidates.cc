// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/candidates.h"

#include <memory>
#include <utility>

#include "mgsfm/base/mask.h"

namespace mgsfm {

CandidateSource MakeCandidateSource(const Scene& scene,
                                    const ViewGraph& view_graph,
                                    const ViewGraph& matches, Mask pair_is_used,
                                    const MapperOptions& options,
                                    const Context& context) {
  const auto groups = [&scene, &view_graph, &options, &context,
                       pair_is_used = std::move(pair_is_used)](
                          const Reconstruction& model, double max_error_px) {
    return std::make_shared<const ObservationGroups>(EstablishCandidates(
        scene, view_graph,
        SelectConsistentMatches({scene, view_graph, pair_is_used, model},
                                max_error_px, options.match_selection, context),
        options.tracks, context));
  };
  return {groups, &matches};
}

}  // namespace mgsfm
