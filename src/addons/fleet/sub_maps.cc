// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/sub_maps.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <map>
#include <set>
#include <utility>

#include "base/ranges.h"
#include "fleet/sub_map_graph.h"
#include "geometry/so3.h"
#include "math/spanning_tree.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "scene/item_lists.h"
#include "scene/point_lookup.h"

namespace mgsfm {
namespace {

// Radians. Sub-maps that are 0.5 m apart after averaging shift a point at a
// distance of 10 m by this angle.
constexpr double kMaxAngleBetweenEqualPoints = 0.05;
// The largest ratio of the distances of two equal points from one camera. The
// depth of a point that two views see at a small angle has a large error.
constexpr double kMaxDistanceRatio = 2.0;

// The sub-maps of each connected component in the order in which they are
// merged: each is next to an earlier one.
std::vector<std::vector<int>> OrderOfMerging(
    size_t num_sub_maps, const std::vector<SubMapEdge>& edges,
    const std::vector<int>& forest) {
  const std::vector<GraphEdge> graph =
      Transformed(edges, [](const SubMapEdge& edge) {
        return GraphEdge{edge.sub_map1, edge.sub_map2};
      });
  std::vector<std::vector<int>> components;
  for (const ForestStep& step :
       WalkForest(static_cast<int>(num_sub_maps), graph, forest)) {
    if (!step.from) components.emplace_back();
    components.back().push_back(step.node);
  }
  return components;
}

// Merges a sub-map of the component first, and gives the component its world.
void StartAt(int first, std::vector<int>* component,
             std::vector<Sim3>* world_from) {
  std::vector<int>& order = *component;
  std::stable_partition(order.begin(), order.end(),
                        [&](int m) { return m == first; });
  const Sim3 first_from_world = (*world_from)[first].Inverse();
  for (const int m : order) {
    Sim3& from = (*world_from)[m];
    from = m == first ? Sim3() : Compose(first_from_world, from);
  }
}

// The points of both keypoints of a match; nullopt for keypoints without a
// point.
struct MatchedPoints {
  Observation observation1, observation2;
  std::optional<int> point1, point2;
};

template <class Visitor>
void VisitMatches(const SceneModel& model, const std::vector<CrossPair>& pairs,
                  Visitor&& visitor) {
  const auto image_of_name = IndexByName(model.scene.images);
  const PointLookup lookup(model.scene, model.reconstruction);
  for (const CrossPair& pair : pairs) {
    const auto image1 = image_of_name.find(pair.name1);
    const auto image2 = image_of_name.find(pair.name2);
    if (image1 == image_of_name.end() || image2 == image_of_name.end()) {
      continue;
    }
    for (const Match& match : pair.matches) {
      const auto idx1 = static_cast<int>(match.keypoint_idx1);
      const auto idx2 = static_cast<int>(match.keypoint_idx2);
      visitor(MatchedPoints{{image1->second, idx1},
                            {image2->second, idx2},
                            lookup.Find(image1->second, idx1),
                            lookup.Find(image2->second, idx2)});
    }
  }
}

// Pairs of points that matches connect, once each.
std::set<std::pair<int, int>> FindEqualPoints(
    const SceneModel& model, const std::vector<CrossPair>& pairs) {
  std::set<std::pair<int, int>> equal;
  VisitMatches(model, pairs, [&](const MatchedPoints& match) {
    const auto& a = match.point1;
    const auto& b = match.point2;
    if (a && b && *a != *b) {
      equal.emplace(std::min(*a, *b), std::max(*a, *b));
    }
  });
  return equal;
}

// Whether both are in about the same direction from a camera of each. Their
// distances may differ: those of distant points are inaccurate.
bool AreClose(const SceneModel& model, const Point3D& a, const Point3D& b) {
  for (const Point3D* point : {&a, &b}) {
    const Eigen::Vector3d camera =
        model.reconstruction
            .CamFromWorld(model.scene, point->track.front().image_idx)
            ->Center();
    const Eigen::Vector3d ray_a = a.point_in_world - camera;
    const Eigen::Vector3d ray_b = b.point_in_world - camera;
    const double ratio = ray_a.norm() / ray_b.norm();
    if (AngleBetween(ray_a, ray_b) > kMaxAngleBetweenEqualPoints ||
        !(std::max(ratio, 1.0 / ratio) <= kMaxDistanceRatio)) {
      return false;
    }
  }
  return true;
}

bool ShareAnImage(const Point3D& a, const Point3D& b) {
  std::set<int> images;
  for (const Observation& o : a.track) images.insert(o.image_idx);
  return AnyOf(b.track, [&](const Observation& o) {
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
  std::vector<int> owner = Indices(points.size());  // of the track of a set
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
  EraseIf(&points, [](const Point3D& point) { return point.track.empty(); });
  return num_merged;
}

// Adds keypoints without a point to the point that most matches connect them
// with, unless the point has another keypoint of that image.
void ExtendTracks(const std::vector<CrossPair>& pairs, SceneModel* model) {
  std::map<Observation, std::map<int, int>> num_matches;
  VisitMatches(*model, pairs, [&](const MatchedPoints& match) {
    if (match.point1.has_value() == match.point2.has_value()) return;
    if (match.point1) {
      ++num_matches[match.observation2][*match.point1];
    } else {
      ++num_matches[match.observation1][*match.point2];
    }
  });
  for (const auto& [observation, of_points] : num_matches) {
    const auto best = std::max_element(
        of_points.begin(), of_points.end(),
        [](const auto& a, const auto& b) { return a.second < b.second; });
    Point3D& point = model->reconstruction.points[best->first];
    const int image_idx = observation.image_idx;
    const bool has_image = AnyOf(point.track, [&](const Observation& o) {
      return o.image_idx == image_idx;
    });
    if (!has_image) point.track.push_back(observation);
  }
  for (Point3D& point : model->reconstruction.points) {
    std::sort(point.track.begin(), point.track.end());
  }
}

// The pairs between sub-maps with a used edge: matches of a rejected loop must
// not merge points.
std::vector<CrossPair> TrustedPairs(const std::vector<SceneModel>& sub_maps,
                                    const std::vector<SubMapEdge>& edges,
                                    const std::vector<CrossPair>& pairs) {
  std::map<std::string, std::vector<int>> sub_maps_of;
  for (size_t m = 0; m < sub_maps.size(); ++m) {
    for (const Image& image : sub_maps[m].scene.images) {
      sub_maps_of[image.name].push_back(static_cast<int>(m));
    }
  }
  std::set<std::pair<int, int>> connected;
  for (const SubMapEdge& edge : edges) {
    if (!edge.is_used) continue;
    connected.emplace(edge.sub_map1, edge.sub_map2);
    connected.emplace(edge.sub_map2, edge.sub_map1);
  }
  const auto are_connected = [&](const CrossPair& pair) {
    for (const int a : sub_maps_of[pair.name1]) {
      for (const int b : sub_maps_of[pair.name2]) {
        if (connected.count({a, b}) > 0) return true;
      }
    }
    return false;
  };
  std::vector<CrossPair> trusted;
  std::copy_if(pairs.begin(), pairs.end(), std::back_inserter(trusted),
               are_connected);
  return trusted;
}

void AddModel(SceneModel model, std::vector<int> sub_maps, JoinedMaps* joined) {
  auto& poses = model.reconstruction.rig_from_world;
  const auto of_old = std::exchange(poses, {});
  for (const int i : SortFrames(&model.scene)) poses.push_back(of_old[i]);
  joined->models.push_back(std::move(model));
  joined->sub_maps.push_back(std::move(sub_maps));
}

// Merges the sub-maps of a component, which are emptied.
void MergeComponent(const std::vector<int>& component,
                    const std::vector<Sim3>& world_from,
                    const std::vector<CrossPair>& pairs,
                    std::vector<SceneModel>* sub_maps, JoinedMaps* joined) {
  // Reserves memory, because a growing vector temporarily holds its items
  // twice.
  size_t num_points = 0;
  for (const int m : component) {
    num_points += (*sub_maps)[m].reconstruction.points.size();
  }
  SceneModel model = std::move((*sub_maps)[component.front()]);
  TransformWorld(world_from[component.front()], &model.reconstruction);
  model.reconstruction.points.reserve(num_points);
  std::vector<int> merged = {component.front()};
  for (size_t i = 1; i < component.size(); ++i) {
    const int m = component[i];
    MergeOptions options;
    options.first_from_second = world_from[m];
    try {
      (void)MergeModels((*sub_maps)[m], options, &model);
    } catch (const Error& error) {
      joined->conflicts[m] = error.what();
      AddModel(std::move((*sub_maps)[m]), {m}, joined);
      continue;
    }
    (*sub_maps)[m] = SceneModel();
    merged.push_back(m);
  }
  joined->num_loop_points += MergePointsOfMatches(pairs, &model);
  ExtendTracks(pairs, &model);
  RemoveLargeErrors(MergeOptions().max_reproj_error_px, &model);
  std::sort(merged.begin(), merged.end());
  AddModel(std::move(model), std::move(merged), joined);
}

void SortModels(JoinedMaps* joined) {
  std::vector<size_t> order = Indices<size_t>(joined->models.size());
  StableSortDescendingBy(&order, [&](size_t a) {
    return CountIf(joined->models[a].reconstruction.rig_from_world,
                   [](const auto& pose) { return pose.has_value(); });
  });
  auto models = std::exchange(joined->models, {});
  auto sub_maps = std::exchange(joined->sub_maps, {});
  for (const size_t i : order) {
    joined->models.push_back(std::move(models[i]));
    joined->sub_maps.push_back(std::move(sub_maps[i]));
  }
}

}  // namespace

JoinedMaps JoinSubMaps(std::vector<SceneModel> sub_maps,
                       const std::vector<CrossPair>& pairs,
                       const JoinOptions& options, const Context& context,
                       int num_existing) {
  JoinedMaps joined;
  joined.edges = MeasureEdges(sub_maps, pairs, options);
  const std::vector<int> forest =
      RejectWrongLoops(sub_maps, options, &joined.edges);
  const std::vector<CrossPair> trusted =
      TrustedPairs(sub_maps, joined.edges, pairs);
  std::vector<Sim3> world_from =
      AverageSimilarities(sub_maps, joined.edges, forest);
  joined.conflicts.resize(sub_maps.size());
  for (std::vector<int>& component :
       OrderOfMerging(sub_maps.size(), joined.edges, forest)) {
    context.CheckInterrupted();
    const int first = *std::min_element(component.begin(), component.end());
    if (first < num_existing) StartAt(first, &component, &world_from);
    MergeComponent(component, world_from, trusted, &sub_maps, &joined);
  }
  SortModels(&joined);
  return joined;
}

}  // namespace mgsfm
