// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Throws Error.
[[noreturn]] void ThrowModelError(const std::filesystem::path& folder,
                                  const std::string& problem);

// From poses of images, per image of a scene that has one, to those of sensors
// and frames; see mgsfm/io/model_scene.h. `folder` is what messages name.
class RigPoses {
 public:
  RigPoses(const std::filesystem::path& folder,
           const std::vector<std::optional<Rigid3>>& cam_from_world,
           const Scene& scene)
      : folder_(folder), cam_from_world_(cam_from_world), scene_(scene) {}

  // Sensors are placed beside those of their frames that have a pose. The poses
  // that are there are kept; sensors without an image that has a pose stay
  // without one.
  void EstimateSensors(std::vector<std::optional<Rigid3>>* poses) const;
  // nullopt for frames without an image that has a pose.
  std::vector<std::optional<Rigid3>> PlaceFrames(
      const std::vector<std::optional<Rigid3>>& sensor_from_rig) const;

 private:
  std::vector<Rigid3> Candidates(
      int sensor_idx, const std::vector<std::optional<Rigid3>>& poses) const;
  void CheckMovesLikeRig(int sensor_idx, const std::vector<Rigid3>& candidates,
                         const Rigid3& pose) const;
  void CheckAllAreKnown(const std::vector<std::optional<Rigid3>>& poses) const;

  const std::filesystem::path& folder_;
  const std::vector<std::optional<Rigid3>>& cam_from_world_;
  const Scene& scene_;
};

}  // namespace mgsfm
