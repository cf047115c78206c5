// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "bundle/bundle_problem.h"
#include "bundle/observation_terms.h"

namespace mgsfm {

// Groups of positions in one array: group g holds items[begin[g]] to
// items[begin[g + 1] - 1], ascending.
struct IndexGroups {
  std::vector<size_t> begin = {0};
  std::vector<int> items;
};

// Groups the positions of `keys` by key; negative keys are left out.
IndexGroups GroupByKey(const std::vector<int>& keys, size_t num_keys);

// The unknowns of one frame, sensor or camera; points are not among them.
struct ParameterBlock {
  int size = 0;
  int first = 0;  // position in the vector of all such unknowns
};

// Which unknowns meet where: depends on the problem alone, so it is made once
// for all iterations. Blocks are numbered frames, then sensors, then cameras,
// leaving out what is held or not observed.
struct BundleStructure {
  explicit BundleStructure(const BundleProblem& problem);

  std::vector<ParameterBlock> blocks;
  int num_unknowns = 0;          // sum of their sizes
  std::vector<int> frame_block;  // -1: none
  std::vector<int> sensor_block;
  std::vector<int> camera_block;

  std::vector<ColumnLayout> layouts;  // per image
  IndexGroups image_observations;
  IndexGroups block_images;

  // An incidence is a block that a point depends on. Those of point p are
  // point_incidences[p] to point_incidences[p + 1] - 1, by ascending block.
  std::vector<size_t> point_incidences = {0};
  std::vector<int> incidence_block;
  std::vector<int> incidence_point;
  std::vector<size_t> incidence_coupling;  // where its size x 3 matrix starts
  size_t coupling_size = 0;
  IndexGroups block_incidences;
  // Per observation: its point, and the incidences of its frame, sensor and
  // camera, or -1.
  std::vector<int> observation_point;
  std::vector<std::array<int, 3>> observation_incidences;

 private:
  void NumberBlocks(const BundleProblem& problem);
  void ListIncidences(const BundleProblem& problem);

  std::array<int, 3> BlocksOf(const BundleProblem::Image& image) const {
    return {frame_block[image.frame], sensor_block[image.sensor],
            camera_block[image.camera]};
  }
};

}  // namespace mgsfm
