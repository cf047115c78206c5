// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "mgsfm/model_tools/model_tools.h"
#include "model_tools/sub_maps.h"

namespace mgsfm {

// Tells the points of a sub-map that the join may need, which another sub-map
// may have, too: those with an observation in an image of several sub-maps, or
// in a match across sub-maps.
class SubMapBoundary {
 public:
  // `names` are those of the images of each sub-map.
  SubMapBoundary(const std::vector<std::vector<std::string>>& names,
                 const std::vector<CrossPair>& pairs);

  // Takes all other points out of the model.
  std::vector<Point3D> TakeInterior(SceneModel* model) const;

 private:
  std::set<std::string> common_images_;
  // Per image: the keypoints of matches, ascending.
  std::map<std::string, std::vector<uint32_t>> matched_keypoints_;
};

}  // namespace mgsfm
