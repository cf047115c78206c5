// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "mgsfm/geometry/rigid3.h"
#include "mgsfm/scene/priors.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// The frame of the body that carries the cameras of a scene: its origin and
// axes are those of an inertial sensor.
struct BodyFrame {
  std::string path;  // of the file, for messages
  std::vector<std::optional<Rigid3>> cam_from_body;  // per sensor
  Eigen::Vector3d antenna_in_body = Eigen::Vector3d::Zero();
  std::string warning;  // of a camera whose axes may be others; empty: none

  // Throws Error, naming the image, if the pose of its camera is unknown.
  const Rigid3& CamFromBody(const Scene& scene, int image_idx) const;
};

// Reads a camchain of Kalibr, as YAML or JSON: T_cam_imu, T_cn_cnm1 and names
// of cameras. Everything else may be missing, but for T_cam_imu of one camera.
// The key antenna_in_imu, [x, y, z] in meters, is the antenna, or else the
// antenna is at the inertial sensor.
//
// Or a URDF, whose only link with the word imu in its name is the inertial
// sensor, and with antenna, gnss or gps, if there is one, the antenna. Cameras
// are called like their links, without _optical_frame, _optical_link, _optical,
// _link and _frame, in this order. The keys urdf, imu_link and antenna_link of
// a YAML file name others; antenna_in_imu is read, too.
//
// A sensor has the camera with its name or number, as in calibration_rigs.h, or
// the only camera, in a URDF the only optical one, if it is the only sensor.
// Sensors that the file lacks follow
// from known poses in their rig. Throws Error for a file of another format, if
// no sensor has a camera, and if the file contradicts a known pose.
[[nodiscard]] BodyFrame ReadBody(const Scene& scene, const std::string& path);
// The same for a model, whose estimated rig may differ from the file and have
// another unit of length, so that all sensors must be in the file.
[[nodiscard]] BodyFrame ReadBodyOfModel(Scene scene, const std::string& path);

// Throws the Error of ReadBody that does not depend on a scene.
void CheckBodyCalibration(const std::string& path);

// Makes the positions those of the antenna. Throws Error as CamFromBody.
void SetAntenna(const Scene& scene, const BodyFrame& body,
                PositionPriors* priors);

}  // namespace mgsfm
