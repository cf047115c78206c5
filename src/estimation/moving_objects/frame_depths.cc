// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/frame_depths.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "base/random.h"
#include "base/ranges.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "math/robust_scale.h"
#include "math/spanning_tree.h"
#include "scene/observations.h"
#include "translation_averaging/baseline_directions.h"
#include "translation_averaging/scale_averaging.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

// Two sensors with pairs of images within frames.
struct SensorPair {
  int sensor_idx1 = 0;  // < sensor_idx2
  int sensor_idx2 = 0;
  std::vector<const ImagePair*> pairs;
  size_t num_matches = 0;
  bool has_direction = false;  // of the baseline of any pair
};

// Whether image 1 of a pair is of the sensor with the larger index.
bool IsSwapped(const Scene& scene, const ImagePair& pair) {
  return scene.images[pair.image_idx1].sensor_idx >
         scene.images[pair.image_idx2].sensor_idx;
}

std::vector<SensorPair> FindSensorPairs(const MotionInput& input) {
  const auto& [scene, bearings, index, view_graph, matches, rotations] = input;
  std::map<std::pair<int, int>, SensorPair> of_sensors;
  for (size_t i = 0; i < view_graph.pairs.size(); ++i) {
    const ImagePair& pair = view_graph.pairs[i];
    if (index.Of(i).IsBetweenFrames() || !pair.relative_pose) continue;
    const std::pair<int, int> sensors =
        std::minmax(scene.images[pair.image_idx1].sensor_idx,
                    scene.images[pair.image_idx2].sensor_idx);
    SensorPair& found = of_sensors[sensors];
    found.sensor_idx1 = sensors.first;
    found.sensor_idx2 = sensors.second;
    found.pairs.push_back(&pair);
    found.num_matches += pair.matches.size();
    found.has_direction = found.has_direction ||
                          pair.relative_pose->translation_direction.has_value();
  }
  std::vector<SensorPair> sensor_pairs;
  for (auto& [sensors, found] : of_sensors) {
    sensor_pairs.push_back(std::move(found));
  }
  return sensor_pairs;
}

// The standard deviation of the angle between the rays of a match.
double RayNoiseRad(const Scene& scene, const ImagePair& pair, double noise_px) {
  return std::hypot(ErrorRad(scene, pair.image_idx1, noise_px),
                    ErrorRad(scene, pair.image_idx2, noise_px));
}

// The matches of all frames, as if one pair of images had them.
RayMatches PoolMatches(const Scene& scene, const Bearings& bearings,
                       const SensorPair& sensor_pair) {
  // More matches of two sensors are thinned out evenly: a pose from this many
  // has an error far below that of a single depth.
  const size_t stride = 1 + sensor_pair.num_matches / 20000;
  RayMatches pooled;
  size_t num_seen = 0;
  for (const ImagePair* pair : sensor_pair.pairs) {
    const bool is_swapped = IsSwapped(scene, *pair);
    ForEachRays(bearings, *pair,
                [&](const Match&, const Vector3d& ray1, const Vector3d& ray2) {
                  if (num_seen++ % stride != 0) return;
                  pooled.Add(is_swapped ? ray2 : ray1,
                             is_swapped ? ray1 : ray2);
                });
  }
  return pooled;
}

// The best pose with the given rotation and the direction of two matches.
Rigid3 SamplePose(const RayMatches& matches, const Eigen::Quaterniond& rotation,
                  Random* random) {
  const auto num_matches = static_cast<uint32_t>(matches.size());
  const auto normal = [&](size_t i) -> Vector3d {
    return (rotation * matches.rays1[i]).cross(matches.rays2[i]);
  };
  Rigid3 best{rotation, Vector3d::UnitX()};
  double best_sigma = std::numeric_limits<double>::infinity();
  // If half of the matches are right, so are a quarter of the two-match
  // samples. The best of these 25 is close to the optimum.
  for (int sample = 0; sample < 100; ++sample) {
    const Vector3d normal1 = normal(random->Index(num_matches));
    const Vector3d direction =
        normal1.cross(normal(random->Index(num_matches)));
    if (direction.isZero()) continue;
    const Rigid3 pose{rotation, direction.normalized()};
    const double sigma = ResidualSigma(matches, pose);
    if (sigma >= best_sigma) continue;
    best = pose;
    best_sigma = sigma;
  }
  const Rigid3 opposite{rotation, -best.translation};
  return ScoreRelativePose(matches, best, 3.0 * best_sigma).num_inliers >=
                 ScoreRelativePose(matches, opposite, 3.0 * best_sigma)
                     .num_inliers
             ? best
             : opposite;
}

