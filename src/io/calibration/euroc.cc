// SPDX-License-Identifier: BSD-3-Clause
#include "calibration/formats.h"
#include "calibration/lens_models.h"

namespace mgsfm {

bool IsEuroc(const YamlValue& file) { return file.Has("T_BS"); }

std::vector<CalibratedCamera> ReadEuroc(const YamlValue& file,
                                        const std::filesystem::path& path) {
  const auto type = file.Find("sensor_type");
  if (type && type->Text() != "camera") return {};  // an inertial sensor
  CalibratedCamera camera;
  if (path.stem() == "sensor" && path.has_parent_path()) {
    camera.names = {path.parent_path().filename().string()};
  } else {
    camera.names = {path.stem().string()};
  }
  camera.place = file["T_BS"].Place();
  camera.cam_from_base = file["T_BS"].Pose().Inverse();
  camera.size_px = file["resolution"].ImageSize();
  const std::string projection = file["camera_model"].Text();
  if (projection != "pinhole") {
    SetUnknownLens(projection, &camera);
    return {camera};
  }
  const std::vector<double> n = file["intrinsics"].Numbers(4);
  SetLens({n[0], n[1], n[2], n[3], file["distortion_model"].Text(),
           file["distortion_coefficients"].Numbers()},
          &camera);
  return {camera};
}

}  // namespace mgsfm
