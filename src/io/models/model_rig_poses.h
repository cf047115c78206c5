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

// Estimates poses of sensors and frames from image poses, one per image of the
// scene where known; see model_scene.h. Messages name `folder`.
class RigPoses {
 public:
  RigPoses(const std::filesystem::path& folder,
           const std::vector<std::optional<Rigid3>>& cam_from_world,
           const Scene& scene)
      : folder_(folder), cam_from_world_(cam_from_world), scene_(scene) {}

  // Estimates missing sensor poses relative to sensors of the same frames.
  // Known poses are kept; sensors without a posed image stay nullopt.
  void EstimateSensors(std::vector<std::optional<Rigid3>>* poses) const;
  // Throws Error if images contradict the known pose of a sensor of the scene.
  // `poses` are estimated from images. The limits are 1 degree, and 5 % of the
  // largest known distance from the reference.
  void CheckKnownSensors(const std::vector<std::optional<Rigid3>>& poses) const;
  // The same for poses that follow from the images alone.
  void CheckKnownSensors() const;
  // Frames without a posed image are nullopt.
  std::vector<std::optional<Rigid3>> PlaceFrames(
      const std::vector<std::optional<Rigid3>>& sensor_from_rig) const;

 private:
  void FillMissing(std::vector<std::optional<Rigid3>>* poses) const;
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
