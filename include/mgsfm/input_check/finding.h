// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"

namespace mgsfm {

// A cause of a finding about an input or a result.
enum class Cause {
  kNoModel,
  kFewImagesRegistered,
  kNoSharedFrames,          // several cameras, but no rig
  kWrongImageSize,          // keypoints do not fit the size of the camera
  kCameraLag,               // a camera is late by a number of frames
  kUnsynchronized,          // cameras are late by parts of a frame interval
  kMirroredCamera,          // mirrored images, or mounted upside down
  kForeignCamera,           // does not move with the rig
  kSwappedCameras,          // in a part of the frames
  kRigMoved,                // the rig changed during the recording
  kRigDiffers,              // between two models
  kWrongKnownRotation,      // of a sensor in its rig
  kWrongFocalLength,        // a trusted one
  kUncertainFocalLength,    // an estimated one
  kRejectedPositionPriors,  // all of them
  kOutlierPositionPriors,   // a large share of them
  kPositionUnit,            // differs from the unit of the known rig
  kRejectedGravityPriors,   // all of them
  kOutlierGravityPriors,    // a large share of them
  kLostMatches,             // matches that the model does not explain
  kWeakSeams,               // of a model (mgsfm/seams/confidence.h)
};

template <>
struct EnumTable<Cause> {
  static constexpr std::pair<std::string_view, Cause> kNames[] = {
      {"no_model", Cause::kNoModel},
      {"few_images_registered", Cause::kFewImagesRegistered},
      {"no_shared_frames", Cause::kNoSharedFrames},
      {"wrong_image_size", Cause::kWrongImageSize},
      {"camera_lag", Cause::kCameraLag},
      {"unsynchronized", Cause::kUnsynchronized},
      {"mirrored_camera", Cause::kMirroredCamera},
      {"foreign_camera", Cause::kForeignCamera},
      {"swapped_cameras", Cause::kSwappedCameras},
      {"rig_moved", Cause::kRigMoved},
      {"rig_differs", Cause::kRigDiffers},
      {"wrong_known_rotation", Cause::kWrongKnownRotation},
      {"wrong_focal_length", Cause::kWrongFocalLength},
      {"uncertain_focal_length", Cause::kUncertainFocalLength},
      {"rejected_position_priors", Cause::kRejectedPositionPriors},
      {"outlier_position_priors", Cause::kOutlierPositionPriors},
      {"position_unit", Cause::kPositionUnit},
      {"rejected_gravity_priors", Cause::kRejectedGravityPriors},
      {"outlier_gravity_priors", Cause::kOutlierGravityPriors},
      {"lost_matches", Cause::kLostMatches},
      {"weak_seams", Cause::kWeakSeams}};
};

// One finding, for users and the report.
struct Finding {
  Cause cause = Cause::kLostMatches;
  std::vector<std::string> cameras;  // names of the sensors concerned
  std::vector<std::string> frames;   // first and last one; empty: all
  std::vector<std::pair<std::string, double>> evidence;  // name and value
  std::string text;    // what was found, one sentence without a full stop
  std::string remedy;  // what to do, likewise

  auto Fields() const {
    return Named("cause", cause, "cameras", cameras, "frames", frames, "text",
                 text, "remedy", remedy, "evidence", evidence);
  }
};

}  // namespace mgsfm
