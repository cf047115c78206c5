// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.h"
#include "base/random.h"
#include "bindings.h"
#include "cameras.h"
#include "command.h"
#include "geometry/absolute_pose.h"
#include "geometry/epipolar.h"
#include "geometry/generalized_pose.h"
#include "geometry/ransac.h"
#include "geometry/triangulation.h"
#include "matching/ray_models.h"
#include "matching/two_view_verification.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/base/options_io.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm::python {
namespace {

namespace py = pybind11;
using Eigen::Matrix3d;
using Eigen::Vector3d;

// ------------------------------------------------------------------- input

struct Ransac {
  double max_error = 0.0;  // in the unit of the function
  double min_inlier_ratio = 0.0;
  RansacOptions options;
  uint64_t random_seed = 0;

  // Samples that find a model with this share of inliers are enough.
  RansacOptions ForSamplesOf(int sample_size) const {
    RansacOptions result = options;
    result.max_num_trials =
        RequiredNumTrials(options, min_inlier_ratio, sample_size);
    return result;
  }
};

Ransac ReadRansac(const py::dict& values) {
  Ransac ransac;
  ransac.max_error = values["max_error"].cast<double>();
  ransac.min_inlier_ratio = values["min_inlier_ratio"].cast<double>();
  ransac.random_seed = values["random_seed"].cast<uint64_t>();
  RansacOptions& options = ransac.options;
  options.max_error_rad = ransac.max_error;
  options.confidence = values["confidence"].cast<double>();
  options.max_num_trials = values["max_num_trials"].cast<int>();
  options.min_num_trials =
      std::min(values["min_num_trials"].cast<int>(), options.max_num_trials);
  if (!(ransac.max_error > 0.0) || !(options.confidence >= 0.0) ||
      !(options.confidence < 1.0) || options.max_num_trials < 1) {
    throw Error(
        "RANSAC options: max_error and max_num_trials must be positive, and "
        "confidence in [0, 1)");
  }
  return ransac;
}

Vector3d Row3(const ArrayIn<double>& array, size_t row) {
  return Vector3d(array.data(static_cast<py::ssize_t>(row), 0));
}

// The shape of CheckShape, and finite values.
void CheckPoints(const ArrayIn<double>& array, const char* name,
                 py::ssize_t num_rows, py::ssize_t num_columns) {
  CheckShape(array, name, num_rows, num_columns);
  for (py::ssize_t i = 0; i < array.size(); ++i) {
    if (std::isfinite(array.data()[i])) continue;
    throw Error(std::string(name) + ": row " + std::to_string(i / num_columns) +
                " is not finite");
  }
}

template <int kSize>
Eigen::Matrix<double, kSize, kSize> ReadMatrix(const ArrayIn<double>& array,
                                               const char* name) {
  CheckShape(array, name, kSize, kSize);
  using RowMajor = Eigen::Matrix<double, kSize, kSize, Eigen::RowMajor>;
  return Eigen::Map<const RowMajor>(array.data());
}

Rigid3 ReadPoseArray(const ArrayIn<double>& row) {
  CheckShape(row, "a pose", 7);
  Rigid3 pose = ReadPose(row.data());
  pose.rotation.normalize();
  return pose;
}

RayMatches ReadRayMatches(const ArrayIn<double>& rays1,
                          const ArrayIn<double>& rays2) {
  CheckPoints(rays1, "rays1", -1, 3);
  CheckPoints(rays2, "rays2", rays1.shape(0), 3);
  RayMatches matches;
  const auto size = static_cast<size_t>(rays1.shape(0));
  matches.Reserve(size);
  for (size_t i = 0; i < size; ++i) {
    matches.Add(Row3(rays1, i).normalized(), Row3(rays2, i).normalized());
  }
  return matches;
}

// ------------------------------------------------------------------ output

py::array_t<bool> MaskToArray(const Mask& mask) {
  py::array_t<bool> array(static_cast<py::ssize_t>(mask.size()));
  std::copy(mask.begin(), mask.end(), array.mutable_data());
  return array;
}

// ---------------------------------------------------------- absolute poses

// 2D-3D correspondences of a rig, by camera.
struct RigPoints {
  std::vector<CameraPoints> cameras;
  std::vector<std::vector<size_t>> rows;  // of the rays of a camera
};

// `cameras` are tuples (model, params, cam_from_rig); NaN rays are left out.
RigPoints ReadRigPoints(const py::list& cameras,
                        const ArrayIn<int64_t>& camera_idxs,
                        const ArrayIn<double>& rays,
                        const ArrayIn<double>& points, double max_error_px) {
  CheckShape(rays, "rays", -1, 3);
  CheckShape(points, "points3D", rays.shape(0), 3);
  CheckShape(camera_idxs, "camera_idxs", rays.shape(0));
  RigPoints rig;
  for (const py::handle item : cameras) {
    const auto [model, params, pose] =
        py::cast<std::tuple<std::string, ArrayIn<double>, ArrayIn<double>>>(
            item);
    const Intrinsics intrinsics = ReadIntrinsics(model, params);
    rig.cameras.push_back(
        {ReadPoseArray(pose),
         {},
         {},
         max_error_px /
             PixelsPerRadian(intrinsics.model, intrinsics.params.data())});
  }
  rig.rows.resize(rig.cameras.size());
  for (py::ssize_t i = 0; i < rays.shape(0); ++i) {
    const int64_t c = camera_idxs.at(i);
    if (c < 0 || c >= static_cast<int64_t>(rig.cameras.size())) {
      throw Error("camera_idxs: row " + std::to_string(i) + " is out of range");
    }
    const auto row = static_cast<size_t>(i);
    const Vector3d ray = Row3(rays, row), point = Row3(points, row);
    if (!ray.allFinite() || !point.allFinite()) continue;
    rig.cameras[c].rays.push_back(ray);
    rig.cameras[c].points.push_back(point);
    rig.rows[c].push_back(row);
  }
  return rig;
}

// (rig_from_world, inliers) or None.
py::object EstimatePose(const py::list& cameras,
                        const ArrayIn<int64_t>& camera_idxs,
                        const ArrayIn<double>& rays,
                        const ArrayIn<double>& points, const py::dict& values) {
  const Ransac ransac = ReadRansac(values);
  const RigPoints rig =
      ReadRigPoints(cameras, camera_idxs, rays, points, ransac.max_error);
  const auto pose = [&] {
    const py::gil_scoped_release release;
    Random random(ransac.random_seed);
    return EstimateAbsolutePose(rig.cameras, ransac.ForSamplesOf(3), &random);
  }();
  if (!pose) return py::none();
  const std::vector<double> errors = AbsolutePoseErrors(rig.cameras, *pose);
  Mask is_inlier(static_cast<size_t>(rays.shape(0)), false);
  size_t k = 0;
  for (const std::vector<size_t>& rows : rig.rows) {
    for (const size_t row : rows) is_inlier[row] = errors[k++] <= 1.0;
  }
  return py::make_tuple(ToArray(*pose), MaskToArray(is_inlier));
}

// (rig_from_world, covariance) or None. Errors are in pixels.
py::object RefinePose(const py::list& cameras,
                      const ArrayIn<int64_t>& camera_idxs,
                      const ArrayIn<double>& rays,
                      const ArrayIn<double>& points,
                      const ArrayIn<double>& start, double loss_scale_px) {
  const RigPoints rig = ReadRigPoints(cameras, camera_idxs, rays, points, 1.0);
  Rigid3 pose = ReadPoseArray(start);
  if (!RefineAbsolutePose(rig.cameras, loss_scale_px, &pose).IsUsable()) {
    return py::none();
  }
  return py::make_tuple(
      ToArray(pose), ToArray(AbsolutePoseCovariance(rig.cameras, 1.0, pose)));
}

// ---------------------------------------------------------- relative poses

// (cam2_from_cam1, E, inliers) or None; max_error is in radians.
py::object EstimatePair(const ArrayIn<double>& rays1,
                        const ArrayIn<double>& rays2, const py::dict& values) {
  const Ransac ransac = ReadRansac(values);
  const RayMatches matches = ReadRayMatches(rays1, rays2);
  const auto pose = [&] {
    const py::gil_scoped_release release;
    Random random(ransac.random_seed);
    return EstimateRelativePose(matches, ransac.ForSamplesOf(5), &random);
  }();
  if (!pose) return py::none();
  return py::make_tuple(
      ToArray(*pose), ToArray(EssentialFromPose(*pose)),
      MaskToArray(FindInliers(matches, *pose, ransac.max_error)));
}

// The pose of an essential matrix with the most points in front of both
// cameras, and whether each is.
py::tuple PoseFromEssential(const ArrayIn<double>& E,
                            const ArrayIn<double>& rays1,
                            const ArrayIn<double>& rays2) {
  const RayMatches matches = ReadRayMatches(rays1, rays2);
  Mask best;
  Rigid3 pose;
  int max_num = -1;
  for (const Rigid3& candidate : DecomposeEssential(ReadMatrix<3>(E, "E"))) {
    Mask is_in_front(matches.size(), false);
    int num = 0;
    for (size_t i = 0; i < matches.size(); ++i) {
      is_in_front[i] =
          IsInFront(candidate, matches.rays1[i], matches.rays2[i], 0.0);
      num += is_in_front[i] ? 1 : 0;
    }
    if (num <= max_num) continue;
    max_num = num;
    pose = candidate;
    best = is_in_front;
  }
  return py::make_tuple(ToArray(pose), MaskToArray(best));
}

// Matches of rigs, as tuples (camera_idx1, camera_idx2, rays1, rays2).
// (rig2_from_rig1, inliers per group) or None; max_error is in radians.
py::object EstimateRigPair(const ArrayIn<double>& cams_from_rig,
                           const py::list& groups, const py::dict& values) {
  const Ransac ransac = ReadRansac(values);
  CheckShape(cams_from_rig, "cams_from_rig", -1, 7);
  std::vector<UnitMatches> pairs;
  for (const py::handle item : groups) {
    const auto [idx1, idx2, rays1, rays2] =
        py::cast<std::tuple<int, int, ArrayIn<double>, ArrayIn<double>>>(item);
    pairs.push_back({ReadPose(cams_from_rig.data(idx1, 0)),
                     ReadPose(cams_from_rig.data(idx2, 0)),
                     ReadRayMatches(rays1, rays2), ransac.max_error});
  }
  const auto pose = [&] {
    const py::gil_scoped_release release;
    Random random(ransac.random_seed);
    return EstimateUnitPose(pairs, {}, ransac.ForSamplesOf(6), &random);
  }();
  if (!pose) return py::none();
  py::list masks;
  for (const UnitMatches& pair : pairs) {
    masks.append(MaskToArray(FindUnitInliers(pair, *pose)));
  }
  return py::make_tuple(ToArray(*pose), masks);
}

// -------------------------------------------------- matrices between pixels

// A pinhole for points of unknown intrinsics. Within its view, pixels per
// radian vary by less than 2 %, as the error of a ray should be that of a
// pixel.
Matrix3d NarrowPinhole(const ArrayIn<double>& pixels) {
  constexpr double kFocalLengthOverExtent = 4.0;
  Eigen::Array2d low = Eigen::Array2d::Constant(1e300), high = -low;
  for (py::ssize_t i = 0; i < pixels.shape(0); ++i) {
    const Eigen::Array2d pixel(pixels.at(i, 0), pixels.at(i, 1));
    low = low.min(pixel);
    high = high.max(pixel);
  }
  Matrix3d K = Matrix3d::Identity();
  K(0, 0) = K(1, 1) =
      kFocalLengthOverExtent * std::max(1.0, (high - low).maxCoeff());
  K(0, 2) = 0.5 * (low + high)[0];
  K(1, 2) = 0.5 * (low + high)[1];
  return K;
}

// (F or H in pixels, inliers) or None.
py::object EstimateMatrix(const std::string& kind,
                          const ArrayIn<double>& pixels1,
                          const ArrayIn<double>& pixels2,
                          const py::dict& values) {
  CheckPoints(pixels1, "points2D1", -1, 2);
  CheckPoints(pixels2, "points2D2", pixels1.shape(0), 2);
  Ransac ransac = ReadRansac(values);
  if (pixels1.shape(0) == 0) return py::none();
  const Matrix3d K1 = NarrowPinhole(pixels1), K2 = NarrowPinhole(pixels2);
  const Matrix3d inverse_K1 = K1.inverse(), inverse_K2 = K2.inverse();
  RayMatches matches;
  for (py::ssize_t i = 0; i < pixels1.shape(0); ++i) {
    matches.Add((inverse_K1 * Vector3d(pixels1.at(i, 0), pixels1.at(i, 1), 1.0))
                    .normalized(),
                (inverse_K2 * Vector3d(pixels2.at(i, 0), pixels2.at(i, 1), 1.0))
                    .normalized());
  }
  const double max_error =
      ransac.max_error * 0.5 * (inverse_K1(0, 0) + inverse_K2(0, 0));
  ransac.options.max_error_rad = max_error;
  Random random(ransac.random_seed);
  Mask is_inlier;
  const auto test_matches = [&](const auto& test) {
    for (size_t i = 0; i < matches.size(); ++i) {
      is_inlier.push_back(test(matches.rays1[i], matches.rays2[i]));
    }
  };
  if (kind == "F") {
    const auto F =
        EstimateFundamental(matches, ransac.ForSamplesOf(7), &random);
    if (!F) return py::none();
    test_matches([&](const Vector3d& ray1, const Vector3d& ray2) {
      return IsFundamentalInlier(*F, ray1, ray2, max_error);
    });
    const Matrix3d in_pixels = inverse_K2.transpose() * *F * inverse_K1;
    return py::make_tuple(ToArray(in_pixels.normalized()),
                          MaskToArray(is_inlier));
  }
  const auto H = EstimateHomography(matches, ransac.ForSamplesOf(4), &random);
  if (!H) return py::none();
  test_matches([&, test = HomographyTest(*H)](const Vector3d& ray1,
                                              const Vector3d& ray2) {
    return test.SquaredError(ray1, ray2) <= max_error * max_error;
  });
  const Matrix3d in_pixels = K2 * *H * inverse_K1;
  return py::make_tuple(ToArray(in_pixels.normalized()),
                        MaskToArray(is_inlier));
}

// ----------------------------------------------------- two-view geometries

struct View {
  Camera camera;
  std::vector<Eigen::Vector2f> keypoints_px;
  std::vector<std::optional<Vector3d>> rays;

