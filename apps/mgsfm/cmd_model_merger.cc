// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/grouped_warnings.h"
#include "base/memory.h"
#include "base/ranges.h"
#include "command.h"
#include "commands.h"
#include "files/file_operations.h"
#include "files/model_files.h"
#include "files/staged_output.h"
#include "fleet/sub_maps.h"
#include "mapper/joined_model.h"
#include "mapper_run.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/mapper/report.h"
#include "model_file.h"
#include "partition_run.h"
#include "scene/item_lists.h"
#include "sub_map_files.h"

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
  Option<std::string> existing_path{
      "existing_path", "",
      "Join the sub-maps of graph to the finished map in this output folder of "
      "the mapper or model_merger. Its frames and calibration stay as they "
      "are, unless the sub-maps contradict them. If sub-maps connect several "
      "models of the map, only the largest of these stays."};
  Option<std::string> cluster_path{
      "cluster_path", "",
      "Report clusters without a model by their names in this folder of mapper "
      "--partition, with graph."};
  Option<std::string> database_path{
      "database_path", "",
      "Close loops between clusters with the matches of this database, with "
      "graph. It is not changed."};
  Option<bool> refine{"refine", true, "Adjust the joined models of graph."};
  Option<std::string> image_path{
      "image_path", "",
      "Color the points of the joined models of graph by the images in this "
      "folder. Without it, points keep the colors of the sub-maps."};
  Option<bool> compute_covariances{
      "compute_covariances", false,
      "Compute the covariances of the joined models of graph, as the mapper "
      "does."};
  Option<bool> write_report{
      "write_report", true,
      "Write report.html, a page to inspect a model, into the folder of each "
      "joined model of graph."};
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
  PosePriorOptions priors;
  BundleAdjustmentOptions bundle_adjustment;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input_path1, input_path2, output_path, min_common_images,
          max_reproj_error, output_format, rigs, graph, input_path,
          existing_path, cluster_path, database_path, image_path, write_report,
          refine, compute_covariances, max_memory_mib, priors);
    visit.Group("Join", join);
    visit.Group("BundleAdjustment", bundle_adjustment);
  }
};

using Json = nlohmann::ordered_json;

