// SPDX-License-Identifier: BSD-3-Clause
#include "sub_map_files.h"

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>
#include <tuple>

#include "base/file_reading.h"
#include "base/format.h"
#include "base/ranges.h"
#include "files/model_files.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/database.h"
#include "mgsfm/priors/pose_priors.h"
#include "partition_run.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

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

// Throws Error if the folder is one of the finished map, whose frames it would
// add as new ones.
void CheckIsNew(const fs::path& folder, const SubMapFiles& files) {
  for (int i = 0; i < files.num_existing; ++i) {
    if (!fs::equivalent(folder, files.folders[i])) continue;
    throw Error("'" + folder.string() +
                "' is a sub-map of --input_path and a model of "
                "--existing_path; move it out of the folder --input_path");
  }
}

// Adds the models in the folder of a cluster. Returns whether there are any.
bool AddModels(const fs::path& folder, std::optional<int> cluster,
               SubMapFiles* files) {
  std::vector<fs::path> paths = {folder};  // model_splitter's are models
  for (const int model : NumberedFolders(folder)) {
    paths.push_back(folder / std::to_string(model));
  }
  const size_t num_before = files->folders.size();
  for (const fs::path& path : paths) {
    if (!fs::is_directory(path) || !ListFolder(path).HoldsModel()) continue;
    CheckIsNew(path, *files);
    files->folders.push_back(path.string());
    files->clusters.push_back(cluster);
  }
  return files->folders.size() > num_before;
}

}  // namespace

fs::path NormalizedFolder(const std::string& path) {
  const fs::path folder = fs::path(path).lexically_normal();
  return folder.has_filename() ? folder : folder.parent_path();
}

SubMapFiles FindSubMaps(const std::string& input_path,
                        const std::string& cluster_path,
                        const std::string& existing_path) {
  SubMapFiles files;
  if (!existing_path.empty()) {
    if (!AddModels(NormalizedFolder(existing_path), std::nullopt, &files)) {
      throw Error("'" + existing_path +
                  "' has no model; set --existing_path to the output folder of "
                  "the finished map");
    }
    files.num_existing = static_cast<int>(files.folders.size());
  }
  std::vector<int> clusters = NumberedFolders(input_path);
  if (!cluster_path.empty()) {
    clusters = Indices(CountClusters(cluster_path));
  }
  for (const int cluster : clusters) {
    const fs::path folder = fs::path(input_path) / std::to_string(cluster);
    if (AddModels(folder, cluster, &files)) continue;
    files.missing.push_back(folder.string());
  }
  return files;
}

SubMapFacts FindSubMapFacts(const fs::path& folder, const SceneModel& model) {
  SubMapFacts facts;
  const Scene& scene = model.scene;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto pose =
        model.reconstruction.CamFromWorld(scene, static_cast<int>(i));
    if (pose) facts.cam_from_world.emplace_back(scene.images[i].name, *pose);
  }
  facts.origin_wgs84 = ReadGeoOrigin(folder.string());
  facts.is_registered = facts.origin_wgs84.has_value();
  const fs::path path = folder.parent_path() / kReportFileName;
  if (!fs::is_regular_file(path) || !IsModelFolderName(folder.filename())) {
    return facts;
  }
  const Json report = Json::parse(ReadFile(path), nullptr, false);
  const Json::json_pointer entry("/models/" + folder.filename().string());
  if (report.is_discarded() || !report.contains(entry)) return facts;
  const Json& of_run = report[entry];
  facts.used_gravity = of_run.contains("gravity");
  const Json::json_pointer registered("/position_priors/is_registered");
  facts.is_registered |= of_run.value(registered, false);
  return facts;
}

Mask FramesOf(const SubMapFacts& facts, const Scene& scene) {
  std::set<std::string> names;
  for (const auto& [name, pose] : facts.cam_from_world) names.insert(name);
  Mask frames(scene.frames.size(), false);
  for (const Image& image : scene.images) {
    if (names.count(image.name) > 0) frames[image.frame_idx] = true;
  }
  return frames;
}

std::vector<CrossPair> ReadCrossPairs(const std::string& database_path,
                                      const std::vector<SubMapFacts>& facts,
                                      const Context& context) {
  if (database_path.empty()) return {};
  std::map<std::string, std::set<size_t>> sub_maps_of;  // by image
  DatabaseSelection selection;
  for (size_t m = 0; m < facts.size(); ++m) {
    for (const auto& [name, pose] : facts[m].cam_from_world) {
      sub_maps_of[name].insert(m);
      selection.image_names.insert(name);
    }
  }
  selection.has_keypoints = false;
  selection.has_pair = [&](const std::string& name1, const std::string& name2) {
    const std::set<size_t>& of2 = sub_maps_of.at(name2);
    return NoneOf(sub_maps_of.at(name1),
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
  SortBy(&pairs, [](const CrossPair& a) { return std::tie(a.name1, a.name2); });
  return pairs;
}

std::optional<WorldOfParts> FindWorld(const SceneModel& model,
                                      const std::vector<int>& sub_maps,
                                      const std::vector<SubMapFacts>& facts,
                                      const Context& context) {
  const auto first = std::find_if(sub_maps.begin(), sub_maps.end(), [&](int m) {
    return facts[m].is_registered;
  });
  if (first == sub_maps.end()) return std::nullopt;
  std::map<std::string, Rigid3> pose_of_name;
  size_t num_others = 0;
  for (const int m : sub_maps) {
    if (!facts[m].is_registered ||
        facts[m].origin_wgs84 != facts[*first].origin_wgs84) {
      ++num_others;
      continue;
    }
    const auto& poses = facts[m].cam_from_world;
    pose_of_name.insert(poses.begin(), poses.end());
  }
  if (num_others > 0) {
    context.Warning(
        Formatted("%zu of %zu sub-maps are not in the world of measured "
                  "positions of the others",
                  num_others, sub_maps.size()));
  }
  const auto& sensor_from_rig = model.reconstruction.sensor_from_rig;
  WorldOfParts world{{}, facts[*first].origin_wgs84};
  world.poses.sensor_from_rig = sensor_from_rig;
  world.poses.rig_from_world.resize(model.scene.frames.size());
  for (const Image& image : model.scene.images) {
    const auto found = pose_of_name.find(image.name);
    const auto& sensor = sensor_from_rig[image.sensor_idx];
    if (found == pose_of_name.end() || !sensor) continue;
    world.poses.rig_from_world[image.frame_idx] =
        sensor->Inverse() * found->second;
  }
  return world;
}

}  // namespace mgsfm
