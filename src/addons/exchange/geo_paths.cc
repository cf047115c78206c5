// SPDX-License-Identifier: BSD-3-Clause
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "base/text_tools.h"
#include "exchange/exported_names.h"
#include "exchange/formats.h"
#include "geometry/geodetic.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

struct GeoStop {
  std::string name;
  Eigen::Vector3d longitude_latitude_altitude;
};

// The frames of each rig and folder, such as a sequence, in their order.
using GeoPaths = std::map<std::string, std::vector<GeoStop>>;

GeoPaths MakeGeoPaths(const ExportInput& input) {
  if (!input.origin_wgs84) {
    throw Error(
        "the model has no place on the earth (no geo_origin.json); "
        "align it to GPS positions with model_aligner, or give the "
        "origin of its east-north-up world");
  }
  const Scene& scene = input.scene;
  const std::vector<std::string> sensor_names = PlainSensorNames(scene);
  GeoPaths paths;
  for (const int frame_idx : RegisteredFrames(input)) {
    const Frame& frame = scene.frames[frame_idx];
    const Eigen::Vector3d position = LatitudeLongitudeAltitude(
        input.model.rig_from_world[frame_idx]->Center(), *input.origin_wgs84);
    std::string path = frame.name.substr(0, frame.name.rfind('/') + 1);
    if (scene.rigs.size() > 1) {
      path += sensor_names[scene.rigs[frame.rig_idx].ref_sensor_idx];
    }
    paths[path].push_back(
        {frame.name, {position.y(), position.x(), position.z()}});
  }
  return paths;
}

}  // namespace

std::vector<ExportedFile> WriteGeoJson(const ExportInput& input) {
  using Json = nlohmann::ordered_json;
  const auto feature = [](const std::string& name, const char* type,
                          const Json& coordinates) {
    return Json{{"type", "Feature"},
                {"properties", {{"name", name}}},
                {"geometry", {{"type", type}, {"coordinates", coordinates}}}};
  };
  Json features = Json::array();
  for (const auto& [path, stops] : MakeGeoPaths(input)) {
    Json line = Json::array();
    for (const GeoStop& stop : stops) {
      const Eigen::Vector3d& p = stop.longitude_latitude_altitude;
      line.push_back({p.x(), p.y(), p.z()});
    }
    if (line.size() > 1) {
      features.push_back(
          feature(path.empty() ? "path" : path, "LineString", line));
    }
    for (size_t i = 0; i < stops.size(); ++i) {
      features.push_back(feature(stops[i].name, "Point", line[i]));
    }
  }
  const Json json = {{"type", "FeatureCollection"}, {"features", features}};
  return {{"", json.dump(1) + '\n'}};
}

std::vector<ExportedFile> WriteKml(const ExportInput& input) {
  std::string text =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<kml xmlns=\"http://www.opengis.net/kml/2.2\">\n<Document>\n";
  for (const auto& [path, stops] : MakeGeoPaths(input)) {
    text += "<Placemark>\n<name>" + EscapeMarkup(path.empty() ? "path" : path) +
            "</name>\n<LineString>\n<altitudeMode>absolute</altitudeMode>\n"
            "<coordinates>\n";
    for (const GeoStop& stop : stops) {
      const Eigen::Vector3d& p = stop.longitude_latitude_altitude;
      text += Digits(p.x()) + ',' + Digits(p.y()) + ',' + Digits(p.z()) + '\n';
    }
    text += "</coordinates>\n</LineString>\n</Placemark>\n";
  }
  return {{"", text + "</Document>\n</kml>\n"}};
}

}  // namespace mgsfm
