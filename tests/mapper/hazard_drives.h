// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/random.h"
#include "geometry/so3.h"
#include "mgsfm/evaluation/evaluation.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"

// Drives on which other systems crash or return wrong results without a
// warning. docs/development/testing.md lists all of them.

namespace mgsfm {

// A database without rigs, and the true poses by image name.
struct Drive {
  DatabaseContents contents;
  std::map<std::string, Rigid3> true_poses;
};

inline SimulationOptions SmallDrive(RigPreset rig, int num_frames = 12) {
  SimulationOptions options;
  options.rig = rig;
  options.num_frames = num_frames;
  options.max_num_features_per_image = 200;
  options.pixel_noise_px = 0.3;
  return options;
}

inline Drive MakeDrive(const Simulation& simulation) {
  const Scene& scene = simulation.scene;
  Drive drive{MakeDatabaseContents(scene, simulation.view_graph), {}};
  drive.contents.path = "simulated.db";
  for (size_t i = 0; i < scene.images.size(); ++i) {
    drive.true_poses[scene.images[i].name] =
        *simulation.ground_truth.CamFromWorld(scene, static_cast<int>(i));
  }
  return drive;
}

inline Drive MakeDriveWithoutRigs(const SimulationOptions& options) {
  Drive drive = MakeDrive(Simulate(options));
  drive.contents.rigs.clear();
  drive.contents.frames.clear();
  return drive;
}

inline std::string NameOf(const DatabaseContents& contents, ImageId id) {
  for (const ImageRow& image : contents.images) {
    if (image.id == id) return image.name;
  }
  return "";
}

inline bool Contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

// Removes the pairs whose image names satisfy the predicate.
inline void RemovePairs(
    const std::function<bool(const std::string&, const std::string&)>& is_bad,
    DatabaseContents* contents) {
  auto& pairs = contents->pairs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                             [&](const TwoViewGeometryRow& pair) {
                               return is_bad(NameOf(*contents, pair.image_id1),
                                             NameOf(*contents, pair.image_id2));
                             }),
              pairs.end());
}

inline void RemoveImages(const std::function<bool(const std::string&)>& is_bad,
                         DatabaseContents* contents) {
  RemovePairs(
      [&](const std::string& name1, const std::string& name2) {
        return is_bad(name1) || is_bad(name2);
      },
      contents);
  auto& images = contents->images;
  images.erase(
      std::remove_if(images.begin(), images.end(),
                     [&](const ImageRow& image) { return is_bad(image.name); }),
      images.end());
}

struct Outcome {
  Scene scene;
  MapperResult result;
};

inline Outcome Map(const Drive& drive, int min_num_frames = 3) {
  Context context;
  context.num_threads = 2;
  LoadedScene loaded =
      LoadScene(drive.contents, SceneLoadingOptions(), context);
  MapperOptions options;
  options.min_num_frames = min_num_frames;
  MapperResult result =
      RunMapper({loaded.scene, loaded.view_graph}, options, context);
  return {std::move(loaded.scene), std::move(result)};
}

inline Evaluation EvaluateModel(const Drive& drive, const Outcome& outcome,
                                size_t model_idx = 0) {
  const Reconstruction& model = outcome.result.models[model_idx].reconstruction;
  std::vector<ImagePoses> images;
  for (size_t i = 0; i < outcome.scene.images.size(); ++i) {
    const Image& image = outcome.scene.images[i];
    const bool is_reference = outcome.scene.IsReference(image.sensor_idx);
    images.push_back({image.name, is_reference,
                      model.CamFromWorld(outcome.scene, static_cast<int>(i)),
                      drive.true_poses.at(image.name)});
  }
  return Evaluate(images, true, {}, {});
}

inline void ExpectRight(const Evaluation& evaluation) {
  ASSERT_TRUE(evaluation.position_m.has_value());
  EXPECT_LT(evaluation.position_m->max, 0.05);
  EXPECT_LT(evaluation.rotation_deg->max, 0.2);
}

// Relative rotations need no alignment; an alignment by positions is inaccurate
// on a path of a few meters.
inline void ExpectRightRotations(const Drive& drive, const Outcome& outcome) {
  ASSERT_EQ(outcome.result.models.size(), 1u);
  const Reconstruction& model = outcome.result.models[0].reconstruction;
  const auto rotation_from_first = [&](int i) {
    const auto first = model.CamFromWorld(outcome.scene, 0);
    const auto pose = model.CamFromWorld(outcome.scene, i);
    EXPECT_TRUE(first && pose);
    return Eigen::Quaterniond(pose->rotation * first->rotation.conjugate());
  };
  const auto true_rotation_from_first = [&](int i) {
    const auto rotation = [&](int k) {
      return drive.true_poses.at(outcome.scene.images[k].name).rotation;
    };
    return Eigen::Quaterniond(rotation(i) * rotation(0).conjugate());
  };
  for (size_t i = 0; i < outcome.scene.images.size(); ++i) {
    const int idx = static_cast<int>(i);
    EXPECT_LT(RadToDeg(AngleBetween(rotation_from_first(idx),
                                    true_rotation_from_first(idx))),
              0.2);
  }
}

// Requires one model of all frames.
inline void ExpectAllRight(const Drive& drive, const Outcome& outcome) {
  ASSERT_EQ(outcome.result.models.size(), 1u);
  const Evaluation evaluation = EvaluateModel(drive, outcome);
  EXPECT_EQ(evaluation.num_registered,
            static_cast<int>(drive.contents.images.size()));
  EXPECT_TRUE(outcome.result.unregistered_frames.empty());
  ExpectRight(evaluation);
}

