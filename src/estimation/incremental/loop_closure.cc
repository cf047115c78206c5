// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "base/ranges.h"
#include "georegistration/pose_graph_deformation.h"
#include "incremental/growth_steps.h"
#include "registration/unit_resection.h"

namespace mgsfm {
namespace {

using MatchesOfCameras = std::vector<GrowingModel::Matches>;

// Two poses see different places if frames that observe points of both hold at
// most this share of the observations.
constexpr double kMaxSharedObservations = 0.2;
// Frames that hold each side of a loop.
constexpr size_t kNumAnchors = 10;
// The standard deviation of the anchors, in median distances of points.
constexpr double kAnchorSigma = 1e-3;

std::vector<CameraPoints> PointsOf(const MatchesOfCameras& matches) {
  return Transformed(matches,
                     [](const auto& of_camera) { return of_camera.points; });
}

// The matches for which keep(index among all, track) holds.
template <class Keep>
MatchesOfCameras Select(const MatchesOfCameras& matches, const Keep& keep) {
  MatchesOfCameras selected;
  size_t next = 0;
  for (const auto& of_camera : matches) {
    CameraPoints points{of_camera.points.cam_from_unit,
                        {},
                        {},
                        of_camera.points.max_error_rad,
                        {}};
    GrowingModel::Matches kept{std::move(points), {}};
    for (size_t k = 0; k < of_camera.track_idxs.size(); ++k) {
      if (!keep(next++, of_camera.track_idxs[k])) continue;
      kept.points.rays.push_back(of_camera.points.rays[k]);
      kept.points.points.push_back(of_camera.points.points[k]);
      kept.track_idxs.push_back(of_camera.track_idxs[k]);
    }
    selected.push_back(std::move(kept));
  }
  return selected;
}

// The matches whose errors are within the bound, or beyond it.
MatchesOfCameras SelectBy(const Rigid3& pose, bool is_inlier,
                          const MatchesOfCameras& matches) {
  const std::vector<double> errors =
      AbsolutePoseErrors(PointsOf(matches), pose);
  return Select(matches,
                [&](size_t i, int) { return (errors[i] <= 1.0) == is_inlier; });
}

// The matches with points that neighbors of the frame observe.
MatchesOfCameras SelectOfNeighbors(const GrowthInput& input,
                                   const GrowingModel& model, int frame_idx,
                                   const MatchesOfCameras& matches) {
  const std::vector<int>& neighbors = input.sequence_neighbors[frame_idx];
  return Select(matches, [&](size_t, int track_idx) {
    return AnyOf(model.ObserversOf(track_idx), [&](const Observation& o) {
      return std::binary_search(neighbors.begin(), neighbors.end(),
                                input.scene.images[o.image_idx].frame_idx);
    });
  });
}

// The number of observations of the points of matches, per frame.
std::vector<int> CountObservers(const Scene& scene, const GrowingModel& model,
                                const MatchesOfCameras& matches) {
  std::vector<int> num_of_frame(scene.frames.size(), 0);
  for (const auto& of_camera : matches) {
    for (const int track_idx : of_camera.track_idxs) {
      for (const Observation& o : model.ObserversOf(track_idx)) {
        ++num_of_frame[scene.images[o.image_idx].frame_idx];
      }
    }
  }
  return num_of_frame;
}

bool AreDifferentPlaces(const std::vector<int>& counts1,
                        const std::vector<int>& counts2) {
  double num_shared = 0.0, num1 = 0.0, num2 = 0.0;
  for (size_t i = 0; i < counts1.size(); ++i) {
    num_shared += std::min(counts1[i], counts2[i]);
    num1 += counts1[i];
    num2 += counts2[i];
  }
  return num_shared <= kMaxSharedObservations * std::min(num1, num2);
}

// The frames with the most observations, but more than in the other counts.
std::vector<int> AnchorsOf(const std::vector<int>& counts,
                           const std::vector<int>& other_counts) {
  std::vector<int> frame_idxs;
  for (size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] > other_counts[i]) frame_idxs.push_back(static_cast<int>(i));
  }
  StableSortDescendingBy(&frame_idxs, [&](int a) { return counts[a]; });
  frame_idxs.resize(std::min(frame_idxs.size(), kNumAnchors));
  return frame_idxs;
}

UnitPose Resect(const GrowthInput& input, const MatchesOfCameras& matches,
                const ResectionOptions& options, int frame_idx, int stream) {
  return ResectUnit(PointsOf(matches), options, input.context.random_seed,
                    2 * static_cast<uint64_t>(frame_idx) + stream);
}

