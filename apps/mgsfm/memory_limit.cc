// SPDX-License-Identifier: BSD-3-Clause
#include "memory_limit.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "mgsfm/base/error.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

// Upper bounds of the peaks in docs/results/constants.md.
constexpr double kProgramMib = 80.0;
constexpr double kBytesPerKeypoint = 60.0;
constexpr double kBytesPerMatch = 100.0;
// Frames that clusters share, as a factor of their size.
constexpr double kOverlapFactor = 1.1;
// A joined model, and its adjustment by all tracks or by a selection of them
// (docs/results/constants.md).
constexpr double kBytesPerPoint = 140.0;
constexpr double kBytesPerObservation = 16.0;
constexpr double kBytesPerImage = 2400.0;
constexpr double kBytesPerAdjustedKeypoint = 10.0;
constexpr double kBytesPerAdjustedObservation = 260.0;
// Errors grow with fewer observations (docs/results/submaps.md).
constexpr double kMinNumAdjustedPerImage = 100.0;
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
  double num_images = 0.0;
  double num_keypoints = 0.0;
  double num_points = 0.0;
  double num_observations = 0.0;
};

ModelSize SizeOf(const std::vector<SceneModel>& models) {
  ModelSize size;
  for (const SceneModel& model : models) {
    size.num_images += static_cast<double>(model.scene.images.size());
    size.num_points += static_cast<double>(model.reconstruction.points.size());
    size.num_observations +=
        static_cast<double>(NumObservations(model.reconstruction));
    for (const Image& image : model.scene.images) {
      size.num_keypoints += static_cast<double>(image.keypoints_px.size());
    }
  }
  return size;
}

double ToMib(double num_bytes) {
  return kProgramMib + num_bytes / kBytesPerMib;
}

double EstimateAdjustmentMib(const ModelSize& size, double num_adjusted) {
  return ToMib(kBytesPerAdjustedKeypoint * size.num_keypoints +
               kBytesPerPoint * size.num_points +
               kBytesPerObservation * size.num_observations +
               kBytesPerImage * size.num_images +
               kBytesPerAdjustedObservation * num_adjusted);
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

std::optional<size_t> MaxNumAdjustedObservations(
    const std::vector<SceneModel>& models, int max_memory_mib) {
  const ModelSize size = SizeOf(models);
  if (max_memory_mib == 0 ||
      EstimateAdjustmentMib(size, size.num_observations) <= max_memory_mib) {
    return std::nullopt;
  }
  const double least = std::min(size.num_observations,
                                kMinNumAdjustedPerImage * size.num_images);
  const double needed_mib = EstimateAdjustmentMib(size, least);
  if (needed_mib > max_memory_mib) {
    throw Error(DescribeNeed("the adjustment of the joined model", needed_mib,
                             max_memory_mib) +
                "allow more, or join without it (--refine 0)");
  }
  const double left_mib = max_memory_mib - EstimateAdjustmentMib(size, 0.0);
  return static_cast<size_t>(left_mib * kBytesPerMib /
                             kBytesPerAdjustedObservation);
}

}  // namespace mgsfm
