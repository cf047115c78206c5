// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace mgsfm {

// One keypoint of one image.
struct Observation {
  int image_idx;
  int keypoint_idx;

  friend bool operator==(const Observation& a, const Observation& b) {
    return a.image_idx == b.image_idx && a.keypoint_idx == b.keypoint_idx;
  }
  friend bool operator<(const Observation& a, const Observation& b) {
    return a.image_idx != b.image_idx ? a.image_idx < b.image_idx
                                      : a.keypoint_idx < b.keypoint_idx;
  }
};

// Groups of observations in flat arrays: the sorted observations of group g are
// observations[offsets[g]] to observations[offsets[g + 1] - 1].
struct ObservationGroups {
  std::vector<Observation> observations;
  std::vector<size_t> offsets = {0};

  size_t size() const { return offsets.size() - 1; }
  const Observation* begin(size_t group) const {
    return observations.data() + offsets[group];
  }
  const Observation* end(size_t group) const {
    return observations.data() + offsets[group + 1];
  }
  size_t length(size_t group) const {
    return offsets[group + 1] - offsets[group];
  }
  // Makes a group of the observations appended since the last call.
  void FinishGroup() { offsets.push_back(observations.size()); }
};

}  // namespace mgsfm
