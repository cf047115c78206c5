// SPDX-License-Identifier: BSD-3-Clause
#include <string>
#include <utility>
#include <vector>

#include "base/text_tools.h"
#include "exchange/formats.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using Fields = std::vector<std::string>;

std::string KaptureHeader(const char* columns) {
  return std::string("# kapture format: 1.1\n# ") + columns + "\n";
}

std::string KaptureLine(Fields fields, const std::vector<double>& numbers) {
  for (const double number : numbers) fields.push_back(Digits(number));
  return Joined(fields, ", ") + "\n";
}

std::vector<double> NumbersOf(const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  const Eigen::Vector3d& t = pose.translation;
  return {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()};
}

std::string KaptureSensor(const ExportInput& input, int sensor_idx,
                          const std::string& name) {
  const int camera_idx = input.scene.sensors[sensor_idx].camera_idx;
  const Camera& camera = input.model.cameras[camera_idx];
  const std::string model(InfoOf(camera.model).name);
  // It has the models of COLMAP 3.8.
  if (camera.model > CameraModelId::kThinPrismFisheye) {
    throw Error(CameraLabel(input.scene, camera_idx) + " is of the model " +
                model +
                ", which kapture cannot represent; undistort the images first, "
                "or map with another camera model");
  }
  return KaptureLine(
      {name, name, "camera", model, std::to_string(camera.width_px),
       std::to_string(camera.height_px)},
      camera.params);
}

}  // namespace

std::vector<ExportedFile> WriteKapture(const ExportInput& input) {
  const Scene& scene = input.scene;
  const Fields names = PlainSensorNames(scene);
  Fields rig_names;
  std::string sensors =
      KaptureHeader("sensor_device_id, name, sensor_type, [sensor_params]+");
  std::string rigs = KaptureHeader(
      "rig_device_id, sensor_device_id, qw, qx, qy, qz, tx, ty, tz");
  for (size_t i = 0; i < scene.rigs.size(); ++i) {
    // Names of rigs are none of sensors.
    rig_names.push_back("rig:" + names[scene.rigs[i].ref_sensor_idx]);
    for (const int sensor_idx : PosedSensors(input, static_cast<int>(i))) {
      const Rigid3 pose =
          input.model.sensor_from_rig[sensor_idx].value_or(Rigid3());
      sensors += KaptureSensor(input, sensor_idx, names[sensor_idx]);
      rigs +=
          KaptureLine({rig_names.back(), names[sensor_idx]}, NumbersOf(pose));
    }
  }
  std::string trajectories =
      KaptureHeader("timestamp, device_id, qw, qx, qy, qz, tx, ty, tz");
  std::string records = KaptureHeader("timestamp, device_id, image_path");
  int number = 0;
  for (const int frame_idx : RegisteredFrames(input)) {
    const Frame& frame = scene.frames[frame_idx];
    const std::string time = std::to_string(number++);
    trajectories +=
        KaptureLine({time, rig_names[frame.rig_idx]},
                    NumbersOf(*input.model.rig_from_world[frame_idx]));
    for (const int image_idx : frame.image_idxs) {
      if (!input.model.IsRegistered(scene, image_idx)) continue;
      const Image& image = scene.images[image_idx];
      if (image.name.find(',') != std::string::npos) {
        throw Error("image '" + image.name +
                    "' has a comma in its name, which kapture cannot "
                    "represent; rename the image");
      }
      records += KaptureLine({time, names[image.sensor_idx], image.name}, {});
    }
  }
  return {{"/sensors/sensors.txt", std::move(sensors)},
          {"/sensors/rigs.txt", std::move(rigs)},
          {"/sensors/trajectories.txt", std::move(trajectories)},
          {"/sensors/records_camera.txt", std::move(records)}};
}

}  // namespace mgsfm
