// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "fleet/sub_maps.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// Relative similarities of sub-maps, and their average.
//
// Edges. Two sub-maps with at least three common images: the rotation is the
// mean over these images, the translation the median over their centers. Other
// two sub-maps: matches between their images pair a point of each; RANSAC finds
// the similarity on which most of these points agree. Its inliers must be at
// least min_num_loop_points. The scale is the ratio of the rigs' sensor offsets
// if both have them, because they share a calibration; otherwise, it is the
// scale of the common centers or points.
//
// Trust. The maximum spanning forest, weighted by common images and then by
// points, places the sub-maps. Another edge is a loop closure. It contradicts
// the forest by a rotation and by a distance at its place. It is rejected if
// the rotation is above max_rotation_deg, or if the distance is above max_drift
// of the path between the two sub-maps through the forest.
//
// Average. With T_i = world_from_i and anchors x of edge (i, j) in both worlds,
//
//   min  sum_ij w_ij sum_k rho(|T_i x_ijk - T_j x_jik|^2),   rho Cauchy,
//
// by Gauss-Newton over all T_i but one per connected component. The four
// anchors are the mean of the common places and a tetrahedron around it of the
// size of the common region. Stops when no anchor moves by more than 1e-9 of
// the extent, or after 50 steps. Cost: linear in the edges, and a sparse
// factorization with seven unknowns per sub-map.
std::vector<SubMapEdge> MeasureEdges(const std::vector<SceneModel>& sub_maps,
                                     const std::vector<CrossPair>& pairs,
                                     const JoinOptions& options);

// Sets is_used and the reason of rejected edges. Returns the indices of the
// edges of the forest.
std::vector<int> RejectWrongLoops(const std::vector<SceneModel>& sub_maps,
                                  const JoinOptions& options,
                                  std::vector<SubMapEdge>* edges);

// world_from_sub_map, in the world of the first sub-map of each tree of the
// forest (WalkForest).
std::vector<Sim3> AverageSimilarities(const std::vector<SceneModel>& sub_maps,
                                      const std::vector<SubMapEdge>& edges,
                                      const std::vector<int>& forest);

Sim3 Compose(const Sim3& c_from_b, const Sim3& b_from_a);

}  // namespace mgsfm
