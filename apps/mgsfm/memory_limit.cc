// SPDX-License-Identifier: BSD-3-Clause
#include "memory_limit.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Upper bounds of the peaks in docs/results/submaps.md.
constexpr double kProgramMib = 25.0;
constexpr double kBytesPerKeypoint = 60.0;
constexpr double kBytesPerMatch = 100.0;
// Frames that clusters share, as a factor of their size.
constexpr double kOverlapFactor = 1.1;
// Joined models and their adjustment, measured in docs/results/submaps.md.
constexpr double kBytesPerKeypointOfModel = 10.0;
constexpr double kBytesPerObservation = 260.0;
constexpr double kBytesPerObservationIfSaved = 50.0;
constexpr double kBytesPerNeighbour = 680.0;  // and frame
// From the fastest to the smallest.
constexpr int kNumNeighbours[] = {64, 48, 32, 24, 16, 12};
constexpr double kBytesPerMib = 1024.0 * 1024.0;

std::string RemedyFor(double needed_mib, int max_memory_mib) {
  const double free_mib = max_memory_mib - kProgramMib;
  if (free_mib <= 0.0) return "allow more";
  const double num_clusters =
      std::ceil(kOverlapFactor * (needed_mib - kProgramMib) / free_mib);
  return "cut the view graph with --partition " +
         std::to_string(std::max(2L, std::lround(num_clusters))) +
         ", or allow more";
}

std::string DescribeNeed(const std::string& what, double needed_mib,
                         int max_memory_mib) {
  return what + " needs about " +
         std::to_string(std::lround(std::ceil(needed_mib))) +
         " MiB, and --max_memory allows " + std::to_string(max_memory_mib) +
         "; ";
}

// What the adjustment of joined models is proportional to.
struct ModelSize {
  double num_frames = 0.0;
  double num_keypoints = 0.0;
  double num_observations = 0.0;
};

ModelSize SizeOf(const std::vector<SceneModel>& models) {
  ModelSize size;
  for (const SceneModel& model : models) {
    size.num_frames += static_cast<double>(model.scene.frames.size());
    for (const Image& image : model.scene.images) {
      size.num_keypoints += static_cast<double>(image.keypoints_px.size());
    }
    for (const Point3D& point : model.reconstruction.points) {
      size.num_observations += static_cast<double>(point.track.size());
    }
  }
  return size;
}

// The memory of an adjustment while all joined models are held.
double EstimateAdjustmentMib(const ModelSize& size,
                             double bytes_per_observation,
                             double bytes_per_frame) {
  return kProgramMib + (kBytesPerKeypointOfModel * size.num_keypoints +
                        bytes_per_observation * size.num_observations +
                        bytes_per_frame * size.num_frames) /
                           kBytesPerMib;
}

}  // namespace

double EstimateMemoryMib(const MapperInput& input) {
  double num_bytes = 0.0;
  for (const Image& image : input.scene.images) {
    num_bytes +=
        kBytesPerKeypoint * static_cast<double>(image.keypoints_px.size());
  }
  for (const ImagePair& pair : input.view_graph.pairs) {
    num_bytes += kBytesPerMatch * static_cast<double>(pair.matches.size());
  }
  return kProgramMib + num_bytes / kBytesPerMib;
}

void CheckMemory(const MapperInput& input, int max_memory_mib) {
  if (max_memory_mib == 0) return;
  const double needed_mib = EstimateMemoryMib(input);
  if (needed_mib <= max_memory_mib) return;
  throw Error(DescribeNeed("the reconstruction", needed_mib, max_memory_mib) +
              RemedyFor(needed_mib, max_memory_mib));
}

std::optional<int> ChooseNumNeighbours(const std::vector<SceneModel>& models,
                                       int max_memory_mib) {
  const ModelSize size = SizeOf(models);
  if (max_memory_mib == 0 || EstimateAdjustmentMib(size, kBytesPerObservation,
                                                   0.0) <= max_memory_mib) {
    return std::nullopt;
  }
  double needed_mib = 0.0;
  for (const int num_neighbours : kNumNeighbours) {
    needed_mib = EstimateAdjustmentMib(size, kBytesPerObservationIfSaved,
                                       kBytesPerNeighbour * num_neighbours);
    if (needed_mib <= max_memory_mib) return num_neighbours;
  }
  throw Error(DescribeNeed("the adjustment of the joined model", needed_mib,
                           max_memory_mib) +
              "allow more, or join without it (--refine 0)");
}

}  // namespace mgsfm
