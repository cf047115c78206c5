// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/numpy.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/error.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm::python {

// An argument of any numeric type and layout.
template <class T>
using ArrayIn =
    pybind11::array_t<T, pybind11::array::c_style | pybind11::array::forcecast>;

// The rows of a matrix, which the array owns and does not copy. Without
// columns: a vector.
template <class T>
pybind11::array_t<T> MakeArray(std::vector<T> values,
                               pybind11::ssize_t num_columns = 0) {
  auto owned = std::make_unique<std::vector<T>>(std::move(values));
  T* const data = owned->data();
  const auto size = static_cast<pybind11::ssize_t>(owned->size());
  const pybind11::capsule owner(owned.get(), [](void* pointer) {
    delete static_cast<std::vector<T>*>(pointer);
  });
  owned.release();
  if (num_columns == 0) return pybind11::array_t<T>({size}, data, owner);
  return pybind11::array_t<T>({size / num_columns, num_columns}, data, owner);
}

// Throws Error, naming the argument, unless the array has this number of
// columns, and of rows if that is not negative.
template <class T>
void CheckShape(const ArrayIn<T>& array, const std::string& name,
                pybind11::ssize_t num_rows, pybind11::ssize_t num_columns = 0) {
  const bool is_matrix = num_columns > 0;
  const bool fits = array.ndim() == (is_matrix ? 2 : 1) &&
                    (num_rows < 0 || array.shape(0) == num_rows) &&
                    (!is_matrix || array.shape(1) == num_columns);
  if (!fits) {
    const std::string rows = num_rows < 0 ? "N" : std::to_string(num_rows);
    throw Error(name + " must have the shape (" + rows +
                (is_matrix ? ", " + std::to_string(num_columns) : ",") + ")");
  }
}

template <class T>
ArrayIn<T> GetArray(const pybind11::dict& arrays, const char* key,
                    pybind11::ssize_t num_rows,
                    pybind11::ssize_t num_columns = 0) {
  auto array = pybind11::cast<ArrayIn<T>>(arrays[key]);
  CheckShape(array, key, num_rows, num_columns);
  return array;
}

// Quaternions are x, y, z, w; poses are a quaternion and a translation.

inline Eigen::Quaterniond ReadQuaternion(const double* xyzw) {
  return Eigen::Quaterniond(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
}

inline Rigid3 ReadPose(const double* xyzw_t) {
  return {ReadQuaternion(xyzw_t),
          Eigen::Vector3d(xyzw_t[4], xyzw_t[5], xyzw_t[6])};
}

inline void Append(const Eigen::Vector3d& vector, std::vector<double>* row) {
  row->insert(row->end(), vector.data(), vector.data() + 3);
}

inline void Append(const Eigen::Quaterniond& rotation,
                   std::vector<double>* row) {
  const Eigen::Vector4d& xyzw = rotation.coeffs();
  row->insert(row->end(), xyzw.data(), xyzw.data() + 4);
}

inline void Append(const Rigid3& pose, std::vector<double>* row) {
  Append(pose.rotation, row);
  Append(pose.translation, row);
}

inline pybind11::array_t<double> ToArray(const Rigid3& pose) {
  std::vector<double> row;
  Append(pose, &row);
  return MakeArray(std::move(row));
}

// A matrix by rows, or a vector.
template <class Derived>
pybind11::array_t<double> ToArray(const Eigen::MatrixBase<Derived>& matrix) {
  std::vector<double> values;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    for (Eigen::Index k = 0; k < matrix.cols(); ++k) {
      values.push_back(matrix(i, k));
    }
  }
  return MakeArray(std::move(values), matrix.cols() > 1 ? matrix.cols() : 0);
}

template <class T>
pybind11::object ToArrayOrNone(const std::optional<T>& value) {
  if (!value) return pybind11::none();
  return ToArray(*value);
}

inline std::optional<Rigid3> ReadOptionalPose(const pybind11::handle& pose) {
  if (pose.is_none()) return std::nullopt;
  const auto row = pybind11::cast<ArrayIn<double>>(pose);
  CheckShape(row, "a pose", 7);
  return ReadPose(row.data());
}

}  // namespace mgsfm::python
