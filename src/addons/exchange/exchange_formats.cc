// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/exchange_formats.h"

#include <algorithm>
#include <cctype>

#include "exchange/exported_names.h"
#include "exchange/formats.h"
#include "mgsfm/rigs/rig_config.h"

namespace mgsfm {
namespace {

std::vector<ExportedFile> WriteRigConfigJson(const ExportInput& input) {
  return {{"", RigConfigsToJson(MakeRigConfigs(input.scene, input.model))}};
}

constexpr ExchangeFormat kFormats[] = {
    {"ply", WritePly},
    {"nvm", WriteNvm, LossesInNvm},
    {"bundler", WriteBundler, LossesInBundler},
    {"tum", WriteTum},
    {"kitti", WriteKitti},
    {"euroc", WriteEuroc},
    {"kalibr", WriteKalibr, SensorsWithoutPose},
    {"euroc_sensor", WriteEurocSensors, SensorsWithoutPose},
    {"ros_tf", WriteRosTransforms, SensorsWithoutPose},
    {"ros_launch", WriteRosLaunch, SensorsWithoutPose},
    {"camera_info", WriteCameraInfo},
    {"rig_config", WriteRigConfigJson},
    {"geojson", WriteGeoJson},
    {"kml", WriteKml},
};

}  // namespace

const ExchangeFormat* FindExchangeFormat(std::string_view name) {
  const auto is_same = [](char a, char b) {
    return std::tolower(static_cast<unsigned char>(a)) == b;
  };
  for (const ExchangeFormat& format : kFormats) {
    if (std::equal(name.begin(), name.end(), format.name.begin(),
                   format.name.end(), is_same)) {
      return &format;
    }
  }
  return nullptr;
}

std::vector<std::string> ExchangeFormatNames() {
  std::vector<std::string> names;
  for (const ExchangeFormat& format : kFormats) {
    names.emplace_back(format.name);
  }
  return names;
}

}  // namespace mgsfm
