// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/models/scene_loading.h"

#include <algorithm>
#include <map>
#include <tuple>
#include <utility>

#include "mgsfm/base/error.h"
#include "models/rows_to_scene.h"

namespace mgsfm {
namespace {

ImagePair MakePair(TwoViewGeometryRow* row, int image_idx1, int image_idx2) {
  ImagePair pair;
  pair.image_idx1 = image_idx1;
  pair.image_idx2 = image_idx2;
  pair.config = row->config;
  pair.F = row->F;
  pair.E = row->E;
  pair.H = row->H;
  if (row->cam2_from_cam1) {
    pair.relative_pose = RelativePose{row->cam2_from_cam1->rotation, {}};
    const double length = row->cam2_from_cam1->translation.norm();
    if (length > 0.0) {
      pair.relative_pose->translation_direction =
          row->cam2_from_cam1->translation / length;
    }
  }
  pair.matches = std::move(row->matches);
  return pair;
}

void SwapImages(MatchesRow* pair) {
  std::swap(pair->image_id1, pair->image_id2);
  for (Match& match : pair->matches) {
    std::swap(match.keypoint_idx1, match.keypoint_idx2);
  }
}

// The rows with matches in canonical order.
template <class Row>
std::vector<std::tuple<int, int, Row*>> OrderPairs(const Scene& scene,
                                                   std::vector<Row>* rows) {
  std::map<ImageId, int> image_idx_of_id;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    image_idx_of_id[scene.images[i].id] = static_cast<int>(i);
  }
  const auto idx_of = [&](ImageId id) {
    const auto found = image_idx_of_id.find(id);
    MGSFM_CHECK_MSG(found != image_idx_of_id.end(), std::to_string(id.value()));
    return found->second;
  };
  std::vector<std::tuple<int, int, Row*>> order;
  for (Row& row : *rows) {
    if (row.matches.empty()) continue;
    if (idx_of(row.image_id1) > idx_of(row.image_id2)) SwapImages(&row);
    order.emplace_back(idx_of(row.image_id1), idx_of(row.image_id2), &row);
  }
  std::sort(order.begin(), order.end());
  return order;
}

ViewGraph BuildViewGraph(std::vector<TwoViewGeometryRow> rows,
                         const Scene& scene) {
  const auto order = OrderPairs(scene, &rows);
  ViewGraph view_graph;
  view_graph.pairs.reserve(order.size());
  for (const auto& [image_idx1, image_idx2, row] : order) {
    view_graph.pairs.push_back(MakePair(row, image_idx1, image_idx2));
  }
  return view_graph;
}

void LogScene(const Scene& scene, const std::string& rig_source,
              size_t num_pairs, const Context& context) {
  context.Info("rigs from " + rig_source + ": " +
               std::to_string(scene.rigs.size()) + " rigs, " +
               std::to_string(scene.frames.size()) + " frames, " +
               std::to_string(scene.images.size()) + " images, " +
               std::to_string(num_pairs) + " pairs");
  std::vector<int> num_images(scene.sensors.size(), 0);
  for (const Image& image : scene.images) ++num_images[image.sensor_idx];
  for (size_t rig_idx = 0; rig_idx < scene.rigs.size(); ++rig_idx) {
    std::string line = "rig " + std::to_string(rig_idx + 1) + ":";
    for (const int sensor_idx : scene.rigs[rig_idx].sensor_idxs) {
      line += " '" + scene.sensors[sensor_idx].name + "' (" +
              std::to_string(num_images[sensor_idx]) + " images" +
              (scene.IsReference(sensor_idx) ? ", reference)" : ")");
    }
    context.Debug(line);
  }
  if (num_pairs == 0) {
    context.Warning(
        "the database has no verified matches; run a matcher with geometric "
        "verification first");
  }
}

}  // namespace

LoadedScene LoadScene(DatabaseContents contents,
                      const SceneLoadingOptions& options,
                      const Context& context) {
  std::vector<TwoViewGeometryRow> pairs = std::move(contents.pairs);
  SceneOfRows rows =
      BuildSceneOfRows("database", std::move(contents), options, context);
  LoadedScene loaded;
  loaded.scene = std::move(rows.scene);
  loaded.rig_source = std::move(rows.rig_source);
  loaded.view_graph = BuildViewGraph(std::move(pairs), loaded.scene);
  LogScene(loaded.scene, loaded.rig_source, loaded.view_graph.pairs.size(),
           context);
  return loaded;
}

LoadedMatches LoadMatches(DatabaseContents contents,
                          const SceneLoadingOptions& options,
                          const Context& context) {
  std::vector<MatchesRow> matches = std::move(contents.matches);
  SceneOfRows rows =
      BuildSceneOfRows("database", std::move(contents), options, context);
  LoadedMatches loaded;
  loaded.scene = std::move(rows.scene);
  const auto order = OrderPairs(loaded.scene, &matches);
  loaded.pairs.reserve(order.size());
  for (const auto& [image_idx1, image_idx2, row] : order) {
    loaded.pairs.push_back({image_idx1, image_idx2, std::move(row->matches)});
  }
  LogScene(loaded.scene, rows.rig_source, loaded.pairs.size(), context);
  return loaded;
}

LoadedScene LoadScene(const std::string& database_path,
                      const SceneLoadingOptions& options,
                      const Context& context) {
  return LoadScene(ReadDatabase(database_path, context), options, context);
}

}  // namespace mgsfm
