// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/sub_map_graph.h"

#include <Eigen/Geometry>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "base/random.h"
#include "base/ranges.h"
#include "geometry/decompositions.h"
#include "geometry/ransac.h"
#include "geometry/so3.h"
#include "math/spanning_tree.h"
#include "math/statistics.h"
#include "scene/point_lookup.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

// Three points determine a similarity.
constexpr int kMinNumCommonImages = 3;
// Largest distance of 3D points from both sides, relative to their distance
// from the camera. Points of two views with the minimum angle are accurate to
// some percent.
constexpr double kMaxRelativePointError = 0.05;

// Maps names to images.
using ImageOfName = std::map<std::string, int>;

ImageOfName IndexImages(const SceneModel& model) {
  ImageOfName images;
  for (size_t i = 0; i < model.scene.images.size(); ++i) {
    const auto image_idx = static_cast<int>(i);
    if (model.reconstruction.IsRegistered(model.scene, image_idx)) {
      images.emplace(model.scene.images[i].name, image_idx);
    }
  }
  return images;
}

// The same place in two sub-maps, and the camera of the first that sees it.
struct PlacePair {
  Vector3d in1, in2;
  Vector3d camera1;
};

// The sum of the distances of sensors from the reference of their rig. Rigs of
// sub-maps that share a calibration have the same.
double RigSize(const SceneModel& model) {
  double size = 0.0;
  for (const auto& pose : model.reconstruction.sensor_from_rig) {
    if (pose) size += pose->translation.norm();
  }
  return size;
}

// The scale from rigs; nullopt if one has none, or not all sensors.
std::optional<double> ScaleOfRigs(const SceneModel& first,
                                  const SceneModel& second) {
  if (first.scene.sensors.size() != second.scene.sensors.size()) {
    return std::nullopt;
  }
  const double size1 = RigSize(first);
  const double size2 = RigSize(second);
  if (size1 <= 0.0 || size2 <= 0.0) return std::nullopt;
  return size1 / size2;
}

Quaterniond MeanRotation(const std::vector<Quaterniond>& rotations) {
  Eigen::Matrix4d moments = Eigen::Matrix4d::Zero();
  for (const Quaterniond& q : rotations) {
    moments += q.coeffs() * q.coeffs().transpose();
  }
  Quaterniond mean;
  mean.coeffs() = SymmetricEigen<Eigen::Matrix4d>(moments).V.col(3);
  return mean.normalized();
}

// The standard deviation of positions about their mean.
double SigmaOf(const std::vector<Vector3d>& places, const Vector3d& mean) {
  double sum = 0.0;
  for (const Vector3d& x : places) sum += (x - mean).squaredNorm();
  return std::sqrt(sum / static_cast<double>(places.size()));
}

Vector3d MeanOf(const std::vector<Vector3d>& places) {
  Vector3d mean = Vector3d::Zero();
  for (const Vector3d& x : places) mean += x;
  return mean / static_cast<double>(places.size());
}

void SetAnchors(const std::vector<Vector3d>& places_in_second,
                SubMapEdge* edge) {
  const Vector3d mean = MeanOf(places_in_second);
  const double sigma = SigmaOf(places_in_second, mean);
  const Vector3d corners[] = {
      {1.0, 1.0, 1.0}, {1.0, -1.0, -1.0}, {-1.0, 1.0, -1.0}, {-1.0, -1.0, 1.0}};
  for (size_t k = 0; k < 4; ++k) {
    edge->anchors2[k] = mean + sigma * corners[k];
    edge->anchors1[k] = edge->first_from_second * edge->anchors2[k];
  }
}

double ScaleOfPlaces(const std::vector<Vector3d>& in1,
                     const std::vector<Vector3d>& in2) {
  const double sigma2 = SigmaOf(in2, MeanOf(in2));
  const double sigma1 = SigmaOf(in1, MeanOf(in1));
  return sigma1 > 0.0 && sigma2 > 0.0 ? sigma1 / sigma2 : 1.0;
}

