// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/bundle_structure.h"

#include <algorithm>

namespace mgsfm {

IndexGroups GroupByKey(const std::vector<int>& keys, size_t num_keys) {
  IndexGroups groups;
  groups.begin.assign(num_keys + 1, 0);
  for (const int key : keys) {
    if (key >= 0) ++groups.begin[key + 1];
  }
  for (size_t k = 0; k < num_keys; ++k) {
    groups.begin[k + 1] += groups.begin[k];
  }
  groups.items.resize(groups.begin.back());
  std::vector<size_t> next(groups.begin.begin(), groups.begin.end() - 1);
  for (size_t i = 0; i < keys.size(); ++i) {
    if (keys[i] >= 0) groups.items[next[keys[i]]++] = static_cast<int>(i);
  }
  return groups;
}

BundleStructure::BundleStructure(const BundleProblem& problem) {
  NumberBlocks(problem);
  std::vector<int> image_of_observation;
  image_of_observation.reserve(problem.observations.size());
  for (const BundleProblem::PixelObservation& o : problem.observations) {
    image_of_observation.push_back(o.image);
  }
  image_observations = GroupByKey(image_of_observation, problem.images.size());

  layouts.resize(problem.images.size());
  std::vector<int> block_of_part;  // three parts an image
  for (size_t i = 0; i < problem.images.size(); ++i) {
    const std::array<int, 3> parts = BlocksOf(problem.images[i]);
    block_of_part.insert(block_of_part.end(), parts.begin(), parts.end());
    ColumnLayout& layout = layouts[i];
    int* const offsets[] = {&layout.frame, &layout.sensor, &layout.camera};
    for (int k = 0; k < 3; ++k) {
      if (parts[k] < 0) continue;
      *offsets[k] = layout.num_columns;
      layout.num_columns += blocks[parts[k]].size;
    }
  }
  block_images = GroupByKey(block_of_part, blocks.size());
  for (int& item : block_images.items) item /= 3;

  ListIncidences(problem);
}

void BundleStructure::NumberBlocks(const BundleProblem& problem) {
  std::vector<char> frame_is_seen(problem.frame_masks.size(), false);
  std::vector<char> sensor_is_seen(problem.sensor_masks.size(), false);
  std::vector<char> camera_is_seen(problem.cameras.size(), false);
  for (const BundleProblem::PixelObservation& o : problem.observations) {
    const BundleProblem::Image& image = problem.images[o.image];
    frame_is_seen[image.frame] = true;
    sensor_is_seen[image.sensor] = true;
    camera_is_seen[image.camera] = true;
  }
  const auto add_block = [this](bool is_needed, int size) {
    if (!is_needed) return -1;
    blocks.push_back({size, num_unknowns});
    num_unknowns += size;
    return static_cast<int>(blocks.size()) - 1;
  };
  for (size_t i = 0; i < frame_is_seen.size(); ++i) {
    const bool is_free = (problem.frame_masks[i].array() != 0.0).any();
    frame_block.push_back(add_block(frame_is_seen[i] && is_free, 6));
  }
  for (size_t i = 0; i < sensor_is_seen.size(); ++i) {
    const bool is_free = (problem.sensor_masks[i].array() != 0.0).any();
    sensor_block.push_back(add_block(sensor_is_seen[i] && is_free, 6));
  }
  for (size_t i = 0; i < camera_is_seen.size(); ++i) {
    const int size = static_cast<int>(problem.cameras[i].free_params.size());
    camera_block.push_back(add_block(camera_is_seen[i] && size > 0, size));
  }
}

void BundleStructure::ListIncidences(const BundleProblem& problem) {
  observation_point.resize(problem.observations.size());
  observation_incidences.resize(problem.observations.size());
  std::vector<int> seen;
  for (size_t p = 0; p < problem.num_points(); ++p) {
    seen.clear();
    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      for (const int block :
           BlocksOf(problem.images[problem.observations[o].image])) {
        if (block >= 0) seen.push_back(block);
      }
    }
    std::sort(seen.begin(), seen.end());
    seen.erase(std::unique(seen.begin(), seen.end()), seen.end());

    const int first = static_cast<int>(incidence_block.size());
    for (const int block : seen) {
      incidence_block.push_back(block);
      incidence_point.push_back(static_cast<int>(p));
      incidence_coupling.push_back(coupling_size);
      coupling_size += 3 * static_cast<size_t>(blocks[block].size);
    }
    point_incidences.push_back(incidence_block.size());

    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      observation_point[o] = static_cast<int>(p);
      const auto parts =
          BlocksOf(problem.images[problem.observations[o].image]);
      for (int k = 0; k < 3; ++k) {
        const auto it = std::lower_bound(seen.begin(), seen.end(), parts[k]);
        observation_incidences[o][k] =
            parts[k] < 0 ? -1 : first + static_cast<int>(it - seen.begin());
      }
    }
  }
  block_incidences = GroupByKey(incidence_block, blocks.size());
}

}  // namespace mgsfm