  VerificationView Get() const { return {&camera, &keypoints_px, &rays}; }
};

// `camera` is (model, params, width, height, has_prior_focal_length).
View ReadView(const py::tuple& camera, const ArrayIn<double>& pixels) {
  CheckPoints(pixels, "points", -1, 2);
  const auto [model, params, width_px, height_px, has_prior] =
      py::cast<std::tuple<std::string, ArrayIn<double>, int, int, bool>>(
          camera);
  Intrinsics intrinsics = ReadIntrinsics(model, params);
  View view{{CameraId(0), intrinsics.model, width_px, height_px,
             intrinsics.params, has_prior},
            {},
            {}};
  for (py::ssize_t i = 0; i < pixels.shape(0); ++i) {
    const Eigen::Vector2d pixel(pixels.at(i, 0), pixels.at(i, 1));
    view.keypoints_px.emplace_back(pixel.cast<float>());
    view.rays.push_back(
        RayFromPixel(intrinsics.model, intrinsics.params.data(), pixel));
  }
  return view;
}

// (config, F, E, H, cam2_from_cam1, inlier matches)
py::tuple EstimateTwoViews(
    const py::tuple& camera1, const ArrayIn<double>& pixels1,
    const py::tuple& camera2, const ArrayIn<double>& pixels2,
    const ArrayIn<uint32_t>& match_array,
    const std::vector<std::pair<std::string, std::string>>& values) {
  const View view1 = ReadView(camera1, pixels1);
  const View view2 = ReadView(camera2, pixels2);
  CheckShape(match_array, "matches", -1, 2);
  TwoViewGeometryOptions options;
  const OptionList list = ListOptions(&options);
  SetNamedOptions(list, values);
  CheckOptions(list);
  std::vector<Match> matches;
  for (py::ssize_t i = 0; i < match_array.shape(0); ++i) {
    matches.push_back({match_array.at(i, 0), match_array.at(i, 1)});
    if (matches.back().keypoint_idx1 >= view1.rays.size() ||
        matches.back().keypoint_idx2 >= view2.rays.size()) {
      throw Error("matches: row " + std::to_string(i) +
                  " refers to no point of its image");
    }
  }
  const ImagePair pair = [&] {
    const py::gil_scoped_release release;
    return VerifyPair(view1.Get(), view2.Get(), matches, options, Random(0));
  }();
  std::vector<uint32_t> inliers;
  for (const Match& match : pair.matches) {
    inliers.push_back(match.keypoint_idx1);
    inliers.push_back(match.keypoint_idx2);
  }
  py::object pose = py::none();
  if (pair.relative_pose) {
    pose = ToArray(Rigid3{
        pair.relative_pose->cam2_from_cam1,
        pair.relative_pose->translation_direction.value_or(Vector3d::Zero())});
  }
  return py::make_tuple(static_cast<int>(pair.config), ToArrayOrNone(pair.F),
                        ToArrayOrNone(pair.E), ToArrayOrNone(pair.H), pose,
                        MakeArray(std::move(inliers), 2));
}

// ------------------------------------------------------------ triangulation

// (xyz, inliers) or None. Errors and angles are in radians.
py::object Triangulate(const ArrayIn<double>& centers,
                       const ArrayIn<double>& rays, double max_error_rad,
                       double min_angle_rad) {
  CheckPoints(centers, "centers", -1, 3);
  CheckPoints(rays, "rays", centers.shape(0), 3);
  std::vector<Vector3d> starts, directions;
  for (size_t i = 0; i < static_cast<size_t>(centers.shape(0)); ++i) {
    starts.push_back(Row3(centers, i));
    directions.push_back(Row3(rays, i).normalized());
  }
  const auto found =
      TriangulateRobust(starts, directions, {max_error_rad, min_angle_rad});
  if (!found) return py::none();
  return py::make_tuple(ToArray(found->point), MaskToArray(found->is_inlier));
}

// The largest angle at each point between the rays to two of its centers,
// centers[offsets[i]] to centers[offsets[i + 1] - 1].
py::array_t<double> TriangulationAngles(const ArrayIn<double>& points,
                                        const ArrayIn<double>& centers,
                                        const ArrayIn<int64_t>& offsets) {
  CheckShape(points, "points", -1, 3);
  CheckShape(offsets, "offsets", points.shape(0) + 1);
  CheckShape(centers, "centers", offsets.at(points.shape(0)), 3);
  std::vector<double> angles_rad;
  for (py::ssize_t i = 0; i < points.shape(0); ++i) {
    std::vector<Vector3d> own;
    for (int64_t k = offsets.at(i); k < offsets.at(i + 1); ++k) {
      own.push_back(Row3(centers, static_cast<size_t>(k)));
    }
    angles_rad.push_back(
        MaxTriangulationAngle(own, Row3(points, static_cast<size_t>(i))));
  }
  return MakeArray(std::move(angles_rad));
}

}  // namespace

