// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/covariance_report.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "geometry/decompositions.h"
#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

std::string CsvNumber(double value) {
  return ',' + FormatDouble(value, std::chars_format::general, 9);
}

int CountUnobservable(const CovarianceResult& covariances, bool is_sensor,
                      int idx, bool is_rotation) {
  int count = 0;
  for (const UnobservableDirection& direction : covariances.unobservable) {
    count += direction.is_sensor == is_sensor && direction.idx == idx &&
             direction.is_rotation == is_rotation;
  }
  return count;
}

std::string Line(const CovarianceResult& covariances, bool is_sensor, int idx,
                 const std::string& name) {
  const PoseMatrix& c =
      *(is_sensor ? covariances.sensors : covariances.frames)[idx];
  std::string line = (is_sensor ? "sensor," : "frame,") + QuoteCsv(name);
  for (int i = 0; i < 6; ++i) {
    const double sigma = std::sqrt(std::max(0.0, c(i, i)));
    line += CsvNumber(i < 3 ? RadToDeg(sigma) : sigma);
  }
  for (const bool is_rotation : {true, false}) {
    line += "," + std::to_string(CountUnobservable(covariances, is_sensor, idx,
                                                   is_rotation));
  }
  for (int i = 0; i < 6; ++i) {
    for (int j = i; j < 6; ++j) line += CsvNumber(c(i, j));
  }
  return line + "\n";
}

bool IsFixed(const PoseMatrix& covariance) {
  return covariance.bottomRightCorner<3, 3>().isZero(0.0);
}

// The standard deviation along the least certain direction.
double SigmaOfTranslation(const PoseMatrix& covariance) {
  const SymmetricEigen<Eigen::Matrix3d> eigen(
      covariance.bottomRightCorner<3, 3>());
  return std::sqrt(std::max(0.0, eigen.values[2]));
}

std::optional<double> MedianSigmaOfFrames(const CovarianceResult& covariances) {
  std::vector<double> sigmas;
  for (const auto& covariance : covariances.frames) {
    if (!covariance || IsFixed(*covariance)) continue;
    sigmas.push_back(SigmaOfTranslation(*covariance));
  }
  if (sigmas.empty()) return std::nullopt;
  return Median(std::move(sigmas));
}

}  // namespace

std::string CovariancesToCsv(const Scene& scene,
                             const CovarianceResult& covariances) {
  std::string csv =
      "kind,name,sigma_rotation_x_deg,sigma_rotation_y_deg,sigma_rotation_z_"
      "deg,"
      "sigma_translation_x,sigma_translation_y,sigma_translation_z,"
      "num_unobservable_rotations,num_unobservable_translations";
  for (int i = 0; i < 6; ++i) {
    for (int j = i; j < 6; ++j) {
      csv += ",c" + std::to_string(i) + std::to_string(j);
    }
  }
  csv += "\n";
  for (size_t i = 0; i < covariances.sensors.size(); ++i) {
    if (!covariances.sensors[i]) continue;
    csv += Line(covariances, true, static_cast<int>(i), scene.sensors[i].name);
  }
  for (size_t i = 0; i < covariances.frames.size(); ++i) {
    if (!covariances.frames[i]) continue;
    csv += Line(covariances, false, static_cast<int>(i), scene.frames[i].name);
  }
  return csv;
}

bool IsPlaceDetermined(const Reconstruction& model,
                       const CovarianceResult& covariances, int sensor_idx) {
  // The quantile of chi squared with three degrees of freedom.
  constexpr double kMinSquaredDistance = 21.108;
  const auto& pose = model.sensor_from_rig[sensor_idx];
  const auto& covariance = covariances.sensors[sensor_idx];
  if (!pose || !covariance || IsFixed(*covariance)) return true;
  const Eigen::Matrix3d C = covariance->bottomRightCorner<3, 3>();
  const double squared_distance =
      pose->translation.dot(C.ldlt().solve(pose->translation));
  if (squared_distance > kMinSquaredDistance) return true;
  const auto sigma_of_frames = MedianSigmaOfFrames(covariances);
  return !sigma_of_frames ||
         SigmaOfTranslation(*covariance) <= *sigma_of_frames;
}

std::string DescribeUnobservable(const Scene& scene,
                                 const Reconstruction& model,
                                 const CovarianceResult& covariances) {
  std::string text;
  for (size_t i = 0; i < scene.sensors.size(); ++i) {
    for (const bool is_rotation : {true, false}) {
      const int count = CountUnobservable(covariances, true,
                                          static_cast<int>(i), is_rotation);
      if (count == 0) continue;
      text += (text.empty() ? "" : "; ") + std::string("camera '") +
              scene.sensors[i].name + "': " + std::to_string(count) + " of 3 " +
              "directions of its " +
              (is_rotation ? "rotation" : "translation") + " in the rig";
    }
    if (IsPlaceDetermined(model, covariances, static_cast<int>(i))) continue;
    text += (text.empty() ? "" : "; ") + std::string("camera '") +
            scene.sensors[i].name + "': its place in the rig" +
            Formatted(
                ", %.2g from the reference with a standard deviation "
                "of %.2g",
                model.sensor_from_rig[i]->translation.norm(),
                SigmaOfTranslation(*covariances.sensors[i]));
  }
  return text.empty() ? text : "not observable: " + text;
}

}  // namespace mgsfm
