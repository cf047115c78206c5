// SPDX-License-Identifier: BSD-3-Clause
#include "exchange/exchange_formats.h"

#include <cctype>
#include <charconv>
#include <set>

#include "base/ranges.h"
#include "base/text_tools.h"
#include "exchange/formats.h"
#include "exchange/ply.h"
#include "mgsfm/base/error.h"
#include "mgsfm/rigs/rig_config.h"

namespace mgsfm {
namespace {

std::vector<ExportedFile> WriteRigConfigJson(const ExportInput& input) {
  return {{"", RigConfigsToJson(MakeRigConfigs(input.scene, input.model))}};
}

std::vector<ExportedFile> WritePly(const ExportInput& input) {
  return {{"", PointsToPly(input.model)}};
}

// Messages list the formats in this order.
const std::vector<ExchangeFormat>& AllFormats() {
  static const std::vector<ExchangeFormat> kAll = [] {
    std::vector<ExchangeFormat> all = {{"ply", WritePly}};
    for (const auto& formats : {RadialFormats(),
                                TrajectoryFormats(),
                                CalibrationFormats(),
                                {{"rig_config", WriteRigConfigJson},
                                 {"kapture", WriteKapture, SensorsWithoutPose}},
                                GeoFormats()}) {
      all.insert(all.end(), formats.begin(), formats.end());
    }
    return all;
  }();
  return kAll;
}

}  // namespace

const ExchangeFormat* FindExchangeFormat(const std::string& name) {
  for (const ExchangeFormat& format : AllFormats()) {
    if (format.name == ToLower(name)) return &format;
  }
  return nullptr;
}

std::vector<std::string> ExchangeFormatNames() {
  return Transformed(AllFormats(), [](const ExchangeFormat& format) {
    return std::string(format.name);
  });
}

std::string Digits(double value) {
  char digits[32];
  const double printed = value == 0.0 ? 0.0 : value;  // never -0
  return {digits, std::to_chars(digits, digits + sizeof(digits), printed).ptr};
}

std::string NumberList(const std::vector<double>& values) {
  return "[" + Joined(Transformed(values, Digits), ", ") + "]";
}

Eigen::Vector2d PrincipalPoint(const Camera& camera) {
  const std::vector<int>& idxs = InfoOf(camera.model).principal_point_idxs;
  return {camera.params[idxs[0]], camera.params[idxs[1]]};
}

std::vector<std::string> PlainSensorNames(const Scene& scene) {
  std::vector<std::string> names;
  std::set<std::string> taken;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    std::string name = scene.sensors[i].name;
    while (!name.empty() && name.back() == '/') name.pop_back();
    for (char& c : name) {
      const bool is_plain =
          c == '-' || std::isalnum(static_cast<unsigned char>(c)) != 0;
      if (!is_plain) c = '_';
    }
    if (name.empty()) name = "camera";
    std::string unique = name;
    for (size_t number = i; !taken.insert(unique).second; ++number) {
      unique = name + "_" + std::to_string(number);
    }
    names.push_back(unique);
  }
  return names;
}

std::vector<int> RegisteredFrames(const ExportInput& input) {
  const Scene& scene = input.scene;
  std::vector<int> frame_idxs = OrderOfFrames(scene);
  EraseIf(&frame_idxs, [&](int frame_idx) {
    return NoneOf(scene.frames[frame_idx].image_idxs, [&](int image_idx) {
      return input.model.IsRegistered(scene, image_idx);
    });
  });
  return frame_idxs;
}

int OnlyRig(const ExportInput& input, const std::string& format,
            const std::string& remedy) {
  std::set<int> rig_idxs;
  for (const int frame_idx : RegisteredFrames(input)) {
    rig_idxs.insert(input.scene.frames[frame_idx].rig_idx);
  }
  if (rig_idxs.size() == 1) return *rig_idxs.begin();
  const auto names = Transformed(rig_idxs, [&](int rig_idx) {
    const Rig& rig = input.scene.rigs[rig_idx];
    return "'" + input.scene.sensors[rig.ref_sensor_idx].name + "'";
  });
  throw Error(format + " holds one rig, but the model has " +
              std::to_string(rig_idxs.size()) + ", of cameras " +
              Joined(names, ", ") + "; " + remedy);
}

std::vector<int> PosedSensors(const ExportInput& input, int rig_idx) {
  const Rig& rig = input.scene.rigs[rig_idx];
  std::vector<int> sensor_idxs = {rig.ref_sensor_idx};
  for (const int sensor_idx : rig.sensor_idxs) {
    if (sensor_idx != rig.ref_sensor_idx &&
        input.model.sensor_from_rig[sensor_idx]) {
      sensor_idxs.push_back(sensor_idx);
    }
  }
  return sensor_idxs;
}

std::vector<std::string> SensorsWithoutPose(const ExportInput& input) {
  std::vector<std::string> messages;
  for (const Rig& rig : input.scene.rigs) {
    for (const int sensor_idx : rig.sensor_idxs) {
      if (sensor_idx == rig.ref_sensor_idx ||
          input.model.sensor_from_rig[sensor_idx]) {
        continue;
      }
      messages.push_back("camera '" + input.scene.sensors[sensor_idx].name +
                         "' is left out, as the model has no pose of it in "
                         "the rig");
    }
  }
  return messages;
}

}  // namespace mgsfm
