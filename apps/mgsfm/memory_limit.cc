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
// The fastest adjustment of joined models, and constants below that do not
// follow from the size of their types, are measured in
// docs/results/constants.md.
constexpr double kBytesPerKeypointOfFastest = 10.0;
constexpr double kBytesPerObservationOfFastest = 260.0;
constexpr double kBytesPerMib = 1024.0 * 1024.0;

// The bytes of the two stages of an adjustment in little memory.
struct StageBytes {
  double per_keypoint;
  double per_observation;
  double per_point;
  double per_image;
  double per_frame;
  double per_neighbour;  // of each frame
};
// Triangulation: keypoints; a track and a candidate; a new point with its track
// as a block of memory, its old position and the indices of both; images as
// measured in docs/results/constants.md.
constexpr StageBytes kTriangulation = {8.0, 16.0, 140.0, 2400.0, 0.0, 0.0};
// Solves: a pixel, an image and a flag; two positions and three indices. An
// image has two poses more. Frames and the factor as measured there.
constexpr StageBytes kSolve = {0.0, 11.0, 60.0, 3000.0, 2700.0, 330.0};
// More neighbours hardly save products, fewer take far more
// (docs/results/constants.md).
constexpr int kMaxNumNeighbours = 64;
constexpr int kMinNumNeighbours = 12;

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
  double num_images = 0.0;
  double num_keypoints = 0.0;
  double num_points = 0.0;
  double num_observations = 0.0;
};

ModelSize SizeOf(const std::vector<SceneModel>& models) {
  ModelSize size;
  for (const SceneModel& model : models) {
    size.num_frames += static_cast<double>(model.scene.frames.size());
    size.num_images += static_cast<double>(model.scene.images.size());
    size.num_points += static_cast<double>(model.reconstruction.points.size());
    for (const Image& image : model.scene.images) {
      size.num_keypoints += static_cast<double>(image.keypoints_px.size());
    }
    size.num_observations +=
        static_cast<double>(NumObservations(model.reconstruction));
  }
  return size;
}

double ToMib(double num_bytes) {
  return kProgramMib + num_bytes / kBytesPerMib;
}

double EstimateFastAdjustmentMib(const ModelSize& size) {
  return ToMib(kBytesPerKeypointOfFastest * size.num_keypoints +
               kBytesPerObservationOfFastest * size.num_observations);
}

double EstimateStageMib(const StageBytes& bytes, const ModelSize& size,
                        int num_neighbours) {
  return ToMib(bytes.per_keypoint * size.num_keypoints +
               bytes.per_observation * size.num_observations +
               bytes.per_point * size.num_points +
               bytes.per_image * size.num_images +
               (bytes.per_frame + bytes.per_neighbour * num_neighbours) *
                   size.num_frames);
}

// Either the models are in memory, or the equations of their adjustment.
double EstimateCompactAdjustmentMib(const ModelSize& size, int num_neighbours) {
  return std::max(EstimateStageMib(kTriangulation, size, num_neighbours),
                  EstimateStageMib(kSolve, size, num_neighbours));
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
  for (int n = kMaxNumNeighbours; n >= kMinNumNeighbours; --n) {
    if (EstimateCompactAdjustmentMib(size, n) <= max_memory_mib) return n;
  }
  const double needed_mib =
      EstimateCompactAdjustmentMib(size, kMinNumNeighbours);
  throw Error(DescribeNeed("the adjustment of the joined model", needed_mib,
                           max_memory_mib) +
              "allow more, or join without it (--refine 0)");
}

}  // namespace mgsfm
