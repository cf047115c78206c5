// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "bundle_adjustment/point_filters.h"
#include "geometry/absolute_pose.h"
#include "mgsfm/incremental/incremental_mapping.h"

namespace mgsfm {

// A keypoint of an image and its track.
struct TrackKeypoint {
  int keypoint_idx = 0;
  int track_idx = 0;
};

// The fixed data of all models of a run.
struct GrowthInput : IncrementalInput {
  const IncrementalOptions& options;
  const Context& context;
  const ObservationGroups& tracks;
  std::vector<std::vector<TrackKeypoint>> keypoints;  // per image
  // Per frame: its neighbors in a sequence that used pairs join to it,
  // ascending.
  std::vector<std::vector<int>> sequence_neighbors;
  FixedPoses held = {};

  bool IsHeld(int frame_idx) const {
    return !held.frames.empty() && held.frames[frame_idx];
  }
};

// A model that grows by frames, with at most one point per track.
class GrowingModel {
 public:
  // Without frames. `sensors` are the sensor poses of earlier models.
  GrowingModel(const GrowthInput& input,
               std::vector<std::optional<Rigid3>> sensors);
  GrowingModel(const GrowingModel&) = delete;  // views refer to the poses
  GrowingModel& operator=(const GrowingModel&) = delete;

  // Poses and cameras; without points.
  const Reconstruction& poses() const { return model_; }
  bool HasSensor(int sensor_idx) const {
    return model_.sensor_from_rig[sensor_idx].has_value();
  }
  bool HasFrame(int frame_idx) const {
    return model_.rig_from_world[frame_idx].has_value();
  }
  int num_frames() const { return num_frames_; }
  size_t num_points() const { return num_points_; }
  size_t NumObservations() const;
  // The median distance of points from the images that observe them, as of the
  // last filtering.
  double median_distance() const { return median_distance_; }

  bool HasNeighborInModel(int frame_idx) const;
  // The fewest points with which the frame may register.
  int MinNumInliers(int frame_idx) const;

  void SetFrame(int frame_idx, const std::optional<Rigid3>& rig_from_world);
  void SetSensor(int sensor_idx, const Rigid3& sensor_from_rig);

  // Keypoints of an image, or of the images of a frame with placed sensors,
  // with tracks that have points.
  int NumVisible(int image_idx) const { return num_visible_[image_idx]; }
  int NumVisibleInFrame(int frame_idx) const;
  // The spread of these keypoints over the images of the frame, in weighted
  // cells.
  int Spread(int frame_idx) const;

  // The points that an image observes if its tracks are right, and their
  // tracks.
  struct Matches {
    CameraPoints points;
    std::vector<int> track_idxs;
  };
  Matches MatchesOf(int image_idx, const Rigid3& cam_from_unit) const;
  // The same for all images of a frame with placed sensors.
  std::vector<Matches> MatchesOfFrame(int frame_idx) const;
  const std::vector<Observation>& ObserversOf(int track_idx) const {
    return points_[track_idx].track;
  }

  // Triangulates the tracks of frames anew.
  void Triangulate(const std::vector<int>& frame_idxs);
  // Adjusts a frame and its neighbors, and triangulates their tracks.
  void AdjustAround(int frame_idx);
  // Adjusts everything, and triangulates all tracks.
  void AdjustAll();
  // Removes frames with fewer observations than bundle adjustment calls weak.
  void DropFramesWithFewPoints();
  // Replaces all poses, and triangulates all tracks.
  void MoveTo(const Reconstruction& moved);
  // Takes the poses, cameras and points of another model. Only tracks that are
  // no points of it are triangulated.
  void StartFrom(const Reconstruction& existing);

  Reconstruction WithPoints() const;

 private:
  void UpdateViews(const std::vector<int>& frame_idxs);
  // The poses and cameras.
  void SetPoses(const Reconstruction& poses);
  void UpdateFilter();
  void TriangulateAll();
  void TriangulateTracks(const std::vector<int>& track_idxs);
  void SetPoint(int track_idx, std::optional<Point3D> point);
  std::vector<int> TracksOf(const std::vector<int>& frame_idxs) const;
  std::vector<int> NeighborsOf(int frame_idx) const;

  const GrowthInput& input_;
  Bearings own_bearings_;  // of refined cameras; empty before
  Reconstruction model_;
  std::vector<ImageView> views_;  // refer to model_
  std::vector<Point3D> points_;   // per track; without observations if none
  std::vector<int> num_visible_;  // per image
  int num_frames_ = 0;
  size_t num_points_ = 0;
  PointFilterOptions filter_;
  double loss_scale_px_ = 0.0;
  double median_distance_ = 1.0;
};

}  // namespace mgsfm
