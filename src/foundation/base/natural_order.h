// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

namespace mgsfm {

// Orders names by the numbers in them: "2.png" comes before "10.png".
bool IsNaturallyBefore(const std::string& a, const std::string& b);

// The number in b minus the number in a, if the names differ in one number
// only: 3 for "left/07.png" and "left/10.png". nullopt for other names.
std::optional<double> NumberDifference(const std::string& a,
                                       const std::string& b);

}  // namespace mgsfm
