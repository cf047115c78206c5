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
#include "mgsfm/base/mask.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/model_tools/model_tools.h"
#include "mgsfm/scene/estimates.h"

namespace mgsfm {

struct SubMapFiles {
  std::vector<std::string> folders;  // of the models that exist
  // Per folder; nullopt for the models of a finished map, which come first.
  std::vector<std::optional<int>> clusters;
  int num_existing = 0;
  std::vector<std::string> missing;  // folders of clusters without models
};

// The path without a slash at its end, so that its last part is the name of the
// folder.
std::filesystem::path NormalizedFolder(const std::string& path);

// The sub-maps in the folder `input_path`, whose folders are named by clusters.
// All clusters of the partition in `cluster_path`, if it is given, should have
// one. The models of a finished map in the folder `existing_path`, if it is
// given, come first. Throws Error if a folder cannot be read, or if a model of
// the finished map is also a sub-map.
SubMapFiles FindSubMaps(const std::string& input_path,
                        const std::string& cluster_path,
                        const std::string& existing_path);

// Facts about a sub-map that its run reports beside its model.
struct SubMapFacts {
  std::vector<std::pair<std::string, Rigid3>> cam_from_world;  // by image name
  // Whether its world is that of measured positions, and the origin of GPS.
  bool is_registered = false;
  std::optional<Eigen::Vector3d> origin_wgs84;
  bool used_gravity = false;
};

// Facts of the model in the folder. The report of its run may be missing.
SubMapFacts FindSubMapFacts(const std::filesystem::path& folder,
                            const SceneModel& model);

// The frames of a scene with images of the sub-map.
Mask FramesOf(const SubMapFacts& facts, const Scene& scene);

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
