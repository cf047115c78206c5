// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/grouped_warnings.h"
#include "base/memory.h"
#include "bundle_adjustment/selected_tracks.h"
#include "command.h"
#include "commands.h"
#include "files/file_operations.h"
#include "files/model_files.h"
#include "files/staged_output.h"
#include "fleet/sub_maps.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/base/version.h"
#include "mgsfm/bundle_adjustment/bundle_adjustment.h"
#include "model_file.h"
#include "partition_run.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

struct ModelMergerOptions {
  Option<std::string> input_path1{
      "input_path1", "",
      "Merge the model in this folder with the second one. The result keeps "
      "its world and poses."};
  Option<std::string> input_path2{
      "input_path2", "",
      "Merge the model in this folder, reconstructed from the same database."};
  Option<std::string> output_path{"output_path", "", Required(),
                                  "Write the merged model, or the models 0, 1, "
                                  "... of sub-maps, into this folder."};
  Option<bool> graph{"graph", false,
                     "Join any number of sub-maps, such as the clusters of "
                     "mapper --partition, "
                     "and adjust the result."};
  Option<std::string> input_path{
      "input_path", "",
      "Join the sub-maps in this folder with graph: an output folder of the "
      "mapper for each cluster, named 0, 1, ..."};
  Option<std::string> cluster_path{
      "cluster_path", "",
      "Report clusters without a model by their names in this folder of mapper "
      "--partition, with graph."};
  Option<std::string> database_path{
      "database_path", "",
      "Close loops between clusters with the matches of this database, with "
      "graph. It is not changed."};
  Option<bool> refine{"refine", true, "Adjust the joined models of graph."};
  Option<int> max_memory_mib{
      "max_memory", 0, AtLeast(0), "MiB",
      "Adjust the joined models of graph within this memory, by a selection of "
      "their tracks if necessary. 0: no limit."};
  Option<int> min_common_images{
      "min_common_images", 3, AtLeast(3), "images",
      "Require this many common images, or cameras in common frames."};
  Option<double> max_reproj_error{
      "max_reproj_error", 64.0, GreaterThan(0.0), "px",
      "Remove observations with larger errors from the merged model."};
  Option<ModelFormat> output_format = ModelFormatOption();
  ModelRigOptions rigs;
  JoinOptions join;
  BundleAdjustmentOptions bundle_adjustment;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path1, input_path2, output_path, min_common_images,
          max_reproj_error, output_format, rigs, graph, input_path,
          cluster_path, database_path, refine, max_memory_mib);
    visit.Group("Join", join);
    visit.Group("BundleAdjustment", bundle_adjustment);
  }
};

using Json = nlohmann::ordered_json;

struct SubMapFiles {
  std::vector<std::string> folders;        // of the models that exist
  std::vector<int> clusters;               // per folder
  std::vector<std::string> missing;        // folders of clusters without models
  std::vector<int> num_frames_of_missing;  // if known
};

// Folders named by numbers, ascending. None if `folder` does not exist.
std::vector<int> NumberedFolders(const fs::path& folder) {
  std::vector<int> numbers;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error)) {
    const fs::path name = it->path().filename();
    if (IsModelFolderName(name) && it->is_directory()) {
      numbers.push_back(std::stoi(name.string()));
    }
  }
  if (error && error != std::errc::no_such_file_or_directory &&
      error != std::errc::not_a_directory) {
    throw Error("cannot read the folder '" + folder.string() +
                "': " + error.message() + "; check its disk and permissions");
  }
  std::sort(numbers.begin(), numbers.end());
  return numbers;
}

SubMapFiles FindSubMaps(const ModelMergerOptions& options) {
  SubMapFiles files;
  std::vector<int> clusters = NumberedFolders(*options.input_path);
  std::vector<ClusterFile> listed;
  if (!options.cluster_path->empty()) {
    listed = ReadClusters(*options.cluster_path);
    clusters.clear();
    for (size_t i = 0; i < listed.size(); ++i) {
      clusters.push_back(static_cast<int>(i));
    }
  }
  for (const int cluster : clusters) {
    const fs::path folder =
        fs::path(*options.input_path) / std::to_string(cluster);
    // Folders of model_splitter are models themselves.
    bool has_model =
        fs::is_directory(folder) && ListFolder(folder).HoldsModel();
    if (has_model) {
      files.folders.push_back(folder.string());
      files.clusters.push_back(cluster);
    }
    for (const int model : NumberedFolders(folder)) {
      const fs::path path = folder / std::to_string(model);
      if (!ListFolder(path).HoldsModel()) continue;
      files.folders.push_back(path.string());
      files.clusters.push_back(cluster);
      has_model = true;
    }
    if (has_model) continue;
    files.missing.push_back(folder.string());
    files.num_frames_of_missing.push_back(
        listed.empty() ? 0 : listed[cluster].num_frames);
  }
  return files;
}

