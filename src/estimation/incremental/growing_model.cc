// SPDX-License-Identifier: BSD-3-Clause
#include "incremental/growing_model.h"

#include <algorithm>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "bundle_adjustment/retriangulation.h"
#include "bundle_adjustment/solve.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// No position error of KITTI 06, EuRoC and nuScenes changes by more than 2 %
// with other values (docs/maths/incremental.md).
//
// Frames that are adjusted together with a new one.
constexpr size_t kNumNeighbors = 5;
// Poses of a growing model need less accuracy than those of a finished one.
constexpr int kMaxNumIterations = 20;
constexpr double kGrowthTolerance = 1e-4;
// Levels of the grids that measure the spread of points: 2 to 16 cells.
constexpr int kNumLevels = 4;

BundleAdjustmentOptions GrowthOptions(BundleAdjustmentOptions options,
                                      double loss_scale_px) {
  options.refine_rig_from_world = true;
  options.refine_points = true;
  options.max_num_iterations =
      std::min<int>(options.max_num_iterations, kMaxNumIterations);
  options.function_tolerance =
      std::max<double>(options.function_tolerance, kGrowthTolerance);
  options.loss_scale_px = loss_scale_px;
  return options;
}

}  // namespace

GrowingModel::GrowingModel(const GrowthInput& input,
                           std::vector<std::optional<Rigid3>> sensors)
    : input_(input),
      views_(input.scene.images.size()),
      points_(input.tracks.size()),
      num_visible_(input.scene.images.size(), 0),
      loss_scale_px_(input.options.bundle_adjustment.loss_scale_px) {
  model_.cameras = input.scene.cameras;
  model_.rig_from_world.resize(input.scene.frames.size());
  model_.sensor_from_rig = std::move(sensors);
  UpdateFilter();
}

size_t GrowingModel::NumObservations() const {
  size_t num = 0;
  for (const Point3D& point : points_) num += point.track.size();
  return num;
}

bool GrowingModel::HasNeighborInModel(int frame_idx) const {
  return AnyOf(input_.sequence_neighbors[frame_idx],
               [&](int other) { return HasFrame(other); });
}

int GrowingModel::MinNumInliers(int frame_idx) const {
  const ResectionOptions& options = input_.options.resection;
  return HasNeighborInModel(frame_idx)
             ? options.abs_pose_min_num_neighbor_inliers
             : options.abs_pose_min_num_inliers;
}

// --------------------------------------------------------------------- poses

void GrowingModel::UpdateViews(const std::vector<int>& frame_idxs) {
  for (const int frame_idx : frame_idxs) {
    for (const int i : input_.scene.frames[frame_idx].image_idxs) {
      views_[i] = MakeImageView(input_.scene, model_, i);
    }
  }
}

void GrowingModel::SetFrame(int frame_idx,
                            const std::optional<Rigid3>& rig_from_world) {
  auto& pose = model_.rig_from_world[frame_idx];
  num_frames_ += static_cast<int>(rig_from_world.has_value()) -
                 static_cast<int>(pose.has_value());
  pose = rig_from_world;
  UpdateViews({frame_idx});
}

void GrowingModel::SetSensor(int sensor_idx, const Rigid3& sensor_from_rig) {
  model_.sensor_from_rig[sensor_idx] = sensor_from_rig;
  views_ = MakeImageViews(input_.scene, model_);
}

void GrowingModel::SetPoses(const Reconstruction& poses) {
  for (size_t i = 0; i < model_.cameras.size(); ++i) {
    if (poses.cameras[i].params == model_.cameras[i].params) continue;
    own_bearings_ = ComputeBearings(input_.scene, poses.cameras,
                                    input_.context.num_threads);
    break;
  }
  model_.cameras = poses.cameras;
  model_.sensor_from_rig = poses.sensor_from_rig;
  model_.rig_from_world = poses.rig_from_world;
  views_ = MakeImageViews(input_.scene, model_);
}

