// SPDX-License-Identifier: BSD-3-Clause
#include "math/statistics.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/ranges.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

double Quantile(std::vector<double> values, double q) {
  MGSFM_CHECK(!values.empty());
  const double rank = q * static_cast<double>(values.size() - 1);
  const auto nth = values.begin() + std::lround(rank);
  std::nth_element(values.begin(), nth, values.end());
  return *nth;
}

double Median(std::vector<double> values) {
  return Quantile(std::move(values), 0.5);
}

std::optional<double> MedianDifference(const std::vector<double>& values) {
  if (values.size() < 2) return std::nullopt;
  std::vector<double> differences;
  for (size_t i = 1; i < values.size(); ++i) {
    differences.push_back(values[i] - values[i - 1]);
  }
  return Median(std::move(differences));
}

Eigen::Vector3d MedianOfCoordinates(
    const std::vector<Eigen::Vector3d>& vectors) {
  Eigen::Vector3d median;
  for (int axis = 0; axis < 3; ++axis) {
    median[axis] = Median(Transformed(
        vectors, [axis](const Eigen::Vector3d& v) { return v[axis]; }));
  }
  return median;
}

}  // namespace mgsfm
