// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "mgsfm/base/options_io.h"

namespace mgsfm {

enum class HelpLevel {
  kBasic,  // an example and the options that most runs need
  kAll,
};

// The text of --help and --help_all. The table of examples and basic options
// is in help.cc; commands without an entry there show all their options.
std::string MakeHelp(const std::string& command, const std::string& summary,
                     const OptionList& options, HelpLevel level);

}  // namespace mgsfm
