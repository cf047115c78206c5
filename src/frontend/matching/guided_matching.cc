// SPDX-License-Identifier: BSD-3-Clause
#include "matching/guided_matching.h"

#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <tuple>
#include <utility>

#include "geometry/epipolar.h"
#include "matching/nearest_two.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Half and twice these numbers take as long or longer (docs/results/
// front_end.md).
constexpr int kNumCellsPerSide = 6;
constexpr size_t kKeypointsPerLandmark = 10;

// The epipolar planes of two views. Rays are those of the cameras, or pixels
// about the image center for uncalibrated pairs, whose planes have no
// orientation.
struct EpipolarPencil {
  Matrix3d E;  // normal = E ray1
  Vector3d epipole1, epipole2;
  Vector3d axis_x, axis_y;  // orthogonal to epipole 2
  double period = 0.0;      // of azimuths
  bool is_calibrated = false;

  double AzimuthOf(const Vector3d& normal) const {
    const double azimuth = std::atan2(normal.dot(axis_y), normal.dot(axis_x));
    return azimuth - period * std::floor(azimuth / period);
  }
};

// From pixels to rays of an uncalibrated camera, whose length is arbitrary.
Matrix3d RayFromPixelMatrix(const Camera& camera) {
  const double scale =
      1.0 / PixelsPerRadian(camera.model, camera.params.data());
  Matrix3d T = Matrix3d::Identity();
  T(0, 0) = T(1, 1) = scale;
  T(0, 2) = -0.5 * scale * camera.width_px;
  T(1, 2) = -0.5 * scale * camera.height_px;
  return T;
}

// Rotations have epipolar planes of any baseline.
EpipolarPencil MakePencil(const VerificationView& view1,
                          const VerificationView& view2,
                          const ImagePair& pair) {
  EpipolarPencil pencil;
  if (pair.relative_pose) {
    const Eigen::Quaterniond& rotation = pair.relative_pose->cam2_from_cam1;
    pencil.epipole2 =
        pair.relative_pose->translation_direction.value_or(Vector3d::UnitX());
    pencil.epipole1 = rotation.conjugate() * pencil.epipole2;
    pencil.E = EssentialFromPose({rotation, pencil.epipole2});
    pencil.period = 2.0 * M_PI;
    pencil.is_calibrated = true;
  } else {
    const Matrix3d T1 = RayFromPixelMatrix(*view1.camera);
    const Matrix3d T2 = RayFromPixelMatrix(*view2.camera);
    pencil.E = T2.inverse().transpose() * *pair.F * T1.inverse();
    const Eigen::JacobiSVD<Matrix3d> svd(
        pencil.E, Eigen::ComputeFullU | Eigen::ComputeFullV);
    pencil.epipole1 = svd.matrixV().col(2);
    pencil.epipole2 = svd.matrixU().col(2);
    pencil.period = M_PI;
  }
  pencil.axis_x = pencil.epipole2.unitOrthogonal();
  pencil.axis_y = pencil.epipole2.cross(pencil.axis_x);
  return pencil;
}

// Where the epipolar plane of a keypoint may be.
struct Place {
  // Half-widths of one class differ by at most a factor of sqrt(2).
  int width_class = 0;
  double azimuth = 0.0;
  uint32_t keypoint_idx = 0;
  double half_width = 0.0;

  friend bool operator<(const Place& a, const Place& b) {
    return std::tie(a.width_class, a.azimuth, a.keypoint_idx) <
           std::tie(b.width_class, b.azimuth, b.keypoint_idx);
  }
};

// The places of all keypoints of an image, sorted. Landmarks and keypoints at
// the epipole may be anywhere.
std::vector<Place> PlacesOf(const EpipolarPencil& pencil, bool is_first,
                            const MatchingView& view, size_t num_keypoints,
                            double max_error_rad) {
  const Vector3d& epipole = is_first ? pencil.epipole1 : pencil.epipole2;
  const Matrix3d T = RayFromPixelMatrix(*view.geometry.camera);
  std::vector<Place> places(num_keypoints);
  for (size_t i = 0; i < num_keypoints; ++i) {
    Place& place = places[i];
    place.keypoint_idx = static_cast<uint32_t>(i);
    place.half_width = pencil.period;
    std::optional<Vector3d> ray = (*view.geometry.rays)[i];
    if (!pencil.is_calibrated) {
      ray =
          Vector3d(
              T * (*view.geometry.keypoints_px)[i].cast<double>().homogeneous())
              .normalized();
    }
    const double sine = ray ? epipole.cross(*ray).norm() : 0.0;
    const bool is_landmark =
        std::binary_search(view.landmarks->begin(), view.landmarks->end(), i);
    if (sine > max_error_rad && !is_landmark) {
      place.half_width = std::asin(max_error_rad / sine);
      place.azimuth = pencil.AzimuthOf(is_first ? Vector3d(pencil.E * *ray)
                                                : pencil.epipole2.cross(*ray));
    }
    place.width_class =
        static_cast<int>(std::floor(2.0 * std::log2(place.half_width)));
  }
  std::sort(places.begin(), places.end());
  return places;
}

