// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calibration/yaml_value.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {

// A camera of a calibration file in COLMAP's conventions: the center of the
// first pixel is (0.5, 0.5).
struct CalibratedCamera {
  // Possible names of its image folder, most specific first; not empty.
  std::vector<std::string> names;
  std::string place;  // "'cam.yaml', line 3", for messages
  // nullopt without why_no_model: the calibration has poses only.
  std::optional<CameraModelId> model;
  std::vector<double> params;  // of model
  // The largest error of `model`, if it only approximates the lens.
  std::optional<double> fit_error_px;
  // Why no model of COLMAP describes the lens; empty if a model does.
  std::string why_no_model;
  std::optional<std::pair<int, int>> size_px;  // width and height
  // The frame shared by the cameras of a calibration: a body, a vehicle or one
  // of the cameras.
  std::optional<Rigid3> cam_from_base;
  // The body of a calibration with an inertial sensor.
  std::optional<Rigid3> cam_from_imu;
  // Offset from image times to the clock of the base.
  std::optional<double> time_shift_s;
};

// Reads calibrations; the content of a file shows its format:
//   Kalibr           camchain.yaml
//   EuRoC            sensor.yaml, one per camera
//   OpenCV, ROS      camera_info YAML, one per camera (also of RTAB-Map)
//   camodocal        YAML with model_type, one per camera (VINS, KITTI-360)
//   KITTI            calib.txt, calib_cam_to_cam.txt
//   KITTI-360        perspective.txt with calib_cam_to_pose.txt
//   nuScenes         calibrated_sensor.json with sensor.json, or one object per
//                    camera
//   Argoverse        vehicle_calibration_info.json
//   OpenSfM          rig_cameras.json with camera_models.json (frames of
//                    rig_assignments.json: calibration_rigs.h)
//   kapture          sensors.txt with rigs.txt
// `paths` is a file, several files separated by commas, or a folder, whose
// calibrations are read together with those one level below. Throws Error,
// naming file, line and remedy, if a file is malformed or there is no camera.
std::vector<CalibratedCamera> ReadCalibration(const std::string& paths);
// The files that it reads.
std::vector<std::filesystem::path> CalibrationFiles(const std::string& paths);

// The cameras of a file; nullopt if it has another format.
using FoundCameras = std::optional<std::vector<CalibratedCamera>>;

// The readers of the formats. They throw Error, naming file, line and remedy,
// for malformed values.

// Kalibr: a map cam0, cam1, ... with camera_model, intrinsics,
// distortion_model, distortion_coeffs and T_cn_cnm1 (from the camera before) or
// T_cam_imu.
FoundCameras ReadKalibr(const YamlValue& file,
                        const std::filesystem::path& path);
// Without the lenses, whose keys may be missing.
std::vector<CalibratedCamera> ReadKalibrPoses(const YamlValue& file);

// EuRoC: T_BS (body from sensor), intrinsics, distortion_coefficients. The
// folder of the file names the camera.
FoundCameras ReadEuroc(const YamlValue& file,
                       const std::filesystem::path& path);

// ROS camera_info and cv::FileStorage: camera_matrix and
// distortion_coefficients. The optional rectification_matrix and
// projection_matrix give the pose relative to the rectified left camera.
FoundCameras ReadOpenCv(const YamlValue& file,
                        const std::filesystem::path& path);

// camodocal: model_type PINHOLE, KANNALA_BRANDT or MEI. The fisheyes of
// KITTI-360 have poses in calib_cam_to_pose.txt beside the file.
FoundCameras ReadCamodocal(const YamlValue& file,
                           const std::filesystem::path& path);

// nuScenes: an array of calibrated sensors with the table sensor.json beside
// it, or a map from cameras to such objects.
FoundCameras ReadNuScenes(const YamlValue& file,
                          const std::filesystem::path& path);

// Argoverse 1: camera_data_.
FoundCameras ReadArgoverse(const YamlValue& file,
                           const std::filesystem::path& path);

// KITTI: lines "P0: 12 numbers" or without names (odometry), or the P_rect_00,
// S_rect_00, R_rect_00 of rectified images (raw data, KITTI-360).
FoundCameras ReadKitti(const std::string& text,
                       const std::filesystem::path& path);

// OpenSfM: a map from rig cameras to rotation (angle-axis), translation, both
// from rig to camera, and camera, a key of camera_models.json beside the file,
// which may be missing (https://opensfm.org/docs/rig.html).
FoundCameras ReadOpenSfm(const YamlValue& file,
                         const std::filesystem::path& path);

// kapture 1.0 and 1.1: the models of COLMAP, and the poses of rigs.txt beside
// the file, from rig to sensor (kapture_format.adoc of github.com/naver).
FoundCameras ReadKapture(const std::string& text,
                         const std::filesystem::path& path);

// KITTI-360: the pose of a camera from calib_cam_to_pose.txt beside the
// calibration of its lens; nullopt without this file.
std::optional<Rigid3> CamFromVehicleOfKitti360(
    const std::filesystem::path& path, const std::string& name);

}  // namespace mgsfm
