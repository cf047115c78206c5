// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/scene/scene.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Where images are missing, two stretches of frames may be joined by nothing
// but a few lone pairs that contradict each other. Rotations agree with any one
// of them, which then tears the road as likely as not. A link, all consistent
// pairs of two frames, is doubtful if
//
//   without it its frames are in two parts,
//   no third image confirms any of its matches,
//   but others those of a link of one of its frames, and
//   pairs between the two parts that contradict it have, together, at least
//   half as many matches.
//
// The third spares chains of which only neighbours were matched: there nothing
// is confirmed, and one wrong pair would cut them all.
//
// Per pair; false where pair_is_consistent is. Cost: linear in the links; if
// some are bridges, in the matches; and the number of doubtful ones times the
// number of contradicting pairs.
Mask FindUnsupportedBridges(const Scene& scene, const ViewGraph& view_graph,
                            const Mask& pair_is_consistent,
                            int num_threads = 1);

}  // namespace mgsfm
