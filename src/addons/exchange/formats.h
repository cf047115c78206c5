// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "exchange/exchange_formats.h"

namespace mgsfm {

// One per file of this folder; docs/reference/exchange.md describes them.

// The points with their colors, binary.
std::vector<ExportedFile> WritePly(const ExportInput& input);
// VisualSFM and Bundler (two files), as COLMAP writes them, except that pixels
// in NVM move by as much as the principal point to the center of the image.
std::vector<ExportedFile> WriteNvm(const ExportInput& input);
std::vector<ExportedFile> WriteBundler(const ExportInput& input);
std::vector<std::string> LossesInNvm(const ExportInput& input);
std::vector<std::string> LossesInBundler(const ExportInput& input);

// Trajectories world_from_rig or world_from_cam. TUM and EuRoC need a time of
// each image (Image::timestamp_s, or a name that is one).
std::vector<ExportedFile> WriteTum(const ExportInput& input);
std::vector<ExportedFile> WriteKitti(const ExportInput& input);
std::vector<ExportedFile> WriteEuroc(const ExportInput& input);

// Calibrations of the only rig. Pixels count from the center of the first one
// there.
std::vector<ExportedFile> WriteKalibr(const ExportInput& input);
std::vector<ExportedFile> WriteEurocSensors(const ExportInput& input);
std::vector<ExportedFile> WriteCameraInfo(const ExportInput& input);
std::vector<ExportedFile> WriteRosTransforms(const ExportInput& input);
std::vector<ExportedFile> WriteRosLaunch(const ExportInput& input);

// Paths of frames on the earth.
std::vector<ExportedFile> WriteGeoJson(const ExportInput& input);
std::vector<ExportedFile> WriteKml(const ExportInput& input);

}  // namespace mgsfm
