// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/eval/evaluation.h"
#include "mgsfm/io/models/trajectory_io.h"
#include "named_model.h"

namespace mgsfm {

// True poses of the reference sensor, and which of them belongs to each frame;
// frames are known by the names of their images without folder and extension.
struct TrueTrajectory {
  std::vector<Rigid3> ref_from_world;
  std::map<std::string, size_t> pose_of_frame;
};

// By the line, from 0, that the name of a frame is the number of; else in
// order, if there are as many. `path` is named in errors.
TrueTrajectory AssignByNumber(const std::vector<std::string>& frames,
                              std::vector<Rigid3> ref_from_world,
                              const std::string& path);
// By the time (s or ns) that the name is, within half the usual step between
// poses; else as above.
TrueTrajectory AssignByTime(const std::vector<std::string>& frames,
                            const std::vector<TimedPose>& poses,
                            const std::string& path);

// The number that a text consists of.
std::optional<double> ParseNumber(const std::string& text);

// Images that the model may lack, by name; nullopt: it is not known which.
using ImageNames = std::optional<std::vector<std::string>>;

// Names of all frames of the model and of other images of its sensors, which
// their folders tell; sorted. Throws Error if two frames of the model have
// one name, as in two sequences.
std::vector<std::string> FrameNames(const NamedModel& model,
                                    const ImageNames& other_images);

// Model and truth, image by image, in the order of the trajectory. Sensors that
// are not in `sensor_from_ref` (per sensor of the model) are left out. Images
// that the model lacks are added: other_images or, if these are not known, all
// of frames in gaps of the model, which are true poses that lie at its median
// step between two of its frames.
std::vector<ImagePoses> PairWithTrajectory(
    const NamedModel& model, const TrueTrajectory& trajectory,
    const std::vector<std::optional<Rigid3>>& sensor_from_ref,
    const ImageNames& other_images);

}  // namespace mgsfm
