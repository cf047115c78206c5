// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/extension/resection.h"

namespace mgsfm {

// Model extension adds the frames of a scene that an existing model lacks.
//
// 1. Passes, until one adds no frame: all frames without a pose are resected
//    against the points (mgsfm/extension/resection.h), each as one rigid unit.
//    The sensors of a rig that is new to the model are calibrated in the same
//    pass. Tracks are then established and triangulated again, and the frames
//    of the pass are refined with all others fixed.
// 2. Tracks, points and bundle adjustment of all frames, as in the mapper.
//
// Gauge: that of the existing model. Unless poses are fixed, the result is
// aligned to it by the similarity that fits the poses of its images, or by a
// rigid motion if known poses of sensors determine the unit of length.
//
// Cost: each pass is linear in the matches between frames with poses; bundle
// adjustment dominates.

struct ExtensionOptions {
  Option<bool> fix_existing_frames{
      "fix_existing_frames", false,
      "Fix the frames of the existing model and the sensors of its rigs."};
  ResectionOptions resection;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(fix_existing_frames, resection);
  }
};

struct ExtensionSummary {
  struct AddedFrame {
    int pass = 0;  // counted from 1
    ResectedFrame frame;
  };
  int num_existing_frames = 0;
  int num_passes = 0;  // passes that added frames
  bool frames_are_fixed = false;
  std::vector<AddedFrame> added_frames;
  std::vector<PlacedSensor> placed_sensors;
};

}  // namespace mgsfm
