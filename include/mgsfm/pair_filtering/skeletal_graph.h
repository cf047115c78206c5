// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

struct SkeletalGraphOptions {
  double min_strength = 0.6;
  double min_connecting_strength = 0.5;  // of the strongest
};
// Hardly more than a chain of neighbours, with what copies do not reach, even
// on a road with little else to see.
constexpr SkeletalGraphOptions kStrictSkeletalGraph = {0.9, 0.9};

// Pairs of neighbours. Counting votes does not tell a road from one that is
// folded so that two equal facades meet: few pairs cross the place where it
// would tear, and many may join the facades. What tells them apart is strength.
// Neighbours share most of what they see; images of two like structures share
// only these. So a first estimate is made from the backbone alone, and pairs
// that its drift cannot explain are left out of the second.
//
// A pair of unrelated places may have more matches than the neighbours of a
// frame that misses most of its images. But no third image confirms its
// matches, as there are no other pairs between these places. So what counts are
// matches of two keypoints that are both matched with one of a third image.
//
// The strength of two frames is the number of such matches of all their pairs
// over that of the best partner of either frame, whichever gives more: the
// cameras of a rig vote together, and a pair that is wrong by itself stands
// alone against all pairs of two neighbours. In the backbone are pairs that
// have such matches and whose frames are stronger than min_strength, pairs in
// one frame, and those needed to connect parts: of the pairs that leave a part,
// those with at least min_connecting_strength times the strength of the
// strongest. Only what is apart then is connected in the same way by all
// matches: a chain of which only neighbours are matched confirms nothing.
//
// Per pair; false where pair_is_used is.
Mask SelectSkeletalGraph(const Scene& scene, const ViewGraph& view_graph,
                         const Mask& pair_is_used,
                         const SkeletalGraphOptions& options = {},
                         int num_threads = 1);

// Of the pairs of a view graph that a backbone can judge, more than this share
// cannot be wrong; if so it is the backbone that is.
constexpr double kMaxShareBeyondDrift = 1.0 / 3.0;

// Wrong pairs between two stretches of neighbouring frames: first_frame_idx1 to
// last_frame_idx1 and first_frame_idx2 to last_frame_idx2.
struct RejectedGroup {
  int num_pairs = 0;
  int first_frame_idx1 = 0;
  int last_frame_idx1 = 0;
  int first_frame_idx2 = 0;
  int last_frame_idx2 = 0;
};

// Puts suspicious pairs together whose frames are, at both ends, at most three
// apart in the order of the scene. Largest group first. A group of many is the
// mark of structures that look alike.
std::vector<RejectedGroup> GroupRejectedPairs(const Scene& scene,
                                              const ViewGraph& view_graph,
                                              const Mask& pair_is_rejected);

// One line for a user: how many pairs between which frames, and what they may
// show. Of stretches that overlap or nearly do, that is vehicles: what keeps
// its distance from the rig looks like what does not move, seen by a rig that
// does not either.
std::string DescribeRejectedGroup(const Scene& scene,
                                  const RejectedGroup& group);

}  // namespace mgsfm