std::optional<SubMapEdge> EdgeOfCommonImages(const SceneModel& first,
                                             const SceneModel& second,
                                             const ImageOfName& images1,
                                             const ImageOfName& images2) {
  std::vector<Quaterniond> rotations;
  std::vector<Vector3d> centers1, centers2;
  for (const auto& [name, image2] : images2) {
    const auto image1 = images1.find(name);
    if (image1 == images1.end()) continue;
    const Rigid3 pose1 =
        *first.reconstruction.CamFromWorld(first.scene, image1->second);
    const Rigid3 pose2 =
        *second.reconstruction.CamFromWorld(second.scene, image2);
    rotations.push_back(pose1.rotation.conjugate() * pose2.rotation);
    centers1.push_back(pose1.Center());
    centers2.push_back(pose2.Center());
  }
  if (static_cast<int>(rotations.size()) < kMinNumCommonImages) {
    return std::nullopt;
  }
  SubMapEdge edge;
  edge.num_common_images = static_cast<int>(rotations.size());
  Sim3& transform = edge.first_from_second;
  transform.scale =
      ScaleOfRigs(first, second).value_or(ScaleOfPlaces(centers1, centers2));
  transform.rotation = MeanRotation(rotations);
  std::vector<Vector3d> translations;
  for (size_t i = 0; i < centers1.size(); ++i) {
    translations.emplace_back(
        centers1[i] - transform.scale * (transform.rotation * centers2[i]));
  }
  transform.translation = MedianOfCoordinates(translations);
  SetAnchors(centers2, &edge);
  return edge;
}

// ------------------------------------------------------- edges of matches

// The similarity of some pairs of places, with a known scale or without.
Sim3 FitPlaces(const std::vector<PlacePair>& pairs,
               const std::vector<size_t>& chosen,
               const std::optional<double>& scale) {
  Eigen::Matrix3Xd from(3, chosen.size()), to(3, chosen.size());
  for (size_t i = 0; i < chosen.size(); ++i) {
    from.col(static_cast<Eigen::Index>(i)) =
        scale.value_or(1.0) * pairs[chosen[i]].in2;
    to.col(static_cast<Eigen::Index>(i)) = pairs[chosen[i]].in1;
  }
  const Eigen::Matrix4d fit = Eigen::umeyama(from, to, !scale);
  const Eigen::Matrix3d linear = fit.topLeftCorner<3, 3>();
  Sim3 transform;
  const double fitted_scale = std::cbrt(linear.determinant());
  transform.scale = scale.value_or(1.0) * fitted_scale;
  transform.rotation =
      Quaterniond(Eigen::Matrix3d(linear / fitted_scale)).normalized();
  transform.translation = fit.topRightCorner<3, 1>();
  return transform;
}

std::vector<size_t> FindInliers(const std::vector<PlacePair>& pairs,
                                const Sim3& transform) {
  std::vector<size_t> inliers;
  for (size_t i = 0; i < pairs.size(); ++i) {
    const double distance = (pairs[i].in1 - pairs[i].camera1).norm();
    if ((transform * pairs[i].in2 - pairs[i].in1).norm() <=
        kMaxRelativePointError * distance) {
      inliers.push_back(i);
    }
  }
  return inliers;
}

std::vector<size_t> FindConsensus(const std::vector<PlacePair>& pairs,
                                  const std::optional<double>& scale,
                                  Sim3* transform) {
  const RansacOptions options;
  Random random(0);
  std::vector<size_t> best;
  int num_trials = options.max_num_trials;
  for (int trial = 0; trial < num_trials; ++trial) {
    const auto sample = DrawSample<3>(pairs.size(), &random);
    const Sim3 fit = FitPlaces(pairs, {sample.begin(), sample.end()}, scale);
    if (!std::isfinite(fit.scale) || fit.scale <= 0.0) continue;
    std::vector<size_t> inliers = FindInliers(pairs, fit);
    if (inliers.size() <= best.size()) continue;
    best = std::move(inliers);
    num_trials = std::min(
        num_trials, RequiredNumTrials(options,
                                      static_cast<double>(best.size()) /
                                          static_cast<double>(pairs.size()),
                                      3));
  }
  for (int i = 0; i < 3 && best.size() >= 3; ++i) {
    *transform = FitPlaces(pairs, best, scale);
    best = FindInliers(pairs, *transform);
  }
  return best;
}

std::optional<SubMapEdge> EdgeOfMatches(const SceneModel& first,
                                        const SceneModel& second,
                                        const std::vector<PlacePair>& pairs,
                                        const JoinOptions& options) {
  if (static_cast<int>(pairs.size()) < options.min_num_loop_points) {
    return std::nullopt;
  }
  SubMapEdge edge;
  const std::vector<size_t> inliers =
      FindConsensus(pairs, ScaleOfRigs(first, second), &edge.first_from_second);
  edge.num_points = static_cast<int>(inliers.size());
  if (edge.num_points < options.min_num_loop_points) return std::nullopt;
  SetAnchors(Transformed(inliers, [&](size_t i) { return pairs[i].in2; }),
             &edge);
  return edge;
}

