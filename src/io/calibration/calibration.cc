// SPDX-License-Identifier: BSD-3-Clause
#include "calibration/calibration.h"

#include <algorithm>
#include <map>

#include "base/file_reading.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "scene/intrinsics_check.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace fs = std::filesystem;
namespace {

constexpr const char* kFormats =
    "Kalibr, EuRoC, OpenCV, ROS, camodocal, KITTI, KITTI-360, nuScenes, "
    "Argoverse, OpenSfM and kapture";
// The largest calibrations, nuScenes tables, take a few MB.
constexpr uintmax_t kMaxFileSize = 64 << 20;

bool HasExtension(const fs::path& path,
                  const std::vector<std::string>& extensions) {
  return Contains(extensions, path.extension());
}

// The files in a folder and its subfolders that may be calibrations.
std::vector<fs::path> FilesIn(const fs::path& folder, bool has_subfolders) {
  // Of nuScenes, OpenSfM and kapture, whose folders have many others.
  for (const char* name : {"calibrated_sensor.json", "rig_cameras.json",
                           "sensors.txt", "sensors/sensors.txt"}) {
    if (fs::exists(folder / name)) return {folder / name};
  }
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const fs::path& path = entry.path();
    if (entry.is_directory() && has_subfolders) {
      const auto inner = FilesIn(path, false);
      files.insert(files.end(), inner.begin(), inner.end());
    } else if (entry.is_regular_file() && entry.file_size() <= kMaxFileSize &&
               HasExtension(path, {".yaml", ".yml", ".json", ".txt"})) {
      files.push_back(path);
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

// nullopt if the file has no known format.
FoundCameras ReadFormat(const fs::path& path) {
  if (HasExtension(path, {".xml", ".xmp", ".csv"})) {
    throw Error("'" + path.string() +
                "' is of no format that is read; if it is a rig of Metashape "
                "or RealityScan, write its poses into a rig_config.json, as "
                "cam_from_rig_rotation and cam_from_rig_translation");
  }
  const std::string text = ReadFile(path);
  if (HasExtension(path, {".txt"})) {
    auto cameras = ReadKapture(text, path);
    return cameras ? cameras : ReadKitti(text, path);
  }
  const YamlValue file(path.string(), text);
  for (const auto read : {ReadEuroc, ReadCamodocal, ReadArgoverse, ReadNuScenes,
                          ReadOpenSfm, ReadOpenCv, ReadKalibr}) {
    if (auto cameras = read(file, path)) return cameras;
  }
  return std::nullopt;
}

void CheckValues(const CalibratedCamera& camera) {
  const auto fail = [&camera](const std::string& problem) {
    throw Error(camera.place + ": camera '" + camera.names.back() + "' " +
                problem + "; correct it");
  };
  if (camera.model) {
    const auto [width, height] = camera.size_px.value_or(std::make_pair(1, 1));
    const Camera intrinsics{CameraId(1), *camera.model, width,
                            height,      camera.params, true};
    if (const auto problem = WhyImplausible(intrinsics)) fail(*problem);
    const auto found =
        camera.size_px ? FindIntrinsicsProblem(intrinsics) : std::nullopt;
    if (found && (found->is_certain || found->is_misread)) {
      fail(found->text);
    }
  }
  if (!camera.cam_from_base) return;
  if (const auto problem = WhyImplausible(*camera.cam_from_base)) {
    fail("has a pose that " + *problem);
  }
}

void CheckNames(const std::vector<CalibratedCamera>& cameras) {
  std::map<std::string, const CalibratedCamera*> known;
  for (const CalibratedCamera& camera : cameras) {
    const auto [other, is_new] = known.emplace(camera.names.front(), &camera);
    if (!is_new) {
      throw Error(camera.place + ": camera '" + camera.names.front() +
                  "' is also in " + other->second->place +
                  "; keep the calibration of your recording only");
    }
  }
}

// Separate files per camera without a rig place all cameras at the origin with
// equal rotations. The cameras of a panorama head, at one place, are turned.
void ForgetCommonPlace(std::vector<CalibratedCamera>* cameras) {
  constexpr double kMaxRounding_rad = 1e-6;
  const Rigid3* first = nullptr;
  const bool is_common = AllOf(*cameras, [&](const CalibratedCamera& camera) {
    if (!camera.cam_from_base) return true;
    if (first == nullptr) first = &*camera.cam_from_base;
    return camera.cam_from_base->translation.isZero(0.0) &&
           AngleBetween(camera.cam_from_base->rotation, first->rotation) <=
               kMaxRounding_rad;
  });
  if (!is_common) return;
  for (CalibratedCamera& camera : *cameras) camera.cam_from_base.reset();
}

}  // namespace

std::vector<fs::path> CalibrationFiles(const std::string& paths) {
  std::error_code ignored;  // a list of files is too long for a name
  if (fs::is_directory(paths, ignored)) return FilesIn(paths, true);
  if (fs::exists(paths, ignored) || paths.find(',') == std::string::npos) {
    return {paths};
  }
  std::vector<fs::path> files;
  for (size_t begin = 0; begin <= paths.size();) {
    const size_t end = std::min(paths.find(',', begin), paths.size());
    files.emplace_back(paths.substr(begin, end - begin));
    begin = end + 1;
  }
  return files;
}

std::vector<CalibratedCamera> ReadCalibration(const std::string& paths) {
  std::error_code ignored;
  const bool is_folder = fs::is_directory(paths, ignored);
  std::vector<CalibratedCamera> cameras;
  for (const fs::path& file : CalibrationFiles(paths)) {
    const auto found = ReadFormat(file);
    if (!found && !is_folder) {
      throw Error("'" + file.string() +
                  "' is not a calibration of a known format; the formats are "
                  "those of " +
                  kFormats);
    }
    if (found) cameras.insert(cameras.end(), found->begin(), found->end());
  }
  if (cameras.empty()) {
    throw Error("'" + paths +
                "' has no calibration of a camera; the formats are those of " +
                kFormats);
  }
  ForgetCommonPlace(&cameras);
  for (const CalibratedCamera& camera : cameras) CheckValues(camera);
  CheckNames(cameras);
  return cameras;
}

}  // namespace mgsfm
