// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "mgsfm/base/options_io.h"

namespace mgsfm {

struct CommandHelp {
  std::string name;
  std::string summary;
  OptionList options;  // with those of all commands; only described
};

// Scripts by which shells complete commands, options and their values.
std::string BashCompletion(const std::vector<CommandHelp>& commands);
std::string ZshCompletion(const std::vector<CommandHelp>& commands);
std::string FishCompletion(const std::vector<CommandHelp>& commands);

// Man pages of the program and of a command.
std::string ManPage(const std::string& version,
                    const std::vector<CommandHelp>& commands);
std::string ManPageOf(const std::string& version, const CommandHelp& command);

}  // namespace mgsfm