// Consecutive places with similar azimuths or half-widths.
struct PlaceRange {
  size_t begin = 0;
  size_t end = 0;
  double min_azimuth = 0.0;
  double max_azimuth = 0.0;
  double max_half_width = 0.0;

  PlaceRange(const std::vector<Place>& places, size_t range_begin,
             size_t range_end)
      : begin(range_begin),
        end(range_end),
        min_azimuth(places[begin].azimuth),
        max_azimuth(min_azimuth) {
    for (size_t i = begin; i < end; ++i) {
      min_azimuth = std::min(min_azimuth, places[i].azimuth);
      max_azimuth = std::max(max_azimuth, places[i].azimuth);
      max_half_width = std::max(max_half_width, places[i].half_width);
    }
  }
};

std::vector<PlaceRange> WidthClasses(const std::vector<Place>& places) {
  std::vector<PlaceRange> classes;
  for (size_t begin = 0, end = 0; begin < places.size(); begin = end) {
    while (end < places.size() &&
           places[end].width_class == places[begin].width_class) {
      ++end;
    }
    classes.emplace_back(places, begin, end);
  }
  return classes;
}

TileSelection SelectBand(const std::vector<Place>& places1,
                         const std::vector<Place>& places2, double period) {
  TileSelection tiles(places1.size(), places2.size());
  const std::vector<PlaceRange> classes = WidthClasses(places2);
  const auto first_at = [&](const PlaceRange& range, double azimuth) {
    const auto begin = places2.begin();
    return static_cast<size_t>(
        std::lower_bound(begin + static_cast<std::ptrdiff_t>(range.begin),
                         begin + static_cast<std::ptrdiff_t>(range.end),
                         azimuth,
                         [](const Place& place, double value) {
                           return place.azimuth < value;
                         }) -
        begin);
  };
  for (size_t i = 0; i < places1.size(); i += kTileRows) {
    const PlaceRange rows(places1, i, std::min(i + kTileRows, places1.size()));
    for (const PlaceRange& columns : classes) {
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

// Verifies the matches of the landmarks; nullopt if most of them contradict the
// motion.
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
  const bool is_explained = 2 * pair.matches.size() > matches.size() &&
                            pair.config != TwoViewConfig::kWatermark;
  if (!is_explained) return std::nullopt;
  return pair;
}

std::vector<uint32_t> KeypointsOf(const std::vector<Place>& places) {
  std::vector<uint32_t> idxs;
  idxs.reserve(places.size());
  for (const Place& place : places) idxs.push_back(place.keypoint_idx);
  return idxs;
}

}  // namespace

std::vector<uint32_t> SelectLandmarks(
    const Camera& camera, const std::vector<FeatureKeypoint>& keypoints) {
  std::vector<std::vector<std::pair<float, uint32_t>>> cells(
      static_cast<size_t>(kNumCellsPerSide) * kNumCellsPerSide);
  const auto index = [](double value, double size) {
    return static_cast<size_t>(
        std::clamp(static_cast<int>(value / size * kNumCellsPerSide), 0,
                   kNumCellsPerSide - 1));
  };
  for (size_t i = 0; i < keypoints.size(); ++i) {
    cells[index(keypoints[i].y_px, camera.height_px) * kNumCellsPerSide +
          index(keypoints[i].x_px, camera.width_px)]
        .emplace_back(-keypoints[i].ScalePx(), static_cast<uint32_t>(i));
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
  const std::vector<Place> places1 =
      PlacesOf(pencil, true, view1, size1, max_error_rad);
  const std::vector<Place> places2 =
      PlacesOf(pencil, false, view2, size2, max_error_rad);
  const TileSelection tiles = SelectBand(places1, places2, pencil.period);
  std::vector<Match> matches =
      MatchListed(view1.descriptors, KeypointsOf(places1), view2.descriptors,
                  KeypointsOf(places2), matching, &tiles);
  std::sort(matches.begin(), matches.end(), [](const Match& a, const Match& b) {
    return a.keypoint_idx1 < b.keypoint_idx1;
  });
  return matches;
}

}  // namespace mgsfm
