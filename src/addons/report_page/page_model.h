// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/natural_order.h"
#include "mgsfm/base/context.h"
#include "mgsfm/report_page/report_page.h"
#include "mgsfm/scene/estimates.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Projects points with the poses and cameras of a model.
class Projector {
 public:
  Projector(const Scene& scene, const Reconstruction& reconstruction);

  const std::optional<Rigid3>& CamFromWorld(int image_idx) const {
    return cam_from_world_[image_idx];
  }
  // Projection minus keypoint. nullopt if the image has no pose or the camera
  // does not see the point.
  std::optional<Eigen::Vector2d> ResidualPx(
      const Observation& observation,
      const Eigen::Vector3d& point_in_world) const;

 private:
  const Scene& scene_;
  const Reconstruction& reconstruction_;
  std::vector<std::optional<Rigid3>> cam_from_world_;
};

struct ImageStatistics {
  size_t num_points = 0;
  size_t num_errors = 0;  // of the points that the camera sees
  double sum_errors_px = 0.0;

  std::optional<double> MeanErrorPx() const {
    if (num_errors == 0) return std::nullopt;
    return sum_errors_px / static_cast<double>(num_errors);
  }
};

// Residuals in one part of the image plane.
struct ImageCell {
  size_t num_residuals = 0;
  double sum_errors_px = 0.0;
  Eigen::Vector2d sum_residuals_px = Eigen::Vector2d::Zero();
};

struct SensorStatistics {
  static constexpr int kNumColumns = 24;  // of cells in the error map
  // The histogram ends at 4 px, the default of max_max_error.
  static constexpr double kBinPx = 0.1;
  static constexpr size_t kNumBins = 40;  // the last one takes larger errors

  size_t num_images = 0;
  size_t num_registered = 0;
  ImageStatistics errors;
  std::array<size_t, kNumBins> error_histogram = {};
  int num_rows = 1;
  std::vector<ImageCell> cells;  // row by row
};

struct PageStatistics {
  std::vector<ImageStatistics> images;
  std::vector<SensorStatistics> sensors;
  std::vector<size_t> num_tracks_of_length;
  size_t num_registered_images = 0;
  size_t num_registered_frames = 0;
  size_t num_observations = 0;
  ImageStatistics errors;
};

// Linear in observations.
PageStatistics ComputeStatistics(const Scene& scene,
                                 const Reconstruction& reconstruction,
                                 const Projector& projector,
                                 const Context& context);

// The common input of all parts of the page.
struct PageModel {
  const ReportPageInput& input;
  Projector projector;
  PageStatistics statistics;
  // The report of the run, and its entry for the model; empty objects if there
  // is none.
  nlohmann::ordered_json report;
  nlohmann::ordered_json model_report;
};

// Warns, and returns an empty object, if the text is none.
nlohmann::ordered_json ParseReport(const std::string& text,
                                   const Context& context);

PageModel MakePageModel(const ReportPageInput& input,
                        nlohmann::ordered_json report, const Context& context);

// The value of a key of an object, else null. Reports may be of other versions,
// so every value may be missing or have another type.
inline const nlohmann::ordered_json& Get(const nlohmann::ordered_json& object,
                                         const char* key) {
  static const nlohmann::ordered_json kNull;
  if (!object.is_object()) return kNull;
  const auto found = object.find(key);
  return found == object.end() ? kNull : *found;
}

// An empty array if the value is none.
inline const nlohmann::ordered_json& GetArray(
    const nlohmann::ordered_json& object, const char* key) {
  static const nlohmann::ordered_json kEmpty = nlohmann::ordered_json::array();
  const nlohmann::ordered_json& value = Get(object, key);
  return value.is_array() ? value : kEmpty;
}

inline std::string GetText(const nlohmann::ordered_json& object,
                           const char* key) {
  const nlohmann::ordered_json& value = Get(object, key);
  return value.is_string() ? value.get<std::string>() : "";
}

inline std::optional<double> GetNumber(const nlohmann::ordered_json& object,
                                       const char* key) {
  const nlohmann::ordered_json& value = Get(object, key);
  if (!value.is_number()) return std::nullopt;
  return value.get<double>();
}

// The texts of an array of two.
std::optional<std::pair<std::string, std::string>> GetTwoNames(
    const nlohmann::ordered_json& names);

// The natural order of names, which is that of frames without times.
struct ByName {
  bool operator()(const std::string& a, const std::string& b) const {
    return IsNaturallyBefore(a, b) || (!IsNaturallyBefore(b, a) && a < b);
  }
};
using FramesOfNames = std::map<std::string, int, ByName>;
FramesOfNames FramesByName(const Scene& scene);

// The indices of the first and the last frame in [first name, last name]. A
// page without the database lacks frames without a pose, also those that begin
// or end a range.
std::optional<std::pair<int, int>> FrameRange(
    const nlohmann::ordered_json& names, const FramesOfNames& frame_of_name);

// "m" if the report states that the model is metric, else "units".
std::string LengthUnit(const PageModel& model);

// The places of the seams of the report as pairs of frames [before, after].
// Each side of a seam consists of stretches of frames, and a seam lies where
// stretches of different sides follow each other.
std::set<std::pair<int, int>> SeamPlaces(const PageModel& model);

}  // namespace mgsfm
