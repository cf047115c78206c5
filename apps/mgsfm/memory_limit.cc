// SPDX-License-Identifier: BSD-3-Clause
#include "memory_limit.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Upper bounds of the peaks in docs/results/submaps.md.
constexpr double kProgramMib = 24.0;
constexpr double kBytesPerKeypoint = 60.0;
constexpr double kBytesPerMatch = 100.0;
// Frames that clusters share, as a factor of their size.
constexpr double kOverlapFactor = 1.1;
// Joined models and their adjustment, measured in
// docs/results/submaps.md#join-in-a-quarter-of-the-memory.
constexpr double kBytesPerKeypointOfModel = 10.0;
constexpr double kBytesPerObservationOfModel = 52.0;
constexpr double kBytesPerObservation = 260.0;
constexpr double kBytesPerObservationIfSaved = 63.0;
constexpr double kBytesPerNeighbour = 500.0;  // and frame
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

// The numbers that determine the memory of an adjustment.
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

double ToMib(double num_bytes) {
  return kProgramMib + num_bytes / kBytesPerMib;
}

double EstimateFastAdjustmentMib(const ModelSize& size) {
  return ToMib(kBytesPerKeypointOfModel * size.num_keypoints +
               kBytesPerObservation * size.num_observations);
}

// Either the models are in memory, or the equations of their adjustment.
double EstimateCompactAdjustmentMib(const ModelSize& size, int num_neighbours) {
  const double models = kBytesPerKeypointOfModel * size.num_keypoints +
                        kBytesPerObservationOfModel * size.num_observations;
  const double equations =
      kBytesPerObservationIfSaved * size.num_observations +
      kBytesPerNeighbour * num_neighbours * size.num_frames;
  return ToMib(std::max(models, equations));
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
  return ToMib(num_bytes);
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
  if (max_memory_mib == 0 ||
      EstimateFastAdjustmentMib(size) <= max_memory_mib) {
    return std::nullopt;
  }
  double needed_mib = 0.0;
  for (const int num_neighbours : kNumNeighbours) {
    needed_mib = EstimateCompactAdjustmentMib(size, num_neighbours);
    if (needed_mib <= max_memory_mib) return num_neighbours;
  }
  throw Error(DescribeNeed("the adjustment of the joined model", needed_mib,
                           max_memory_mib) +
              "allow more, or join without it (--refine 0)");
}

}  // namespace mgsfm