// Offsets all ids and names of a drive, so that another drive can be added.
inline void Rename(
    const std::function<std::string(const std::string&)>& new_name,
    uint32_t id_offset, Drive* drive) {
  const auto shift = [id_offset](auto* id) {
    *id = std::decay_t<decltype(*id)>(id->value() + id_offset);
  };
  DatabaseContents& contents = drive->contents;
  std::map<std::string, Rigid3> true_poses;
  for (Camera& camera : contents.cameras) shift(&camera.id);
  for (ImageRow& image : contents.images) {
    true_poses[new_name(image.name)] = drive->true_poses.at(image.name);
    image.name = new_name(image.name);
    shift(&image.id);
    shift(&image.camera_id);
  }
  for (TwoViewGeometryRow& pair : contents.pairs) {
    shift(&pair.image_id1);
    shift(&pair.image_id2);
  }
  for (RigRow& rig : contents.rigs) {
    shift(&rig.id);
    if (rig.ref_camera_id) shift(&*rig.ref_camera_id);
    for (RigSensorRow& sensor : rig.sensors) shift(&sensor.camera_id);
  }
  for (FrameRow& frame : contents.frames) {
    shift(&frame.id);
    shift(&frame.rig_id);
    for (FrameDataRow& data : frame.data) {
      shift(&data.camera_id);
      shift(&data.image_id);
    }
  }
  drive->true_poses = true_poses;
}

template <class T>
void Append(const std::vector<T>& from, std::vector<T>* to) {
  to->insert(to->end(), from.begin(), from.end());
}

inline Drive Join(const Drive& a, const Drive& b) {
  Drive joint = a;
  Append(b.contents.cameras, &joint.contents.cameras);
  Append(b.contents.images, &joint.contents.images);
  Append(b.contents.pairs, &joint.contents.pairs);
  Append(b.contents.rigs, &joint.contents.rigs);
  Append(b.contents.frames, &joint.contents.frames);
  joint.true_poses.insert(b.true_poses.begin(), b.true_poses.end());
  return joint;
}

constexpr uint32_t kIdOffset = 10000;

// The keypoints of each image, by the world point they show.
inline std::map<std::string, std::map<double, uint32_t>> KeypointsByPoint(
    const Simulation& simulation) {
  std::map<std::string, std::map<double, uint32_t>> keypoints;
  for (const Point3D& point : simulation.ground_truth.points) {
    for (const Observation& o : point.track) {
      keypoints[simulation.scene.images[o.image_idx].name]
               [point.point_in_world.x()] =
                   static_cast<uint32_t>(o.keypoint_idx);
    }
  }
  return keypoints;
}

// Replaces the world points that the keypoints of an image show.
using PointsOfKeypoints =
    std::map<std::string, std::map<uint32_t, Eigen::Vector3d>>;
inline PointsOfKeypoints PointsByKeypoint(const Simulation& simulation) {
  PointsOfKeypoints points;
  for (const Point3D& point : simulation.ground_truth.points) {
    for (const Observation& o : point.track) {
      points[simulation.scene.images[o.image_idx].name]
            [static_cast<uint32_t>(o.keypoint_idx)] = point.point_in_world;
    }
  }
  return points;
}

inline ImageRow& ImageOf(const std::string& name, DatabaseContents* contents) {
  return *std::find_if(contents->images.begin(), contents->images.end(),
                       [&](const ImageRow& row) { return row.name == name; });
}

// Adds an image pair that agrees perfectly with a wrong pose of the second
// image: its new keypoints show the points of the first image as seen from that
// pose.
inline void AddWrongPair(const PointsOfKeypoints& points,
                         const std::string& name1, const std::string& name2,
                         const Rigid3& wrong_cam2_from_world, Drive* drive) {
  DatabaseContents& contents = drive->contents;
  ImageRow& image2 = ImageOf(name2, &contents);
  TwoViewGeometryRow pair{ImageOf(name1, &contents).id,
                          image2.id,
                          TwoViewConfig::kCalibrated,
                          {},
                          {},
                          {},
                          {},
                          {}};
  const Camera& camera =
      *std::find_if(contents.cameras.begin(), contents.cameras.end(),
                    [&](const Camera& c) { return c.id == image2.camera_id; });
  for (const auto& [keypoint, point] : points.at(name1)) {
    const auto pixel = ProjectToPixel(camera.model, camera.params.data(),
                                      wrong_cam2_from_world * point);
    if (!pixel || pixel->minCoeff() < 0.0 || pixel->x() > camera.width_px ||
        pixel->y() > camera.height_px) {
      continue;
    }
    pair.matches.push_back(
        {keypoint, static_cast<uint32_t>(image2.keypoints_px.size())});
    image2.keypoints_px.push_back(pixel->cast<float>());
  }
  ASSERT_GE(pair.matches.size(), 40u);
  pair.cam2_from_cam1 =
      wrong_cam2_from_world * drive->true_poses.at(name1).Inverse();
  if (pair.image_id2 < pair.image_id1) SwapImages(&pair);
  contents.pairs.push_back(std::move(pair));
}

inline std::string FrameNameOf(const Outcome& outcome,
                               const UnregisteredFrame& frame) {
  return outcome.scene.frames[frame.frame_idx].name;
}

}  // namespace mgsfm
