// SPDX-License-Identifier: BSD-3-Clause
#include "oracle/oracle.h"

#include <algorithm>
#include <utility>

#include "geometry/so3.h"
#include "geometry/triangulation.h"
#include "math/union_find.h"
#include "mgsfm/base/timer.h"

namespace mgsfm {
namespace {

// An oracle starts at the truth, so stopping early makes it too good: it has
// hardly moved along weak directions such as the bends of a long drive.
constexpr double kOracleTolerance = 1e-8;
constexpr int kMaxNumOracleIterations = 1000;
// The bound of RefineReconstruction.
constexpr double kMinLossScalePx = 0.05;

RigErrors CompareSensor(const std::string& name, const Rigid3& estimate,
                        const Rigid3& truth, double scale) {
  RigErrors errors;
  errors.sensor = name;
  errors.rotation_deg =
      RadToDeg(AngleBetween(estimate.rotation, truth.rotation));
  errors.position_m = (scale * estimate.Center() - truth.Center()).norm();
  errors.true_distance_m = truth.translation.norm();
  return errors;
}

// The true poses of the registered frames and sensors of the model.
Reconstruction TruthOf(const Simulation& simulation,
                       const Reconstruction& model) {
  Reconstruction truth = simulation.ground_truth;
  truth.points.clear();
  for (size_t i = 0; i < truth.sensor_from_rig.size(); ++i) {
    if (!model.sensor_from_rig[i]) truth.sensor_from_rig[i].reset();
  }
  for (size_t i = 0; i < truth.rig_from_world.size(); ++i) {
    if (!model.rig_from_world[i]) truth.rig_from_world[i].reset();
  }
  return truth;
}

// Triangulates a track with the given poses; nullopt if its rays do not
// intersect.
std::optional<Eigen::Vector3d> Triangulate(
    const Bearings& bearings,
    const std::vector<std::optional<Rigid3>>& cam_from_world,
    const std::vector<Observation>& track) {
  std::vector<Eigen::Vector3d> centers, rays;
  for (const Observation& o : track) {
    if (!cam_from_world[o.image_idx] ||
        !bearings.HasRay(o.image_idx, o.keypoint_idx)) {
      continue;
    }
    const Rigid3& pose = *cam_from_world[o.image_idx];
    centers.push_back(pose.Center());
    rays.push_back(pose.rotation.conjugate() *
                   bearings.Ray(o.image_idx, o.keypoint_idx));
  }
  if (rays.size() < 2) return std::nullopt;
  const auto point = TriangulateL1(centers, rays);
  return point ? point : TriangulateMidpoint(centers, rays);
}

OracleResult Solve(const Simulation& simulation, const Reconstruction& initial,
                   double loss_scale_px, BundleAdjustmentOptions options,
                   const Context& context) {
  options.loss_scale_px = loss_scale_px;
  options.function_tolerance = kOracleTolerance;
  options.max_num_iterations = kMaxNumOracleIterations;
  const Timer timer;
  BundleResult adjusted =
      AdjustBundle(simulation.scene, initial, options, context);
  OracleResult result;
  result.seconds = timer.Seconds();
  result.model = std::move(adjusted.estimate);
  result.solve = adjusted.summary.solves.back();
  result.num_points = result.model.points.size();
  for (const Point3D& point : result.model.points) {
    result.num_observations += point.track.size();
  }
  result.errors = EvaluateModel(simulation, result.model);
  return result;
}

double Ratio(const ModelErrors& mapper, const ModelErrors& oracle) {
  if (!mapper.position_m || !oracle.position_m) return 0.0;
  return mapper.position_m->mean / oracle.position_m->mean;
}

}  // namespace

ModelErrors EvaluateModel(const Simulation& simulation,
                          const Reconstruction& model) {
  const Scene& scene = simulation.scene;
  std::vector<ImagePoses> images;
  images.reserve(scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    images.push_back({image.name, scene.IsReference(image.sensor_idx),
                      model.CamFromWorld(scene, static_cast<int>(i)),
                      simulation.cam_from_world[i]});
  }
  const Evaluation evaluation = Evaluate(images, true, {}, {});
  ModelErrors errors;
  errors.num_images = evaluation.num_images;
  errors.num_registered = evaluation.num_registered;
  errors.position_m = evaluation.position_m;
  errors.rotation_deg = evaluation.rotation_deg;
  if (!evaluation.world_from_model) return errors;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const auto& estimate = model.sensor_from_rig[i];
    if (!estimate || scene.IsReference(static_cast<int>(i))) continue;
    errors.rig.push_back(
        CompareSensor(scene.sensors[i].name, *estimate,
                      *simulation.ground_truth.sensor_from_rig[i],
                      evaluation.world_from_model->scale));
  }
  return errors;
}

