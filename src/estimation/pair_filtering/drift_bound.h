// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <limits>

#include "math/spanning_tree.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/scene/view_graph.h"
#include "pair_filtering/frame_pair_index.h"

namespace mgsfm {

enum class DriftGrowth {
  // Independent errors of the edges: the standard deviation of their sum grows
  // with the square root of the path length.
  kRandomWalk,
  // Errors that persist, such as those of scale and heading.
  kProportional,
};

// Largest drift between two frames that an estimate from the skeletal graph
// alone may have: for a path of length l,
//
//   bound = min(rate * sqrt(l), max)   or   min(rate * l, max).
//
// Paths lead through the maximum spanning tree of the skeletal graph, weighted
// by the number of matches. Between two components only the parts of the path
// inside them count.
class DriftBound {
 public:
  struct Model {
    DriftGrowth growth;
    double rate;  // of the bound at path length 1
    double max = std::numeric_limits<double>::infinity();
  };

  // length_of_pair(pair_idx) is the length of a pair of the skeletal graph that
  // connects two frames.
  DriftBound(const FramePairIndex& index, const ViewGraph& view_graph,
             const Mask& is_in_skeleton,
             const std::function<double(size_t)>& length_of_pair,
             const Model& model);

  // Cost: the number of edges on the path.
  double Of(const FramePairIndex::FramePair& frames) const;

 private:
  TreePathLengths paths_;
  Model model_;
};

// True if so many of the judged pairs were rejected that the skeletal graph
// must be wrong rather than the pairs.
bool RejectsTooMany(size_t num_rejected, size_t num_judged);

}  // namespace mgsfm
