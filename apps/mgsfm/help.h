// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "mgsfm/base/options_io.h"

namespace mgsfm {

// The advice on a command or option that exists in COLMAP or other programs but
// not here, for example "use mapper". nullopt if the name is
// unknown or nothing replaces it.
std::optional<std::string> AdviceOnCommand(const std::string& name);
std::optional<std::string> AdviceOnOption(const std::string& name,
                                          const OptionList& options);

enum class HelpLevel {
  kBasic,  // an example and the options that most runs need
  kAll,
};

// The text of --help and --help_all. The table of examples and basic options
// is in help.cc; commands without an entry there show all their options.
std::string MakeHelp(const std::string& command, const std::string& summary,
                     const OptionList& options, HelpLevel level);

}  // namespace mgsfm
