// SPDX-License-Identifier: BSD-3-Clause
#include "pair_filtering/unsupported_bridges.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "pair_filtering/triplet_consistency.h"

namespace mgsfm {
namespace {

using FramePair = FramePairIndex::FramePair;

// All consistent pairs of two frames.
struct Link {
  int frame_idx1 = 0;
  int frame_idx2 = 0;
  int num_matches = 0;
  bool is_loop = false;  // of distant frames of a sequence
  std::vector<size_t> pair_idxs;

  int Other(int frame_idx) const {
    return frame_idx == frame_idx1 ? frame_idx2 : frame_idx1;
  }
};

struct LinkGraph {
  std::vector<Link> links;
  std::vector<std::vector<size_t>> links_of_frame;
};

// A frame in the depth-first forest of the link graph. The frames below it are
// entered at the numbers [enter, leave).
struct VisitedFrame {
  int root = 0;
  std::optional<size_t> link_to_parent;
  int enter = 0;
  int leave = 0;
  int lowest = 0;  // first entered frame that a link from below leads to

  bool IsBelowBridge() const { return link_to_parent && lowest >= enter; }
  bool Contains(const VisitedFrame& other) const {
    return root == other.root && other.enter >= enter && other.enter < leave;
  }
};
using DepthFirstForest = std::vector<std::optional<VisitedFrame>>;

LinkGraph BuildLinkGraph(const PairEvidence& evidence) {
  const FramePairIndex& index = evidence.index;
  LinkGraph graph;
  graph.links_of_frame.resize(index.num_frames());
  for (const FramePair& frames : index.frame_pairs()) {
    if (!frames.IsBetweenFrames()) continue;
    Link link{
        frames.frame_idx1, frames.frame_idx2, 0, index.IsLoop(frames), {}};
    for (const size_t i : frames.pair_idxs) {
      if (!evidence.pair_is_used[i]) continue;
      link.num_matches +=
          static_cast<int>(evidence.view_graph.pairs[i].matches.size());
      link.pair_idxs.push_back(i);
    }
    if (link.pair_idxs.empty()) continue;
    graph.links_of_frame[link.frame_idx1].push_back(graph.links.size());
    graph.links_of_frame[link.frame_idx2].push_back(graph.links.size());
    graph.links.push_back(std::move(link));
  }
  return graph;
}

// Visits the component of `root` depth first (Tarjan, 1974). Iterative, because
// paths are as long as drives.
void VisitComponent(const LinkGraph& graph, int root, int* num_entered,
                    DepthFirstForest* forest) {
  std::vector<std::pair<int, size_t>> path;  // frames, and their next links
  const auto enter = [&](int frame, std::optional<size_t> link_to_parent) {
    (*forest)[frame] = {root, link_to_parent, *num_entered, 0, *num_entered};
    ++*num_entered;
    path.emplace_back(frame, 0);
  };
  enter(root, std::nullopt);
  while (!path.empty()) {
    const int frame = path.back().first;
    VisitedFrame& visited = *(*forest)[frame];
    if (path.back().second == graph.links_of_frame[frame].size()) {
      visited.leave = *num_entered;
      path.pop_back();
      if (path.empty()) break;
      int& lowest_of_parent = (*forest)[path.back().first]->lowest;
      lowest_of_parent = std::min(lowest_of_parent, visited.lowest);
      continue;
    }
    const size_t link = graph.links_of_frame[frame][path.back().second++];
    if (link == visited.link_to_parent) continue;
    const int other = graph.links[link].Other(frame);
    if ((*forest)[other]) {
      visited.lowest = std::min(visited.lowest, (*forest)[other]->enter);
    } else {
      enter(other, link);
    }
  }
}

LinkGraph WithoutLoops(const LinkGraph& graph) {
  LinkGraph rest;
  rest.links_of_frame.resize(graph.links_of_frame.size());
  for (const Link& link : graph.links) {
    if (link.is_loop) continue;
    rest.links_of_frame[link.frame_idx1].push_back(rest.links.size());
    rest.links_of_frame[link.frame_idx2].push_back(rest.links.size());
    rest.links.push_back(link);
  }
  return rest;
}

DepthFirstForest VisitDepthFirst(const LinkGraph& graph) {
  DepthFirstForest forest(graph.links_of_frame.size());
  int num_entered = 0;
  for (size_t f = 0; f < forest.size(); ++f) {
    if (!forest[f]) {
      VisitComponent(graph, static_cast<int>(f), &num_entered, &forest);
    }
  }
  return forest;
}

// Per link: whether any of its matches is triplet-consistent.
Mask FindSupportedLinks(const LinkGraph& graph, const PairEvidence& evidence) {
  const std::vector<int> support = CountTripletConsistentMatches(
      evidence.view_graph, evidence.pair_is_used, evidence.num_threads);
  Mask is_supported(graph.links.size(), false);
  for (size_t k = 0; k < graph.links.size(); ++k) {
    const std::vector<size_t>& pair_idxs = graph.links[k].pair_idxs;
    is_supported[k] =
        AnyOf(pair_idxs, [&](size_t i) { return support[i] > 0; });
  }
  return is_supported;
}

// Whether each frame is connected to the first one of its component by more
// than one path.
bool HasBridges(const DepthFirstForest& forest) {
  return AnyOf(forest,
               [](const auto& frame) { return frame->IsBelowBridge(); });
}

bool IsUnsupportedAmongSupported(const LinkGraph& graph,
                                 const Mask& link_is_supported, size_t link) {
  if (link_is_supported[link]) return false;
  const auto has_support = [&](int frame_idx) {
    const std::vector<size_t>& links = graph.links_of_frame[frame_idx];
    return AnyOf(links, [&](size_t k) { return link_is_supported[k]; });
  };
  return has_support(graph.links[link].frame_idx1) ||
         has_support(graph.links[link].frame_idx2);
}

// Matches of inconsistent pairs between the frames below `top` and the rest of
// its component. In a sequence, those of neighbors only: the number of wrong
// loops across a cut grows with the length of the sequence.
int CountMatchesAgainst(const PairEvidence& evidence,
                        const Mask& pair_is_explained,
                        const DepthFirstForest& forest,
                        const VisitedFrame& top) {
  int num_matches = 0;
  for (const FramePair& frames : evidence.index.frame_pairs()) {
    const VisitedFrame& visited1 = *forest[frames.frame_idx1];
    const VisitedFrame& visited2 = *forest[frames.frame_idx2];
    if (visited1.root != top.root || visited2.root != top.root ||
        top.Contains(visited1) == top.Contains(visited2) ||
        evidence.index.IsLoop(frames)) {
      continue;
    }
    for (const size_t i : frames.pair_idxs) {
      const ImagePair& pair = evidence.view_graph.pairs[i];
      if (evidence.pair_is_used[i] || pair_is_explained[i] ||
          !pair.relative_pose) {
        continue;
      }
      num_matches += static_cast<int>(pair.matches.size());
    }
  }
  return num_matches;
}

// The links whose removal disconnects frames.
Mask FindBridges(const PairEvidence& evidence, const Mask& pair_is_explained,
                 const LinkGraph& graph) {
  Mask is_unsupported(evidence.pair_is_used.size(), false);
  const DepthFirstForest forest = VisitDepthFirst(graph);
  if (!HasBridges(forest)) return is_unsupported;
  const Mask link_is_supported = FindSupportedLinks(graph, evidence);
  for (const std::optional<VisitedFrame>& top : forest) {
    if (!top->IsBelowBridge() ||
        !IsUnsupportedAmongSupported(graph, link_is_supported,
                                     *top->link_to_parent)) {
      continue;
    }
    const Link& bridge = graph.links[*top->link_to_parent];
    if (CountMatchesAgainst(evidence, pair_is_explained, forest, *top) <
        evidence.options.min_share_against_bridge * bridge.num_matches) {
      continue;
    }
    for (const size_t i : bridge.pair_idxs) is_unsupported[i] = true;
  }
  return is_unsupported;
}

bool ShareMatches(const PairEvidence& evidence, int frame_idx1,
                  int frame_idx2) {
  if (frame_idx1 == frame_idx2) return true;
  const FramePair* frames = evidence.index.Find(frame_idx1, frame_idx2);
  return frames != nullptr && AnyOf(frames->pair_idxs, [&](size_t i) {
           return evidence.pair_is_used[i];
         });
}

// Rejects the loop links between parts that the links of neighbors do not
// connect, and that loops of one place alone join.
void RejectLoopsOfOnePlace(const PairEvidence& evidence, const LinkGraph& graph,
                           Mask* pair_is_unsupported) {
  UnionFind parts(graph.links_of_frame.size());
  bool has_loops = false;
  for (const Link& link : graph.links) {
    has_loops |= link.is_loop;
    if (!link.is_loop) parts.Union(link.frame_idx1, link.frame_idx2);
  }
  if (!has_loops) return;
  std::vector<std::vector<int>> frames_of_part(graph.links_of_frame.size());
  for (size_t f = 0; f < frames_of_part.size(); ++f) {
    frames_of_part[parts.Find(f)].push_back(static_cast<int>(f));
  }
  const Mask link_is_supported = FindSupportedLinks(graph, evidence);
  std::map<std::pair<size_t, size_t>, std::vector<std::pair<int, int>>> joins;
  for (size_t k = 0; k < graph.links.size(); ++k) {
    const int frame1 = graph.links[k].frame_idx1;
    const int frame2 = graph.links[k].frame_idx2;
    const size_t part1 = parts.Find(frame1), part2 = parts.Find(frame2);
    if (part1 == part2 || !link_is_supported[k]) continue;
    if (part1 < part2) {
      joins[{part1, part2}].emplace_back(frame1, frame2);
    } else {
      joins[{part2, part1}].emplace_back(frame2, frame1);
    }
  }
  for (const auto& [of_parts, links] : joins) {
    const auto& [part1, part2] = of_parts;
    if (!ShowOnePlace(evidence, links, frames_of_part[part1],
                      frames_of_part[part2])) {
      parts.Union(part1, part2);
    }
  }
  for (const Link& link : graph.links) {
    if (parts.Find(link.frame_idx1) == parts.Find(link.frame_idx2)) continue;
    for (const size_t i : link.pair_idxs) (*pair_is_unsupported)[i] = true;
  }
}

}  // namespace

bool ShowOnePlace(const PairEvidence& evidence,
                  const std::vector<std::pair<int, int>>& links,
                  const std::vector<int>& frame_idxs1,
                  const std::vector<int>& frame_idxs2) {
  for (size_t i = 0; i < links.size(); ++i) {
    for (size_t k = 0; k < i; ++k) {
      if (!ShareMatches(evidence, links[i].first, links[k].first) &&
          !ShareMatches(evidence, links[i].second, links[k].second)) {
        return false;
      }
    }
  }
  const auto has_other_places = [&](const std::vector<int>& frame_idxs,
                                    int std::pair<int, int>::*linked) {
    return AnyOf(frame_idxs, [&](int frame) {
      return NoneOf(links, [&](const auto& link) {
        return ShareMatches(evidence, frame, link.*linked);
      });
    });
  };
  return has_other_places(frame_idxs1, &std::pair<int, int>::first) &&
         has_other_places(frame_idxs2, &std::pair<int, int>::second);
}

Mask FindUnsupportedBridges(const PairEvidence& evidence,
                            const Mask& pair_is_explained) {
  MGSFM_CHECK_EQ(evidence.index.num_pairs(), evidence.view_graph.pairs.size());
  MGSFM_CHECK_EQ(evidence.pair_is_used.size(),
                 evidence.view_graph.pairs.size());
  MGSFM_CHECK_EQ(pair_is_explained.size(), evidence.view_graph.pairs.size());
  const LinkGraph graph = BuildLinkGraph(evidence);
  Mask is_unsupported =
      FindBridges(evidence, pair_is_explained, WithoutLoops(graph));
  RejectLoopsOfOnePlace(evidence, graph, &is_unsupported);
  return is_unsupported;
}

}  // namespace mgsfm
