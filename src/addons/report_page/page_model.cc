// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/page_model.h"

#include <algorithm>
#include <iterator>

#include "base/parallel.h"
#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/version.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Json = nlohmann::ordered_json;

// Adds one value to the statistics of an image, sensor or model.
void Add(std::optional<double> error_px, ImageStatistics* statistics) {
  ++statistics->num_points;
  if (!error_px) return;
  ++statistics->num_errors;
  statistics->sum_errors_px += *error_px;
}

void AddResidual(const Vector2d& keypoint_px, const Camera& camera,
                 const Vector2d& residual_px, SensorStatistics* sensor) {
  const double error_px = residual_px.norm();
  const double bin = std::min(error_px / SensorStatistics::kBinPx,
                              SensorStatistics::kNumBins - 1.0);
  ++sensor->error_histogram[static_cast<size_t>(bin)];
  const auto index = [](double position, int extent, int size) {
    const double share = position / std::max(extent, 1) * size;
    return static_cast<int>(std::clamp(share, 0.0, size - 1.0));
  };
  const int column =
      index(keypoint_px.x(), camera.width_px, SensorStatistics::kNumColumns);
  const int row = index(keypoint_px.y(), camera.height_px, sensor->num_rows);
  ImageCell& cell = sensor->cells[row * SensorStatistics::kNumColumns + column];
  ++cell.num_residuals;
  cell.sum_errors_px += error_px;
  cell.sum_residuals_px += residual_px;
}

void CountImages(const Scene& scene, const Projector& projector,
                 const Reconstruction& reconstruction,
                 PageStatistics* statistics) {
  for (size_t i = 0; i < scene.images.size(); ++i) {
    SensorStatistics& sensor = statistics->sensors[scene.images[i].sensor_idx];
    ++sensor.num_images;
    if (!projector.CamFromWorld(static_cast<int>(i))) continue;
    ++sensor.num_registered;
    ++statistics->num_registered_images;
  }
  statistics->num_registered_frames =
      CountIf(reconstruction.rig_from_world,
              [](const auto& pose) { return pose.has_value(); });
}

}  // namespace

Projector::Projector(const Scene& scene, const Reconstruction& reconstruction)
    : scene_(scene), reconstruction_(reconstruction) {
  for (size_t i = 0; i < scene.images.size(); ++i) {
    cam_from_world_.push_back(
        reconstruction.CamFromWorld(scene, static_cast<int>(i)));
  }
}

std::optional<Vector2d> Projector::ResidualPx(
    const Observation& observation,
    const Eigen::Vector3d& point_in_world) const {
  const auto& pose = cam_from_world_[observation.image_idx];
  if (!pose) return std::nullopt;
  const Image& image = scene_.images[observation.image_idx];
  const Camera& camera = reconstruction_.cameras[image.camera_idx];
  const auto pixel = ProjectToPixel(camera.model, camera.params.data(),
                                    *pose * point_in_world);
  if (!pixel || !pixel->allFinite()) return std::nullopt;
  return *pixel - image.keypoints_px[observation.keypoint_idx].cast<double>();
}

PageStatistics ComputeStatistics(const Scene& scene,
                                 const Reconstruction& reconstruction,
                                 const Projector& projector,
                                 const Context& context) {
  PageStatistics statistics;
  statistics.images.resize(scene.images.size());
  statistics.sensors.resize(scene.sensors.size());
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    const Camera& camera = scene.cameras[scene.sensors[i].camera_idx];
    SensorStatistics& sensor = statistics.sensors[i];
    const double aspect =
        static_cast<double>(camera.height_px) / std::max(camera.width_px, 1);
    sensor.num_rows = static_cast<int>(std::clamp(
        std::round(SensorStatistics::kNumColumns * aspect), 1.0, 96.0));
    sensor.cells.resize(static_cast<size_t>(sensor.num_rows) *
                        SensorStatistics::kNumColumns);
  }
  CountImages(scene, projector, reconstruction, &statistics);

  // Blocks bound the memory for residuals.
  constexpr size_t kBlockSize = 1 << 16;
  const std::vector<Point3D>& points = reconstruction.points;
  for (size_t begin = 0; begin < points.size(); begin += kBlockSize) {
    const size_t size = std::min(kBlockSize, points.size() - begin);
    std::vector<std::vector<std::optional<Vector2d>>> residuals_px(size);
    ParallelFor(size, context.num_threads, [&](size_t i) {
      const Point3D& point = points[begin + i];
      for (const Observation& observation : point.track) {
        residuals_px[i].push_back(
            projector.ResidualPx(observation, point.point_in_world));
      }
    });
    context.CheckInterrupted();
    for (size_t i = 0; i < size; ++i) {
      const std::vector<Observation>& track = points[begin + i].track;
      statistics.num_observations += track.size();
      if (statistics.num_tracks_of_length.size() <= track.size()) {
        statistics.num_tracks_of_length.resize(track.size() + 1);
      }
      ++statistics.num_tracks_of_length[track.size()];
      for (size_t k = 0; k < track.size(); ++k) {
        const auto& residual_px = residuals_px[i][k];
        const Image& image = scene.images[track[k].image_idx];
        SensorStatistics& sensor = statistics.sensors[image.sensor_idx];
        std::optional<double> error_px;
        if (residual_px) {
          error_px = residual_px->norm();
          AddResidual(image.keypoints_px[track[k].keypoint_idx].cast<double>(),
                      reconstruction.cameras[image.camera_idx], *residual_px,
                      &sensor);
        }
        Add(error_px, &statistics.images[track[k].image_idx]);
        Add(error_px, &sensor.errors);
        Add(error_px, &statistics.errors);
      }
    }
  }
  return statistics;
}

