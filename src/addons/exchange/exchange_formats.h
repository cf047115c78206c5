// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Formats of other programs. Each writes registered images only, and numbers
// such that reading returns the same values. A format that cannot
// represent a model throws Error with the camera or image, and the remedy.

enum class TrajectoryPoses { kFrame, kCamera };

template <>
struct EnumTable<TrajectoryPoses> {
  static constexpr std::pair<std::string_view, TrajectoryPoses> kNames[] = {
      {"frame", TrajectoryPoses::kFrame}, {"camera", TrajectoryPoses::kCamera}};
};

struct ExportInput {
  const Scene& scene;
  const Reconstruction& model;
  // Poses of frames, or of the images of each camera in a file of their own.
  TrajectoryPoses poses = TrajectoryPoses::kFrame;
  // Latitude, longitude (degrees) and altitude (meters) of the origin of a
  // world that is east, north, up.
  std::optional<Eigen::Vector3d> origin_wgs84;
};

// A file at the path of the output followed by `suffix`.
struct ExportedFile {
  std::string suffix;
  std::string content;
};

struct ExchangeFormat {
  std::string_view name;
  std::vector<ExportedFile> (*write)(const ExportInput& input);
  // A message for each part of the model that the file lacks or changes.
  std::vector<std::string> (*losses)(const ExportInput& input) = nullptr;
};

// Upper and lower case are the same. nullptr for an unknown name.
const ExchangeFormat* FindExchangeFormat(const std::string& name);
std::vector<std::string> ExchangeFormatNames();

}  // namespace mgsfm
