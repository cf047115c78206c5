// SPDX-License-Identifier: BSD-3-Clause
#include "pipeline/frame_depths.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "math/spanning_tree.h"
#include "math/statistics.h"
#include "mgsfm/geometry/camera_models.h"
#include "translation/baseline_directions.h"
#include "translation/position_problem.h"
#include "translation/scale_averaging.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// The pairs within frames, by their two sensors.
std::vector<std::vector<int>> PairsOfEqualSensors(const Scene& scene,
                                                  const FramePairIndex& index,
                                                  const ViewGraph& view_graph) {
  std::map<std::pair<int, int>, std::vector<int>> pairs_of_sensors;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    if (index.Of(i).IsBetweenFrames()) continue;
    const ImagePair& pair = view_graph.pairs[i];
    pairs_of_sensors[std::minmax(scene.images[pair.image_idx1].sensor_idx,
                                 scene.images[pair.image_idx2].sensor_idx)]
        .push_back(static_cast<int>(i));
  }
  std::vector<std::vector<int>> sets;
  for (auto& [sensors, pair_idxs] : pairs_of_sensors) {
    sets.push_back(std::move(pair_idxs));
  }
  return sets;
}

// Offsets of the centres of two sensors, in the axes of the rig, by the pairs
// of their images within frames.
struct SensorOffset {
  std::vector<Vector3d> samples;
  size_t num_matches = 0;
};
using SensorOffsets = std::map<std::pair<int, int>, SensorOffset>;

Vector3d MedianVector(const std::vector<Vector3d>& samples) {
  Vector3d median;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const auto& sample : samples) values.push_back(sample[axis]);
    median[axis] = Median(std::move(values));
  }
  return median;
}

// Centres of sensors in the axes of their rig, along a spanning tree of the
// pairs of sensors with the most matches. Few matches determine no direction.
// The origin of each rig is one sensor of its strongest pair.
std::vector<std::optional<Vector3d>> PlaceSensors(
    const Scene& scene, const SensorOffsets& offsets) {
  std::vector<GraphEdge> edges;
  std::vector<const SensorOffset*> of_edge;
  for (const auto& [sensors, offset] : offsets) {
    edges.push_back({sensors.first, sensors.second,
                     static_cast<double>(offset.num_matches)});
    of_edge.push_back(&offset);
  }
  const auto num_sensors = static_cast<int>(scene.sensors.size());
  std::vector<std::optional<Vector3d>> centers(num_sensors);
  const auto forest = MaximumSpanningForest(num_sensors, edges);
  for (const ForestStep& step : WalkForest(num_sensors, edges, forest)) {
    if (!step.from) {
      centers[step.node] = Vector3d::Zero();
      continue;
    }
    const GraphEdge& edge = edges[step.from->edge];
    const Vector3d offset = MedianVector(of_edge[step.from->edge]->samples);
    centers[step.node] = *centers[step.from->parent] +
                         (edge.node2 == step.node ? offset : Vector3d(-offset));
  }
  // A sensor without pairs is the root of its own tree.
  Mask has_pairs(scene.sensors.size(), false);
  for (const GraphEdge& edge : edges) {
    has_pairs[edge.node1] = true;
    has_pairs[edge.node2] = true;
  }
  for (int s = 0; s < num_sensors; ++s) {
    if (!has_pairs[s]) centers[s].reset();
  }
  return centers;
}

// The offsets that the pairs within frames measure.
SensorOffsets MeasureOffsets(const Scene& scene, const ViewGraph& view_graph,
                             const RotationEstimate& rotations,
                             const std::vector<BaselineDirection>& measured,
                             const PairScales& scales) {
  SensorOffsets offsets;
  for (size_t i = 0; i < measured.size(); ++i) {
    if (!scales.pairs[i] || scales.pairs[i]->group != 0) continue;
    const Image& image1 = scene.images[measured[i].image_idx1];
    const Image& image2 = scene.images[measured[i].image_idx2];
    const auto& rig_from_world = rotations.rig_from_world[image1.frame_idx];
    if (!rig_from_world) continue;
    const Vector3d offset =
        *rig_from_world * measured[i].direction * scales.pairs[i]->scale;
    const bool is_ordered = image1.sensor_idx < image2.sensor_idx;
    SensorOffset& of_sensors =
        offsets[std::minmax(image1.sensor_idx, image2.sensor_idx)];
    of_sensors.samples.push_back(is_ordered ? offset : Vector3d(-offset));
    of_sensors.num_matches += view_graph.pairs[i].matches.size();
  }
  return offsets;
}

