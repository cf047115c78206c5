// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {

// The source of the focal length of a camera.
enum class LensSource {
  kGiven,       // a calibration
  kGuess,       // feature extraction, without knowledge
  kExif,        // the file of an image
  kPairs,       // the epipolar geometry of image pairs
  kAdjustment,  // bundle adjustment, and its images determine it
};

template <>
struct EnumTable<LensSource> {
  static constexpr std::pair<std::string_view, LensSource> kNames[] = {
      {"given", LensSource::kGiven},
      {"guess", LensSource::kGuess},
      {"EXIF", LensSource::kExif},
      {"pairs", LensSource::kPairs},
      {"adjustment", LensSource::kAdjustment}};
};

// The model of a lens without calibration.
struct LensChoice {
  int camera_idx = 0;
  CameraModelId model = CameraModelId::kSimpleRadial;
  std::string reason = {};  // empty if the model was given
  LensSource start = LensSource::kGuess;

  auto Fields() const {
    return Named("camera_id", As<Item::kCameraId>(camera_idx), "model", model,
                 "reason", reason);
  }
};

struct LensSummary {
  int num_rounds = 0;  // maps before the last one, with lenses that changed
  std::vector<LensChoice> lenses;

  auto Fields() const {
    return Named("num_rounds", num_rounds, "cameras", lenses);
  }
};

}  // namespace mgsfm
