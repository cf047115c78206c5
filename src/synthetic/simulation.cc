// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/synthetic/simulation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "mgsfm/base/error.h"
#include "mgsfm/base/random.h"
#include "mgsfm/geometry/so3.h"
#include "synthetic/rig_presets.h"

namespace mgsfm {
namespace {

// Streams of the random generator, so that switching one effect on leaves all
// others as they were.
enum RandomStream : uint64_t { kPoints, kMissing, kKeypoints, kPairs };

std::vector<Rigid3> MakePath(const SimulationOptions& options) {
  std::vector<Rigid3> rig_from_world;
  Eigen::Vector3d center = Eigen::Vector3d::Zero();
  const double loop_turn = 2.0 * kPi / options.num_frames;
  for (int i = 0; i < options.num_frames; ++i) {
    const double distance = i * options.frame_spacing_m;
    double yaw = 0.0, pitch = 0.0, roll = 0.0;
    if (options.path == PathPreset::kLoop) {
      yaw = loop_turn * i;
    } else if (options.path == PathPreset::kCurve) {
      yaw = 0.7 * std::sin(distance / 12.0);
      pitch = 0.08 * std::sin(distance / 7.0);
      roll = 0.05 * std::sin(distance / 5.0 + 1.0);
    }
    const Eigen::Quaterniond world_from_rig =
        ExpSO3(Eigen::Vector3d(0.0, yaw, 0.0)) *
        ExpSO3(Eigen::Vector3d(pitch, 0.0, 0.0)) *
        ExpSO3(Eigen::Vector3d(0.0, 0.0, roll));
    rig_from_world.push_back(
        Rigid3::FromRotationAndCenter(world_from_rig.conjugate(), center));
    if (options.path != PathPreset::kStanding) {
      // The chord of the turn to the next frame, so that loops close exactly.
      const double half_turn =
          options.path == PathPreset::kLoop ? 0.5 * loop_turn : 0.0;
      center +=
          options.frame_spacing_m *
          (world_from_rig * (ExpSO3(Eigen::Vector3d(0.0, half_turn, 0.0)) *
                             Eigen::Vector3d::UnitZ()));
    }
  }
  return rig_from_world;
}

// Points of walls on both sides, of the ground and of the sky line.
std::vector<Eigen::Vector3d> MakePoints(const SimulationOptions& options,
                                        const std::vector<Rigid3>& path) {
  Random random(options.random_seed, kPoints);
  std::vector<Eigen::Vector3d> points;
  points.reserve(path.size() * options.num_points_per_frame);
  for (const Rigid3& rig_from_world : path) {
    const Rigid3 world_from_rig = rig_from_world.Inverse();
    for (int i = 0; i < options.num_points_per_frame; ++i) {
      const double side = random.Uniform() < 0.5 ? -1.0 : 1.0;
      const Eigen::Vector3d point_in_rig(
          side * random.Uniform(2.0, 14.0), random.Uniform(-6.0, 1.6),
          random.Uniform(-10.0, options.max_visible_distance_m));
      points.push_back(world_from_rig * point_in_rig);
    }
  }
  return points;
}

struct Feature {
  int point_idx;
  Eigen::Vector2f keypoint_px;
};

// What one image sees, sorted by point. Where there is too much, the points
// with the lowest priority rank are left out: the same in all images, so that
// tracks stay long.
std::vector<Feature> SeePoints(const SimulationOptions& options,
                               const SimulatedCamera& camera,
                               const Rigid3& cam_from_world,
                               const std::vector<Eigen::Vector3d>& points,
                               const std::vector<int>& candidates,
                               const std::vector<uint64_t>& priority,
                               Random* random) {
  std::vector<Feature> features;
  for (const int point_idx : candidates) {
    const Eigen::Vector3d point_in_cam = cam_from_world * points[point_idx];
    if (point_in_cam.norm() > options.max_visible_distance_m) continue;
    const auto pixel =
        ProjectToPixel(camera.model, camera.params.data(), point_in_cam);
    if (!pixel || pixel->x() < 0 || pixel->y() < 0 ||
        pixel->x() >= camera.width_px || pixel->y() >= camera.height_px) {
      continue;
    }
    features.push_back({point_idx, pixel->cast<float>()});
  }
  const size_t num_kept = options.max_num_features_per_image;
  if (features.size() > num_kept) {
    std::nth_element(features.begin(), features.begin() + num_kept,
                     features.end(), [&](const Feature& a, const Feature& b) {
                       return priority[a.point_idx] < priority[b.point_idx];
                     });
    features.resize(num_kept);
  }
  std::sort(features.begin(), features.end(),
            [](const Feature& a, const Feature& b) {
              return a.point_idx < b.point_idx;
            });
  for (Feature& feature : features) {
    feature.keypoint_px += (options.pixel_noise_px *
                            Eigen::Vector2d(random->Normal(), random->Normal()))
                               .cast<float>();
  }
  return features;
}

class Simulator {
 public:
  explicit Simulator(const SimulationOptions& options)
      : options_(options),
        rig_(MakeRig(options.rig)),
        path_(MakePath(options)),
        points_(MakePoints(options, path_)) {}

