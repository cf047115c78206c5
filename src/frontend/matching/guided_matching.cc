// SPDX-License-Identifier: BSD-3-Clause
#include "matching/guided_matching.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <tuple>
#include <utility>

#include "base/ranges.h"
#include "geometry/decompositions.h"
#include "geometry/epipolar.h"
#include "matching/nearest_two.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Half and twice these numbers take as long or longer
// (docs/results/front_end.md).
constexpr int kNumCellsPerSide = 6;
constexpr size_t kKeypointsPerLandmark = 10;
// Matches that the motion does not explain may show another lens
// (fisheye_detection.h) or a rival motion. If there are many, all descriptors
// are compared. A share of 0.5 guides one pair in a hundred more
// (docs/results/front_end.md).
constexpr double kMinExplainedShare = 0.8;

// The epipolar planes of two views. The rays of an uncalibrated pair ignore
// distortion, and its planes have no orientation.
struct EpipolarPencil {
  Matrix3d E;  // normal = E ray1
  double product_of_singular_values = 1.0;
  Vector3d epipole1, epipole2;
  Vector3d axis_x, axis_y;  // orthogonal to epipole 2
  double period = 0.0;      // of azimuths
  bool is_calibrated = false;

  double AzimuthOf(const Vector3d& normal) const {
    const double azimuth = std::atan2(normal.dot(axis_y), normal.dot(axis_x));
    return azimuth - period * std::floor(azimuth / period);
  }
  // The derivative of the azimuth about epipole 2 by that about epipole 1, 1
  // for calibrated pairs. `sine` is that of the angle of ray 1 from epipole 1.
  double StretchOf(const Vector3d& normal, double sine) const {
    return product_of_singular_values * sine * sine / normal.squaredNorm();
  }
};

EpipolarPencil MakePencil(const VerificationView& view1,
                          const VerificationView& view2,
                          const ImagePair& pair) {
  EpipolarPencil pencil;
  if (pair.relative_pose) {
    const Rigid3 pose{pair.relative_pose->cam2_from_cam1,
                      *pair.relative_pose->translation_direction};
    pencil.epipole2 = pose.translation;
    pencil.epipole1 = pose.rotation.conjugate() * pose.translation;
    pencil.E = EssentialFromPose(pose);
    pencil.period = 2.0 * M_PI;
    pencil.is_calibrated = true;
  } else {
    pencil.E = LinearPart(*view2.camera).transpose() * *pair.F *
               LinearPart(*view1.camera);
    const Svd3 svd(pencil.E);
    pencil.product_of_singular_values = svd.values[0] * svd.values[1];
    pencil.epipole1 = svd.V.col(2);
    pencil.epipole2 = svd.U.col(2);
    pencil.period = M_PI;
  }
  pencil.axis_x = pencil.epipole2.unitOrthogonal();
  pencil.axis_y = pencil.epipole2.cross(pencil.axis_x);
  return pencil;
}

// The interval of azimuths that contains the epipolar plane of a keypoint.
struct KeypointPlane {
  // Half-widths of one class differ by at most a factor of sqrt(2).
  int width_class = 0;
  double azimuth = 0.0;
  uint32_t keypoint_idx = 0;
  double half_width = 0.0;

  friend bool operator<(const KeypointPlane& a, const KeypointPlane& b) {
    return std::tie(a.width_class, a.azimuth, a.keypoint_idx) <
           std::tie(b.width_class, b.azimuth, b.keypoint_idx);
  }
};

// The planes of all keypoints of an image, sorted. Landmarks and keypoints at
// the epipole may be anywhere.
std::vector<KeypointPlane> PlanesOf(const EpipolarPencil& pencil, bool is_first,
                                    const MatchingView& view,
                                    size_t num_keypoints,
                                    double max_error_rad) {
  const Vector3d& epipole = is_first ? pencil.epipole1 : pencil.epipole2;
  const Matrix3d inverse_K = LinearPart(*view.geometry.camera).inverse();
  std::vector<KeypointPlane> planes(num_keypoints);
  for (size_t i = 0; i < num_keypoints; ++i) {
    KeypointPlane& plane = planes[i];
    plane.keypoint_idx = static_cast<uint32_t>(i);
    plane.half_width = pencil.period;
    std::optional<Vector3d> ray = (*view.geometry.rays)[i];
    if (!pencil.is_calibrated) {
      ray = LinearRay(inverse_K, (*view.geometry.keypoints_px)[i]);
    }
    const double sine = ray ? epipole.cross(*ray).norm() : 0.0;
    const bool is_landmark =
        std::binary_search(view.landmarks->begin(), view.landmarks->end(), i);
    if (sine > max_error_rad && !is_landmark) {
      const Vector3d normal =
          is_first ? Vector3d(pencil.E * *ray) : pencil.epipole2.cross(*ray);
      plane.half_width = std::asin(max_error_rad / sine) *
                         (is_first ? pencil.StretchOf(normal, sine) : 1.0);
      plane.azimuth = pencil.AzimuthOf(normal);
    }
    plane.width_class =
        static_cast<int>(std::floor(2.0 * std::log2(plane.half_width)));
  }
  std::sort(planes.begin(), planes.end());
  return planes;
}