// The sub-maps of each image.
using SubMapsOfName = std::map<std::string, std::set<size_t>>;

// The names of the images of each sub-map, in the order of its scene.
using NamesOfSubMaps = std::vector<std::vector<std::string>>;

NamesOfSubMaps ReadNames(const SubMapFiles& files) {
  NamesOfSubMaps names;
  for (const std::string& folder : files.folders) {
    names.emplace_back();
    for (const ModelImage& image : ReadModelPoses(folder).images) {
      names.back().push_back(image.name);
    }
  }
  return names;
}

// Pairs of images that are both in models, but not in the same model.
std::vector<CrossPair> ReadCrossPairs(const std::string& database_path,
                                      const NamesOfSubMaps& names,
                                      const Context& context) {
  if (database_path.empty()) return {};
  SubMapsOfName sub_maps_of;
  DatabaseSelection selection;
  for (size_t m = 0; m < names.size(); ++m) {
    for (const std::string& name : names[m]) {
      sub_maps_of[name].insert(m);
      selection.image_names.insert(name);
    }
  }
  selection.has_keypoints = false;
  selection.has_pair = [&](const std::string& name1, const std::string& name2) {
    const std::set<size_t>& of2 = sub_maps_of.at(name2);
    return std::none_of(sub_maps_of.at(name1).begin(),
                        sub_maps_of.at(name1).end(),
                        [&](size_t m) { return of2.count(m) > 0; });
  };
  DatabaseContents contents = ReadDatabase(database_path, context, selection);
  std::map<ImageId, std::string> name_of_id;
  for (const ImageRow& image : contents.images) {
    name_of_id.emplace(image.id, image.name);
  }
  std::vector<CrossPair> pairs;
  for (TwoViewGeometryRow& row : contents.pairs) {
    pairs.push_back({name_of_id.at(row.image_id1), name_of_id.at(row.image_id2),
                     std::move(row.matches)});
  }
  std::sort(pairs.begin(), pairs.end(),
            [](const CrossPair& a, const CrossPair& b) {
              return std::tie(a.name1, a.name2) < std::tie(b.name1, b.name2);
            });
  return pairs;
}

std::vector<SceneModel> LoadSubMaps(const ModelMergerOptions& options,
                                    const SubMapFiles& files,
                                    const Context& context) {
  std::vector<SceneModel> models;
  for (const std::string& folder : files.folders) {
    models.push_back(ReadModelFile(folder, options.rigs, context).model);
  }
  return models;
}

JoinedMaps Join(const ModelMergerOptions& options, const SubMapFiles& files,
                const Context& context) {
  const std::vector<CrossPair> pairs =
      ReadCrossPairs(*options.database_path, ReadNames(files), context);
  return JoinSubMaps(LoadSubMaps(options, files, context), pairs, options.join,
                     context);
}

BundleSummary Adjust(const ModelMergerOptions& options,
                     std::optional<size_t> max_num_observations,
                     SceneModel* joined, const Context& context) {
  Reconstruction& model = joined->reconstruction;
  BundleResult result;
  if (max_num_observations) {
    result = RefineBySelectedTracks(joined->scene, std::exchange(model, {}),
                                    options.bundle_adjustment,
                                    *max_num_observations, context);
  } else {
    const CandidateSource tracks = FixedCandidates(GroupTracks(model.points));
    result =
        RefineReconstruction(joined->scene, tracks, std::exchange(model, {}),
                             options.bundle_adjustment, context);
  }
  model = std::move(result.estimate);
  return std::move(result.summary);
}