namespace {

void WarnOfNewerVersion(const std::string& version, const Context& context) {
  try {
    if (version.empty() || !IsNewerVersion(version)) return;
    context.Warning("the report of the run was written by mgsfm " + version +
                    ", which is newer than this " + Version() +
                    "; what has changed is missing in the page");
  } catch (const Error& error) {
    context.Warning(std::string("the report of the run: ") + error.what());
  }
}

}  // namespace

Json ParseReport(const std::string& text, const Context& context) {
  if (text.empty()) return Json::object();
  Json report = Json::parse(text, nullptr, false);
  if (!report.is_object()) {
    context.Warning(
        "the report of the run is not a JSON object; it is ignored");
    return Json::object();
  }
  WarnOfNewerVersion(GetText(report, "mgsfm_version"), context);
  return report;
}

PageModel MakePageModel(const ReportPageInput& input, Json report,
                        const Context& context) {
  Projector projector(input.scene, input.reconstruction);
  PageStatistics statistics =
      ComputeStatistics(input.scene, input.reconstruction, projector, context);
  const Json& models = GetArray(report, "models");
  Json entry = input.model_idx < models.size() ? models[input.model_idx]
                                               : Json::object();
  return {input, std::move(projector), std::move(statistics), std::move(report),
          std::move(entry)};
}

FramesOfNames FramesByName(const Scene& scene) {
  FramesOfNames frame_of_name;
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    frame_of_name[scene.frames[i].name] = static_cast<int>(i);
  }
  return frame_of_name;
}

std::optional<std::pair<std::string, std::string>> GetTwoNames(
    const Json& names) {
  if (!names.is_array() || names.size() != 2 || !names[0].is_string() ||
      !names[1].is_string()) {
    return std::nullopt;
  }
  return std::pair(names[0].get<std::string>(), names[1].get<std::string>());
}

std::optional<std::pair<int, int>> FrameRange(
    const Json& names, const FramesOfNames& frame_of_name) {
  const auto ends = GetTwoNames(names);
  if (!ends) return std::nullopt;
  const auto first = frame_of_name.lower_bound(ends->first);
  const auto end = frame_of_name.upper_bound(ends->second);
  if (first == frame_of_name.end() || end == frame_of_name.begin()) {
    return std::nullopt;
  }
  const auto range = std::make_pair(first->second, std::prev(end)->second);
  if (range.first > range.second) return std::nullopt;
  return range;
}

std::string LengthUnit(const PageModel& model) {
  const Json& models = GetArray(Get(model.report, "summary"), "models");
  const size_t i = model.input.model_idx;
  const bool is_metric =
      i < models.size() &&
      GetText(models[i], "unit_of_length").compare(0, 6, "metric") == 0;
  return is_metric ? "m" : "units";
}

std::set<std::pair<int, int>> SeamPlaces(const PageModel& model) {
  const auto frame_of_name = FramesByName(model.input.scene);
  std::set<std::pair<int, int>> places;
  for (const Json& seam : GetArray(model.model_report, "seams")) {
    std::map<int, std::pair<int, const char*>> stretches;  // by first frame
    for (const char* side : {"frames_before", "frames_after"}) {
      for (const Json& names : GetArray(seam, side)) {
        const auto range = FrameRange(names, frame_of_name);
        if (range) stretches[range->first] = {range->second, side};
      }
    }
    const std::pair<int, const char*>* last = nullptr;
    for (const auto& [first, stretch] : stretches) {
      if (last && last->second != stretch.second) {
        places.emplace(last->first, first);
      }
      last = &stretch;
    }
  }
  return places;
}

}  // namespace mgsfm
