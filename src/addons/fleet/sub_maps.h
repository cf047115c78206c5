// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/model_tools/model_tools.h"
#include "mgsfm/scene/view_graph.h"

namespace mgsfm {

// Joins models of overlapping parts of one database.

struct JoinOptions {
  // Three points determine the similarity. A wrong point agrees with it by
  // chance with a probability of about 1e-4, so seven more do not. A loop of 29
  // correct points halves the error of 08, stereo (docs/results/constants.md).
  Option<int> min_num_loop_points{
      "min_num_loop_points", 10, AtLeast(3), "points",
      "Reject loop closures between sub-maps without common images if their "
      "matches agree on fewer points."};
  Option<double> max_loop_rotation_deg{
      "max_loop_rotation_deg", 10.0, Between(0.0, 180.0), "deg",
      "Reject loop closures whose rotation contradicts the chain of sub-maps "
      "by more."};
  Option<double> max_loop_drift{
      "max_loop_drift", 0.05, GreaterThan(0.0),
      "Reject loop closures whose position contradicts the chain of sub-maps "
      "by more than this fraction of its length. Increase it if a single "
      "camera drifts in scale."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(min_num_loop_points, max_loop_rotation_deg, max_loop_drift);
  }
};

// Matches of two images, given by name, that are in no common sub-map.
struct CrossPair {
  std::string name1;
  std::string name2;
  std::vector<Match> matches;
};

// A relative similarity of two sub-maps.
struct SubMapEdge {
  int sub_map1 = 0;  // < sub_map2
  int sub_map2 = 0;
  Sim3 first_from_second;
  int num_common_images = 0;
  int num_points = 0;  // that matches across agree on
  // The same places in the worlds of both sub-maps.
  std::array<Eigen::Vector3d, 4> anchors1, anchors2;
  bool is_used = true;
  // The contradiction of a loop closure with the chain of sub-maps.
  std::optional<double> rotation_error_deg;
  std::optional<double> drift;  // share of the path length
};

struct JoinedMaps {
  // The largest model comes first. SortFrames() has ordered the frames of each.
  std::vector<SceneModel> models;
  std::vector<std::vector<int>> sub_maps;  // per model, ascending
  std::vector<SubMapEdge> edges;
  int num_loop_points = 0;  // points that matches across sub-maps merged
  // Per sub-map: why it is in a separate model although edges connect it.
  std::vector<std::string> conflicts;
};

// Places the sub-maps by sub_map_graph.h and merges them, largest first. Points
// are merged if they share an observation, or if a match connects them across
// two sub-maps with a used edge and both are in about the same direction. Such
// matches also add keypoints without a point to tracks. The first
// `num_existing` sub-maps are models of a finished map: the first one in a
// joined model gives it its world and calibration.
JoinedMaps JoinSubMaps(std::vector<SceneModel> sub_maps,
                       const std::vector<CrossPair>& pairs,
                       const JoinOptions& options, const Context& context,
                       int num_existing = 0);

}  // namespace mgsfm
