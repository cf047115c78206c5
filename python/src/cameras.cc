// SPDX-License-Identifier: BSD-3-Clause
#include "cameras.h"

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <Eigen/Core>
#include <algorithm>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "arrays.h"
#include "bindings.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm::python {
namespace {

namespace py = pybind11;

constexpr double kNotANumber = std::numeric_limits<double>::quiet_NaN();

py::list ListCameraModels() {
  py::list list;
  for (const CameraModelInfo& info : AllCameraModels()) {
    list.append(
        py::make_tuple(static_cast<int>(info.id), std::string(info.name),
                       info.num_params, info.focal_length_idxs,
                       info.principal_point_idxs, info.extra_params_idxs));
  }
  return list;
}

template <class Matrix>
void CopyRows(const Matrix& matrix, double* rows) {
  std::copy(matrix.data(), matrix.data() + matrix.size(), rows);
}

// (pixels, d pixels / d points, d pixels / d params); the last two are None
// unless they are wanted. NaN outside the domain of the model.
py::tuple Project(const std::string& model, const ArrayIn<double>& params,
                  const ArrayIn<double>& points_in_cam, bool has_jacobians) {
  const Intrinsics camera = ReadIntrinsics(model, params);
  CheckShape(points_in_cam, "points in the camera frame", -1, 3);
  const auto num_points = static_cast<size_t>(points_in_cam.shape(0));
  const size_t num_params = camera.params.size();
  std::vector<double> pixels(2 * num_points, kNotANumber), by_point, by_params;
  if (has_jacobians) {
    by_point.assign(6 * num_points, kNotANumber);
    by_params.assign(2 * num_params * num_points, kNotANumber);
  }
  for (size_t i = 0; i < num_points; ++i) {
    Eigen::Matrix<double, 2, 3> jacobian_point;
    PixelJacobianParams jacobian_params;
    const auto pixel =
        ProjectToPixel(camera.model, camera.params.data(),
                       Eigen::Vector3d(points_in_cam.data() + 3 * i),
                       has_jacobians ? &jacobian_point : nullptr,
                       has_jacobians ? &jacobian_params : nullptr);
    if (!pixel) continue;
    CopyRows(*pixel, &pixels[2 * i]);
    if (!has_jacobians) continue;
    using RowMajor23 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
    CopyRows(RowMajor23(jacobian_point), &by_point[6 * i]);
    CopyRows(jacobian_params, &by_params[2 * num_params * i]);
  }
  const auto n = static_cast<py::ssize_t>(num_points);
  py::object point_array = py::none(), params_array = py::none();
  if (has_jacobians) {
    point_array = MakeArray(std::move(by_point))
                      .reshape({n, py::ssize_t{2}, py::ssize_t{3}});
    params_array =
        MakeArray(std::move(by_params))
            .reshape({n, py::ssize_t{2}, static_cast<py::ssize_t>(num_params)});
  }
  return py::make_tuple(MakeArray(std::move(pixels), 2), point_array,
                        params_array);
}

// Unit rays; NaN where a pixel has none.
py::array_t<double> Unproject(const std::string& model,
                              const ArrayIn<double>& params,
                              const ArrayIn<double>& pixels) {
  const Intrinsics camera = ReadIntrinsics(model, params);
  CheckShape(pixels, "pixels", -1, 2);
  std::vector<double> rays;
  for (py::ssize_t i = 0; i < pixels.shape(0); ++i) {
    Append(RayFromPixel(camera.model, camera.params.data(),
                        Eigen::Vector2d(pixels.data(i, 0)))
               .value_or(Eigen::Vector3d::Constant(kNotANumber)),
           &rays);
  }
  return MakeArray(std::move(rays), 3);
}

double PixelsPerRadianOf(const std::string& model,
                         const ArrayIn<double>& params) {
  const Intrinsics camera = ReadIntrinsics(model, params);
  return PixelsPerRadian(camera.model, camera.params.data());
}

}  // namespace

Intrinsics ReadIntrinsics(const std::string& model,
                          const ArrayIn<double>& params) {
  const CameraModelInfo* info = FindCameraModel(std::string_view(model));
  if (info == nullptr) throw Error("unknown camera model '" + model + "'");
  CheckShape(params, "params of " + model, info->num_params);
  return {info->id, {params.data(), params.data() + params.size()}};
}

void BindCameras(py::module_* module) {
  module->def("list_camera_models", &ListCameraModels);
  module->def("project", &Project, py::arg("model"), py::arg("params"),
              py::arg("points_in_cam"), py::arg("has_jacobians"));
  module->def("unproject", &Unproject, py::arg("model"), py::arg("params"),
              py::arg("pixels"));
  module->def("pixels_per_radian", &PixelsPerRadianOf, py::arg("model"),
              py::arg("params"));
}

}  // namespace mgsfm::python
