// SPDX-License-Identifier: BSD-3-Clause
#include "calibration/formats.h"
#include "calibration/lens_models.h"

namespace mgsfm {
namespace {

std::vector<double> Values(const YamlValue& map,
                           const std::vector<std::string>& keys) {
  std::vector<double> values;
  for (const std::string& key : keys) values.push_back(map[key].Number());
  return values;
}

}  // namespace

bool IsCamodocal(const YamlValue& file) { return file.Has("model_type"); }

std::vector<CalibratedCamera> ReadCamodocal(const YamlValue& file,
                                            const std::filesystem::path& path) {
  CalibratedCamera camera;
  const auto name = file.Find("camera_name");
  if (name) camera.names.push_back(name->Text());
  camera.names.push_back(path.stem().string());
  camera.place = file["model_type"].Place();
  camera.size_px.emplace(file["image_width"].Size(),
                         file["image_height"].Size());
  const std::string model = file["model_type"].Text();
  if (model == "PINHOLE") {
    const auto n =
        Values(file["projection_parameters"], {"fx", "fy", "cx", "cy"});
    SetLens({n[0], n[1], n[2], n[3], "radtan",
             Values(file["distortion_parameters"], {"k1", "k2", "p1", "p2"})},
            &camera);
  } else if (model == "KANNALA_BRANDT") {
    const YamlValue projection = file["projection_parameters"];
    const auto n = Values(projection, {"mu", "mv", "u0", "v0"});
    SetLens({n[0], n[1], n[2], n[3], "equidistant",
             Values(projection, {"k2", "k3", "k4", "k5"})},
            &camera);
  } else if (model == "MEI") {
    const auto n =
        Values(file["projection_parameters"], {"gamma1", "gamma2", "u0", "v0"});
    SetUnifiedLens(
        {n[0], n[1], n[2], n[3], file["mirror_parameters"]["xi"].Number(), 0.0,
         Values(file["distortion_parameters"], {"k1", "k2", "p1", "p2"})},
        &camera);
  } else {
    SetUnknownLens(model, &camera);
  }
  camera.cam_from_base = CamFromVehicleOfKitti360(path, camera.names.front());
  return {camera};
}

}  // namespace mgsfm
