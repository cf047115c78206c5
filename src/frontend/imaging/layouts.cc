// SPDX-License-Identifier: BSD-3-Clause
#include "imaging/layouts.h"

#include <Eigen/Core>
#include <nlohmann/json.hpp>

#include "files/file_operations.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

nlohmann::ordered_json OpenGlPose(const Rigid3& cam_from_world) {
  const Rigid3 world_from_cam = cam_from_world.Inverse();
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = world_from_cam.rotation.toRotationMatrix() *
                                 Eigen::Vector3d(1, -1, -1).asDiagonal();
  matrix.topRightCorner<3, 1>() = world_from_cam.translation;
  nlohmann::ordered_json rows;
  for (int i = 0; i < 4; ++i) {
    rows.push_back({matrix(i, 0), matrix(i, 1), matrix(i, 2), matrix(i, 3)});
  }
  return rows;
}

}  // namespace

std::string NerfstudioTransforms(const Scene& scene,
                                 const Reconstruction& reconstruction,
                                 bool has_masks) {
  nlohmann::ordered_json frames = nlohmann::ordered_json::array();
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    const Camera& camera = reconstruction.cameras[image.camera_idx];
    nlohmann::ordered_json frame = {
        {"file_path", "images/" + image.name},
        {"fl_x", camera.params[0]},
        {"fl_y", camera.params[1]},
        {"cx", camera.params[2]},
        {"cy", camera.params[3]},
        {"w", camera.width_px},
        {"h", camera.height_px},
        {"transform_matrix",
         OpenGlPose(*reconstruction.CamFromWorld(scene, static_cast<int>(i)))}};
    if (has_masks) frame["mask_path"] = "masks/" + image.name + ".png";
    frames.push_back(std::move(frame));
  }
  const nlohmann::ordered_json transforms = {{"camera_model", "OPENCV"},
                                             {"ply_file_path", "sparse_pc.ply"},
                                             {"frames", std::move(frames)}};
  return transforms.dump(1) + "\n";
}

void WriteStereoFolder(const fs::path& folder, const Scene& scene) {
  std::string patch_match, fusion;
  for (const Image& image : scene.images) {
    patch_match += image.name + "\n__auto__, 20\n";
    fusion += image.name + "\n";
    for (const char* result :
         {"depth_maps", "normal_maps", "consistency_graphs"}) {
      fs::create_directories((folder / result / image.name).parent_path());
    }
  }
  ReplaceFile(folder / "patch-match.cfg", patch_match);
  ReplaceFile(folder / "fusion.cfg", fusion);
}

}  // namespace mgsfm
