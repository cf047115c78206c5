// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <utility>

#include "base/parallel.h"
#include "base/random.h"
#include "geometry/generalized_pose.h"
#include "geometry/so3.h"
#include "incremental/growth_steps.h"
#include "mgsfm/geometry/camera_models.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

using SensorPoses = std::vector<std::optional<Rigid3>>;

// Larger angles are no better: the depth of a point is accurate already.
constexpr double kMaxWeightedAngleRad = DegToRad(10.0);
// Starts are tried in this number before a set of frames is given up.
constexpr size_t kMaxNumTries = 100;

Rigid3 PoseOfPair(const ImagePair& pair) {
  return {pair.relative_pose->cam2_from_cam1,
          *pair.relative_pose->translation_direction};
}

// The parallax of the matches of a pair; 0 without translation.
double WeightOf(const GrowthInput& input, const ImagePair& pair) {
  if (!pair.relative_pose || !pair.relative_pose->translation_direction) {
    return 0.0;
  }
  const Eigen::Quaterniond& rotation = pair.relative_pose->cam2_from_cam1;
  const RayMatches rays = RaysOf(input.bearings, pair);
  double weight = 0.0;
  for (size_t i = 0; i < rays.rays1.size(); ++i) {
    const double angle_rad =
        AngleBetween(rotation * rays.rays1[i], rays.rays2[i]);
    weight += std::min(angle_rad / kMaxWeightedAngleRad, 1.0);
  }
  return weight;
}

UnitMatches MatchesOfPair(const GrowthInput& input, const SensorPoses& sensors,
                          const ImagePair& pair) {
  const Scene& scene = input.scene;
  const Image& image1 = scene.images[pair.image_idx1];
  const Image& image2 = scene.images[pair.image_idx2];
  UnitMatches matches{
      *sensors[image1.sensor_idx], *sensors[image2.sensor_idx], {}, 0.0};
  const auto pixels_per_radian = [&](const Image& image) {
    return PixelsPerRadian(scene.cameras[image.camera_idx]);
  };
  matches.max_error_rad =
      2.0 * input.options.bundle_adjustment.min_max_error_px /
      (pixels_per_radian(image1) + pixels_per_radian(image2));
  matches.rays = RaysOf(input.bearings, pair);
  return matches;
}

// The largest distance of a placed sensor of a rig from its reference.
double LongestBaseline(const Scene& scene, const SensorPoses& sensors,
                       int rig_idx) {
  double longest = 0.0;
  for (const int i : scene.rigs[rig_idx].sensor_idxs) {
    if (sensors[i]) longest = std::max(longest, sensors[i]->translation.norm());
  }
  return longest;
}

}  // namespace

StartFinder::StartFinder(const GrowthInput& input)
    : input_(input),
      weights_(input.view_graph.pairs.size()),
      frame_is_tried_(input.scene.frames.size()) {
  ParallelFor(weights_.size(), input.context.num_threads, [&](size_t i) {
    if (!input.pair_is_used[i]) return;
    weights_[i] = WeightOf(input, input.view_graph.pairs[i]);
  });
}

std::vector<StartFinder::Candidate> StartFinder::ListCandidates(
    const SensorPoses& sensors, const Mask& frame_is_taken) const {
  const Scene& scene = input_.scene;
  std::map<std::pair<int, int>, Candidate> by_frames;
  std::vector<Candidate> candidates, within_frames;
  for (size_t i = 0; i < weights_.size(); ++i) {
    if (weights_[i] <= 0.0) continue;
    const ImagePair& pair = input_.view_graph.pairs[i];
    const Image& image1 = scene.images[pair.image_idx1];
    const Image& image2 = scene.images[pair.image_idx2];
    const int frame_idx1 = image1.frame_idx, frame_idx2 = image2.frame_idx;
    if (frame_is_taken[frame_idx1] || frame_is_taken[frame_idx2] ||
        frame_is_tried_[frame_idx1] || frame_is_tried_[frame_idx2]) {
      continue;
    }
    const bool has_sensor1 = sensors[image1.sensor_idx].has_value();
    const bool has_sensor2 = sensors[image2.sensor_idx].has_value();
    if (frame_idx1 == frame_idx2) {
      if (has_sensor1 == has_sensor2) continue;
      within_frames.push_back({frame_idx1, frame_idx2, weights_[i], {i}});
      continue;
    }
    if (!has_sensor1 || !has_sensor2) continue;
    Candidate& candidate = by_frames[std::minmax(frame_idx1, frame_idx2)];
    candidate.frame_idx1 = std::min(frame_idx1, frame_idx2);
    candidate.frame_idx2 = std::max(frame_idx1, frame_idx2);
    candidate.weight += weights_[i];
    candidate.pair_idxs.push_back(i);
  }
  for (auto& [frames, candidate] : by_frames) {
    std::stable_sort(
        candidate.pair_idxs.begin(), candidate.pair_idxs.end(),
        [&](size_t a, size_t b) { return weights_[a] > weights_[b]; });
    candidates.push_back(std::move(candidate));
  }
  const auto is_heavier = [](const Candidate& a, const Candidate& b) {
    return a.weight > b.weight;
  };
  std::stable_sort(candidates.begin(), candidates.end(), is_heavier);
  std::stable_sort(within_frames.begin(), within_frames.end(), is_heavier);
  candidates.resize(std::min(candidates.size(), kMaxNumTries));
  within_frames.resize(std::min(within_frames.size(), kMaxNumTries));
  candidates.insert(candidates.end(), within_frames.begin(),
                    within_frames.end());
  return candidates;
}

