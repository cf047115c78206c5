// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

namespace mgsfm {

// The q-quantile of the values by nearest rank, q in [0, 1]. `values` must not
// be empty. O(n).
double Quantile(std::vector<double> values, double q);

// Quantile(values, 0.5).
double Median(std::vector<double> values);

// The median difference of consecutive values; nullopt for fewer than two.
std::optional<double> MedianDifference(const std::vector<double>& values);

// A median of five tolerates two outliers.
inline constexpr size_t kMinNumOfMedian = 5;

// A mean or median of as many samples is accurate to a tenth of their standard
// deviation; more only cost time.
inline constexpr size_t kSufficientNumSamples = 200;

// The median of each coordinate. `vectors` must not be empty.
Eigen::Vector3d MedianOfCoordinates(
    const std::vector<Eigen::Vector3d>& vectors);

}  // namespace mgsfm
