// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "mgsfm/model_tools/model_tools.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

// Removes points with fewer than two observations: two rays determine a point.
void RemovePointsOfShortTracks(std::vector<Point3D>* points) {
  constexpr size_t kMinTrackLength = 2;
  EraseIf(points, [](const Point3D& point) {
    return point.track.size() < kMinTrackLength;
  });
}

// The new index of each item that is kept; -1 for the others.
std::vector<int> NumberKept(const Mask& keeps) {
  std::vector<int> new_idx(keeps.size(), -1);
  int next = 0;
  for (size_t i = 0; i < keeps.size(); ++i) {
    if (keeps[i]) new_idx[i] = next++;
  }
  return new_idx;
}

template <class Item>
void KeepItems(const std::vector<int>& new_idx, std::vector<Item>* items) {
  size_t num_kept = 0;
  for (size_t i = 0; i < items->size(); ++i) {
    if (new_idx[i] < 0) continue;
    if (num_kept != i) (*items)[num_kept] = std::move((*items)[i]);
    ++num_kept;
  }
  items->erase(items->begin() + static_cast<std::ptrdiff_t>(num_kept),
               items->end());
}

void KeepObservations(const std::vector<int>& new_image_idx,
                      std::vector<Point3D>* points) {
  for (Point3D& point : *points) {
    std::vector<Observation> track;
    for (const Observation& o : point.track) {
      if (new_image_idx[o.image_idx] < 0) continue;
      track.push_back({new_image_idx[o.image_idx], o.keypoint_idx});
    }
    point.track = std::move(track);
  }
  RemovePointsOfShortTracks(points);
}

}  // namespace

void KeepImages(const Mask& keeps_image, SceneModel* model) {
  Scene& scene = model->scene;
  MGSFM_CHECK_EQ(keeps_image.size(), scene.images.size());
  Mask keeps_frame(scene.frames.size(), false);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (keeps_image[i]) keeps_frame[scene.images[i].frame_idx] = true;
  }
  const std::vector<int> new_image_idx = NumberKept(keeps_image);
  const std::vector<int> new_frame_idx = NumberKept(keeps_frame);
  for (Frame& frame : scene.frames) {
    std::vector<int> image_idxs;
    for (const int image_idx : frame.image_idxs) {
      if (keeps_image[image_idx]) {
        image_idxs.push_back(new_image_idx[image_idx]);
      }
    }
    frame.image_idxs = std::move(image_idxs);
  }
  for (Image& image : scene.images) {
    image.frame_idx = new_frame_idx[image.frame_idx];
  }
  KeepItems(new_image_idx, &scene.images);
  KeepItems(new_frame_idx, &scene.frames);
  KeepItems(new_frame_idx, &model->reconstruction.rig_from_world);
  KeepObservations(new_image_idx, &model->reconstruction.points);
}

void KeepBox(const Eigen::AlignedBox3d& box, SceneModel* model) {
  std::vector<Point3D>& points = model->reconstruction.points;
  EraseIf(&points, [&](const Point3D& point) {
    return !box.contains(point.point_in_world);
  });
  Mask frame_observes(model->scene.frames.size(), false);
  for (const Point3D& point : points) {
    for (const Observation& o : point.track) {
      frame_observes[model->scene.images[o.image_idx].frame_idx] = true;
    }
  }
  Mask keeps_image;
  for (const Image& image : model->scene.images) {
    keeps_image.push_back(frame_observes[image.frame_idx]);
  }
  KeepImages(keeps_image, model);
}

Eigen::AlignedBox3d BoxOfQuantiles(const SceneModel& model, double lower,
                                   double upper) {
  const std::vector<Point3D>& points = model.reconstruction.points;
  MGSFM_CHECK(!points.empty());
  Eigen::AlignedBox3d box;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values = Transformed(points, [&](const Point3D& point) {
      return point.point_in_world[axis];
    });
    std::sort(values.begin(), values.end());
    const auto last = static_cast<double>(values.size() - 1);
    box.min()[axis] = values[static_cast<size_t>(lower * last)];
    box.max()[axis] = values[static_cast<size_t>(upper * last)];
  }
  return box;
}

void RemoveLargeErrors(double max_error_px, SceneModel* model) {
  std::vector<Point3D>& points = model->reconstruction.points;
  for (Point3D& point : points) {
    double sum_px = 0.0;
    size_t num_kept = 0;
    for (const Observation& o : point.track) {
      const auto residual_px = ResidualPx(model->scene, model->reconstruction,
                                          o, point.point_in_world);
      if (!residual_px || residual_px->norm() > max_error_px) continue;
      point.track[num_kept++] = o;
      sum_px += residual_px->norm();
    }
    point.track.resize(num_kept);
    point.track.shrink_to_fit();
    if (num_kept > 0) point.error_px = sum_px / static_cast<double>(num_kept);
  }
  RemovePointsOfShortTracks(&points);
}

ModelStatistics AnalyzeModel(const SceneModel& model) {
  const Scene& scene = model.scene;
  std::set<int> rig_idxs, camera_idxs, frame_idxs;
  ModelStatistics statistics;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    if (!model.reconstruction.IsRegistered(scene, static_cast<int>(i))) {
      continue;
    }
    const Sensor& sensor = scene.sensors[scene.images[i].sensor_idx];
    rig_idxs.insert(sensor.rig_idx);
    camera_idxs.insert(sensor.camera_idx);
    frame_idxs.insert(scene.images[i].frame_idx);
    ++statistics.num_images;
  }
  statistics.num_rigs = rig_idxs.size();
  statistics.num_cameras = camera_idxs.size();
  statistics.num_frames = frame_idxs.size();
  statistics.num_points = model.reconstruction.points.size();
  statistics.num_observations = NumObservations(model.reconstruction);
  const auto mean = [](size_t sum, size_t count) {
    return count == 0 ? 0.0
                      : static_cast<double>(sum) / static_cast<double>(count);
  };
  statistics.mean_track_length =
      mean(statistics.num_observations, statistics.num_points);
  statistics.mean_observations_per_image =
      mean(statistics.num_observations, statistics.num_images);
  statistics.mean_reprojection_error_px =
      MeanReprojectionErrorPx(model.reconstruction);
  return statistics;
}

}  // namespace mgsfm
