// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/extension/resection.h"

namespace mgsfm {

// Going on from a model: frames that it lacks are added.
//
// 1. In passes, until none adds a frame: all frames without pose are resected
//    against the points (mgsfm/resection/resection.h), whole frames at once,
//    also of rigs that are new, whose poses of sensors are estimated on the
//    way; tracks are made anew and triangulated; the frames of the pass are
//    refined with all others held.
// 2. Tracks, points and bundle adjustment of everything, as of any model.
//
// Gauge: that of the given model. Where nothing holds it there, the result is
// moved back by the similarity that fits the poses of the images it had, or by
// a rigid motion if given poses of sensors determine the unit of length.
//
// Cost: for each pass, linear in the matches between frames with poses; then
// bundle adjustment.

struct ExtensionOptions {
  bool fix_existing_frames = false;
  ResectionOptions resection;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("fix_existing_frames", self.fix_existing_frames, AnyValue(), "",
          "With --input_path: hold the frames of that model, and the cameras "
          "in its rigs, where they are.");
    ResectionOptions::Describe(self.resection, visit);
  }
};

// What became of a model that was gone on from.
struct ExtensionSummary {
  struct AddedFrame {
    int pass = 0;  // from 1 on
    ResectedFrame frame;
  };
  int num_existing_frames = 0;
  int num_passes = 0;  // that added frames
  bool frames_are_fixed = false;
  std::vector<AddedFrame> added_frames;
  std::vector<PlacedSensor> placed_sensors;
};

}  // namespace mgsfm