void GrowingModel::MoveTo(const Reconstruction& moved) {
  SetPoses(moved);
  TriangulateAll();
}

void GrowingModel::StartFrom(const Reconstruction& existing) {
  SetPoses(existing);
  for (const auto& pose : model_.rig_from_world)
    num_frames_ += pose.has_value();
  // Per keypoint: the point whose track begins with it.
  std::vector<std::vector<const Point3D*>> points(input_.scene.images.size());
  for (size_t i = 0; i < points.size(); ++i) {
    points[i].resize(input_.scene.images[i].keypoints_px.size(), nullptr);
  }
  for (const Point3D& point : existing.points) {
    const Observation& first = point.track.front();
    points[first.image_idx][first.keypoint_idx] = &point;
  }
  std::vector<int> changed;
  for (size_t t = 0; t < input_.tracks.size(); ++t) {
    const Observation& first = *input_.tracks.begin(t);
    const Point3D* point = points[first.image_idx][first.keypoint_idx];
    if (point != nullptr && point->track.size() == input_.tracks.length(t)) {
      SetPoint(static_cast<int>(t), *point);
    } else {
      changed.push_back(static_cast<int>(t));
    }
  }
  TriangulateTracks(changed);
  UpdateFilter();
}

// ------------------------------------------------------------ visible points

int GrowingModel::NumVisibleInFrame(int frame_idx) const {
  int num = 0;
  for (const int i : input_.scene.frames[frame_idx].image_idxs) {
    if (HasSensor(input_.scene.images[i].sensor_idx)) num += num_visible_[i];
  }
  return num;
}

int GrowingModel::Spread(int frame_idx) const {
  int spread = 0;
  for (const int i : input_.scene.frames[frame_idx].image_idxs) {
    const Image& image = input_.scene.images[i];
    if (!HasSensor(image.sensor_idx)) continue;
    const Camera& camera = model_.cameras[image.camera_idx];
    constexpr int kSide = 1 << kNumLevels;
    std::vector<Mask> is_occupied;
    for (int level = 1; level <= kNumLevels; ++level) {
      is_occupied.emplace_back(size_t{1} << (2 * level));
    }
    const auto cell_of = [&](float pixel, int size_px) {
      return std::clamp(static_cast<int>(kSide * pixel / size_px), 0,
                        kSide - 1);
    };
    for (const TrackKeypoint& k : input_.keypoints[i]) {
      if (points_[k.track_idx].track.empty()) continue;
      const Eigen::Vector2f& pixel = image.keypoints_px[k.keypoint_idx];
      const int x = cell_of(pixel.x(), camera.width_px);
      const int y = cell_of(pixel.y(), camera.height_px);
      for (int level = 1; level <= kNumLevels; ++level) {
        const int shift = kNumLevels - level;
        const int cell = ((y >> shift) << level) + (x >> shift);
        if (is_occupied[level - 1][cell]) continue;
        is_occupied[level - 1][cell] = true;
        spread += 1 << level;
      }
    }
  }
  return spread;
}

GrowingModel::Matches GrowingModel::MatchesOf(
    int image_idx, const Rigid3& cam_from_unit) const {
  const Bearings& bearings =
      own_bearings_.images.empty() ? input_.bearings : own_bearings_;
  const Camera& camera =
      model_.cameras[input_.scene.images[image_idx].camera_idx];
  Matches matches;
  matches.points.cam_from_unit = cam_from_unit;
  matches.points.max_error_rad =
      input_.options.resection.abs_pose_max_error_px / PixelsPerRadian(camera);
  for (const TrackKeypoint& k : input_.keypoints[image_idx]) {
    const Point3D& point = points_[k.track_idx];
    if (point.track.empty() || !bearings.HasRay(image_idx, k.keypoint_idx)) {
      continue;
    }
    matches.points.rays.push_back(bearings.Ray(image_idx, k.keypoint_idx));
    matches.points.points.push_back(point.point_in_world);
    matches.track_idxs.push_back(k.track_idx);
  }
  return matches;
}

