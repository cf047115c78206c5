// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "exchange/exchange_formats.h"

namespace mgsfm {

// The shortest number that reads back as this value, in any locale.
std::string Digits(double value);
// "[1.5, 2]", as in YAML.
std::string NumberList(const std::vector<double>& values);

Eigen::Vector2d PrincipalPoint(const Camera& camera);

// Names of sensors that serve as file names and as frames of ROS: letters,
// digits, '_' and '-'; all different.
std::vector<std::string> PlainSensorNames(const Scene& scene);

// The frames with a registered image, in the natural order of their names.
std::vector<int> RegisteredFrames(const ExportInput& input);

// The index of the rig with registered frames. Throws Error, naming the format,
// if there are several.
int OnlyRig(
    const ExportInput& input, const std::string& format,
    const std::string& remedy = "delete the images of the others first");

// The sensors of a rig that have a pose, the reference first.
std::vector<int> PosedSensors(const ExportInput& input, int rig_idx);

// A message for each sensor that PosedSensors leaves out.
std::vector<std::string> SensorsWithoutPose(const ExportInput& input);

// The formats that docs/reference/exchange.md describes.

// VisualSFM and Bundler (two files), as COLMAP writes them, except that pixels
// in NVM move by as much as the principal point to the center of the image.
std::vector<ExchangeFormat> RadialFormats();

// Trajectories world_from_rig or world_from_cam. TUM and EuRoC need a time of
// each image (Image::timestamp_s, or a name that is one).
std::vector<ExchangeFormat> TrajectoryFormats();

// Calibrations of the only rig. Pixels count from the center of the first one
// there.
std::vector<ExchangeFormat> CalibrationFormats();

// The folder `sensors` of kapture 1.1: cameras, rigs, and poses and images of
// frames, whose numbers are their times (kapture_format.adoc of
// github.com/naver/kapture).
std::vector<ExportedFile> WriteKapture(const ExportInput& input);

// Paths of frames on the earth.
std::vector<ExchangeFormat> GeoFormats();

}  // namespace mgsfm