void BindEstimators(py::module_* module) {
  module->def("estimate_pose", &EstimatePose, py::arg("cameras"),
              py::arg("camera_idxs"), py::arg("rays"), py::arg("points"),
              py::arg("ransac"));
  module->def("refine_pose", &RefinePose, py::arg("cameras"),
              py::arg("camera_idxs"), py::arg("rays"), py::arg("points"),
              py::arg("start"), py::arg("loss_scale_px"));
  module->def("estimate_pair", &EstimatePair, py::arg("rays1"),
              py::arg("rays2"), py::arg("ransac"));
  module->def("pose_from_essential", &PoseFromEssential, py::arg("E"),
              py::arg("rays1"), py::arg("rays2"));
  module->def("estimate_rig_pair", &EstimateRigPair, py::arg("cams_from_rig"),
              py::arg("groups"), py::arg("ransac"));
  module->def("estimate_matrix", &EstimateMatrix, py::arg("kind"),
              py::arg("pixels1"), py::arg("pixels2"), py::arg("ransac"));
  module->def("estimate_two_views", &EstimateTwoViews, py::arg("camera1"),
              py::arg("pixels1"), py::arg("camera2"), py::arg("pixels2"),
              py::arg("matches"), py::arg("values"));
  module->def("triangulate", &Triangulate, py::arg("centers"), py::arg("rays"),
              py::arg("max_error_rad"), py::arg("min_angle_rad"));
  module->def("triangulation_angles", &TriangulationAngles, py::arg("points"),
              py::arg("centers"), py::arg("offsets"));
}

}  // namespace mgsfm::python
