// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "mgsfm/base/options_io.h"

namespace mgsfm {

// The replacement for a command or an option of COLMAP, or a habit from other
// programs, that does not exist here, as in "use mapper"; nullopt if the name
// is not known, or none of the options replaces it.
std::optional<std::string> AdviceOnCommand(const std::string& name);
std::optional<std::string> AdviceOnOption(const std::string& name,
                                          const OptionList& options);

}  // namespace mgsfm