std::vector<GrowingModel::Matches> GrowingModel::MatchesOfFrame(
    int frame_idx) const {
  std::vector<Matches> matches;
  for (const int i : input_.scene.frames[frame_idx].image_idxs) {
    const auto& sensor =
        model_.sensor_from_rig[input_.scene.images[i].sensor_idx];
    if (sensor) matches.push_back(MatchesOf(i, *sensor));
  }
  return matches;
}

// -------------------------------------------------------------------- points

void GrowingModel::SetPoint(int track_idx, std::optional<Point3D> point) {
  Point3D& old = points_[track_idx];
  const int change = static_cast<int>(point.has_value()) -
                     static_cast<int>(!old.track.empty());
  if (point) {
    old = *std::move(point);
  } else {
    old.track.clear();
  }
  if (change == 0) return;
  num_points_ += change;
  for (const Observation* o = input_.tracks.begin(track_idx);
       o != input_.tracks.end(track_idx); ++o) {
    num_visible_[o->image_idx] += change;
  }
}

void GrowingModel::TriangulateTracks(const std::vector<int>& track_idxs) {
  std::vector<std::optional<Point3D>> triangulated(track_idxs.size());
  ParallelFor(
      track_idxs.size(), input_.context.num_threads,
      [&](size_t i) {
        const size_t track = static_cast<size_t>(track_idxs[i]);
        const Point3D& old = points_[track];
        std::vector<Eigen::Vector3d> old_points;
        if (!old.track.empty()) old_points.push_back(old.point_in_world);
        std::vector<Point3D> points =
            TriangulateGroup(input_.scene, views_, input_.tracks.begin(track),
                             input_.tracks.end(track), old_points, filter_);
        if (!points.empty()) triangulated[i] = std::move(points.front());
      },
      256);
  for (size_t i = 0; i < track_idxs.size(); ++i) {
    SetPoint(track_idxs[i], std::move(triangulated[i]));
  }
}

std::vector<int> GrowingModel::TracksOf(
    const std::vector<int>& frame_idxs) const {
  std::vector<int> track_idxs;
  for (const int frame_idx : frame_idxs) {
    for (const int i : input_.scene.frames[frame_idx].image_idxs) {
      if (!views_[i].is_registered) continue;
      for (const TrackKeypoint& k : input_.keypoints[i]) {
        track_idxs.push_back(k.track_idx);
      }
    }
  }
  SortUnique(&track_idxs);
  return track_idxs;
}

void GrowingModel::Triangulate(const std::vector<int>& frame_idxs) {
  TriangulateTracks(TracksOf(frame_idxs));
}

void GrowingModel::TriangulateAll() {
  std::vector<int> track_idxs;
  for (size_t i = 0; i < points_.size(); ++i) {
    track_idxs.push_back(static_cast<int>(i));
  }
  TriangulateTracks(track_idxs);
}

void GrowingModel::UpdateFilter() {
  const BundleAdjustmentOptions& options = input_.options.bundle_adjustment;
  const Reconstruction model = WithPoints();
  const double sigma_px =
      NoiseSigmaPx(input_.scene, model, input_.context.num_threads);
  // The bound of the round before the last one.
  filter_ = MakeFilterOptions(input_.scene, model, options,
                              sigma_px > 0.0 ? MaxErrorPx(options, sigma_px, 1)
                                             : 2.0 * options.max_max_error_px,
                              input_.context);
  // More frames will observe most points.
  filter_.min_two_view_angle_rad = filter_.min_angle_rad;
  if (model.points.empty()) return;
  loss_scale_px_ = LossScalePx(options, sigma_px);
  median_distance_ =
      MedianDistance(input_.scene, model, input_.context.num_threads);
}

// ---------------------------------------------------------------- adjustment