// Per two sub-maps: the places that matches connect, each pair of points once.
using PlacesOfPair = std::map<std::pair<int, int>, std::vector<PlacePair>>;

PlacesOfPair CollectPlaces(const std::vector<SceneModel>& sub_maps,
                           const std::vector<ImageOfName>& images,
                           const std::vector<CrossPair>& pairs) {
  std::vector<PointLookup> lookups;
  for (const SceneModel& model : sub_maps) {
    lookups.emplace_back(model.scene, model.reconstruction);
  }
  PlacesOfPair places;
  std::set<std::array<int, 4>> met;  // sub-maps and points
  const auto add = [&](int a, const Observation& in_a, int b,
                       const Observation& in_b) {
    const auto point1 = lookups[a].Find(in_a.image_idx, in_a.keypoint_idx);
    const auto point2 = lookups[b].Find(in_b.image_idx, in_b.keypoint_idx);
    if (!point1 || !point2 || !met.insert({a, *point1, b, *point2}).second) {
      return;
    }
    const SceneModel& first = sub_maps[a];
    places[{a, b}].push_back(
        {first.reconstruction.points[*point1].point_in_world,
         sub_maps[b].reconstruction.points[*point2].point_in_world,
         first.reconstruction.CamFromWorld(first.scene, in_a.image_idx)
             ->Center()});
  };
  const auto num_sub_maps = static_cast<int>(sub_maps.size());
  for (const CrossPair& pair : pairs) {
    for (int a = 0; a < num_sub_maps; ++a) {
      for (int b = 0; b < num_sub_maps; ++b) {
        const auto image1 = images[a].find(pair.name1);
        const auto image2 = images[b].find(pair.name2);
        if (a == b || image1 == images[a].end() || image2 == images[b].end()) {
          continue;
        }
        for (const Match& match : pair.matches) {
          const Observation in_a{image1->second,
                                 static_cast<int>(match.keypoint_idx1)};
          const Observation in_b{image2->second,
                                 static_cast<int>(match.keypoint_idx2)};
          a < b ? add(a, in_a, b, in_b) : add(b, in_b, a, in_a);
        }
      }
    }
  }
  return places;
}

// ------------------------------------------------------------------ trust

// The length of the path of the frames, in their order.
double PathLength(const SceneModel& model) {
  double length = 0.0;
  std::optional<Vector3d> last;
  for (const auto& pose : model.reconstruction.rig_from_world) {
    if (!pose) continue;
    if (last) length += (pose->Center() - *last).norm();
    last = pose->Center();
  }
  return length;
}

std::vector<GraphEdge> ToGraph(const std::vector<SubMapEdge>& edges) {
  // One common image, which is the same by name, outweighs all points.
  constexpr double kWeightOfImage = 1e6;
  return Transformed(edges, [](const SubMapEdge& edge) {
    return GraphEdge{edge.sub_map1, edge.sub_map2,
                     kWeightOfImage * edge.num_common_images + edge.num_points};
  });
}

// Places each sub-map in the world of the root of its tree.
std::vector<Sim3> PlaceByForest(size_t num_sub_maps,
                                const std::vector<SubMapEdge>& edges,
                                const std::vector<int>& forest) {
  std::vector<Sim3> world_from(num_sub_maps);
  for (const ForestStep& step :
       WalkForest(static_cast<int>(num_sub_maps), ToGraph(edges), forest)) {
    if (!step.from) continue;
    const SubMapEdge& edge = edges[step.from->edge];
    const Sim3 parent_from_node = edge.sub_map2 == step.node
                                      ? edge.first_from_second
                                      : edge.first_from_second.Inverse();
    world_from[step.node] =
        Compose(world_from[step.from->parent], parent_from_node);
  }
  return world_from;
}

// ---------------------------------------------------------------- average

constexpr int kNumUnknowns = 7;  // rotation, translation, log of scale
using Jacobian = Eigen::Matrix<double, 3, kNumUnknowns>;

// The derivative of T x by a small similarity after T.
Jacobian JacobianAt(const Vector3d& in_world) {
  Jacobian J;
  J.leftCols<3>() = -CrossMatrix(in_world);
  J.middleCols<3>(3) = Eigen::Matrix3d::Identity();
  J.col(6) = in_world;
  return J;
}

// The normal equations of one Gauss-Newton step.
class SimilarityStep {
 public:
  explicit SimilarityStep(const std::vector<std::optional<int>>& unknown_of)
      : unknown_of_(unknown_of) {
    for (const auto& unknown : unknown_of) num_ += unknown.has_value() ? 1 : 0;
    rhs_.setZero(kNumUnknowns * num_);
  }

