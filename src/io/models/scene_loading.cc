// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/io/models/scene_loading.h"

#include <algorithm>
#include <map>
#include <tuple>
#include <utility>

#include "io/models/rows_to_scene.h"
#include "mgsfm/base/error.h"

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

ViewGraph BuildViewGraph(std::vector<TwoViewGeometryRow> rows,
                         const Scene& scene) {
  std::map<ImageId, int> image_idx_of_id;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    image_idx_of_id[scene.images[i].id] = static_cast<int>(i);
  }
  const auto idx_of = [&](ImageId id) {
    const auto found = image_idx_of_id.find(id);
    MGSFM_CHECK_MSG(found != image_idx_of_id.end(), std::to_string(id.value()));
    return found->second;
  };
  std::vector<std::tuple<int, int, TwoViewGeometryRow*>> order;
  for (TwoViewGeometryRow& row : rows) {
    if (row.matches.empty()) continue;
    if (idx_of(row.image_id1) > idx_of(row.image_id2)) SwapImages(&row);
    order.emplace_back(idx_of(row.image_id1), idx_of(row.image_id2), &row);
  }
  std::sort(order.begin(), order.end());
  ViewGraph view_graph;
  view_graph.pairs.reserve(order.size());
  for (const auto& [image_idx1, image_idx2, row] : order) {
    view_graph.pairs.push_back(MakePair(row, image_idx1, image_idx2));
  }
  return view_graph;
}

void LogScene(const LoadedScene& loaded, const Context& context) {
  const Scene& scene = loaded.scene;
  context.Info("rigs from " + loaded.rig_source + ": " +
               std::to_string(scene.rigs.size()) + " rigs, " +
               std::to_string(scene.frames.size()) + " frames, " +
               std::to_string(scene.images.size()) + " images, " +
               std::to_string(loaded.view_graph.pairs.size()) + " pairs");
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
  if (loaded.view_graph.pairs.empty()) {
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
  LogScene(loaded, context);
  return loaded;
}

LoadedScene LoadScene(const std::string& database_path,
                      const SceneLoadingOptions& options,
                      const Context& context) {
  return LoadScene(ReadDatabase(database_path, context), options, context);
}

}  // namespace mgsfm
