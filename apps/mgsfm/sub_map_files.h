// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "fleet/sub_maps.h"
#include "mgsfm/base/context.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/model_tools/model_tools.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

struct SubMapFiles {
  std::vector<std::string> folders;  // of the models that exist
  std::vector<int> clusters;         // per folder
  std::vector<std::string> missing;  // folders of clusters without models
};

// The sub-maps in the folder `input_path`, whose folders are named by clusters.
// All clusters of the partition in `cluster_path`, if it is given, should have
// one. Throws Error if a folder cannot be read.
SubMapFiles FindSubMaps(const std::string& input_path,
                        const std::string& cluster_path);

// Facts about a sub-map that its run reports beside its model.
struct SubMapFacts {
  std::vector<std::pair<std::string, Rigid3>> cam_from_world;  // by image name
  // Whether its world is that of measured positions, and the origin of GPS.
  bool is_registered = false;
  std::optional<Eigen::Vector3d> origin_wgs84;
  bool used_gravity = false;
};

// The report of the run of a sub-map may be missing.
SubMapFacts ReadSubMapFacts(const std::filesystem::path& folder);

// Pairs of images that are both in models, but not in the same model. None
// without a database.
std::vector<CrossPair> ReadCrossPairs(const std::string& database_path,
                                      const std::vector<SubMapFacts>& facts,
                                      const Context& context);

// The world of measured positions that most frames of a joined model have.
struct WorldOfParts {
  Reconstruction poses;  // of the sub-maps in it, in the scene of the model
  std::optional<Eigen::Vector3d> origin_wgs84;
};

// nullopt if no sub-map of the model is in such a world. The first one that is
// defines it; the sub-maps are ordered by their clusters.
std::optional<WorldOfParts> FindWorld(const SceneModel& model,
                                      const std::vector<int>& sub_maps,
                                      const std::vector<SubMapFacts>& facts,
                                      const Context& context);

}  // namespace mgsfm