  // The residual T_a x_a - T_b x_b.
  void Add(int a, int b, const Vector3d& a_in_world, const Vector3d& b_in_world,
           double weight) {
    const Vector3d residual = a_in_world - b_in_world;
    const Jacobian Ja = JacobianAt(a_in_world);
    const Jacobian Jb = -JacobianAt(b_in_world);
    for (const auto& [m, Jm] : {std::make_pair(a, Ja), {b, Jb}}) {
      if (!unknown_of_[m]) continue;
      rhs_.segment<kNumUnknowns>(kNumUnknowns * *unknown_of_[m]) -=
          weight * Jm.transpose() * residual;
      for (const auto& [n, Jn] : {std::make_pair(a, Ja), {b, Jb}}) {
        if (unknown_of_[n]) AddBlock(m, n, weight * Jm.transpose() * Jn);
      }
    }
  }

  Eigen::VectorXd Solve() const {
    Eigen::SparseMatrix<double> matrix(rhs_.size(), rhs_.size());
    matrix.setFromTriplets(triplets_.begin(), triplets_.end());
    // A single sub-map on a straight line leaves a rotation free.
    for (Eigen::Index i = 0; i < rhs_.size(); ++i) {
      matrix.coeffRef(i, i) += 1e-9 * matrix.coeff(i, i) + 1e-12;
    }
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(matrix);
    return solver.solve(rhs_);
  }

 private:
  void AddBlock(int m, int n,
                const Eigen::Matrix<double, kNumUnknowns, kNumUnknowns>& H) {
    for (int i = 0; i < kNumUnknowns; ++i) {
      for (int k = 0; k < kNumUnknowns; ++k) {
        triplets_.emplace_back(kNumUnknowns * *unknown_of_[m] + i,
                               kNumUnknowns * *unknown_of_[n] + k, H(i, k));
      }
    }
  }

  const std::vector<std::optional<int>>& unknown_of_;
  int num_ = 0;
  Eigen::VectorXd rhs_;
  std::vector<Eigen::Triplet<double>> triplets_;
};

// One step of all similarities. Returns the longest move of an anchor.
double StepSimilarities(const std::vector<SubMapEdge>& edges,
                        const std::vector<std::optional<int>>& unknown_of,
                        double loss_scale, std::vector<Sim3>* world_from) {
  SimilarityStep step(unknown_of);
  for (const SubMapEdge& edge : edges) {
    if (!edge.is_used) continue;
    for (size_t k = 0; k < edge.anchors1.size(); ++k) {
      const Vector3d a = (*world_from)[edge.sub_map1] * edge.anchors1[k];
      const Vector3d b = (*world_from)[edge.sub_map2] * edge.anchors2[k];
      const double ratio = (a - b).norm() / loss_scale;
      step.Add(edge.sub_map1, edge.sub_map2, a, b, 1.0 / (1.0 + ratio * ratio));
    }
  }
  const Eigen::VectorXd delta = step.Solve();
  std::vector<Sim3> moved = *world_from;
  for (size_t m = 0; m < unknown_of.size(); ++m) {
    if (!unknown_of[m]) continue;
    const auto d = delta.segment<kNumUnknowns>(kNumUnknowns * *unknown_of[m]);
    const Sim3 change{std::exp(d[6]), ExpSO3(d.head<3>()), d.segment<3>(3)};
    moved[m] = Compose(change, moved[m]);
  }
  double longest = 0.0;
  for (const SubMapEdge& edge : edges) {
    for (const Vector3d& x : edge.anchors1) {
      longest = std::max(
          longest,
          ((*world_from)[edge.sub_map1] * x - moved[edge.sub_map1] * x).norm());
    }
  }
  *world_from = std::move(moved);
  return longest;
}

}  // namespace

Sim3 Compose(const Sim3& c_from_b, const Sim3& b_from_a) {
  return {c_from_b.scale * b_from_a.scale,
          (c_from_b.rotation * b_from_a.rotation).normalized(),
          c_from_b * b_from_a.translation};
}