double LastLossScalePx(const BundleAdjustmentOptions& options,
                       const BundleSummary& summary) {
  // The last round only filters after the last solve.
  if (summary.rounds.size() < 2) return options.loss_scale_px;
  const double sigma_px = summary.rounds[summary.rounds.size() - 2].sigma_px;
  return std::min(
      options.loss_scale_px,
      std::max(kMinLossScalePx, options.loss_sigma_factor * sigma_px));
}

OracleResult SolveOracle(const Simulation& simulation, const MapperModel& model,
                         const BundleAdjustmentOptions& options,
                         const Context& context) {
  const Scene& scene = simulation.scene;
  Reconstruction initial = TruthOf(simulation, model.reconstruction);
  const Bearings bearings = ComputeBearings(scene, context.num_threads);
  std::vector<std::optional<Rigid3>> cam_from_world;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    cam_from_world.push_back(initial.CamFromWorld(scene, static_cast<int>(i)));
  }
  for (const Point3D& point : model.reconstruction.points) {
    const auto start = Triangulate(bearings, cam_from_world, point.track);
    if (!start) continue;
    initial.points.push_back({*start, point.color, std::nullopt, point.track});
  }
  return Solve(simulation, initial, LastLossScalePx(options, model.bundle),
               options, context);
}

ObservationGroups TrueTracks(const Simulation& simulation) {
  const Scene& scene = simulation.scene;
  std::vector<size_t> first_node = {0};
  for (const Image& image : scene.images) {
    first_node.push_back(first_node.back() + image.keypoints_px.size());
  }
  UnionFind sets(first_node.back());
  for (const ImagePair& pair : simulation.view_graph.pairs) {
    const std::vector<int>& points1 =
        simulation.keypoint_points[pair.image_idx1];
    const std::vector<int>& points2 =
        simulation.keypoint_points[pair.image_idx2];
    for (const Match& match : pair.matches) {
      const int point = points1[match.keypoint_idx1];
      if (point < 0 || point != points2[match.keypoint_idx2]) continue;
      sets.Union(first_node[pair.image_idx1] + match.keypoint_idx1,
                 first_node[pair.image_idx2] + match.keypoint_idx2);
    }
  }
  // Sorted by first observation.
  std::vector<int> track_of_root(first_node.back(), -1);
  std::vector<std::vector<Observation>> tracks;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    for (size_t k = 0; k < scene.images[i].keypoints_px.size(); ++k) {
      int& track = track_of_root[sets.Find(first_node[i] + k)];
      if (track < 0) {
        track = static_cast<int>(tracks.size());
        tracks.emplace_back();
      }
      tracks[track].push_back({static_cast<int>(i), static_cast<int>(k)});
    }
  }
  ObservationGroups groups;
  for (const std::vector<Observation>& track : tracks) {
    if (track.size() < 2) continue;
    groups.observations.insert(groups.observations.end(), track.begin(),
                               track.end());
    groups.FinishGroup();
  }
  return groups;
}

OracleResult SolveFullOracle(const Simulation& simulation, double loss_scale_px,
                             const BundleAdjustmentOptions& options,
                             const Context& context) {
  Reconstruction initial = simulation.ground_truth;
  initial.points.clear();
  const ObservationGroups tracks = TrueTracks(simulation);
  for (size_t i = 0; i < tracks.size(); ++i) {
    const Observation& first = *tracks.begin(i);
    const int point_idx =
        simulation.keypoint_points[first.image_idx][first.keypoint_idx];
    Point3D point;
    point.point_in_world = simulation.world_points[point_idx];
    point.track.assign(tracks.begin(i), tracks.end(i));
    initial.points.push_back(std::move(point));
  }
  return Solve(simulation, initial, loss_scale_px, options, context);
}

double OracleComparison::OracleRatio() const {
  return Ratio(mapper, oracle.errors);
}

double OracleComparison::FullOracleRatio() const {
  return Ratio(mapper, full_oracle.errors);
}

std::optional<OracleComparison> CompareWithOracles(
    const Simulation& simulation, const MapperResult& result,
    const BundleAdjustmentOptions& options, const Context& context) {
  if (result.models.empty()) return std::nullopt;
  const MapperModel& model = result.models.front();
  OracleComparison comparison;
  comparison.mapper = EvaluateModel(simulation, model.reconstruction);
  comparison.loss_scale_px = LastLossScalePx(options, model.bundle);
  comparison.oracle = SolveOracle(simulation, model, options, context);
  comparison.full_oracle =
      SolveFullOracle(simulation, comparison.loss_scale_px, options, context);
  return comparison;
}

}  // namespace mgsfm
