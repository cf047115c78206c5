// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace mgsfm {

// Times are in ascending order.

// The images that are nearest to the times t0, t0 + 1 / rate, ... up to the
// last image, where t0 is the time of the first one; the earlier one of two
// equally near ones. Each image is selected at most once.
std::vector<int> SelectByRate(const std::vector<int64_t>& times_ns,
                              double rate_hz);

// For each instant the image that is nearest to it, if they are at most
// `max_difference_ns` apart. One to one: an image that is nearest to several
// instants belongs to the nearest of them, the earlier one if two are equally
// near.
std::vector<std::optional<int>> SelectAtInstants(
    const std::vector<int64_t>& instants_ns,
    const std::vector<int64_t>& times_ns, int64_t max_difference_ns);

// The median time between two images; nullopt for fewer than two.
std::optional<int64_t> MedianInterval(const std::vector<int64_t>& times_ns);

}  // namespace mgsfm