// The pose of two sensors, with a baseline of length 1, and the standard
// deviation of the direction of this baseline.
struct SensorPose {
  Rigid3 sensor2_from_sensor1;
  double sigma_rad = 0.0;
};

// The averaged rotation, and the direction that the matches of all frames
// determine together, because a single frame may have too few. Matches do not
// refine the rotation: in a narrow overlap they determine only combinations of
// rotation and direction, and errors of intrinsics turn it.
std::optional<SensorPose> EstimateSensorPose(const MotionInput& input,
                                             const SensorPair& sensor_pair,
                                             Random* random) {
  const auto& sensor_from_rig = input.rotations.sensor_from_rig;
  const auto& sensor1_from_rig = sensor_from_rig[sensor_pair.sensor_idx1];
  const auto& sensor2_from_rig = sensor_from_rig[sensor_pair.sensor_idx2];
  if (!sensor1_from_rig || !sensor2_from_rig) return std::nullopt;
  const Eigen::Quaterniond rotation =
      *sensor2_from_rig * sensor1_from_rig->conjugate();
  const RayMatches pooled =
      PoolMatches(input.scene, input.bearings, sensor_pair);
  if (!sensor_pair.has_direction || pooled.size() == 0) return std::nullopt;
  Rigid3 pose = SamplePose(pooled, rotation, random);
  PoseRefinementOptions options;
  options.is_rotation_fixed = true;
  // The loss adapts to the noise that the last round has left. The pose moves
  // little after the second.
  for (int round = 0; round < 3; ++round) {
    options.loss_scale_rad = ResidualSigma(pooled, pose);
    if (!RefineRelativePose(pooled, options, &pose).IsUsable()) {
      return std::nullopt;
    }
  }
  return SensorPose{pose, DirectionSigmaRad(pooled, options, pose)};
}

// The smallest sine of the angle between the rays of a match with a depth.
// Noise turns smaller angles into depths that are too short
// (docs/results/constants.md).
double MinSine(double noise_rad, double min_parallax_deg) {
  constexpr double kMinParallaxInSigmas = 2.0;
  return std::max(std::sin(DegToRad(min_parallax_deg)),
                  kMinParallaxInSigmas * noise_rad);
}

// A point on both rays of a match: its distances from both cameras and the sine
// of the angle between the rays.
struct Intersection {
  double distances[2];
  double sine;
};

// nullopt for small angles, and unless the point is in front of both cameras.
std::optional<Intersection> Intersect(const Rigid3& cam2_from_cam1,
                                      const Vector3d& ray1,
                                      const Vector3d& ray2, double min_sine) {
  const Vector3d& t = cam2_from_cam1.translation;
  const Vector3d turned = cam2_from_cam1.rotation * ray1;
  const Vector3d normal = turned.cross(ray2);
  const double sine = normal.norm();
  // A point in front of both cameras has the baseline between its rays.
  if (sine < min_sine || normal.dot(ray2.cross(t)) <= 0.0 ||
      normal.dot(turned.cross(t)) <= 0.0) {
    return std::nullopt;
  }
  return Intersection{
      {t.cross(ray2).norm() / sine, t.cross(turned).norm() / sine}, sine};
}

// Calls function(match, intersection) for all matches of a pair that intersect.
template <typename Function>
void ForEachIntersection(const Bearings& bearings, const ImagePair& pair,
                         const Rigid3& cam2_from_cam1, double min_sine,
                         const Function& function) {
  ForEachRays(
      bearings, pair,
      [&](const Match& match, const Vector3d& ray1, const Vector3d& ray2) {
        const auto point = Intersect(cam2_from_cam1, ray1, ray2, min_sine);
        if (point) function(match, *point);
      });
}

// The depths of the keypoints of all images of two sensors, in baselines of
// these sensors. Keypoints are numbered through all images.
BaselineDirection MeasureDepths(const MotionInput& input,
                                const std::vector<int>& first_keypoint,
                                const SensorPair& sensor_pair,
                                const Rigid3& sensor2_from_sensor1,
                                const DepthOptions& options) {
  BaselineDirection baseline;
  baseline.image_idx1 = sensor_pair.sensor_idx1;
  baseline.image_idx2 = sensor_pair.sensor_idx2;
  baseline.kind = BaselineKind::kDirection;
  for (const ImagePair* pair : sensor_pair.pairs) {
    const bool is_swapped = IsSwapped(input.scene, *pair);
    ForEachIntersection(
        input.bearings, *pair,
        is_swapped ? sensor2_from_sensor1.Inverse() : sensor2_from_sensor1,
        MinSine(RayNoiseRad(input.scene, *pair, options.noise_px),
                options.min_parallax_deg),
        [&](const Match& match, const Intersection& point) {
          baseline.depths[is_swapped ? 1 : 0].push_back(
              {first_keypoint[pair->image_idx1] +
                   static_cast<int>(match.keypoint_idx1),
               static_cast<float>(std::log(point.distances[0]))});
          baseline.depths[is_swapped ? 0 : 1].push_back(
              {first_keypoint[pair->image_idx2] +
                   static_cast<int>(match.keypoint_idx2),
               static_cast<float>(std::log(point.distances[1]))});
        });
  }
  for (auto& depths : baseline.depths) SortByKeypoint(&depths);
  return baseline;
}

