// SPDX-License-Identifier: BSD-3-Clause
#include "partition_run.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/file_reading.h"
#include "base/format.h"
#include "command.h"
#include "database/database_reader.h"
#include "files/file_operations.h"
#include "files/staged_output.h"
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
  return what + Formatted(" needs about %ld MiB, and --max_memory allows %d; ",
                          std::lround(std::ceil(needed_mib)), max_memory_mib);
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

// The memory that the mapper needs for an input.
double EstimateMemoryMib(const MapperInput& input) {
  double num_bytes = 0.0;
  for (const Image& image : input.scene.images) {
    num_bytes +=
        kBytesPerKeypoint * static_cast<double>(image.keypoints_px.size());
  }
  for (const ImagePair& pair : input.view_graph.pairs) {
    num_bytes += kBytesPerMatch * static_cast<double>(pair.matches.size() +
                                                      pair.outliers.size());
  }
  return ToMib(num_bytes);
}

double EstimateAdjustmentMib(const ModelSize& size, double num_adjusted) {
  return ToMib(kBytesPerAdjustedKeypoint * size.num_keypoints +
               kBytesPerPoint * size.num_points +
               kBytesPerObservation * size.num_observations +
               kBytesPerImage * size.num_images +
               kBytesPerAdjustedObservation * num_adjusted);
}

}  // namespace

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

namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kVersion = 1;  // of clusters.json

LoadedMatches LoadListedMatches(const MapperRun& run, const Context& context) {
  DatabaseSelection selection;
  selection.has_keypoints = false;
  selection.has_geometries = false;
  if (!run.image_list_path.empty()) {
    const auto listed = ReadImageList(run.image_list_path);
    selection.image_names.insert(listed.begin(), listed.end());
  }
  DatabaseContents contents =
      ReadDatabase(run.database_path, context, selection);
  if (!selection.image_names.empty()) {
    KeepListedImages(selection.image_names, run.image_list_path, &contents);
  }
  return LoadMatches(std::move(contents), run.loading, context);
}

std::string FileName(size_t cluster) {
  return std::to_string(cluster) + ".txt";
}

size_t CountImages(const Scene& scene, const FrameCluster& cluster) {
  size_t num_images = 0;
  for (const int frame_idx : cluster.frame_idxs) {
    num_images += scene.frames[frame_idx].image_idxs.size();
  }
  return num_images;
}

std::string ToJson(const Scene& scene, const ViewGraphPartition& partition) {
  Json json{{"version", kVersion}, {"clusters", Json::array()}};
  for (size_t i = 0; i < partition.clusters.size(); ++i) {
    const FrameCluster& cluster = partition.clusters[i];
    json["clusters"].push_back({{"image_list", FileName(i)},
                                {"num_frames", cluster.frame_idxs.size()},
                                {"num_core_frames", cluster.num_core_frames},
                                {"num_images", CountImages(scene, cluster)}});
  }
  json["edges"] = Json::array();
  for (const ClusterOverlap& overlap : partition.overlaps) {
    json["edges"].push_back({{"clusters", {overlap.cluster1, overlap.cluster2}},
                             {"num_common_frames", overlap.num_frames}});
  }
  json["calibration_clusters"] = partition.calibration_clusters;
  json["frames_without_cluster"] = Json::array();
  for (const int frame_idx : partition.frame_idxs_without_cluster) {
    json["frames_without_cluster"].push_back(scene.frames[frame_idx].name);
  }
  return json.dump(2) + "\n";
}

void WriteClusters(const Scene& scene, const ViewGraphPartition& partition,
                   const fs::path& folder) {
  for (size_t i = 0; i < partition.clusters.size(); ++i) {
    std::string names;
    for (const int frame_idx : partition.clusters[i].frame_idxs) {
      for (const int image_idx : scene.frames[frame_idx].image_idxs) {
        names += scene.images[image_idx].name + "\n";
      }
    }
    WriteFile(folder / FileName(i), names);
  }
  WriteFile(folder / "clusters.json", ToJson(scene, partition));
}

void LogClusters(const ViewGraphPartition& partition, int num_wanted,
                 const Context& context) {
  for (size_t i = 0; i < partition.clusters.size(); ++i) {
    const FrameCluster& cluster = partition.clusters[i];
    context.Info(Formatted("cluster %zu: %zu frames, %d without the overlap", i,
                           cluster.frame_idxs.size(), cluster.num_core_frames));
  }
  if (static_cast<int>(partition.clusters.size()) < num_wanted) {
    context.Info(
        Formatted("%zu of %d clusters: more cuts would cross weak seams",
                  partition.clusters.size(), num_wanted));
  }
  if (!partition.frame_idxs_without_cluster.empty()) {
    context.Warning(
        std::to_string(partition.frame_idxs_without_cluster.size()) +
        " frames are in no cluster: no matches connect them to three others");
  }
}

}  // namespace

int PartitionDatabase(const MapperRun& run, const PartitionOptions& options,
                      const Context& context) {
  // An existing report would be replaced as part of an earlier run.
  if (fs::exists(fs::path(run.output_path) / "report.json")) {
    throw Error(
        "'" + run.output_path +
        "' holds models; choose another --output_path for the clusters");
  }
  StagedOutput output(run.output_path);
  LoadedMatches loaded = LoadListedMatches(run, context);
  const ViewGraphPartition partition =
      PartitionViewGraph(loaded.scene, std::move(loaded.pairs),
                         run.mapper.pair_filtering, options, context);
  if (partition.clusters.empty()) {
    context.log(LogLevel::kError,
                "the database has no cluster of three connected frames; match "
                "its images first");
    return kExitNotSolvable;
  }
  WriteClusters(loaded.scene, partition, output.StagingDir());
  context.CheckInterrupted();
  output.Commit();
  LogClusters(partition, options.num_clusters, context);
  context.Info(
      "next: map each cluster with --image_list_path, then join the "
      "models with model_merger --graph");
  return kExitSuccess;
}

size_t CountClusters(const std::string& folder) {
  const std::string path = (fs::path(folder) / "clusters.json").string();
  const Json json =
      Json::parse(ReadFile(path, "'" + path + "'"), nullptr, false);
  size_t num_clusters = 0;
  try {
    for (const Json& cluster : json.at("clusters")) {
      (void)cluster.at("image_list").get<std::string>();
      (void)cluster.at("num_frames").get<int>();
      ++num_clusters;
    }
    if (json.at("version").get<int>() != kVersion) num_clusters = 0;
  } catch (const Json::exception&) {
    num_clusters = 0;
  }
  if (num_clusters > 0) return num_clusters;
  throw Error("'" + path +
              "' is not a list of clusters; write it with mapper "
              "--partition");
}

}  // namespace mgsfm
