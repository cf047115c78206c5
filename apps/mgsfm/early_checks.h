// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/priors/pose_priors.h"

namespace mgsfm {

// A path that an option names; lists have commas.
struct NamedPath {
  std::string option;
  std::string value;  // empty: none
};

// Throws Error, naming the option, unless all paths exist.
void CheckPathsExist(const std::vector<NamedPath>& paths);

// Throws the Error that the rigs would cause after the extraction of features:
// names of cameras, folders and sizes of images that do not fit the
// configuration, calibration or rule. Does nothing where intrinsics or times
// decide.
void CheckRigsOfImages(const std::string& image_path,
                       const std::vector<std::string>& names,
                       const SceneLoadingOptions& loading);

// Throws the Error that files of times, positions and gravity of images would
// cause after the matching: malformed lines, and names of other images.
void CheckValuesOfImages(const std::vector<std::string>& names,
                         const std::string& image_timestamps_path,
                         const PosePriorOptions& priors);

}  // namespace mgsfm
