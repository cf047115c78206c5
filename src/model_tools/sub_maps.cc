// SPDX-License-Identifier: BSD-3-Clause
#include "model_tools/sub_maps.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include "math/spanning_tree.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "model_tools/point_lookup.h"
#include "model_tools/sub_map_graph.h"

namespace mgsfm {
namespace {

// Errors of two-view points; see sub_map_graph.cc.
constexpr double kMaxRelativeDistance = 0.05;

size_t NumFrames(const SceneModel& model) {
  const auto& poses = model.reconstruction.rig_from_world;
  return static_cast<size_t>(
      std::count_if(poses.begin(), poses.end(),
                    [](const auto& pose) { return pose.has_value(); }));
}

// The sub-maps of each connected component in the order in which they are
// merged: each is next to an earlier one.
std::vector<std::vector<int>> OrderOfMerging(
    size_t num_sub_maps, const std::vector<SubMapEdge>& edges,
    const std::vector<int>& forest) {
  std::vector<GraphEdge> graph;
  for (const SubMapEdge& edge : edges) {
    graph.push_back({edge.sub_map1, edge.sub_map2});
  }
  std::vector<std::vector<int>> components;
  for (const ForestStep& step :
       WalkForest(static_cast<int>(num_sub_maps), graph, forest)) {
    if (!step.from) components.emplace_back();
    components.back().push_back(step.node);
  }
  return components;
}

// Points that matches connect, once each.
std::set<std::pair<int, int>> FindEqualPoints(
    const SceneModel& model, const std::vector<CrossPair>& pairs) {
  std::map<std::string, int> image_of_name;
  for (size_t i = 0; i < model.scene.images.size(); ++i) {
    image_of_name.emplace(model.scene.images[i].name, static_cast<int>(i));
  }
  const PointLookup lookup(model.reconstruction, model.scene.images.size());
  std::set<std::pair<int, int>> equal;
  for (const CrossPair& pair : pairs) {
    const auto image1 = image_of_name.find(pair.name1);
    const auto image2 = image_of_name.find(pair.name2);
    if (image1 == image_of_name.end() || image2 == image_of_name.end()) {
      continue;
    }
    for (const Match& match : pair.matches) {
      const auto a =
          lookup.Find(image1->second, static_cast<int>(match.keypoint_idx1));
      const auto b =
          lookup.Find(image2->second, static_cast<int>(match.keypoint_idx2));
      if (a && b && *a != *b) {
        equal.emplace(std::min(*a, *b), std::max(*a, *b));
      }
    }
  }
  return equal;
}

bool AreClose(const SceneModel& model, const Point3D& a, const Point3D& b) {
  const Eigen::Vector3d camera =
      model.reconstruction.CamFromWorld(model.scene, a.track.front().image_idx)
          ->Center();
  return (a.point_in_world - b.point_in_world).norm() <=
         kMaxRelativeDistance * (a.point_in_world - camera).norm();
}

bool ShareAnImage(const Point3D& a, const Point3D& b) {
  std::set<int> images;
  for (const Observation& o : a.track) images.insert(o.image_idx);
  return std::any_of(b.track.begin(), b.track.end(), [&](const Observation& o) {
    return images.count(o.image_idx) > 0;
  });
}

// Adds b to a. The longer track counts for more.
void MergePoint(Point3D* a, Point3D* b) {
  const auto size1 = static_cast<double>(a->track.size());
  const auto size2 = static_cast<double>(b->track.size());
  a->point_in_world =
      (size1 * a->point_in_world + size2 * b->point_in_world) / (size1 + size2);
  a->track.insert(a->track.end(), b->track.begin(), b->track.end());
  std::sort(a->track.begin(), a->track.end());
  b->track.clear();
}

int MergePointsOfMatches(const std::vector<CrossPair>& pairs,
                         SceneModel* model) {
  std::vector<Point3D>& points = model->reconstruction.points;
  UnionFind sets(points.size());
  std::vector<int> owner(points.size());  // of the track of a set
  std::iota(owner.begin(), owner.end(), 0);
  int num_merged = 0;
  for (const auto& [i, k] : FindEqualPoints(*model, pairs)) {
    const int a = owner[sets.Find(i)];
    const int b = owner[sets.Find(k)];
    if (a == b || !AreClose(*model, points[a], points[b]) ||
        ShareAnImage(points[a], points[b])) {
      continue;
    }
    MergePoint(&points[a], &points[b]);
    sets.Union(a, b);
    owner[sets.Find(a)] = a;
    ++num_merged;
  }
  points.erase(
      std::remove_if(points.begin(), points.end(),
                     [](const Point3D& point) { return point.track.empty(); }),
      points.end());
  return num_merged;
}

class SubMapJoiner {
 public:
  SubMapJoiner(std::vector<SceneModel> sub_maps,
               const std::vector<CrossPair>& pairs, const JoinOptions& options,
               const Context& context)
      : sub_maps_(std::move(sub_maps)),
        pairs_(pairs),
        options_(options),
        context_(context) {}