// Poses of the sensors in the axes of their rig, along a spanning tree of the
// most certain baselines. The origin of each rig is one of these sensors. Pairs
// of sensors whose lengths are not linked with the others have none.
std::vector<std::optional<Rigid3>> PlaceSensors(
    const RotationEstimate& rotations,
    const std::vector<SensorPair>& sensor_pairs,
    const std::vector<std::optional<SensorPose>>& poses,
    const PairScales& scales) {
  std::vector<GraphEdge> edges;
  std::vector<Rigid3> sensor2_from_sensor1;
  for (size_t i = 0; i < sensor_pairs.size(); ++i) {
    if (!scales.pairs[i] || scales.pairs[i]->group != 0) continue;
    edges.push_back({sensor_pairs[i].sensor_idx1, sensor_pairs[i].sensor_idx2,
                     1.0 / poses[i]->sigma_rad});
    const Rigid3& pose = poses[i]->sensor2_from_sensor1;
    sensor2_from_sensor1.push_back(
        {pose.rotation, scales.pairs[i]->scale * pose.translation});
  }
  Mask has_pairs(rotations.sensor_from_rig.size(), false);
  for (const GraphEdge& edge : edges) {
    has_pairs[edge.node1] = true;
    has_pairs[edge.node2] = true;
  }
  const auto num_sensors = static_cast<int>(has_pairs.size());
  std::vector<std::optional<Rigid3>> sensor_from_rig(num_sensors);
  const auto forest = MaximumSpanningForest(num_sensors, edges);
  for (const ForestStep& step : WalkForest(num_sensors, edges, forest)) {
    if (!step.from) {
      if (has_pairs[step.node] && rotations.sensor_from_rig[step.node]) {
        sensor_from_rig[step.node] =
            Rigid3{*rotations.sensor_from_rig[step.node], Vector3d::Zero()};
      }
      continue;
    }
    const auto& parent_from_rig = sensor_from_rig[step.from->parent];
    if (!parent_from_rig) continue;
    const Rigid3& pose = sensor2_from_sensor1[step.from->edge];
    sensor_from_rig[step.node] =
        (edges[step.from->edge].node2 == step.node ? pose : pose.Inverse()) *
        *parent_from_rig;
  }
  return sensor_from_rig;
}

// Intersects the matching rays of two images of one frame. A distance is
// inversely proportional to the sine of the angle between the rays.
void AddDepths(const MotionInput& input, const ImagePair& pair,
               const DepthOptions& options, FrameDepths* depths) {
  const Scene& scene = input.scene;
  const int images[2] = {pair.image_idx1, pair.image_idx2};
  const auto& cam1_from_rig =
      depths->cam_from_rig[scene.images[images[0]].sensor_idx];
  const auto& cam2_from_rig =
      depths->cam_from_rig[scene.images[images[1]].sensor_idx];
  if (!cam1_from_rig || !cam2_from_rig) return;
  const double noise_rad = RayNoiseRad(scene, pair, options.noise_px);
  for (const int image : images) {
    depths->keypoints[image].resize(scene.images[image].keypoints_px.size());
  }
  ForEachIntersection(
      input.bearings, pair, *cam2_from_rig * cam1_from_rig->Inverse(),
      MinSine(noise_rad, options.min_parallax_deg),
      [&](const Match& match, const Intersection& point) {
        const size_t keypoints[2] = {match.keypoint_idx1, match.keypoint_idx2};
        for (const int i : {0, 1}) {
          // The most precise pair counts.
          auto& depth = depths->keypoints[images[i]][keypoints[i]];
          const double sigma = noise_rad / point.sine;
          if (depth && depth->relative_sigma <= sigma) continue;
          depth = {point.distances[i], sigma};
        }
      });
}

// The parallax of one ray by a baseline of length 1, and the measured one.
struct Parallax {
  double by_unit_rad = 0.0;
  double measured_rad = 0.0;

  double Length() const { return measured_rad / by_unit_rad; }
};