// frame2_from_frame1.
std::optional<Rigid3> StartFinder::PoseOf(const SensorPoses& sensors,
                                          const Candidate& candidate) const {
  const Scene& scene = input_.scene;
  const auto is_from_first = [&](const ImagePair& pair) {
    return scene.images[pair.image_idx1].frame_idx == candidate.frame_idx1;
  };
  std::vector<UnitMatches> matches;
  std::vector<PairPose> guesses;
  for (const size_t i : candidate.pair_idxs) {
    const ImagePair& pair = input_.view_graph.pairs[i];
    UnitMatches of_pair = MatchesOfPair(input_, sensors, pair);
    Rigid3 pose = PoseOfPair(pair);
    if (!is_from_first(pair)) {
      std::swap(of_pair.cam1_from_unit1, of_pair.cam2_from_unit2);
      std::swap(of_pair.rays.rays1, of_pair.rays.rays2);
      pose = pose.Inverse();
    }
    guesses.push_back({matches.size(), pose});
    matches.push_back(std::move(of_pair));
  }
  const double baseline =
      std::max(LongestBaseline(scene, sensors,
                               scene.frames[candidate.frame_idx1].rig_idx),
               LongestBaseline(scene, sensors,
                               scene.frames[candidate.frame_idx2].rig_idx));
  if (baseline > 0.0 && matches.size() > 1) {
    Random random(input_.context.random_seed,
                  static_cast<uint64_t>(candidate.frame_idx1));
    if (auto pose =
            EstimateUnitPose(matches, guesses, RansacOptions(), &random)) {
      return pose;
    }
  }
  // The matches do not tell the length in the unit of the rig.
  Rigid3 pose = guesses.front().cam2_from_cam1;
  if (baseline > 0.0) pose.translation *= baseline;
  return matches.front().cam2_from_unit2.Inverse() * pose *
         matches.front().cam1_from_unit1;
}

std::unique_ptr<GrowingModel> StartFinder::Try(
    const SensorPoses& sensors, const Candidate& candidate) const {
  auto model = std::make_unique<GrowingModel>(input_, sensors);
  if (candidate.frame_idx1 == candidate.frame_idx2) {
    const ImagePair& pair = input_.view_graph.pairs[candidate.pair_idxs[0]];
    const int sensor_idx1 = input_.scene.images[pair.image_idx1].sensor_idx;
    const int sensor_idx2 = input_.scene.images[pair.image_idx2].sensor_idx;
    const Rigid3 pose = PoseOfPair(pair);
    if (sensors[sensor_idx1]) {
      model->SetSensor(sensor_idx2, pose * *sensors[sensor_idx1]);
    } else {
      model->SetSensor(sensor_idx1, pose.Inverse() * *sensors[sensor_idx2]);
    }
  } else {
    const std::optional<Rigid3> pose = PoseOf(sensors, candidate);
    if (!pose) return nullptr;
    model->SetFrame(candidate.frame_idx2, pose);
  }
  model->SetFrame(candidate.frame_idx1, Rigid3());
  const auto min_num_points =
      2 * static_cast<size_t>(model->MinNumInliers(candidate.frame_idx1));
  model->Triangulate({candidate.frame_idx1, candidate.frame_idx2});
  if (model->num_points() < min_num_points) return nullptr;
  model->AdjustAll();
  if (model->num_points() < min_num_points) return nullptr;
  return model;
}

std::unique_ptr<GrowingModel> StartFinder::Start(const SensorPoses& sensors,
                                                 const Mask& frame_is_taken) {
  for (const Candidate& candidate : ListCandidates(sensors, frame_is_taken)) {
    input_.context.CheckInterrupted();
    if (auto model = Try(sensors, candidate)) {
      frame_is_tried_[candidate.frame_idx1] = true;
      frame_is_tried_[candidate.frame_idx2] = true;
      return model;
    }
  }
  return nullptr;
}

}  // namespace mgsfm
