// SPDX-License-Identifier: BSD-3-Clause
#include "priors/body_calibration.h"

#include <re2/re2.h>

#include <algorithm>
#include <filesystem>
#include <map>

#include "base/file_reading.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "calibration/calibration.h"
#include "calibration/calibration_rigs.h"
#include "calibration/yaml_value.h"
#include "mgsfm/base/error.h"
#include "priors/urdf.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

constexpr const char* kLayout =
    "give T_cam_imu of a camera in the layout of Kalibr's camchain, as YAML or "
    "JSON, with antenna_in_imu: [x, y, z] in meters; or a URDF";

std::string ExtensionOf(const std::string& path) {
  return ToLower(std::filesystem::path(path).extension());
}

// Throws Error for formats that are not read.
void CheckFormat(const std::string& path) {
  const std::string extension = ExtensionOf(path);
  if (extension == ".bag" || extension == ".mcap" || extension == ".db3") {
    throw Error("'" + path + "' is a recording, which is not read; " + kLayout);
  }
}

struct BodyFile {
  std::vector<CalibratedCamera> cameras;
  // The first cameras, whose axes are those of images. The only one is that of
  // the only sensor.
  size_t num_preferred = 0;
  Eigen::Vector3d antenna_in_body = Eigen::Vector3d::Zero();
  bool have_numbers = true;  // the cameras, as in cam0
};

// The link that a key names, or else the only one with one of the words, such
// as "gnss|gps", in its name. Throws Error if there are several, or if a needed
// one is missing.
std::optional<std::string> FindLink(const Urdf& urdf, const std::string& key,
                                    const std::string& name,
                                    const std::string& words, bool is_needed) {
  const RE2 has_word("(?i)(?:^|[^a-z])(?:" + words + ")(?:[^a-z]|$)",
                     RE2::Latin1);
  std::vector<std::string> found = urdf.links;
  EraseIf(&found, [&](const std::string& link) {
    return name.empty() ? !RE2::PartialMatch(link, has_word) : link != name;
  });
  if (found.size() == 1) return found.front();
  if (found.empty() && name.empty() && !is_needed) return std::nullopt;
  const std::string link =
      name.empty() ? "with " + words + " in its name" : "'" + name + "'";
  throw Error("'" + urdf.path + "' has " +
              (found.empty() ? "no link " + link + " (" + key + "), but " +
                                   Joined(urdf.links, ", ")
                             : "the links " + Joined(found, ", ")) +
              "; set " + key +
              " to one of them in a YAML file with the key urdf");
}

// A camera is called like its link, without an end. By convention, only optical
// frames look along z, so that they come first.
constexpr const char* kLinkEnds[] = {
    "_optical_frame", "_optical_link", "_optical", "", "_link", "_frame"};

// A URDF whose links carry the sensors. `keys` are those of a YAML file.
BodyFile ReadBodyOfUrdf(const std::string& path,
                        std::map<std::string, std::string> keys) {
  const Urdf urdf = ReadUrdf(path);
  const std::string imu =
      *FindLink(urdf, "imu_link", keys["imu_link"], "imu", true);
  BodyFile body;
  body.have_numbers = false;
  for (const std::string end : kLinkEnds) {
    for (const std::string& link : urdf.links) {
      const size_t size = link.size() - std::min(link.size(), end.size());
      if (link.substr(size) != end) continue;
      CalibratedCamera camera;
      camera.names = {link.substr(0, size), link};
      camera.cam_from_imu = urdf.fixed.Between(link, imu);
      if (!camera.cam_from_imu) continue;
      body.cameras.push_back(std::move(camera));
      if (end.find("_optical") == 0) ++body.num_preferred;
    }
  }
  if (keys.count("antenna_in_imu") > 0) return body;
  const auto antenna = FindLink(urdf, "antenna_link", keys["antenna_link"],
                                "antenna|gnss|gps", false);
  if (!antenna) return body;
  const auto imu_from_antenna = urdf.fixed.Between(imu, *antenna);
  if (!imu_from_antenna) {
    throw Error("'" + path + "': no fixed joints connect the links '" + imu +
                "' and '" + *antenna + "'; correct the joints or the links");
  }
  body.antenna_in_body = imu_from_antenna->translation;
  return body;
}

// A YAML file with the names of links.
BodyFile ReadBodyOfLinks(const std::string& path, const YamlValue& file) {
  static constexpr auto kKeys = {"urdf", "imu_link", "antenna_link",
                                 "antenna_in_imu"};
  std::map<std::string, std::string> keys;
  for (const auto& [key, value] : file.Items()) {
    if (!Contains(kKeys, key)) {
      value.Throw(
          "is none of urdf, imu_link, antenna_link, antenna_in_imu; "
          "correct or delete it");
    }
    keys[key] = value.IsSequence() ? "" : value.Text();
  }
  if (keys.count("antenna_in_imu") + keys.count("antenna_link") == 2) {
    file["antenna_in_imu"].Throw("is beside antenna_link; delete one of them");
  }
  return ReadBodyOfUrdf(
      std::filesystem::path(path).parent_path() / keys["urdf"], keys);
}

