// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/tracks/track_establishment.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <tuple>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "base/ranges.h"
#include "math/item_groups.h"
#include "math/sorted_adjacency.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"
#include "pair_filtering/triplet_consistency.h"
#include "scene/track_coverage.h"
#include "tracks/match_graph.h"

namespace mgsfm {

namespace {

constexpr uint32_t kNone = MatchComponents::kNone;

// Disjoint sets of nodes with at most one keypoint per image, except for
// features detected twice. Members are linked lists.
class ConflictFreeSets {
 public:
  ConflictFreeSets(const Scene& scene, const Observation* observations,
                   size_t num_nodes, double max_duplicate_distance_px)
      : scene_(scene),
        observations_(observations),
        max_squared_distance_(max_duplicate_distance_px *
                              max_duplicate_distance_px),
        set_of_node_(num_nodes),
        next_(num_nodes, kNone),
        last_(num_nodes),
        size_(num_nodes, 1),
        local_image_(num_nodes, 0) {
    std::iota(set_of_node_.begin(), set_of_node_.end(), 0);
    std::iota(last_.begin(), last_.end(), 0);
    for (size_t i = 1; i < num_nodes; ++i) {
      local_image_[i] = local_image_[i - 1] + (observations[i].image_idx !=
                                               observations[i - 1].image_idx);
    }
    node_in_image_.assign(num_nodes > 0 ? local_image_.back() + 1 : 0, kNone);
  }

  // Joins the sets of both nodes unless this causes a conflict.
  void UnionIfConsistent(uint32_t a, uint32_t b) {
    uint32_t into = set_of_node_[a], from = set_of_node_[b];
    if (into == from) return;
    if (std::make_pair(size_[into], from) < std::make_pair(size_[from], into)) {
      std::swap(into, from);
    }
    if (HaveConflict(into, from)) return;
    for (uint32_t i = from; i != kNone; i = next_[i]) set_of_node_[i] = into;
    next_[last_[into]] = from;
    last_[into] = last_[from];
    size_[into] += size_[from];
  }

  uint32_t SetOf(uint32_t node) const { return set_of_node_[node]; }

 private:
  bool HaveConflict(uint32_t set1, uint32_t set2) {
    for (uint32_t i = set1; i != kNone; i = next_[i]) {
      node_in_image_[local_image_[i]] = i;
    }
    bool have_conflict = false;
    for (uint32_t i = set2; i != kNone && !have_conflict; i = next_[i]) {
      const uint32_t other = node_in_image_[local_image_[i]];
      have_conflict = other != kNone && AreDifferent(i, other);
    }
    for (uint32_t i = set1; i != kNone; i = next_[i]) {
      node_in_image_[local_image_[i]] = kNone;
    }
    return have_conflict;
  }

  bool AreDifferent(uint32_t a, uint32_t b) const {
    const auto& keypoints =
        scene_.images[observations_[a].image_idx].keypoints_px;
    const double squared_distance = (keypoints[observations_[a].keypoint_idx] -
                                     keypoints[observations_[b].keypoint_idx])
                                        .cast<double>()
                                        .squaredNorm();
    return squared_distance > max_squared_distance_;
  }

  const Scene& scene_;
  const Observation* observations_;
  const double max_squared_distance_;
  std::vector<uint32_t> set_of_node_;    // the head of its list
  std::vector<uint32_t> next_;           // in the list of its set
  std::vector<uint32_t> last_, size_;    // of a set, at its head
  std::vector<uint32_t> local_image_;    // image index within the component
  std::vector<uint32_t> node_in_image_;  // scratch, kNone between calls
};

// Indices of the matches in descending order of support.
std::vector<uint32_t> OrderBySupport(const SortedAdjacency& adjacency,
                                     const ComponentMatch* matches,
                                     size_t num_matches) {
  std::vector<uint32_t> support(num_matches), order(num_matches);
  for (size_t i = 0; i < num_matches; ++i) {
    support[i] =
        adjacency.NumCommonNeighbors(matches[i].first, matches[i].second);
  }
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](uint32_t a, uint32_t b) {
    return std::make_tuple(support[b], matches[b].num_pair_matches,
                           matches[a].first, matches[a].second) <
           std::make_tuple(support[a], matches[a].num_pair_matches,
                           matches[b].first, matches[b].second);
  });
  return order;
}