  Simulation Run() {
    AddRig();
    AddImages();
    SeeAllPoints();
    AddPairs();
    AddGroundTruth();
    CheckConsistent(simulation_.scene);
    return std::move(simulation_);
  }

 private:
  void AddRig();
  void AddImages();
  void SeeAllPoints();
  std::vector<int> PointsNear(const Eigen::Vector3d& center) const;
  void AddPairs();
  bool ShouldMatch(const Image& image1, const Image& image2) const;
  void AddPair(int image_idx1, int image_idx2, Random* random);
  std::vector<Match> CommonPoints(int image_idx1, int image_idx2) const;
  void AddGroundTruth();

  const SimulationOptions options_;
  const std::vector<SimulatedCamera> rig_;
  const std::vector<Rigid3> path_;
  const std::vector<Eigen::Vector3d> points_;
  std::vector<int> path_idx_;  // per frame: its place on the path
  std::vector<std::vector<int>> point_idxs_;  // per image and keypoint
  Simulation simulation_;
};

void Simulator::AddRig() {
  Scene& scene = simulation_.scene;
  Rig rig{RigId(5), 0, {}};
  for (size_t i = 0; i < rig_.size(); ++i) {
    const SimulatedCamera& camera = rig_[i];
    scene.cameras.push_back({CameraId(static_cast<uint32_t>(3 * i + 4)),
                             camera.model, camera.width_px, camera.height_px,
                             camera.params, true});
    const int idx = static_cast<int>(i);
    Sensor sensor{camera.folder, 0, idx, std::nullopt};
    if (i == 0 || options_.extrinsics_are_known) {
      sensor.sensor_from_rig = camera.sensor_from_rig;
    }
    scene.sensors.push_back(sensor);
    rig.sensor_idxs.push_back(idx);
  }
  scene.rigs.push_back(rig);
}

void Simulator::AddImages() {
  Scene& scene = simulation_.scene;
  Random random(options_.random_seed, kMissing);
  std::vector<int> frame_idx_of_path(path_.size(), -1);
  for (size_t sensor_idx = 0; sensor_idx < rig_.size(); ++sensor_idx) {
    for (size_t path_idx = 0; path_idx < path_.size(); ++path_idx) {
      if (random.Uniform() < options_.missing_image_ratio) continue;
      char frame_name[32];
      std::snprintf(frame_name, sizeof(frame_name), "%06zu.png", path_idx);
      int& frame_idx = frame_idx_of_path[path_idx];
      if (frame_idx < 0) {
        frame_idx = static_cast<int>(scene.frames.size());
        scene.frames.push_back(
            {FrameId(static_cast<uint32_t>(2 * path_idx + 9)),
             frame_name,
             0,
             {}});
        path_idx_.push_back(static_cast<int>(path_idx));
      }
      const int image_idx = static_cast<int>(scene.images.size());
      scene.frames[frame_idx].image_idxs.push_back(image_idx);
      scene.images.push_back(
          {ImageId(static_cast<uint32_t>(path_idx * 8 + sensor_idx + 1)),
           rig_[sensor_idx].folder + "/" + frame_name,
           static_cast<int>(sensor_idx),
           static_cast<int>(sensor_idx),
           frame_idx,
           {}});
    }
  }
}

std::vector<int> Simulator::PointsNear(const Eigen::Vector3d& center) const {
  // Points lie within this distance of the place on the path they belong to.
  const double reach = 2.0 * options_.max_visible_distance_m + 20.0;
  std::vector<int> candidates;
  for (size_t i = 0; i < path_.size(); ++i) {
    if ((path_[i].Center() - center).norm() > reach) continue;
    const int begin = static_cast<int>(i) * options_.num_points_per_frame;
    for (int j = 0; j < options_.num_points_per_frame; ++j) {
      candidates.push_back(begin + j);
    }
  }
  return candidates;
}

void Simulator::SeeAllPoints() {
  Scene& scene = simulation_.scene;
  std::vector<uint64_t> priority(points_.size());
  Random priority_random(options_.random_seed, kPoints);
  for (uint64_t& p : priority) p = priority_random.NextBits();
  point_idxs_.resize(scene.images.size());
  for (const Frame& frame : scene.frames) {
    const int path_idx = path_idx_[&frame - scene.frames.data()];
    const std::vector<int> candidates = PointsNear(path_[path_idx].Center());
    for (const int image_idx : frame.image_idxs) {
      Image& image = scene.images[image_idx];
      Random random(options_.random_seed + kKeypoints, image.id.value());
      const SimulatedCamera& camera = rig_[image.sensor_idx];
      for (const Feature& feature :
           SeePoints(options_, camera, camera.sensor_from_rig * path_[path_idx],
                     points_, candidates, priority, &random)) {
        image.keypoints_px.push_back(feature.keypoint_px);
        point_idxs_[image_idx].push_back(feature.point_idx);
      }
    }
  }
}

bool Simulator::ShouldMatch(const Image& image1, const Image& image2) const {
  if (!options_.match_different_sensors &&
      image1.sensor_idx != image2.sensor_idx) {
    return false;
  }
  const int num_frames = options_.num_frames;
  int gap = std::abs(path_idx_[image1.frame_idx] - path_idx_[image2.frame_idx]);
  if (options_.path == PathPreset::kLoop) gap = std::min(gap, num_frames - gap);
  return gap <= options_.num_matched_frames;
}

void Simulator::AddPairs() {
  const std::vector<Image>& images = simulation_.scene.images;
  Random random(options_.random_seed, kPairs);
  for (size_t i = 0; i < images.size(); ++i) {
    for (size_t j = i + 1; j < images.size(); ++j) {
      if (!ShouldMatch(images[i], images[j])) continue;
      AddPair(static_cast<int>(i), static_cast<int>(j), &random);
    }
  }
}

std::vector<Match> Simulator::CommonPoints(int image_idx1,
                                           int image_idx2) const {
  const std::vector<int>& points1 = point_idxs_[image_idx1];
  const std::vector<int>& points2 = point_idxs_[image_idx2];
  std::vector<Match> matches;
  for (size_t i = 0, j = 0; i < points1.size() && j < points2.size();) {
    if (points1[i] < points2[j]) {
      ++i;
    } else if (points2[j] < points1[i]) {
      ++j;
    } else {
      matches.push_back(
          {static_cast<uint32_t>(i++), static_cast<uint32_t>(j++)});
    }
  }
  return matches;
}

void Simulator::AddPair(int image_idx1, int image_idx2, Random* random) {
  const Image& image1 = simulation_.scene.images[image_idx1];
  const Image& image2 = simulation_.scene.images[image_idx2];
  ImagePair pair;
  pair.image_idx1 = image_idx1;
  pair.image_idx2 = image_idx2;
  pair.config = TwoViewConfig::kCalibrated;
  pair.matches = CommonPoints(image_idx1, image_idx2);
  if (static_cast<int>(pair.matches.size()) < options_.min_num_matches) return;

  const auto random_vector = [random] {
    return Eigen::Vector3d(random->Normal(), random->Normal(),
                           random->Normal());
  };
  const Rigid3 cam1_from_world = rig_[image1.sensor_idx].sensor_from_rig *
                                 path_[path_idx_[image1.frame_idx]];
  const Rigid3 cam2_from_world = rig_[image2.sensor_idx].sensor_from_rig *
                                 path_[path_idx_[image2.frame_idx]];
  Rigid3 cam2_from_cam1 = cam2_from_world * cam1_from_world.Inverse();
  const auto num_keypoints2 = static_cast<uint32_t>(image2.keypoints_px.size());
  double mismatch_ratio = options_.mismatch_ratio;
  if (random->Uniform() < options_.wrong_pair_ratio) {
    cam2_from_cam1 = {ExpSO3(random_vector()), random_vector()};
    pair.matches.resize(options_.min_num_matches);
    mismatch_ratio = 1.0;
  }
  for (Match& match : pair.matches) {
    if (random->Uniform() < mismatch_ratio) {
      match.keypoint_idx2 = random->Index(num_keypoints2);
    }
  }
  const double noise = DegToRad(options_.relative_rotation_noise_deg);
  RelativePose relative_pose{
      cam2_from_cam1.rotation * ExpSO3(noise * random_vector()), std::nullopt};
  if (cam2_from_cam1.translation.norm() > 1e-9) {
    relative_pose.translation_direction =
        cam2_from_cam1.translation.normalized();
    pair.E = CrossMatrix(*relative_pose.translation_direction) *
             relative_pose.cam2_from_cam1.toRotationMatrix();
  }
  pair.relative_pose = relative_pose;
  simulation_.view_graph.pairs.push_back(std::move(pair));
}

void Simulator::AddGroundTruth() {
  const Scene& scene = simulation_.scene;
  Reconstruction& truth = simulation_.ground_truth;
  truth.cameras = scene.cameras;
  for (const SimulatedCamera& camera : rig_) {
    truth.sensor_from_rig.emplace_back(camera.sensor_from_rig);
  }
  for (const int path_idx : path_idx_) {
    truth.rig_from_world.emplace_back(path_[path_idx]);
  }
  std::vector<Point3D> points(points_.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    for (size_t j = 0; j < point_idxs_[i].size(); ++j) {
      points[point_idxs_[i][j]].track.push_back(
          {static_cast<int>(i), static_cast<int>(j)});
    }
  }
  for (size_t i = 0; i < points.size(); ++i) {
    if (points[i].track.size() < 2) continue;
    points[i].point_in_world = points_[i];
    truth.points.push_back(std::move(points[i]));
  }
}

}  // namespace

Simulation Simulate(const SimulationOptions& options) {
  MGSFM_CHECK_GT(options.num_frames, 0);
  return Simulator(options).Run();
}

}  // namespace mgsfm
