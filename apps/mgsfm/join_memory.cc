// SPDX-License-Identifier: BSD-3-Clause
#include "join_memory.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Upper bounds of the peaks in docs/results/submaps.md.
constexpr double kProgramMib = 75.0;
constexpr double kBytesPerKeypoint = 16.0;
constexpr double kBytesPerObservation = 100.0;        // of the model
constexpr double kBytesPerSolvedObservation = 300.0;  // of the equations

struct Sizes {
  double num_keypoints = 0.0;
  double num_observations = 0.0;
  double largest_block = 0.0;  // observations
};

Sizes CountSizes(const SceneModel& model, const FrameBlocks& blocks) {
  Sizes sizes;
  for (const Image& image : model.scene.images) {
    sizes.num_keypoints += static_cast<double>(image.keypoints_px.size());
  }
  std::vector<double> of_block(blocks.size() + 1, 0.0);
  for (const Point3D& point : model.reconstruction.points) {
    int block = static_cast<int>(blocks.size());
    for (const Observation& o : point.track) {
      block =
          std::min(block, blocks[model.scene.images[o.image_idx].frame_idx]);
    }
    const auto num_observations = static_cast<double>(point.track.size());
    of_block[block] += num_observations;
    sizes.num_observations += num_observations;
  }
  sizes.largest_block = *std::max_element(of_block.begin(), of_block.end());
  return sizes;
}

double EstimateMib(const Sizes& sizes, double num_solved_observations) {
  return kProgramMib + (kBytesPerKeypoint * sizes.num_keypoints +
                        kBytesPerObservation * sizes.num_observations +
                        kBytesPerSolvedObservation * num_solved_observations) /
                           (1024.0 * 1024.0);
}

}  // namespace

bool NeedsBlocks(const SceneModel& model, const FrameBlocks& blocks,
                 int max_memory_mib) {
  if (max_memory_mib == 0) return false;
  const Sizes sizes = CountSizes(model, blocks);
  if (EstimateMib(sizes, sizes.num_observations) <= max_memory_mib) {
    return false;
  }
  const double needed_mib = EstimateMib(sizes, sizes.largest_block);
  if (needed_mib <= max_memory_mib) return true;
  throw Error("the adjustment of the joined model needs about " +
              std::to_string(std::lround(std::ceil(needed_mib))) +
              " MiB, and --max_memory allows " +
              std::to_string(max_memory_mib) +
              "; cut the drive into more clusters, or allow more");
}

}  // namespace mgsfm
