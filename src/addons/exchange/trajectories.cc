// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "base/format.h"
#include "base/nanoseconds.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "exchange/formats.h"
#include "geometry/geodetic.h"
#include "mgsfm/base/error.h"
#include "rigs/image_times.h"

namespace mgsfm {
namespace {

// A line of a trajectory, of the frame or image with this name.
struct Stop {
  std::string name;
  Rigid3 world_from_body;
  std::optional<double> time_s;
};

struct Trajectory {
  std::string suffix;
  std::vector<Stop> stops;  // in the order of frames
};

int64_t TimeOf(const Stop& stop) {
  if (stop.time_s) return std::llround(*stop.time_s * kNsPerSecond);
  const std::optional<int64_t> time_ns =
      TimeOrNumberInStem(StemOfName(stop.name));
  if (time_ns) return *time_ns;
  throw Error("the time of image '" + stop.name +
              "' is unknown, as its name is not a number; give times with "
              "image_timestamps_path");
}

Trajectory FrameTrajectory(const ExportInput& input) {
  const Scene& scene = input.scene;
  OnlyRig(input, "a trajectory of frames",
          "write one trajectory per camera (poses camera)");
  Trajectory trajectory;
  for (const int frame_idx : RegisteredFrames(input)) {
    const Frame& frame = scene.frames[frame_idx];
    const Image& image = scene.images[frame.image_idxs.front()];
    std::optional<double> time_s;
    if (image.timestamp_s) time_s = TimeOfFrame(scene, frame_idx);
    trajectory.stops.push_back(
        {image.name, input.model.rig_from_world[frame_idx]->Inverse(), time_s});
  }
  return trajectory;
}

std::vector<Trajectory> CameraTrajectories(const ExportInput& input,
                                           const std::string& extension) {
  const Scene& scene = input.scene;
  const std::vector<std::string> names = PlainSensorNames(scene);
  std::vector<Trajectory> all;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    Trajectory trajectory{"/" + names[i] + extension, {}};
    for (const int frame_idx : RegisteredFrames(input)) {
      for (const int image_idx : scene.frames[frame_idx].image_idxs) {
        const Image& image = scene.images[image_idx];
        const auto pose = input.model.CamFromWorld(scene, image_idx);
        if (image.sensor_idx != static_cast<int>(i) || !pose) continue;
        trajectory.stops.push_back(
            {image.name, pose->Inverse(), image.timestamp_s});
      }
    }
    if (!trajectory.stops.empty()) all.push_back(std::move(trajectory));
  }
  return all;
}

std::vector<Trajectory> MakeTrajectories(const ExportInput& input,
                                         const std::string& extension) {
  if (input.poses == TrajectoryPoses::kCamera) {
    return CameraTrajectories(input, extension);
  }
  return {FrameTrajectory(input)};
}

// A file of lines in the order of their times.
std::vector<ExportedFile> WriteTimed(const ExportInput& input,
                                     const std::string& extension,
                                     const std::string& header,
                                     std::string (*line)(int64_t time_ns,
                                                         const Rigid3& pose)) {
  std::vector<ExportedFile> files;
  for (const Trajectory& trajectory : MakeTrajectories(input, extension)) {
    auto stops = Transformed(trajectory.stops, [](const Stop& stop) {
      return std::pair(TimeOf(stop), &stop);
    });
    StableSortBy(&stops, [](const auto& a) { return a.first; });
    std::string text = header;
    for (size_t i = 0; i < stops.size(); ++i) {
      if (i > 0 && stops[i].first == stops[i - 1].first) {
        throw Error("images '" + stops[i - 1].second->name + "' and '" +
                    stops[i].second->name +
                    "' have the same time; give times with "
                    "image_timestamps_path");
      }
      text += line(stops[i].first, stops[i].second->world_from_body);
    }
    files.push_back({trajectory.suffix, std::move(text)});
  }
  return files;
}

std::string TumLine(int64_t time_ns, const Rigid3& pose) {
  const std::string time =
      Formatted("%s%lld.%09lld", time_ns < 0 ? "-" : "",
                static_cast<long long>(std::abs(time_ns) / kNsPerSecond),
                static_cast<long long>(std::abs(time_ns) % kNsPerSecond));
  std::string line = time;
  for (const double value : pose.translation) line += ' ' + Digits(value);
  for (const double value : pose.rotation.coeffs()) line += ' ' + Digits(value);
  return line + '\n';
}

std::string EurocLine(int64_t time_ns, const Rigid3& pose) {
  const Eigen::Quaterniond& q = pose.rotation;
  std::string line = std::to_string(time_ns);
  for (const double value : pose.translation) line += ',' + Digits(value);
  for (const double value : {q.w(), q.x(), q.y(), q.z()}) {
    line += ',' + Digits(value);
  }
  return line + '\n';
}

// KITTI numbers poses by line, so a missing frame would shift all that follow.
void CheckHasNoGap(const Trajectory& trajectory) {
  const std::vector<Stop>& stops = trajectory.stops;
  // The counter at the end of a name; times need not be evenly spaced.
  const auto number = [](const Stop& stop) -> std::optional<int64_t> {
    constexpr size_t kMaxDigits = 18;  // any such number fits 64 bits
    const std::string stem = StemOfName(stop.name);
    const std::string digits =
        stem.substr(stem.find_last_not_of("0123456789") + 1);
    if (digits.empty() || digits.size() > kMaxDigits || TimeInName(stop.name)) {
      return std::nullopt;
    }
    return std::stoll(digits);
  };
  std::vector<int64_t> numbers;
  for (const Stop& stop : stops) {
    const std::optional<int64_t> n = number(stop);
    if (!n) return;
    numbers.push_back(*n);
  }
  for (size_t i = 2; i < numbers.size(); ++i) {
    if (numbers[i] - numbers[i - 1] == numbers[1] - numbers[0]) continue;
    throw Error(
        "kitti has a line per frame without its name, but there are "
        "no poses between '" +
        stops[i - 1].name + "' and '" + stops[i].name +
        "', or before them; write tum or euroc");
  }
}

std::vector<ExportedFile> WriteTum(const ExportInput& input) {
  return WriteTimed(input, ".txt", "# timestamp tx ty tz qx qy qz qw\n",
                    TumLine);
}

std::vector<ExportedFile> WriteEuroc(const ExportInput& input) {
  return WriteTimed(input, ".csv",
                    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],"
                    "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n",
                    EurocLine);
}

std::vector<ExportedFile> WriteKitti(const ExportInput& input) {
  std::vector<ExportedFile> files;
  for (const Trajectory& trajectory : MakeTrajectories(input, ".txt")) {
    CheckHasNoGap(trajectory);
    std::string text;
    for (const Stop& stop : trajectory.stops) {
      Eigen::Matrix<double, 3, 4> matrix;
      matrix << stop.world_from_body.rotation.toRotationMatrix(),
          stop.world_from_body.translation;
      for (int k = 0; k < 12; ++k) {
        text += Digits(matrix(k / 4, k % 4)) + (k < 11 ? ' ' : '\n');
      }
    }
    files.push_back({trajectory.suffix, std::move(text)});
  }
  return files;
}

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

}  // namespace

std::vector<ExchangeFormat> TrajectoryFormats() {
  return {{"tum", WriteTum}, {"kitti", WriteKitti}, {"euroc", WriteEuroc}};
}

std::vector<ExchangeFormat> GeoFormats() {
  return {{"geojson", WriteGeoJson}, {"kml", WriteKml}};
}

}  // namespace mgsfm
