// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// A camera as any calibration file describes it, in COLMAP's conventions: the
// center of the first pixel is (0.5, 0.5).
struct CalibratedCamera {
  // Possible names of its image folder, most specific first; not empty.
  std::vector<std::string> names;
  std::string place;  // "'cam.yaml', line 3", for messages
  std::optional<CameraModelId> model;
  std::vector<double> params;  // of model
  // The largest error of `model`, if it only approximates the lens of the file.
  std::optional<double> fit_error_px;
  // Why no model of COLMAP describes the lens; empty if one does.
  std::string why_no_model;
  std::optional<std::pair<int, int>> size_px;  // width and height
  // The base is common to the cameras of a calibration: a body, a vehicle or
  // one of the cameras.
  std::optional<Rigid3> cam_from_base;
  // Added to the times of its images, gives times of the base's clock.
  std::optional<double> time_shift_s;
};

// Reads calibrations; the content of a file shows its format:
//   Kalibr           camchain.yaml
//   EuRoC            sensor.yaml, one per camera
//   OpenCV, ROS      camera_info YAML, one per camera
//   camodocal        YAML with model_type, one per camera (VINS, KITTI-360)
//   KITTI            calib.txt, calib_cam_to_cam.txt
//   KITTI-360        perspective.txt with calib_cam_to_pose.txt
//   nuScenes         calibrated_sensor.json with sensor.json, or one object per
//                    camera
//   Argoverse        vehicle_calibration_info.json
// `paths` is a file, several files with commas between them, or a folder, of
// which the calibrations there and one level below are read. Throws Error,
// naming file, line and remedy, if a file is malformed and if there is no
// camera.
std::vector<CalibratedCamera> ReadCalibration(const std::string& paths);

}  // namespace mgsfm