BodyFile ReadFileOfBody(const std::string& path) {
  CheckFormat(path);
  const std::vector<std::string> of_urdf = {".urdf", ".xacro", ".xml"};
  if (Contains(of_urdf, ExtensionOf(path))) return ReadBodyOfUrdf(path, {});
  const YamlValue file(path, ReadFile(path));
  if (!file.IsMap()) throw Error("'" + path + "' is no map; " + kLayout);
  if (file.Has("transforms")) {
    throw Error("'" + path + "' is a dump of tf, which is not read; " +
                kLayout);
  }
  BodyFile body;
  if (file.Has("urdf")) {
    body = ReadBodyOfLinks(path, file);
  } else {
    body.cameras = ReadKalibrPoses(file);
    body.num_preferred = body.cameras.size();
    if (NoneOf(body.cameras,
               [](const auto& c) { return c.cam_from_imu.has_value(); })) {
      throw Error("'" + path + "' has no camera with T_cam_imu; " + kLayout);
    }
  }
  if (const auto antenna = file.Find("antenna_in_imu")) {
    body.antenna_in_body = Eigen::Vector3d::Map(antenna->Numbers(3).data());
    const auto why = WhyImplausible(body.antenna_in_body);
    if (why) antenna->Throw(*why + "; correct it");
  }
  return body;
}

// The camera of a sensor by name, or else by number.
const CalibratedCamera* FindCamera(const BodyFile& file, const Scene& scene,
                                   const Sensor& sensor) {
  const std::string name =
      ToLower(std::filesystem::path(sensor.name).filename());
  for (const CalibratedCamera& camera : file.cameras) {
    for (const std::string& other : camera.names) {
      if (ToLower(other) == name) return &camera;
    }
  }
  const auto number = NumberAtEnd(name);
  for (const CalibratedCamera& camera : file.cameras) {
    if (number && file.have_numbers &&
        NumberAtEnd(camera.names.back()) == number)
      return &camera;
  }
  const bool is_only = scene.sensors.size() == 1 && file.num_preferred == 1;
  return is_only ? &file.cameras.front() : nullptr;
}

// Completes the poses of the sensors of a rig from those that are known in it.
void UseKnownRig(const Scene& scene, const Rig& rig, BodyFrame* body) {
  std::optional<Rigid3> rig_from_body;
  std::string first;
  for (const int s : rig.sensor_idxs) {
    const auto& in_rig = scene.sensors[s].sensor_from_rig;
    const auto& pose = body->cam_from_body[s];
    if (!in_rig || !pose) continue;
    if (!rig_from_body) {
      rig_from_body = in_rig->Inverse() * *pose;
      first = scene.sensors[s].name;
    }
    const auto difference = WhyDifferent(*pose, *in_rig * *rig_from_body);
    if (difference) {
      throw Error("'" + body->path + "': the pose of camera '" +
                  scene.sensors[s].name + "' relative to '" + first +
                  "' differs from that in the known rig " + *difference +
                  "; correct one of them");
    }
  }
  for (const int s : rig.sensor_idxs) {
    const auto& in_rig = scene.sensors[s].sensor_from_rig;
    if (!in_rig || !rig_from_body || body->cam_from_body[s]) continue;
    body->cam_from_body[s] = *in_rig * *rig_from_body;
  }
}

}  // namespace

const Rigid3& BodyFrame::CamFromBody(const Scene& scene, int image_idx) const {
  const Image& image = scene.images[image_idx];
  const auto& pose = cam_from_body[image.sensor_idx];
  if (pose) return *pose;
  throw Error(
      "'" + path + "' has no pose of camera '" +
      scene.sensors[image.sensor_idx].name + "', whose image '" + image.name +
      "' has a measurement; add its T_cam_imu, or fixed joints to its link");
}

BodyFrame ReadBody(const Scene& scene, const std::string& path) {
  const BodyFile file = ReadFileOfBody(path);
  BodyFrame body{path, {}, file.antenna_in_body, ""};
  std::vector<std::string> names;
  for (const Sensor& sensor : scene.sensors) {
    const CalibratedCamera* camera = FindCamera(file, scene, sensor);
    body.cam_from_body.push_back(camera ? camera->cam_from_imu : std::nullopt);
    if (camera && camera >= file.cameras.data() + file.num_preferred) {
      body.warning = "'" + path + "': the axes of camera '" + sensor.name +
                     "' are those of the link '" + camera->names.back() +
                     "', which by convention (REP 103) has x forward; if so, "
                     "add the link " +
                     camera->names.front() +
                     "_optical_frame, with x to the right and z forward";
    }
    names.push_back("'" + sensor.name + "'");
  }
  if (NoneOf(body.cam_from_body,
             [](const auto& pose) { return pose.has_value(); })) {
    throw Error("'" + path + "' has none of the cameras " +
                Joined(names, ", ") + "; rename its cameras like them");
  }
  for (const Rig& rig : scene.rigs) UseKnownRig(scene, rig, &body);
  return body;
}

BodyFrame ReadBodyOfModel(Scene scene, const std::string& path) {
  for (const Rig& rig : scene.rigs) {
    for (const int s : rig.sensor_idxs) {
      if (!scene.IsReference(s)) scene.sensors[s].sensor_from_rig.reset();
    }
  }
  return ReadBody(scene, path);
}

void CheckBodyCalibration(const std::string& path) {
  (void)ReadFileOfBody(path);
}

void SetAntenna(const Scene& scene, const BodyFrame& body,
                PositionPriors* priors) {
  for (size_t i = 0; i < priors->images.size(); ++i) {
    if (!priors->images[i]) continue;
    const Rigid3& pose = body.CamFromBody(scene, static_cast<int>(i));
    priors->images[i]->cam_from_antenna = {pose.rotation,
                                           pose * body.antenna_in_body};
  }
}

}  // namespace mgsfm