// The length that minimizes the sum of the absolute errors of all parallaxes:
// the median of their lengths, weighted by those of a unit baseline.
double FitLength(std::vector<Parallax> parallaxes) {
  SortBy(&parallaxes, [](const auto& a) { return a.Length(); });
  double total = 0.0;
  for (const Parallax& parallax : parallaxes) total += parallax.by_unit_rad;
  double sum = 0.0;
  for (const Parallax& parallax : parallaxes) {
    sum += parallax.by_unit_rad;
    if (sum >= 0.5 * total) return parallax.Length();
  }
  return parallaxes.back().Length();
}

// nullopt if a ray looks along the baseline.
std::optional<Parallax> ParallaxOf(const Rigid3& b_from_a,
                                   const Vector3d& ray_a, const Vector3d& ray_b,
                                   double distance) {
  const Vector3d turned = b_from_a.rotation * ray_a;
  const Vector3d across =
      b_from_a.translation - b_from_a.translation.dot(turned) * turned;
  const double sine = across.norm();
  if (!(sine > 0.0)) return std::nullopt;
  return Parallax{sine / distance, (ray_b - turned).dot(across) / sine};
}

}  // namespace

double ResidualSigma(const RayMatches& matches, const Rigid3& pose) {
  return std::max(RobustSigma<1>(SampsonAngles(matches, pose)),
                  std::numeric_limits<double>::epsilon());
}

std::optional<BaselineLength> MeasureBaselineLength(const Scene& scene,
                                                    const Bearings& bearings,
                                                    const ImagePair& pair,
                                                    double noise_px,
                                                    const FrameDepths& depths) {
  const Rigid3 pose{pair.relative_pose->cam2_from_cam1,
                    *pair.relative_pose->translation_direction};
  const double noise_rad = RayNoiseRad(scene, pair, noise_px);
  std::vector<Parallax> parallaxes;
  double information = 0.0, by_depths = 0.0;
  const auto add = [&](int image, size_t keypoint, const Vector3d& ray,
                       const Vector3d& other_ray, const Rigid3& other_from) {
    const KeypointDepth* depth = depths.Find(image, keypoint);
    if (depth == nullptr) return;
    const auto parallax =
        ParallaxOf(other_from, ray, other_ray, depth->distance);
    if (!parallax) return;
    parallaxes.push_back(*parallax);
    const double squared = parallax->by_unit_rad * parallax->by_unit_rad;
    const double sigma = depth->relative_sigma;
    information += squared;
    by_depths += sigma * sigma * squared;
  };
  const Rigid3 inverse = pose.Inverse();
  ForEachRays(
      bearings, pair,
      [&](const Match& match, const Vector3d& ray1, const Vector3d& ray2) {
        add(pair.image_idx1, match.keypoint_idx1, ray1, ray2, pose);
        add(pair.image_idx2, match.keypoint_idx2, ray2, ray1, inverse);
      });
  if (parallaxes.empty()) return std::nullopt;
  const auto num_rays = static_cast<double>(parallaxes.size());
  const double length = std::max(0.0, FitLength(std::move(parallaxes)));
  // The variance of the median of normal errors is pi / 2 times that of the
  // mean.
  const double variance =
      0.5 * M_PI *
      (noise_rad * noise_rad + length * length * by_depths / num_rays) /
      information;
  return BaselineLength{length, std::sqrt(variance)};
}

FrameDepths MeasureFrameDepths(const MotionInput& input,
                               const DepthOptions& options,
                               const Context& context) {
  const Scene& scene = input.scene;
  std::vector<int> first_keypoint;
  int num_keypoints = 0;
  for (const Image& image : scene.images) {
    first_keypoint.push_back(num_keypoints);
    num_keypoints += static_cast<int>(image.keypoints_px.size());
  }
  const std::vector<SensorPair> sensor_pairs = FindSensorPairs(input);
  std::vector<std::optional<SensorPose>> poses(sensor_pairs.size());
  std::vector<BaselineDirection> measured(sensor_pairs.size());
  ParallelFor(sensor_pairs.size(), context.num_threads, [&](size_t i) {
    context.CheckInterrupted();
    Random random(context.random_seed, i);
    poses[i] = EstimateSensorPose(input, sensor_pairs[i], &random);
    if (!poses[i]) return;
    measured[i] = MeasureDepths(input, first_keypoint, sensor_pairs[i],
                                poses[i]->sensor2_from_sensor1, options);
  });
  const PairScales scales =
      AverageScales(measured, static_cast<int>(scene.sensors.size()), context);
  FrameDepths depths;
  depths.keypoints.resize(scene.images.size());
  depths.cam_from_rig =
      PlaceSensors(input.rotations, sensor_pairs, poses, scales);
  for (const SensorPair& sensor_pair : sensor_pairs) {
    for (const ImagePair* pair : sensor_pair.pairs) {
      AddDepths(input, *pair, options, &depths);
    }
  }
  return depths;
}

}  // namespace mgsfm