// Whether each node represents its set in its image: it has the most matches
// within the set; ties go to the first node.
Mask ChooseRepresentatives(const Observation* observations, size_t num_nodes,
                           const SortedAdjacency& adjacency,
                           const std::vector<uint32_t>& set_of_node) {
  std::vector<uint32_t> degree(num_nodes, 0);
  for (uint32_t node = 0; node < num_nodes; ++node) {
    for (const uint32_t* i = adjacency.begin(node); i != adjacency.end(node);
         ++i) {
      degree[node] += set_of_node[*i] == set_of_node[node];
    }
  }
  Mask is_kept(num_nodes, true);
  for (uint32_t i = 0; i < num_nodes; ++i) {
    for (uint32_t j = i + 1; j < num_nodes && observations[j].image_idx ==
                                                  observations[i].image_idx;
         ++j) {
      if (set_of_node[i] != set_of_node[j]) continue;
      is_kept[degree[j] > degree[i] ? i : j] = false;
    }
  }
  return is_kept;
}

// The sets with at least two nodes, ordered by their first nodes.
ObservationGroups GroupBySet(const Observation* observations,
                             const std::vector<uint32_t>& set_of_node,
                             const Mask& is_kept) {
  const size_t num_nodes = set_of_node.size();
  std::vector<uint32_t> first_node_of_set(num_nodes, kNone);
  std::vector<std::pair<uint32_t, uint32_t>> order;  // first of set, node
  for (uint32_t node = 0; node < num_nodes; ++node) {
    if (!is_kept[node]) continue;
    uint32_t& first_node = first_node_of_set[set_of_node[node]];
    if (first_node == kNone) first_node = node;
    order.emplace_back(first_node, node);
  }
  std::sort(order.begin(), order.end());
  ObservationGroups groups;
  for (size_t begin = 0, end = 0; begin < order.size(); begin = end) {
    while (end < order.size() && order[end].first == order[begin].first) ++end;
    if (end - begin < 2) continue;
    for (size_t i = begin; i < end; ++i) {
      groups.observations.push_back(observations[order[i].second]);
    }
    groups.FinishGroup();
  }
  return groups;
}

// Splits the sorted observations of a component into sets of at least two
// images with at most one keypoint per image; see EstablishCandidates. Sets are
// ordered by their first observations.
ObservationGroups SplitComponent(const Scene& scene,
                                 const Observation* observations,
                                 size_t num_observations,
                                 const ComponentMatch* matches,
                                 size_t num_matches,
                                 double max_duplicate_distance_px) {
  const SortedAdjacency adjacency(num_observations, [&](const auto& visit) {
    for (size_t i = 0; i < num_matches; ++i) {
      visit(matches[i].first, matches[i].second);
    }
  });
  ConflictFreeSets sets(scene, observations, num_observations,
                        max_duplicate_distance_px);
  for (const uint32_t i : OrderBySupport(adjacency, matches, num_matches)) {
    sets.UnionIfConsistent(matches[i].first, matches[i].second);
  }
  std::vector<uint32_t> set_of_node(num_observations);
  for (uint32_t node = 0; node < num_observations; ++node) {
    set_of_node[node] = sets.SetOf(node);
  }
  return GroupBySet(observations, set_of_node,
                    ChooseRepresentatives(observations, num_observations,
                                          adjacency, set_of_node));
}

// Selects tracks by length such that every image has enough; see TrackOptions.
// Keeps the order of the candidates.
ObservationGroups SelectTracks(const ObservationGroups& candidates,
                               size_t num_images, const TrackOptions& options) {
  TrackCoverage coverage(candidates, num_images);
  coverage.Select(static_cast<size_t>(options.min_track_length),
                  options.max_tracks_per_image > 0
                      ? options.max_tracks_per_image
                      : std::numeric_limits<int>::max());
  coverage.Select(0, options.min_tracks_per_image);
  return coverage.Selected();
}

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
    splits[i] = SplitComponent(scene, groups.begin(group), groups.length(group),
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
    result.AddGroup(begin, end);
  }
  return result;
}

struct JoinedMatches {
  ObservationGroups candidates;
  size_t num_components = 0;
  size_t num_components_with_conflicts = 0;
};