// Few points suffice if neighbors in a sequence observe them.
void ResectByNeighbors(const GrowthInput& input, const GrowingModel& model,
                       int frame_idx, const MatchesOfCameras& matches,
                       FrameRegistration* registration) {
  if (!model.HasNeighborInModel(frame_idx)) return;
  ResectionOptions options = input.options.resection;
  options.abs_pose_min_num_inliers = options.abs_pose_min_num_neighbor_inliers;
  const UnitPose pose =
      Resect(input, SelectOfNeighbors(input, model, frame_idx, matches),
             options, frame_idx, 0);
  if (!pose.unit_from_world) return;
  registration->rig_from_world = pose.unit_from_world;
  registration->num_inliers =
      ScoreAbsolutePose(PointsOf(matches), *pose.unit_from_world).num_inliers;
}

// Whether scale drifts: no placed sensor has a baseline.
bool ScaleDrifts(const GrowthInput& input, const GrowingModel& model) {
  for (size_t i = 0; i < input.scene.sensors.size(); ++i) {
    const auto& pose = model.poses().sensor_from_rig[i];
    if (pose && !pose->translation.isZero(0.0)) return false;
  }
  return true;
}

PositionPriors AnchorPositions(const GrowthInput& input,
                               const FrameRegistration& registration,
                               const GrowingModel& model) {
  const Rigid3 new_from_old = registration.rig_from_world->Inverse() *
                              registration.loop->rig_from_world;
  const double sigma = kAnchorSigma * model.median_distance();
  PositionPriors priors;
  priors.images.resize(input.scene.images.size());
  const auto add = [&](const std::vector<int>& frame_idxs, bool is_moved) {
    for (const int frame_idx : frame_idxs) {
      for (const int i : input.scene.frames[frame_idx].image_idxs) {
        const auto pose = model.poses().CamFromWorld(input.scene, i);
        if (!pose) continue;
        const Eigen::Vector3d center = pose->Center();
        priors.images[i] =
            PositionMeasurement{is_moved ? new_from_old * center : center,
                                sigma * sigma * Eigen::Matrix3d::Identity()};
      }
    }
  };
  add(registration.loop->frame_idxs, true);
  add(registration.loop->other_frame_idxs, false);
  return priors;
}

}  // namespace

FrameRegistration RegisterFrame(const GrowthInput& input,
                                const GrowingModel& model, int frame_idx) {
  const ResectionOptions& options = input.options.resection;
  const MatchesOfCameras matches = model.MatchesOfFrame(frame_idx);
  const UnitPose pose = Resect(input, matches, options, frame_idx, 0);
  FrameRegistration registration{pose.unit_from_world, pose.num_keypoints,
                                 pose.num_inliers, std::nullopt};
  if (!pose.unit_from_world) {
    ResectByNeighbors(input, model, frame_idx, matches, &registration);
    return registration;
  }
  const MatchesOfCameras others =
      SelectBy(*pose.unit_from_world, false, matches);
  const UnitPose other = Resect(input, others, options, frame_idx, 1);
  if (!other.unit_from_world) return registration;
  const std::vector<int> counts = CountObservers(
      input.scene, model, SelectBy(*other.unit_from_world, true, others));
  const std::vector<int> other_counts = CountObservers(
      input.scene, model, SelectBy(*pose.unit_from_world, true, matches));
  if (!AreDifferentPlaces(counts, other_counts)) return registration;
  registration.loop = {*other.unit_from_world, other.num_inliers,
                       AnchorsOf(counts, other_counts),
                       AnchorsOf(other_counts, counts)};
  return registration;
}

bool CloseLoop(const GrowthInput& input, int frame_idx,
               const FrameRegistration& registration, GrowingModel* model) {
  const Reconstruction before = model->poses();
  const size_t num_observations = model->NumObservations();
  const MatchSelection selection = SelectConsistentMatches(
      {input.scene, input.view_graph, input.pair_is_used, before},
      input.options.bundle_adjustment.max_max_error_px,
      input.options.match_selection, input.context);
  Reconstruction deformed = model->WithPoints();
  const PositionPriors anchors = AnchorPositions(input, registration, *model);
  PositionPriors used = anchors;
  const std::optional<ModelDeformation> deformation =
      DeformToPriors({input.scene, input.view_graph, selection.pair_is_used,
                      anchors, !ScaleDrifts(input, *model)},
                     input.context, &used, &deformed);
  if (!deformation) return false;
  model->MoveTo(deformed);
  model->AdjustAll();
  model->AdjustAll();
  const FrameRegistration after = RegisterFrame(input, *model, frame_idx);
  // At least half of the points of the second pose agree with the first one.
  if (2 * after.num_inliers >=
          2 * registration.num_inliers + registration.loop->num_inliers &&
      model->NumObservations() >= num_observations) {
    return true;
  }
  model->MoveTo(before);
  return false;
}

}  // namespace mgsfm