Json DescribeEdge(const SubMapEdge& edge) {
  Json json{{"sub_maps", {edge.sub_map1, edge.sub_map2}},
            {"num_common_images", edge.num_common_images},
            {"num_points", edge.num_points},
            {"scale", edge.first_from_second.scale},
            {"is_used", edge.is_used}};
  if (edge.drift) json["drift"] = *edge.drift;
  if (edge.rotation_error_deg) {
    json["rotation_error_deg"] = *edge.rotation_error_deg;
  }
  return json;
}

Json DescribeModel(const ModelStatistics& statistics,
                   const std::vector<int>& sub_maps,
                   const std::optional<BundleSummary>& bundle) {
  Json json{{"sub_maps", sub_maps},
            {"num_frames", statistics.num_frames},
            {"num_images", statistics.num_images},
            {"num_points", statistics.num_points},
            {"num_observations", statistics.num_observations}};
  if (!bundle) return json;
  json["adjustment"] = Json::array();
  for (const SolveSummary& solve : bundle->solves) {
    json["adjustment"].push_back(
        {{"num_iterations", solve.num_iterations},
         {"initial_cost", solve.initial_cost},
         {"final_cost", solve.final_cost},
         {"termination", std::string(EnumName(solve.termination))}});
  }
  return json;
}

Json DescribeSubMaps(const SubMapFiles& files, const JoinedMaps& joined) {
  Json json{{"mgsfm_version", Version()}, {"sub_maps", Json::array()}};
  for (size_t i = 0; i < files.folders.size(); ++i) {
    Json sub_map{{"path", files.folders[i]}, {"cluster", files.clusters[i]}};
    if (!joined.conflicts[i].empty()) sub_map["conflict"] = joined.conflicts[i];
    json["sub_maps"].push_back(std::move(sub_map));
  }
  json["missing_clusters"] = files.missing;
  json["edges"] = Json::array();
  for (const SubMapEdge& edge : joined.edges) {
    json["edges"].push_back(DescribeEdge(edge));
  }
  json["num_loop_points"] = joined.num_loop_points;
  return json;
}

void LogEdges(const SubMapFiles& files, const JoinedMaps& joined,
              const Context& context) {
  for (const SubMapEdge& edge : joined.edges) {
    const std::string maps = "'" + files.folders[edge.sub_map1] + "' and '" +
                             files.folders[edge.sub_map2] + "'";
    if (edge.is_used) {
      context.Debug(maps + ": " + std::to_string(edge.num_common_images) +
                    " common images, " + std::to_string(edge.num_points) +
                    " points of matches");
      continue;
    }
    const std::string numbers =
        Formatted("%.1f %% of the path and %.1f deg", 100.0 * *edge.drift,
                  *edge.rotation_error_deg);
    context.Warning(
        std::string("the loop between ")
            .append(maps)
            .append(" is rejected: it contradicts the chain of sub-maps by ")
            .append(numbers));
  }
  for (size_t i = 0; i < joined.conflicts.size(); ++i) {
    if (joined.conflicts[i].empty()) continue;
    context.Warning("'" + files.folders[i] +
                    "' stays separate: " + joined.conflicts[i]);
  }
}

void LogMissing(const SubMapFiles& files, const Context& context) {
  GroupedWarnings warnings;
  for (const std::string& folder : files.missing) {
    warnings.Add("there is no model in '" + folder +
                 "'; frames of this cluster that no other has are missing");
  }
  warnings.Log(context);
}

// Adjusts a joined model and writes it into the folder. Returns its entry in
// the report.
Json FinishModel(const ModelMergerOptions& options,
                 std::optional<size_t> max_num_observations,
                 const fs::path& folder, const std::vector<int>& sub_maps,
                 SceneModel* model, const Context& context) {
  CheckFormat(model->scene, options.output_format);
  std::optional<BundleSummary> bundle;
  if (options.refine)
    bundle = Adjust(options, max_num_observations, model, context);
  WriteModelAndRig(folder, model->scene, model->reconstruction,
                   options.output_format, context);
  const ModelStatistics statistics = AnalyzeModel(*model);
  context.Info("model " + folder.filename().string() + ": " +
               DescribeSize(statistics) + " of " +
               std::to_string(sub_maps.size()) + " sub-maps");
  return DescribeModel(statistics, sub_maps, bundle);
}

