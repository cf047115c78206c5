// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/database/database.h"
#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Adds the rigs and frames of a model. Frames lose images that the model lacks.
void AddModelTables(const PoseModel& poses, DatabaseContents* contents);

// Throws Error, naming `folder` and the image, unless image poses agree with
// those of their frames and sensors, and each image is in one frame of a rig
// with its camera. Programs without rigs write images beside the rigs and
// frames of an earlier model.
void CheckModelTables(const PoseModel& poses,
                      const std::filesystem::path& folder);

// Compares poses, cameras and points of a model with its keypoints. Throws
// Error if more than a tenth of the points do not project to their keypoints,
// and less than half as many fail with poses in another convention: quaternions
// x, y, z, w, or poses world_from_cam. Warns if most points fail.
void CheckObservations(const Model& model, const std::filesystem::path& folder,
                       const Context& context);

// The points of a model, with sorted tracks. `image_idxs` are those of its
// images.
std::vector<Point3D> PointsOf(const Model& model,
                              const std::vector<int>& image_idxs);

// Throws Error.
[[noreturn]] void ThrowModelError(const std::filesystem::path& folder,
                                  const std::string& problem);

// A pose per item, where it is known.
using OptionalPoses = std::vector<std::optional<Rigid3>>;

// Estimates poses of sensors and frames from image poses, one per image of the
// scene where known; see model_scene.h. Messages name `folder`.
class RigPoses {
 public:
  RigPoses(const std::filesystem::path& folder,
           const OptionalPoses& cam_from_world, const Scene& scene)
      : folder_(folder), cam_from_world_(cam_from_world), scene_(scene) {}

  // Estimates missing sensor poses relative to sensors of the same frames.
  // Known poses are kept; sensors without a posed image stay nullopt.
  void EstimateSensors(OptionalPoses* poses) const;
  // Throws Error if images contradict the known pose of a sensor of the scene.
  // `poses` are estimated from images. The limits are 1 degree, and 5 % of the
  // largest known distance from the reference.
  void CheckKnownSensors(const OptionalPoses& poses) const;
  // The same for poses estimated from the images alone.
  void CheckKnownSensors() const;
  // Frames without a posed image are nullopt.
  OptionalPoses PlaceFrames(const OptionalPoses& sensor_from_rig) const;

 private:
  void FillMissing(OptionalPoses* poses) const;
  std::vector<Rigid3> Candidates(int sensor_idx,
                                 const OptionalPoses& poses) const;
  void CheckMovesLikeRig(int sensor_idx, const std::vector<Rigid3>& candidates,
                         const Rigid3& pose) const;
  void CheckAllAreKnown(const OptionalPoses& poses) const;

  const std::filesystem::path& folder_;
  const OptionalPoses& cam_from_world_;
  const Scene& scene_;
};

}  // namespace mgsfm
