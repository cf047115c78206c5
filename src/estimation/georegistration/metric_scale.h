// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The measured distance of the centers of two sensors.
struct KnownBaseline {
  std::vector<std::pair<int, int>> sensor_idxs;  // one pair per rig
  double length_m = 0.0;
};

// Parses "known_baseline=LEFT:RIGHT:METERS" with names of sensors; nullopt if
// the text is empty. Throws Error unless the length is positive and a rig has
// both sensors.
std::optional<KnownBaseline> ParseMetricScale(const std::string& text,
                                              const Scene& scene);

// The factor that makes the mean distance of the estimated sensor pairs equal
// to the known distance; nullopt if none is estimated or all coincide.
std::optional<double> MetersPerUnit(const KnownBaseline& baseline,
                                    const Reconstruction& model);

}  // namespace mgsfm
