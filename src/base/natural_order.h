// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace mgsfm {

// Orders names by the numbers in them: "2.png" comes before "10.png".
bool IsNaturallyBefore(const std::string& a, const std::string& b);

}  // namespace mgsfm