  JoinedMaps Run() {
    joined_.edges = MeasureEdges(sub_maps_, pairs_, options_);
    const std::vector<int> forest =
        RejectWrongLoops(sub_maps_, options_, &joined_.edges);
    world_from_ = AverageSimilarities(sub_maps_, joined_.edges, forest);
    joined_.conflicts.resize(sub_maps_.size());
    for (const std::vector<int>& component :
         OrderOfMerging(sub_maps_.size(), joined_.edges, forest)) {
      context_.CheckInterrupted();
      MergeComponent(component);
    }
    SortModels();
    return std::move(joined_);
  }

 private:
  void MergeComponent(const std::vector<int>& component) {
    SceneModel model = std::move(sub_maps_[component.front()]);
    TransformWorld(world_from_[component.front()], &model.reconstruction);
    std::vector<int> merged = {component.front()};
    std::vector<int> blocks(model.scene.frames.size(), 0);
    for (size_t i = 1; i < component.size(); ++i) {
      const int m = component[i];
      MergeOptions options;
      options.first_from_second = world_from_[m];
      try {
        (void)MergeModels(sub_maps_[m], options, &model);
      } catch (const Error& error) {
        joined_.conflicts[m] = error.what();
        std::vector<int> block(sub_maps_[m].scene.frames.size(), 0);
        Add(std::move(sub_maps_[m]), {m}, std::move(block));
        continue;
      }
      sub_maps_[m] = SceneModel();
      blocks.resize(model.scene.frames.size(), static_cast<int>(merged.size()));
      merged.push_back(m);
    }
    joined_.num_loop_points += MergePointsOfMatches(pairs_, &model);
    std::sort(merged.begin(), merged.end());
    Add(std::move(model), std::move(merged), std::move(blocks));
  }

  void Add(SceneModel model, std::vector<int> sub_maps,
           std::vector<int> frame_blocks) {
    joined_.models.push_back(std::move(model));
    joined_.sub_maps.push_back(std::move(sub_maps));
    joined_.frame_blocks.push_back(std::move(frame_blocks));
  }

  void SortModels() {
    std::vector<size_t> order(joined_.models.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
      return NumFrames(joined_.models[a]) > NumFrames(joined_.models[b]);
    });
    JoinedMaps sorted;
    for (const size_t i : order) {
      sorted.models.push_back(std::move(joined_.models[i]));
      sorted.sub_maps.push_back(std::move(joined_.sub_maps[i]));
      sorted.frame_blocks.push_back(std::move(joined_.frame_blocks[i]));
    }
    joined_.models = std::move(sorted.models);
    joined_.sub_maps = std::move(sorted.sub_maps);
    joined_.frame_blocks = std::move(sorted.frame_blocks);
  }

  std::vector<SceneModel> sub_maps_;
  const std::vector<CrossPair>& pairs_;
  const JoinOptions& options_;
  const Context& context_;
  std::vector<Sim3> world_from_;
  JoinedMaps joined_;
};

}  // namespace

JoinedMaps JoinSubMaps(std::vector<SceneModel> sub_maps,
                       const std::vector<CrossPair>& pairs,
                       const JoinOptions& options, const Context& context) {
  return SubMapJoiner(std::move(sub_maps), pairs, options, context).Run();
}

}  // namespace mgsfm
