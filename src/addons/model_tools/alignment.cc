// SPDX-License-Identifier: BSD-3-Clause
#include "base/ranges.h"
#include "geometry/decompositions.h"
#include "mgsfm/model_tools/model_tools.h"
#include "scene/item_lists.h"

namespace mgsfm {
namespace {

// mu in the header.
constexpr double kUpwardWeight = 0.05;

// The sum of outer products of the centers, relative to their mean.
Eigen::Matrix3d Scatter(const std::vector<Eigen::Vector3d>& centers,
                        const Eigen::Vector3d& mean) {
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& center : centers) {
    scatter += (center - mean) * (center - mean).transpose();
  }
  return scatter;
}

}  // namespace

std::vector<ImagePoses> PairImages(const SceneModel& model,
                                   const SceneModel& reference) {
  const auto image_of_name = IndexByName(reference.scene.images);
  std::vector<ImagePoses> pairs;
  for (size_t i = 0; i < model.scene.images.size(); ++i) {
    const Image& image = model.scene.images[i];
    const auto found = image_of_name.find(image.name);
    if (found == image_of_name.end()) continue;
    const auto pose =
        model.reconstruction.CamFromWorld(model.scene, static_cast<int>(i));
    const auto reference_pose =
        reference.reconstruction.CamFromWorld(reference.scene, found->second);
    if (!pose || !reference_pose) continue;
    pairs.push_back({image.name, model.scene.IsReference(image.sensor_idx),
                     pose, *reference_pose});
  }
  return pairs;
}

ImageAgreement CompareCenters(const std::vector<ImagePoses>& images,
                              const Sim3& reference_from_model,
                              const Reconstruction& reference) {
  constexpr double kMaxShareOfExtent = 0.1;
  Eigen::AlignedBox3d box;
  for (const auto& pose : reference.rig_from_world) {
    if (pose) box.extend(pose->Center());
  }
  ImageAgreement agreement;
  for (const ImagePoses& image : images) {
    const Eigen::Vector3d center = image.cam_from_world.Center();
    box.extend(center);
    agreement.distances.push_back(
        (reference_from_model * image.cam_from_model->Center() - center)
            .norm());
  }
  agreement.max_distance = kMaxShareOfExtent * box.diagonal().norm() + 1e-12;
  agreement.num_agreeing =
      static_cast<int>(CountIf(agreement.distances, [&](double d) {
        return d <= agreement.max_distance;
      }));
  return agreement;
}

std::optional<Sim3> AlignToGroundPlane(
    const SceneModel& model,
    const std::optional<Eigen::Vector3d>& measured_up) {
  std::vector<Eigen::Vector3d> centers;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Vector3d upward = Eigen::Vector3d::Zero();
  Eigen::Vector3d forward = Eigen::Vector3d::Zero();
  for (const auto& pose : model.reconstruction.rig_from_world) {
    if (!pose) continue;
    centers.push_back(pose->Center());
    mean += centers.back();
    upward -= pose->rotation.conjugate() * Eigen::Vector3d::UnitY();
    forward += pose->rotation.conjugate() * Eigen::Vector3d::UnitZ();
  }
  if (centers.empty()) return std::nullopt;
  const auto num_frames = static_cast<double>(centers.size());
  mean /= num_frames;
  upward /= num_frames;
  forward /= num_frames;

  const Eigen::Matrix3d scatter = Scatter(centers, mean);
  Eigen::Matrix3d cost =
      -kUpwardWeight * kUpwardWeight * upward * upward.transpose();
  if (scatter.trace() > 0.0) cost += scatter / scatter.trace();
  Eigen::Matrix3d axes = SymmetricEigen<Eigen::Matrix3d>(cost).V;
  Eigen::Vector3d normal = axes.col(0);
  if (normal.dot(upward) - normal.dot(forward) < 0.0) normal = -normal;
  if (measured_up) normal = measured_up->normalized();
  // The principal axis within the plane.
  const Eigen::Matrix3d projection =
      Eigen::Matrix3d::Identity() - normal * normal.transpose();
  axes = SymmetricEigen<Eigen::Matrix3d>(projection * scatter * projection).V;
  Eigen::Vector3d along = projection * axes.col(2);
  if (along.norm() < 0.5) along = normal.unitOrthogonal();
  // The x axis is in the direction of travel.
  if (along.dot(centers.back() - centers.front()) < 0.0) along = -along;

  Eigen::Matrix3d rotation;
  rotation.row(0) = along.normalized();
  rotation.row(2) = normal;
  rotation.row(1) = rotation.row(2).cross(rotation.row(0));
  Sim3 plane_from_world{1.0, Eigen::Quaterniond(rotation).normalized(), {}};
  plane_from_world.translation = -(plane_from_world.rotation * mean);
  return plane_from_world;
}

}  // namespace mgsfm