// Joins the sub-maps, and collects their facts.
JoinedMaps Join(const ModelMergerOptions& options, const SubMapFiles& files,
                const Context& context, std::vector<SubMapFacts>* facts) {
  std::vector<SceneModel> models;
  for (const std::string& folder : files.folders) {
    models.push_back(ReadModelFile(folder, options.rigs, context).model);
    facts->push_back(FindSubMapFacts(folder, models.back()));
  }
  const std::vector<CrossPair> pairs =
      ReadCrossPairs(*options.database_path, *facts, context);
  return JoinSubMaps(std::move(models), pairs, options.join, context,
                     files.num_existing);
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

Json DescribeSubMaps(const SubMapFiles& files, const JoinedMaps& joined) {
  Json json{{"sub_maps", Json::array()}};
  for (size_t i = 0; i < files.folders.size(); ++i) {
    Json sub_map{{"path", files.folders[i]}};
    if (files.clusters[i]) sub_map["cluster"] = *files.clusters[i];
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
      context.Debug(maps + Formatted(": %d common images, %d points of matches",
                                     edge.num_common_images, edge.num_points));
      continue;
    }
    context.Warning("the loop between " + maps +
                    Formatted(" is rejected: it contradicts the chain of "
                              "sub-maps by %.1f %% of the path and %.1f deg",
                              100.0 * *edge.drift, *edge.rotation_error_deg));
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

// States which measurements of the sub-maps the join is not given.
void LogUnusedPriors(const PosePriorOptions& options,
                     const std::vector<SubMapFacts>& facts,
                     const Context& context) {
  const auto any = [&](bool SubMapFacts::*used) {
    return AnyOf(facts, [&](const SubMapFacts& f) { return f.*used; });
  };
  if (any(&SubMapFacts::is_registered) && !options.AreUsed()) {
    context.Warning(
        "the sub-maps used measured positions, but the join only keeps their "
        "world; set --use_prior_position or --ref_images_path as for the "
        "sub-maps to adjust it to the positions");
  }
  const bool has_gravity =
      options.use_prior_gravity || !options.gravity_path->empty();
  if (any(&SubMapFacts::used_gravity) && !has_gravity) {
    context.Warning(
        "the sub-maps used measured gravity, but the join does not; set "
        "--use_prior_gravity or --gravity_path as for the sub-maps");
  }
}

// The pairs of the database, for the page and the report.
ViewGraph ReadViewGraph(const std::string& database_path, const Scene& scene,
                        const Context& context) {
  if (database_path.empty()) return {};
  DatabaseSelection selection;
  selection.has_keypoints = false;
  const std::map<std::string, int> idx_of_name = IndexByName(scene.images);
  for (const auto& [name, idx] : idx_of_name) {
    selection.image_names.insert(name);
  }
  DatabaseContents contents = ReadDatabase(database_path, context, selection);
  std::map<ImageId, int> idx_of_id;
  for (const ImageRow& image : contents.images) {
    idx_of_id.emplace(image.id, idx_of_name.at(image.name));
  }
  ViewGraph view_graph;
  for (TwoViewGeometryRow& row : contents.pairs) {
    if (row.matches.empty()) continue;
    if (idx_of_id[row.image_id1] > idx_of_id[row.image_id2]) SwapImages(&row);
    ImagePair pair;
    pair.image_idx1 = idx_of_id[row.image_id1];
    pair.image_idx2 = idx_of_id[row.image_id2];
    pair.config = row.config;
    pair.matches = std::move(row.matches);
    view_graph.pairs.push_back(std::move(pair));
  }
  SortBy(&view_graph.pairs, [](const ImagePair& a) {
    return std::pair(a.image_idx1, a.image_idx2);
  });
  return view_graph;
}

// A joined model, and what its report and page need.
struct FinishedModel {
  MapperInput input;
  MapperResult result;
};

// A run of the mapper, as far as the join is one.
MapperRun RunOf(const ModelMergerOptions& options) {
  MapperRun run;
  run.database_path = options.database_path;
  run.output_path = options.output_path;
  run.image_path = options.image_path;
  run.output_format = options.output_format;
  run.loading.rig_config_path = options.rigs.rig_config_path;
  run.loading.rig_name_rule = options.rigs.rig_name_rule;
  run.priors = options.priors;
  run.mapper.bundle_adjustment = options.bundle_adjustment;
  run.mapper.compute_covariances = options.compute_covariances;
  run.options_json = OptionsToJsonOf(options);
  run.default_options_json = OptionsToJsonOf(ModelMergerOptions());
  return run;
}

// The facts about a joined model that its sub-maps state.
struct KnownParts {
  std::optional<WorldOfParts> world;
  Mask existing_frames;  // of a finished map; empty: none
  std::optional<size_t> max_num_observations;
};

// Adjusts a joined model and writes it into the folder.
FinishedModel FinishModel(const ModelMergerOptions& options, KnownParts parts,
                          const fs::path& folder, SceneModel model,
                          const Context& context) {
  const std::optional<WorldOfParts>& world = parts.world;
  const MapperRun run = RunOf(options);
  FinishedModel done;
  done.input.scene = std::move(model.scene);
  const Scene& scene = done.input.scene;
  CheckFormat(scene, run.output_format);
  if (!run.database_path.empty()) ReadPriors(run, context, &done.input);
  const PositionPriors& positions = done.input.position_priors;
  const bool is_apart = !parts.existing_frames.empty() && world &&
                        !positions.IsEmpty() &&
                        world->origin_wgs84 != positions.origin_wgs84;
  done.result = AdjustJoinedModel(
      {scene, positions, done.input.gravity_priors,
       world && !is_apart ? &world->poses : nullptr, options.refine,
       parts.max_num_observations, std::move(parts.existing_frames)},
      run.mapper, context, std::move(model.reconstruction));
  ColorModels(scene, run.image_path, context, &done.result);
  done.input.view_graph = ReadViewGraph(run.database_path, scene, context);
  const MapperModel& adjusted = done.result.models.front();
  WriteMapperModel(folder, done.input, adjusted, run.output_format, context);
  const fs::path origin = folder / "geo_origin.json";
  if (world && world->origin_wgs84 && !fs::exists(origin)) {
    WriteGeoOrigin(origin.string(), *world->origin_wgs84);
  }
  return done;
}

// Adds the report of a model to that of the join: as the mapper writes it, but
// without the stages that the join does not have.
void AddToReport(const std::string& model_report,
                 const std::vector<int>& sub_maps, bool is_in_world_of_parts,
                 Json* report) {
  Json json = Json::parse(model_report);
  Json& model = json["models"][0];
  model["sub_maps"] = sub_maps;
  for (const char* key :
       {"tracks", "translation_averaging", "rejected_groups"}) {
    model.erase(key);
  }
  Json& summary = json["summary"];
  if (is_in_world_of_parts) {
    summary["models"][0]["unit_of_length"] = "that of the sub-maps";
  }
  if (!report->contains("models")) {
    for (const char* key :
         {"view_graph", "rotation_averaging", "rejected_pairs",
          "motion_was_refuted", "peak_memory_mib"}) {
      json.erase(key);
    }
    report->update(json);
    return;
  }
  (*report)["models"].push_back(model);
  Json& total = (*report)["summary"];
  total["models"].push_back(summary["models"][0]);
  const auto add = [](const Json& from, Json* to) {
    for (const auto& [key, value] : from.items()) {
      if (!value.is_number_unsigned()) continue;
      (*to)[key] = (*to)[key].get<size_t>() + value.get<size_t>();
    }
  };
  add(summary, &total);
  add(json["input"], &(*report)["input"]);
  for (const char* key : {"warnings", "unregistered_frames"}) {
    for (const Json& entry : json[key]) (*report)[key].push_back(entry);
  }
}

// Models do not state which camera poses were known.
void LogIfRigsAreRefined(const ModelMergerOptions& options,
                         const std::vector<SceneModel>& models,
                         const Context& context) {
  const bool have_rigs = AnyOf(models, [](const SceneModel& model) {
    return model.scene.sensors.size() > model.scene.rigs.size();
  });
  if (!options.refine || !options.rigs.rig_config_path->empty() ||
      !options.existing_path->empty() || !have_rigs) {
    return;
  }
  context.Info(
      "bundle adjustment refines the poses of the cameras in their rigs; set "
      "--rig_config_path to keep known ones");
}

void CheckExistingPath(const ModelMergerOptions& options) {
  if (options.existing_path->empty()) return;
  if (!options.graph) {
    throw Error(
        "--existing_path belongs to the join of sub-maps; set --graph 1 and "
        "--input_path");
  }
  std::error_code ignored;
  fs::path existing = NormalizedFolder(*options.existing_path);
  if (IsModelFolderName(existing.filename())) existing = existing.parent_path();
  if (existing.empty()) existing = ".";
  if (fs::equivalent(existing, *options.output_path, ignored) ||
      fs::equivalent(*options.existing_path, *options.output_path, ignored)) {
    throw Error("'" + *options.output_path +
                "' holds the finished map; choose another --output_path");
  }
}

void CheckUsage(const ModelMergerOptions& options) {
  if (options.input_path->empty()) {
    throw Error("--graph needs the folder of the sub-maps; set --input_path");
  }
  std::error_code ignored;
  if (fs::equivalent(*options.input_path, *options.output_path, ignored)) {
    throw Error("'" + *options.output_path +
                "' holds the sub-maps; choose another --output_path");
  }
  if (options.database_path->empty() && options.priors.HaveAny()) {
    throw Error(
        "positions and gravity belong to the images of a database; set "
        "--database_path");
  }
  CheckImagePath(options.image_path);
}

// Warns if no joined model has frames of the finished map and of sub-maps.
void LogIfMapIsApart(const ModelMergerOptions& options, int num_existing,
                     const JoinedMaps& joined, const Context& context) {
  const bool is_extended =
      AnyOf(joined.sub_maps, [&](const std::vector<int>& sub_maps) {
        return sub_maps.front() < num_existing &&
               sub_maps.back() >= num_existing;
      });
  if (num_existing == 0 || is_extended) return;
  context.Warning(
      "nothing connects the finished map '" + *options.existing_path +
      "' of --existing_path and the sub-maps, which stay separate models; " +
      (options.database_path->empty()
           ? "set --database_path to a database with matches between them"
           : "match images of both, for example with vocab_tree_matcher"));
}

// Collects these facts, but for the limit of observations.
KnownParts FindParts(const SubMapFiles& files,
                     const std::vector<SubMapFacts>& facts,
                     const std::vector<int>& sub_maps, const SceneModel& model,
                     const Context& context) {
  KnownParts parts;
  parts.world = FindWorld(model, sub_maps, facts, context);
  if (sub_maps.front() >= files.num_existing) return parts;
  const SubMapFacts& existing = facts[sub_maps.front()];
  parts.existing_frames = FramesOf(existing, model.scene);
  if (!existing.is_registered) parts.world.reset();
  return parts;
}

// Finishes all joined models in the folder, and writes report.json there.
// Returns the models and the report.
std::pair<std::vector<FinishedModel>, std::string> FinishModels(
    const ModelMergerOptions& options, const SubMapFiles& files,
    const fs::path& output, const Context& context) {
  std::vector<SubMapFacts> facts;
  JoinedMaps joined = Join(options, files, context, &facts);
  LogEdges(files, joined, context);
  LogIfMapIsApart(options, files.num_existing, joined, context);
  Json report = DescribeSubMaps(files, joined);
  LogIfRigsAreRefined(options, joined.models, context);
  LogUnusedPriors(options.priors, facts, context);
  std::optional<size_t> max_num_observations;
  if (options.refine) {
    max_num_observations =
        MaxNumAdjustedObservations(joined.models, options.max_memory_mib);
  }
  RunDescription description = DescribeInput(RunOf(options), context);
  description.rig_source = "the sub-maps";
  std::vector<FinishedModel> models;
  for (size_t i = 0; i < joined.models.size(); ++i) {
    const std::vector<int>& sub_maps = joined.sub_maps[i];
    KnownParts parts =
        FindParts(files, facts, sub_maps, joined.models[i], context);
    parts.max_num_observations = max_num_observations;
    const bool has_world = parts.world.has_value();
    models.push_back(FinishModel(options, std::move(parts),
                                 output / std::to_string(i),
                                 std::move(joined.models[i]), context));
    const auto& [input, result] = models.back();
    const auto& positions = result.models.front().position_priors;
    AddToReport(
        MapperReportToJson(input.scene, input.view_graph, result, description),
        sub_maps, has_world && !(positions && positions->is_registered),
        &report);
    const Json& counts = report["models"].back();
    context.Info("model " + std::to_string(i) + ": " +
                 counts["num_frames"].dump() + " frames, " +
                 counts["num_images"].dump() + " images and " +
                 counts["num_points"].dump() + " points of " +
                 std::to_string(sub_maps.size()) + " sub-maps");
  }
  if (!options.database_path->empty()) {
    report["summary"]["num_images"] =
        ReadImageNames(options.database_path).size();
  }
  report["peak_memory_mib"] = PeakMemoryMib();
  std::string text = report.dump(2) + "\n";
  WriteFile(output / kReportFileName, text);
  return {std::move(models), std::move(text)};
}

// Joins the models of clusters from `mapper --partition` into the models 0, 1,
// ... with the tables and pages of the mapper, and a report.json. Reports
// clusters without a model. Returns an ExitCode; throws Error for bad input.
int JoinClusters(const ModelMergerOptions& options, const Context& context) {
  CheckUsage(options);
  ReturnLargeBlocks();
  StagedOutput output(*options.output_path);
  const SubMapFiles files = FindSubMaps(
      options.input_path, options.cluster_path, options.existing_path);
  LogMissing(files, context);
  if (files.folders.size() == static_cast<size_t>(files.num_existing)) {
    context.log(LogLevel::kError, "'" + *options.input_path +
                                      "' has no model of any cluster; check "
                                      "--input_path, or map the clusters "
                                      "first");
    return kExitNotSolvable;
  }
  const auto [models, report] =
      FinishModels(options, files, output.StagingDir(), context);
  context.CheckInterrupted();
  output.Commit();
  for (size_t i = 0; options.write_report && i < models.size(); ++i) {
    const fs::path folder = fs::path(*options.output_path) / std::to_string(i);
    WriteReportPage({folder, options.image_path, models[i].input,
                     models[i].result.models.front(), i, report},
                    context);
  }
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
  CheckExistingPath(options);
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