std::vector<SubMapEdge> MeasureEdges(const std::vector<SceneModel>& sub_maps,
                                     const std::vector<CrossPair>& pairs,
                                     const JoinOptions& options) {
  std::vector<ImageOfName> images;
  for (const SceneModel& model : sub_maps) images.push_back(IndexImages(model));
  const PlacesOfPair places = CollectPlaces(sub_maps, images, pairs);
  std::vector<SubMapEdge> edges;
  for (size_t a = 0; a < sub_maps.size(); ++a) {
    for (size_t b = a + 1; b < sub_maps.size(); ++b) {
      const auto sub_map1 = static_cast<int>(a);
      const auto sub_map2 = static_cast<int>(b);
      std::optional<SubMapEdge> edge =
          EdgeOfCommonImages(sub_maps[a], sub_maps[b], images[a], images[b]);
      const auto found = places.find({sub_map1, sub_map2});
      if (!edge && found != places.end()) {
        edge = EdgeOfMatches(sub_maps[a], sub_maps[b], found->second, options);
      }
      if (!edge) continue;
      edge->sub_map1 = sub_map1;
      edge->sub_map2 = sub_map2;
      edges.push_back(*edge);
    }
  }
  return edges;
}

std::vector<int> RejectWrongLoops(const std::vector<SceneModel>& sub_maps,
                                  const JoinOptions& options,
                                  std::vector<SubMapEdge>* edges) {
  const auto num_sub_maps = static_cast<int>(sub_maps.size());
  const std::vector<GraphEdge> graph = ToGraph(*edges);
  std::vector<int> forest = MaximumSpanningForest(num_sub_maps, graph);
  const std::vector<Sim3> world_from =
      PlaceByForest(sub_maps.size(), *edges, forest);
  std::vector<double> lengths;  // of edges: half of either sub-map
  for (const SubMapEdge& edge : *edges) {
    lengths.push_back(0.5 * (world_from[edge.sub_map1].scale *
                                 PathLength(sub_maps[edge.sub_map1]) +
                             world_from[edge.sub_map2].scale *
                                 PathLength(sub_maps[edge.sub_map2])));
  }
  const TreePathLengths paths(num_sub_maps, graph, lengths);
  for (size_t i = 0; i < edges->size(); ++i) {
    SubMapEdge& edge = (*edges)[i];
    if (std::binary_search(forest.begin(), forest.end(), static_cast<int>(i))) {
      continue;
    }
    const Sim3& first = world_from[edge.sub_map1];
    const Sim3& second = world_from[edge.sub_map2];
    const Sim3 by_edge = Compose(first, edge.first_from_second);
    const Vector3d place = 0.25 * (edge.anchors2[0] + edge.anchors2[1] +
                                   edge.anchors2[2] + edge.anchors2[3]);
    edge.rotation_error_deg =
        RadToDeg(AngleBetween(by_edge.rotation, second.rotation));
    edge.drift = (by_edge * place - second * place).norm() /
                 (paths.Between(edge.sub_map1, edge.sub_map2) + lengths[i]);
    edge.is_used = *edge.rotation_error_deg <= options.max_loop_rotation_deg &&
                   *edge.drift <= options.max_loop_drift;
  }
  return forest;
}

std::vector<Sim3> AverageSimilarities(const std::vector<SceneModel>& sub_maps,
                                      const std::vector<SubMapEdge>& edges,
                                      const std::vector<int>& forest) {
  // Rings of 3 to 200 sub-maps with simulated drift, up to half of their
  // extent, need 4 to 20 steps.
  constexpr int kMaxNumSteps = 50;
  std::vector<Sim3> world_from = PlaceByForest(sub_maps.size(), edges, forest);
  const std::vector<ForestStep> steps =
      WalkForest(static_cast<int>(sub_maps.size()), ToGraph(edges), forest);
  std::vector<std::optional<int>> unknown_of(sub_maps.size());
  int num_unknown = 0;
  for (const ForestStep& step : steps) {
    if (step.from) unknown_of[step.node] = num_unknown++;
  }
  std::vector<double> distances;
  double extent = 0.0;
  for (const SubMapEdge& edge : edges) {
    if (!edge.is_used) continue;
    const Vector3d a = world_from[edge.sub_map1] * edge.anchors1[0];
    const Vector3d b = world_from[edge.sub_map2] * edge.anchors2[0];
    distances.push_back((a - b).norm());
    extent = std::max(extent, a.norm());
  }
  // Without loops, the forest is the average.
  if (num_unknown == 0 || distances.size() == forest.size()) return world_from;
  // Drift spreads over all edges of a cycle, so that all are inliers.
  const double loss_scale =
      *std::max_element(distances.begin(), distances.end()) + 1e-9 * extent;
  for (int i = 0; i < kMaxNumSteps; ++i) {
    if (StepSimilarities(edges, unknown_of, loss_scale, &world_from) <=
        1e-9 * extent) {
      break;
    }
  }
  return world_from;
}

}  // namespace mgsfm