double PixelsPerRadianOf(const Scene& scene, int image_idx) {
  const Camera& camera = scene.cameras[scene.images[image_idx].camera_idx];
  return PixelsPerRadian(camera.model, camera.params.data());
}

// Intersects the matching rays of two images of one frame. A distance is
// inversely proportional to the sine of the angle between the rays.
void AddDepths(const Scene& scene, const Bearings& bearings,
               const ImagePair& pair, double min_parallax_deg, double noise_px,
               FrameDepths* depths) {
  const int images[2] = {pair.image_idx1, pair.image_idx2};
  const auto& cam1_from_rig =
      depths->cam_from_rig[scene.images[images[0]].sensor_idx];
  const auto& cam2_from_rig =
      depths->cam_from_rig[scene.images[images[1]].sensor_idx];
  if (!cam1_from_rig || !cam2_from_rig) return;
  const Rigid3 cam2_from_cam1 = *cam2_from_rig * cam1_from_rig->Inverse();
  const Vector3d& t = cam2_from_cam1.translation;
  const double min_sine = std::sin(DegToRad(min_parallax_deg));
  const double noise_rad =
      std::hypot(noise_px / PixelsPerRadianOf(scene, images[0]),
                 noise_px / PixelsPerRadianOf(scene, images[1]));
  for (const int image : images) {
    depths->distances[image].resize(scene.images[image].keypoints_px.size());
    depths->relative_sigmas[image].resize(
        scene.images[image].keypoints_px.size());
  }
  for (const Match& match : pair.matches) {
    const int keypoints[2] = {static_cast<int>(match.keypoint_idx1),
                              static_cast<int>(match.keypoint_idx2)};
    const Vector3d turned =
        cam2_from_cam1.rotation * bearings.Ray(images[0], keypoints[0]);
    const Vector3d& ray2 = bearings.Ray(images[1], keypoints[1]);
    const Vector3d normal = turned.cross(ray2);
    const double sine = normal.norm();
    // In front of both cameras: t, from camera 1, between the rays.
    if (sine < min_sine || normal.dot(ray2.cross(t)) <= 0.0 ||
        normal.dot(turned.cross(t)) <= 0.0) {
      continue;
    }
    const double distances[2] = {t.cross(ray2).norm() / sine,
                                 t.cross(turned).norm() / sine};
    for (const int i : {0, 1}) {
      // The most precise pair counts.
      auto& distance = depths->distances[images[i]][keypoints[i]];
      double& sigma = depths->relative_sigmas[images[i]][keypoints[i]];
      if (distance && sigma <= noise_rad / sine) continue;
      distance = distances[i];
      sigma = noise_rad / sine;
    }
  }
}

}  // namespace

FrameDepths MeasureFrameDepths(const Scene& scene, const Bearings& bearings,
                               const FramePairIndex& index,
                               const ViewGraph& view_graph,
                               const RotationEstimate& rotations,
                               double min_parallax_deg, double noise_px,
                               const Context& context) {
  Mask is_within(view_graph.pairs.size(), false);
  for (size_t i = 0; i < is_within.size(); ++i) {
    is_within[i] = !index.Of(i).IsBetweenFrames() &&
                   view_graph.pairs[i].relative_pose.has_value();
  }
  const std::vector<BaselineDirection> measured =
      EstimateBaselineDirections(scene, bearings, view_graph, is_within,
                                 MakePositionProblem(scene, rotations),
                                 min_parallax_deg, context, PairRotation::kOwn);
  const PairScales scales =
      AverageScales(measured, static_cast<int>(scene.images.size()), context,
                    {PairsOfEqualSensors(scene, index, view_graph)});
  FrameDepths depths;
  depths.distances.resize(scene.images.size());
  depths.relative_sigmas.resize(scene.images.size());
  const auto centers = PlaceSensors(
      scene, MeasureOffsets(scene, view_graph, rotations, measured, scales));
  depths.cam_from_rig.resize(scene.sensors.size());
  for (size_t s = 0; s < centers.size(); ++s) {
    if (!centers[s] || !rotations.sensor_from_rig[s]) continue;
    depths.cam_from_rig[s] = Rigid3::FromRotationAndCenter(
        *rotations.sensor_from_rig[s], *centers[s]);
  }
  for (size_t i = 0; i < is_within.size(); ++i) {
    if (is_within[i]) {
      AddDepths(scene, bearings, view_graph.pairs[i], min_parallax_deg,
                noise_px, &depths);
    }
  }
  return depths;
}

}  // namespace mgsfm
