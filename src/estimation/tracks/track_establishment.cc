// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/tracks/track_establishment.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "base/ranges.h"
#include "math/index_groups.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "pair_filtering/triplet_consistency.h"
#include "tracks/component_splitting.h"
#include "tracks/match_graph.h"
#include "tracks/track_selection.h"

namespace mgsfm {
namespace {

using internal::ConflictingMatches;
using internal::MatchComponents;

// Splits the components with conflicts; the result is ordered by first
// observations.
ObservationGroups MakeConflictFree(const Scene& scene,
                                   const MatchComponents& components,
                                   const ConflictingMatches& conflicting,
                                   const TrackOptions& options,
                                   const Context& context) {
  const ObservationGroups& groups = components.groups;
  std::vector<size_t> with_conflict;
  for (size_t i = 0; i < groups.size(); ++i) {
    if (components.has_conflict[i]) with_conflict.push_back(i);
  }
  std::vector<ObservationGroups> splits(with_conflict.size());
  ParallelFor(with_conflict.size(), context.num_threads, [&](size_t i) {
    context.CheckInterrupted();
    const size_t group = with_conflict[i];
    const size_t first_match = conflicting.offsets[group];
    splits[i] = internal::SplitComponent(
        scene, groups.begin(group), groups.length(group),
        conflicting.matches.data() + first_match,
        conflicting.offsets[group + 1] - first_match,
        options.max_duplicate_distance_px);
  });

  std::vector<std::pair<const Observation*, const Observation*>> ranges;
  for (size_t i = 0; i < groups.size(); ++i) {
    if (components.has_conflict[i]) continue;
    ranges.emplace_back(groups.begin(i), groups.end(i));
  }
  for (const ObservationGroups& split : splits) {
    for (size_t i = 0; i < split.size(); ++i) {
      ranges.emplace_back(split.begin(i), split.end(i));
    }
  }
  std::sort(ranges.begin(), ranges.end(),
            [](const auto& a, const auto& b) { return *a.first < *b.first; });
  ObservationGroups result;
  for (const auto& [begin, end] : ranges) {
    result.observations.insert(result.observations.end(), begin, end);
    result.FinishGroup();
  }
  return result;
}

struct JoinedMatches {
  ObservationGroups candidates;
  size_t num_components = 0;
  size_t num_components_with_conflicts = 0;
};

JoinedMatches JoinMatches(const Scene& scene,
                          const internal::KeypointNodes& nodes,
                          const ViewGraph& view_graph,
                          const MatchSelection& selection,
                          const TrackOptions& options, const Context& context) {
  const MatchComponents components =
      internal::FindComponents(nodes, view_graph, selection);
  context.CheckInterrupted();
  const ConflictingMatches conflicting = internal::GatherConflictingMatches(
      nodes, view_graph, selection, components);

  JoinedMatches joined;
  joined.candidates =
      MakeConflictFree(scene, components, conflicting, options, context);
  joined.num_components = components.groups.size();
  joined.num_components_with_conflicts = static_cast<size_t>(
      std::count(components.has_conflict.begin(), components.has_conflict.end(),
                 char{true}));
  return joined;
}

// The triplet-consistent matches, and all matches of images with few tracks.
MatchSelection SelectTripletConsistent(const ViewGraph& view_graph,
                                       const Mask& pair_is_used,
                                       const Mask& is_triplet_consistent,
                                       const Mask& has_few_tracks) {
  MatchSelection selection{pair_is_used, is_triplet_consistent};
  size_t begin = 0;
  for (const ImagePair& pair : view_graph.pairs) {
    const size_t end = begin + pair.matches.size();
    if (has_few_tracks[pair.image_idx1] || has_few_tracks[pair.image_idx2]) {
      selection.match_is_used.Fill(begin, end, true);
    }
    begin = end;
  }
  return selection;
}

// Images with fewer than min_tracks_per_image tracks.
Mask FindImagesWithFewTracks(const ObservationGroups& tracks, size_t num_images,
                             const TrackOptions& options) {
  std::vector<int> num_tracks(num_images, 0);
  for (const Observation& observation : tracks.observations) {
    ++num_tracks[observation.image_idx];
  }
  Mask has_few_tracks;
  for (const int number : num_tracks) {
    has_few_tracks.push_back(number < options.min_tracks_per_image);
  }
  return has_few_tracks;
}

}  // namespace

ObservationGroups EstablishCandidates(const Scene& scene,
                                      const ViewGraph& view_graph,
                                      const MatchSelection& selection,
                                      const TrackOptions& options,
                                      const Context& context) {
  MGSFM_CHECK_EQ(selection.pair_is_used.size(), view_graph.pairs.size());
  return JoinMatches(scene, internal::KeypointNodes(scene), view_graph,
                     selection, options, context)
      .candidates;
}

ObservationGroups JoinPoints(const Scene& scene,
                             const ObservationGroups& candidates,
                             const std::vector<Point3D>& points) {
  const internal::KeypointNodes nodes(scene);
  constexpr int kNoPoint = -1;
  std::vector<int> point_of_node(nodes.size(), kNoPoint);
  for (size_t i = 0; i < points.size(); ++i) {
    for (const Observation& o : points[i].track) {
      point_of_node[nodes.NodeOf(o.image_idx, o.keypoint_idx)] =
          static_cast<int>(i);
    }
  }
  UnionFind sets(candidates.size() + points.size());
  for (size_t g = 0; g < candidates.size(); ++g) {
    for (const Observation* o = candidates.begin(g); o != candidates.end(g);
         ++o) {
      const int i = point_of_node[nodes.NodeOf(o->image_idx, o->keypoint_idx)];
      if (i != kNoPoint) sets.Union(g, candidates.size() + i);
    }
  }
  std::vector<int> set_of_member(sets.size());
  for (size_t i = 0; i < sets.size(); ++i) {
    set_of_member[i] = static_cast<int>(sets.Find(i));
  }
  const IndexGroups members = GroupByKey(set_of_member, sets.size());
  ObservationGroups joined;
  for (size_t g = 0; g < candidates.size(); ++g) {
    const size_t begin = members.begin[set_of_member[g]];
    const size_t end = members.begin[set_of_member[g] + 1];
    if (members.items[begin] != static_cast<int>(g)) continue;
    std::vector<Observation> observations;
    for (size_t k = begin; k < end; ++k) {
      const size_t i = members.items[k];
      if (i < candidates.size()) {
        observations.insert(observations.end(), candidates.begin(i),
                            candidates.end(i));
      } else {
        const auto& track = points[i - candidates.size()].track;
        observations.insert(observations.end(), track.begin(), track.end());
      }
    }
    SortUnique(&observations);
    joined.observations.insert(joined.observations.end(), observations.begin(),
                               observations.end());
    joined.FinishGroup();
  }
  return joined;
}

TrackResult EstablishTracks(const Scene& scene, const ViewGraph& view_graph,
                            const Mask& pair_is_used,
                            const TrackOptions& options,
                            const Context& context) {
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  const internal::KeypointNodes nodes(scene);
  const Mask is_triplet_consistent = FindTripletConsistentMatches(
      view_graph, pair_is_used, context.num_threads);
  context.CheckInterrupted();
  Mask has_few_tracks(scene.images.size(), false);
  JoinedMatches joined;
  TrackResult result;
  // The first pass finds the images that need more than triplet-consistent
  // matches.
  for (int pass = 0; pass < 2; ++pass) {
    joined = JoinMatches(
        scene, nodes, view_graph,
        SelectTripletConsistent(view_graph, pair_is_used, is_triplet_consistent,
                                has_few_tracks),
        options, context);
    result.estimate =
        internal::SelectTracks(joined.candidates, scene.images.size(), options);
    has_few_tracks =
        FindImagesWithFewTracks(result.estimate, scene.images.size(), options);
    if (std::count(has_few_tracks.begin(), has_few_tracks.end(), char{true}) ==
        0)
      break;
  }
  TrackSummary& summary = result.summary;
  summary.num_components = joined.num_components;
  summary.num_components_with_conflicts = joined.num_components_with_conflicts;
  summary.num_tracks = result.estimate.size();
  summary.num_observations = result.estimate.observations.size();
  if (summary.num_tracks > 0) {
    summary.mean_track_length =
        static_cast<double>(summary.num_observations) / summary.num_tracks;
  }
  return result;
}

}  // namespace mgsfm