// Consecutive planes with similar azimuths or half-widths.
struct PlaneRange {
  size_t begin = 0;
  size_t end = 0;
  double min_azimuth = 0.0;
  double max_azimuth = 0.0;
  double max_half_width = 0.0;

  PlaneRange(const std::vector<KeypointPlane>& planes, size_t range_begin,
             size_t range_end)
      : begin(range_begin),
        end(range_end),
        min_azimuth(planes[begin].azimuth),
        max_azimuth(min_azimuth) {
    for (size_t i = begin; i < end; ++i) {
      min_azimuth = std::min(min_azimuth, planes[i].azimuth);
      max_azimuth = std::max(max_azimuth, planes[i].azimuth);
      max_half_width = std::max(max_half_width, planes[i].half_width);
    }
  }
};

std::vector<PlaneRange> WidthClasses(const std::vector<KeypointPlane>& planes) {
  std::vector<PlaneRange> classes;
  for (size_t begin = 0, end = 0; begin < planes.size(); begin = end) {
    while (end < planes.size() &&
           planes[end].width_class == planes[begin].width_class) {
      ++end;
    }
    classes.emplace_back(planes, begin, end);
  }
  return classes;
}

TileSelection SelectBand(const std::vector<KeypointPlane>& planes1,
                         const std::vector<KeypointPlane>& planes2,
                         double period) {
  TileSelection tiles(planes1.size(), planes2.size());
  const std::vector<PlaneRange> classes = WidthClasses(planes2);
  const auto first_at = [&](const PlaneRange& range, double azimuth) {
    const auto begin = planes2.begin();
    return static_cast<size_t>(
        std::lower_bound(begin + range.begin, begin + range.end, azimuth,
                         [](const KeypointPlane& plane, double value) {
                           return plane.azimuth < value;
                         }) -
        begin);
  };
  for (size_t i = 0; i < planes1.size(); i += kTileRows) {
    const PlaneRange rows(planes1, i, std::min(i + kTileRows, planes1.size()));
    for (const PlaneRange& columns : classes) {
      const double width = rows.max_half_width + columns.max_half_width;
      const double lower = rows.min_azimuth - width;
      const double upper = rows.max_azimuth + width;
      if (upper - lower >= period) {
        tiles.Select(i / kTileRows, columns.begin, columns.end);
        continue;
      }
      // Azimuths lie between 0 and the period.
      for (const double shift : {-period, 0.0, period}) {
        tiles.Select(i / kTileRows, first_at(columns, lower + shift),
                     first_at(columns, upper + shift));
      }
    }
  }
  return tiles;
}

std::vector<uint8_t> RowsOf(DescriptorView descriptors,
                            const std::vector<uint32_t>& idxs) {
  std::vector<uint8_t> rows;
  rows.reserve(idxs.size() * DescriptorView::kDim);
  for (const uint32_t i : idxs) {
    rows.insert(rows.end(), descriptors.Row(i), descriptors.Row(i + 1));
  }
  return rows;
}

// Matches the descriptors with these indices. `tiles` are of the lists.
std::vector<Match> MatchListed(DescriptorView descriptors1,
                               const std::vector<uint32_t>& idxs1,
                               DescriptorView descriptors2,
                               const std::vector<uint32_t>& idxs2,
                               const DescriptorMatchingOptions& options,
                               const TileSelection* tiles) {
  const std::vector<uint8_t> rows1 = RowsOf(descriptors1, idxs1);
  const std::vector<uint8_t> rows2 = RowsOf(descriptors2, idxs2);
  std::vector<Match> matches = MatchDescriptors(
      {rows1.data(), idxs1.size()}, {rows2.data(), idxs2.size()}, options,
      FastestInstructionSet(), tiles);
  for (Match& match : matches) {
    match = {idxs1[match.keypoint_idx1], idxs2[match.keypoint_idx2]};
  }
  return matches;
}

