// SPDX-License-Identifier: BSD-3-Clause
#include "memory_limit.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Upper bounds of the peaks in docs/results/submaps.md.
constexpr double kProgramMib = 70.0;
constexpr double kBytesPerKeypoint = 60.0;
constexpr double kBytesPerMatch = 100.0;
// Frames that clusters share, as a factor of their size.
constexpr double kOverlapFactor = 1.1;
// Joined models and their adjustment, measured in docs/results/submaps.md: the
// estimate is 12 to 17 % above the peak on 05, and 6 % below it on 100,000
// images.
constexpr double kBytesPerKeypointOfModel = 10.0;
constexpr double kBytesPerObservation = 260.0;
constexpr double kBytesPerObservationIfSaved = 100.0;
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

// The memory of an adjustment while all joined models are held.
double EstimateAdjustmentMib(const std::vector<SceneModel>& models,
                             bool saves_memory) {
  double num_bytes = 0.0;
  for (const SceneModel& model : models) {
    for (const Image& image : model.scene.images) {
      num_bytes += kBytesPerKeypointOfModel *
                   static_cast<double>(image.keypoints_px.size());
    }
    for (const Point3D& point : model.reconstruction.points) {
      num_bytes +=
          (saves_memory ? kBytesPerObservationIfSaved : kBytesPerObservation) *
          static_cast<double>(point.track.size());
    }
  }
  return kProgramMib + num_bytes / kBytesPerMib;
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

bool MustSaveMemory(const std::vector<SceneModel>& models, int max_memory_mib) {
  if (max_memory_mib == 0 ||
      EstimateAdjustmentMib(models, false) <= max_memory_mib) {
    return false;
  }
  const double needed_mib = EstimateAdjustmentMib(models, true);
  if (needed_mib <= max_memory_mib) return true;
  throw Error(DescribeNeed("the adjustment of the joined model", needed_mib,
                           max_memory_mib) +
              "allow more, or join without it (--refine 0)");
}

}  // namespace mgsfm
