// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "exchange/exchange_formats.h"

namespace mgsfm {

// The shortest number that reads back as this value, in any locale.
std::string Digits(double value);
// "[1.5, 2]", as in YAML.
std::string NumberList(const std::vector<double>& values);

// Names of sensors that serve as file names and as frames of ROS: letters,
// digits, '_' and '-'; all different.
std::vector<std::string> PlainSensorNames(const Scene& scene);

// "000012" of "cam0/000012.png".
std::string ImageStem(const std::string& image_name);

// The frames with a registered image, in the natural order of their names.
std::vector<int> RegisteredFrames(const ExportInput& input);

// The index of the rig with registered frames. Throws Error, naming the format,
// if there are several.
int OnlyRig(const ExportInput& input, const std::string& format,
            const std::string& remedy);

// The sensors of a rig that have a pose, the reference first.
std::vector<int> PosedSensors(const ExportInput& input, int rig_idx);

// A message for each sensor that PosedSensors leaves out.
std::vector<std::string> SensorsWithoutPose(const ExportInput& input);

}  // namespace mgsfm