// Verifies the matches of the landmarks; nullopt if they do not determine the
// epipolar planes, or if too many of them contradict the motion.
std::optional<ImagePair> FindMotion(const MatchingView& view1,
                                    const MatchingView& view2,
                                    const DescriptorMatchingOptions& matching,
                                    const TwoViewGeometryOptions& two_view,
                                    Random random) {
  const auto landmarks = [&](const MatchingView& view) {
    std::vector<uint32_t> idxs = *view.landmarks;
    const auto limit = static_cast<uint32_t>(matching.max_num_matches);
    idxs.erase(std::lower_bound(idxs.begin(), idxs.end(), limit), idxs.end());
    return idxs;
  };
  const std::vector<Match> matches =
      MatchListed(view1.descriptors, landmarks(view1), view2.descriptors,
                  landmarks(view2), matching, nullptr);
  ImagePair pair =
      VerifyPair(view1.geometry, view2.geometry, matches, two_view, random);
  // Landmarks on a plane, or without parallax, do not determine the epipolar
  // planes of other points.
  const bool has_planes = pair.config == TwoViewConfig::kCalibrated ||
                          pair.config == TwoViewConfig::kUncalibrated;
  if (!has_planes ||
      pair.matches.size() < kMinExplainedShare * matches.size()) {
    return std::nullopt;
  }
  return pair;
}

}  // namespace

std::vector<uint32_t> SelectLandmarks(
    const Camera& camera, const std::vector<FeatureKeypoint>& keypoints) {
  std::vector<std::vector<std::pair<float, uint32_t>>> cells(
      static_cast<size_t>(kNumCellsPerSide) * kNumCellsPerSide);
  const auto index = [](double value, double size) {
    const double cell = value / size * kNumCellsPerSide;
    return cell > 0.0
               ? static_cast<size_t>(std::min(cell, kNumCellsPerSide - 1.0))
               : size_t{0};
  };
  for (size_t i = 0; i < keypoints.size(); ++i) {
    const float scale_px = keypoints[i].ScalePx();
    cells[index(keypoints[i].y_px, camera.height_px) * kNumCellsPerSide +
          index(keypoints[i].x_px, camera.width_px)]
        .emplace_back(std::isfinite(scale_px) ? -scale_px : 0.0F,
                      static_cast<uint32_t>(i));
  }
  std::vector<uint32_t> landmarks;
  for (auto& cell : cells) {
    std::sort(cell.begin(), cell.end());
    const size_t number =
        (cell.size() + kKeypointsPerLandmark - 1) / kKeypointsPerLandmark;
    for (size_t k = 0; k < number; ++k) landmarks.push_back(cell[k].second);
  }
  std::sort(landmarks.begin(), landmarks.end());
  return landmarks;
}

std::vector<Match> MatchGuided(const MatchingView& view1,
                               const MatchingView& view2,
                               const DescriptorMatchingOptions& matching,
                               const TwoViewGeometryOptions& two_view,
                               Random random) {
  if (!matching.guided_matching) {
    return MatchDescriptors(view1.descriptors, view2.descriptors, matching);
  }
  const auto max_size = static_cast<size_t>(matching.max_num_matches);
  const size_t size1 = std::min(view1.descriptors.size, max_size);
  const size_t size2 = std::min(view2.descriptors.size, max_size);
  const auto motion = FindMotion(view1, view2, matching, two_view, random);
  if (!motion) {
    return MatchDescriptors(view1.descriptors, view2.descriptors, matching);
  }
  const EpipolarPencil pencil =
      MakePencil(view1.geometry, view2.geometry, *motion);
  const double max_error_rad =
      two_view.max_error *
      RadiansPerPixel(*view1.geometry.camera, *view2.geometry.camera);
  const std::vector<KeypointPlane> planes1 =
      PlanesOf(pencil, true, view1, size1, max_error_rad);
  const std::vector<KeypointPlane> planes2 =
      PlanesOf(pencil, false, view2, size2, max_error_rad);
  const TileSelection tiles = SelectBand(planes1, planes2, pencil.period);
  std::vector<Match> matches = MatchListed(
      view1.descriptors, Transformed(planes1, &KeypointPlane::keypoint_idx),
      view2.descriptors, Transformed(planes2, &KeypointPlane::keypoint_idx),
      matching, &tiles);
  SortBy(&matches, &Match::keypoint_idx1);
  return matches;
}

}  // namespace mgsfm