JoinedMatches JoinMatches(const Scene& scene, const KeypointNodes& nodes,
                          const ViewGraph& view_graph,
                          const MatchSelection& selection,
                          const TrackOptions& options, const Context& context) {
  const MatchComponents components =
      FindComponents(nodes, view_graph, selection);
  context.CheckInterrupted();
  const ConflictingMatches conflicting =
      GatherConflictingMatches(nodes, view_graph, selection, components);

  JoinedMatches joined;
  joined.candidates =
      MakeConflictFree(scene, components, conflicting, options, context);
  joined.num_components = components.groups.size();
  joined.num_components_with_conflicts = components.has_conflict.Count();
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

constexpr int kNoPoint = -1;

// The point that a keypoint observes, or kNoPoint.
std::vector<int> PointsOfNodes(const KeypointNodes& nodes,
                               const std::vector<Point3D>& points) {
  std::vector<int> point_of_node(nodes.size(), kNoPoint);
  for (size_t i = 0; i < points.size(); ++i) {
    for (const Observation& o : points[i].track) {
      point_of_node[nodes.NodeOf(o.image_idx, o.keypoint_idx)] =
          static_cast<int>(i);
    }
  }
  return point_of_node;
}

}  // namespace

ObservationGroups EstablishCandidates(const Scene& scene,
                                      const ViewGraph& view_graph,
                                      const MatchSelection& selection,
                                      const TrackOptions& options,
                                      const Context& context) {
  MGSFM_CHECK_EQ(selection.pair_is_used.size(), view_graph.pairs.size());
  return JoinMatches(scene, KeypointNodes(scene), view_graph, selection,
                     options, context)
      .candidates;
}

ObservationGroups JoinPoints(const Scene& scene,
                             const ObservationGroups& candidates,
                             const std::vector<Point3D>& points,
                             bool with_others) {
  const KeypointNodes nodes(scene);
  const std::vector<int> point_of_node = PointsOfNodes(nodes, points);
  UnionFind sets(candidates.size() + points.size());
  for (size_t g = 0; g < candidates.size(); ++g) {
    for (const Observation* o = candidates.begin(g); o != candidates.end(g);
         ++o) {
      const int i = point_of_node[nodes.NodeOf(o->image_idx, o->keypoint_idx)];
      if (i != kNoPoint) sets.Union(g, candidates.size() + i);
    }
  }
  const ItemGroups<size_t> members =
      GroupItems<size_t>(sets.size(), [&](const auto& add) {
        for (size_t i = 0; i < sets.size(); ++i) add(sets.Find(i), i);
      });
  ObservationGroups joined;
  const size_t num_firsts = with_others ? sets.size() : candidates.size();
  for (size_t first = 0; first < num_firsts; ++first) {
    const size_t set = sets.Find(first);
    if (*members.begin(set) != first) continue;
    std::vector<Observation> observations;
    for (const size_t* i = members.begin(set); i != members.end(set); ++i) {
      if (*i < candidates.size()) {
        observations.insert(observations.end(), candidates.begin(*i),
                            candidates.end(*i));
      } else {
        const auto& track = points[*i - candidates.size()].track;
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

std::vector<std::ptrdiff_t> CountMatchesOfPoints(
    const Scene& scene, const ViewGraph& view_graph,
    const std::vector<Point3D>& points) {
  const KeypointNodes nodes(scene);
  const std::vector<int> point_of_node = PointsOfNodes(nodes, points);
  const auto point_of = [&](int image_idx, uint32_t keypoint_idx) {
    MGSFM_CHECK_LT(keypoint_idx, scene.images[image_idx].keypoints_px.size());
    return point_of_node[nodes.NodeOf(image_idx, keypoint_idx)];
  };
  return Transformed(view_graph.pairs, [&](const ImagePair& pair) {
    return CountIf(pair.matches, [&](const Match& match) {
      const int point = point_of(pair.image_idx1, match.keypoint_idx1);
      return point != kNoPoint &&
             point == point_of(pair.image_idx2, match.keypoint_idx2);
    });
  });
}

TrackResult EstablishTracks(const Scene& scene, const ViewGraph& view_graph,
                            const Mask& pair_is_used,
                            const TrackOptions& options,
                            const Context& context) {
  MGSFM_CHECK_EQ(pair_is_used.size(), view_graph.pairs.size());
  const KeypointNodes nodes(scene);
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
        SelectTracks(joined.candidates, scene.images.size(), options);
    has_few_tracks =
        FindImagesWithFewTracks(result.estimate, scene.images.size(), options);
    if (!has_few_tracks.Any()) break;
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
