// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "fuzz/fuzz_target.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/model_scene.h"

namespace mgsfm {

constexpr const char* kModelStems[] = {"cameras", "images", "points3D", "rigs",
                                       "frames"};

inline void FuzzCheckFinite(const Rigid3& pose) {
  FUZZ_CHECK(pose.translation.allFinite());
  FUZZ_CHECK(std::abs(pose.rotation.norm() - 1.0) < 1e-9);
}

inline void FuzzCheckFinite(const Model& model) {
  for (const ModelImage& image : model.poses.images) {
    FuzzCheckFinite(image.cam_from_world);
  }
  for (const ModelFrame& frame : model.poses.frames) {
    FuzzCheckFinite(frame.rig_from_world);
  }
  for (const RigRow& rig : model.poses.rigs) {
    for (const RigSensorRow& sensor : rig.sensors) {
      if (sensor.sensor_from_rig) FuzzCheckFinite(*sensor.sensor_from_rig);
    }
  }
  for (const Camera& camera : model.cameras) {
    for (const double param : camera.params) FUZZ_CHECK(std::isfinite(param));
  }
  for (const ModelPoint& point : model.points) {
    FUZZ_CHECK(point.point_in_world.allFinite());
    FUZZ_CHECK(!point.error_px || std::isfinite(*point.error_px));
  }
  for (const auto& keypoints : model.keypoints) {
    for (const ModelKeypoint& keypoint : keypoints) {
      FUZZ_CHECK(keypoint.position_px.allFinite());
    }
  }
}

inline std::vector<std::string> ReadModelFiles(
    const std::filesystem::path& folder, const std::string& extension) {
  std::vector<std::string> files;
  for (const char* stem : kModelStems) {
    files.push_back(ReadTextFile(folder / (stem + extension)));
  }
  return files;
}

// If a model forms a scene, the model written from it must read back
// identically. `source` is the path in messages.
inline void FuzzCheckReadsBack(const Model& model,
                               const std::filesystem::path& source,
                               ModelFormat format) {
  namespace fs = std::filesystem;
  const std::string extension = format == ModelFormat::kText ? ".txt" : ".bin";
  const fs::path folders[] = {FuzzFolder() / "out", FuzzFolder() / "again"};
  for (const fs::path& folder : folders) fs::create_directories(folder);
  FuzzCheckFinite(model);
  ModelScene scene;
  if (!Accepts([&] { scene = MakeModelScene(model, source, {}, {}); }) ||
      !Accepts([&] {
        WriteModel(folders[0], scene.scene, scene.reconstruction, format);
      })) {
    return;
  }
  CheckConsistent(scene.scene);
  const ModelScene again = LoadModelScene(folders[0], {}, {});
  WriteModel(folders[1], again.scene, again.reconstruction, format);
  FUZZ_CHECK(ReadModelFiles(folders[0], extension) ==
             ReadModelFiles(folders[1], extension));
}

// Reads the five files of a model.
inline void FuzzModel(const std::string& input, ModelFormat format) {
  namespace fs = std::filesystem;
  const std::string extension = format == ModelFormat::kText ? ".txt" : ".bin";
  const fs::path folder = FuzzFolder() / "in";
  fs::create_directories(folder);
  const std::vector<std::string> files = SplitFiles(input, 5);
  for (size_t i = 0; i < files.size(); ++i) {
    // Models of COLMAP before 3.12 lack the last two.
    const fs::path path = folder / (kModelStems[i] + extension);
    fs::remove(path);
    if (i < 3 || !files[i].empty()) WriteTextFile(path, files[i]);
  }
  Model model;
  Accepts([&] { return ReadModelPoses(folder); });
  if (!Accepts([&] { model = ReadModel(folder); })) return;
  FuzzCheckReadsBack(model, folder, format);
}

}  // namespace mgsfm