std::vector<int> GrowingModel::NeighborsOf(int frame_idx) const {
  std::vector<std::pair<int, int>> shared;  // minus the number of points, frame
  std::vector<int> num_shared(model_.rig_from_world.size(), 0);
  for (const int track_idx : TracksOf({frame_idx})) {
    int last = frame_idx;
    for (const Observation& o : points_[track_idx].track) {
      const int other = input_.scene.images[o.image_idx].frame_idx;
      if (other == last || other == frame_idx) continue;
      ++num_shared[other];
      last = other;
    }
  }
  for (size_t i = 0; i < num_shared.size(); ++i) {
    if (num_shared[i] == 0) continue;
    shared.emplace_back(-num_shared[i], static_cast<int>(i));
  }
  const size_t num = std::min(kNumNeighbors, shared.size());
  std::partial_sort(shared.begin(), shared.begin() + num, shared.end());
  std::vector<int> neighbors = {frame_idx};
  for (size_t i = 0; i < num; ++i) neighbors.push_back(shared[i].second);
  return neighbors;
}

void GrowingModel::AdjustAround(int frame_idx) {
  const std::vector<int> frame_idxs = NeighborsOf(frame_idx);
  const std::vector<int> track_idxs = TracksOf(frame_idxs);
  FixedPoses fixed{Mask(model_.rig_from_world.size(), true),
                   Mask(model_.sensor_from_rig.size(), true)};
  for (const int i : frame_idxs) fixed.frames[i] = input_.IsHeld(i);
  BundleAdjustmentOptions options =
      GrowthOptions(input_.options.bundle_adjustment, loss_scale_px_);
  options.HoldIntrinsics();
  Reconstruction seen = model_;
  std::vector<int> used;
  for (const int track_idx : track_idxs) {
    if (points_[track_idx].track.empty()) continue;
    seen.points.push_back(points_[track_idx]);
    used.push_back(track_idx);
  }
  if (used.empty()) return;
  const Reconstruction adjusted =
      AdjustBundle(input_.scene, seen, options, input_.context, {}, fixed)
          .estimate;
  model_.rig_from_world = adjusted.rig_from_world;
  for (size_t k = 0; k < used.size(); ++k) {
    points_[used[k]].point_in_world = adjusted.points[k].point_in_world;
  }
  UpdateViews(frame_idxs);
  TriangulateTracks(track_idxs);
}

void GrowingModel::AdjustAll() {
  const Reconstruction start = WithPoints();
  if (start.points.empty()) return;
  const BundleAdjustmentOptions options =
      GrowthOptions(input_.options.bundle_adjustment, loss_scale_px_);
  const Reconstruction adjusted = AdjustBundle(input_.scene, start, options,
                                               input_.context, {}, input_.held)
                                      .estimate;
  size_t next = 0;
  for (Point3D& point : points_) {
    if (point.track.empty()) continue;
    point.point_in_world = adjusted.points[next++].point_in_world;
  }
  SetPoses(adjusted);
  UpdateFilter();
  TriangulateAll();
}

void GrowingModel::DropFramesWithFewPoints() {
  std::vector<int> num_of_frame(model_.rig_from_world.size(), 0);
  for (const Point3D& point : points_) {
    for (const Observation& o : point.track) {
      ++num_of_frame[input_.scene.images[o.image_idx].frame_idx];
    }
  }
  for (size_t i = 0; i < num_of_frame.size(); ++i) {
    const int frame_idx = static_cast<int>(i);
    if (!HasFrame(frame_idx) || input_.IsHeld(frame_idx) ||
        num_of_frame[i] >=
            input_.options.bundle_adjustment.min_num_observations_per_frame) {
      continue;
    }
    const std::vector<int> track_idxs = TracksOf({frame_idx});
    SetFrame(frame_idx, std::nullopt);
    TriangulateTracks(track_idxs);
  }
}

Reconstruction GrowingModel::WithPoints() const {
  Reconstruction model = model_;
  for (const Point3D& point : points_) {
    if (!point.track.empty()) model.points.push_back(point);
  }
  return model;
}

}  // namespace mgsfm