// Models do not state which camera poses were known.
void LogIfRigsAreRefined(const ModelMergerOptions& options,
                         const std::vector<SceneModel>& models,
                         const Context& context) {
  const bool have_rigs =
      std::any_of(models.begin(), models.end(), [](const SceneModel& model) {
        return model.scene.sensors.size() > model.scene.rigs.size();
      });
  if (!options.refine || !options.rigs.rig_config_path->empty() || !have_rigs)
    return;
  context.Info(
      "bundle adjustment refines the poses of the cameras in their rigs; set "
      "--rig_config_path to keep known ones");
}

// Joins the models of clusters from `mapper --partition` into the models 0, 1,
// ... and a report.json. Reports clusters without a model.
int JoinClusters(const ModelMergerOptions& options, const Context& context) {
  if (options.input_path->empty()) {
    throw Error("--graph needs the folder of the sub-maps; set --input_path");
  }
  std::error_code ignored;
  if (fs::equivalent(*options.input_path, *options.output_path, ignored)) {
    throw Error("'" + *options.output_path +
                "' holds the sub-maps; choose another --output_path");
  }
  ReturnLargeBlocks();
  StagedOutput output(*options.output_path);
  const SubMapFiles files = FindSubMaps(options);
  LogMissing(files, context);
  if (files.folders.empty()) {
    context.log(LogLevel::kError, "'" + *options.input_path +
                                      "' has no model of any cluster; map the "
                                      "clusters first");
    return kExitNotSolvable;
  }
  JoinedMaps joined = Join(options, files, context);
  LogEdges(files, joined, context);
  Json report = DescribeSubMaps(files, joined);
  report["models"] = Json::array();
  LogIfRigsAreRefined(options, joined.models, context);
  std::optional<size_t> max_num_observations;
  if (options.refine) {
    max_num_observations =
        MaxNumAdjustedObservations(joined.models, options.max_memory_mib);
  }
  if (max_num_observations) {
    context.Info("bundle adjustment selects tracks that fit the memory");
  }
  for (size_t i = 0; i < joined.models.size(); ++i) {
    const fs::path folder = output.StagingDir() / std::to_string(i);
    fs::create_directory(folder);
    report["models"].push_back(FinishModel(options, max_num_observations,
                                           folder, joined.sub_maps[i],
                                           &joined.models[i], context));
  }
  report["peak_memory_mib"] = PeakMemoryMib();
  WriteFile(output.StagingDir() / "report.json", report.dump(2) + "\n");
  context.CheckInterrupted();
  output.Commit();
  return kExitSuccess;
}

void LogSummary(const MergeSummary& summary, const Context& context) {
  context.Info(
      Formatted("%d common frames with %d common images, median distance "
                "%.4g, scale %.9g",
                summary.num_common_frames, summary.num_common_images,
                summary.median_distance, summary.first_from_second.scale));
  context.Info(
      Formatted("%d new images, %d points merged, %d contradictory points "
                "dropped",
                summary.num_new_images, summary.num_merged_points,
                summary.num_dropped_points));
}

int RunModelMerger(const ModelMergerOptions& options, const Context& context) {
  if (options.graph) return JoinClusters(options, context);
  if (options.input_path1->empty() || options.input_path2->empty()) {
    throw Error(
        "give two models with --input_path1 and --input_path2, or "
        "sub-maps with --graph and --input_path");
  }
  StagedOutput output(*options.output_path, OutputKind::kModel);
  ModelFile first = ReadModelFile(options.input_path1, options.rigs, context);
  ModelFile second = ReadModelFile(options.input_path2, options.rigs, context);
  MergeSummary summary;
  try {
    summary = MergeModels(std::move(second.model),
                          {options.min_common_images, options.max_reproj_error},
                          &first.model);
  } catch (const Error& error) {
    throw Error("'" + *options.input_path1 + "' and '" + *options.input_path2 +
                "' cannot be merged: " + error.what());
  }
  CheckFormat(first.model.scene, options.output_format);
  WriteModelFile(first, options.output_format, context, &output);
  LogSummary(summary, context);
  context.Info("the merged model has " + DescribeSize(first.model));
  return kExitSuccess;
}

}  // namespace

Command ModelMergerCommand() {
  return MakeCommand("model_merger",
                     "Merges two models with common images or frames.",
                     RunModelMerger);
}

}  // namespace mgsfm
