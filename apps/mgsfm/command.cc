// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

#include "base/parallel.h"
#include "colmap_names.h"
#include "mgsfm/base/error.h"
#include "output_check.h"

namespace mgsfm {
namespace {

struct Flag {
  std::string name;
  std::optional<std::string> value;
};

bool IsFlag(const std::string& argument) {
  return argument.size() > 2 && argument.compare(0, 2, "--") == 0;
}

// Options with a list of paths, which commas separate. On the command line,
// each path may be an argument, as shells expand them.
bool TakesList(const std::string& name) {
  return name == "calibration_path" || name == "video_path";
}

std::vector<Flag> SplitFlags(const std::vector<std::string>& arguments) {
  std::vector<Flag> flags;
  for (const std::string& argument : arguments) {
    const bool is_first_value =
        !flags.empty() && !flags.back().value && !IsFlag(argument);
    const bool is_next_value = !flags.empty() && flags.back().value &&
                               !IsFlag(argument) &&
                               TakesList(flags.back().name);
    if (argument == "-h") {
      flags.push_back({"help", {}});
    } else if (is_first_value) {
      flags.back().value = argument;
    } else if (is_next_value) {
      *flags.back().value += "," + argument;
    } else if (IsFlag(argument)) {
      const size_t equals = argument.find('=');
      flags.push_back({argument.substr(2, equals - 2), {}});
      if (equals != std::string::npos) {
        flags.back().value = argument.substr(equals + 1);
      }
    } else {
      throw Error("unexpected argument '" + argument +
                  "'; options are given as --name value");
    }
  }
  return flags;
}

// Removes the flag from the list.
std::optional<Flag> TakeFlag(const std::string& name,
                             std::vector<Flag>* flags) {
  for (size_t i = 0; i < flags->size(); ++i) {
    if ((*flags)[i].name != name) continue;
    Flag flag = std::move((*flags)[i]);
    flags->erase(flags->begin() + static_cast<std::ptrdiff_t>(i));
    return flag;
  }
  return std::nullopt;
}

bool TakeSwitch(const std::string& name, std::vector<Flag>* flags) {
  const std::optional<Flag> flag = TakeFlag(name, flags);
  if (flag && flag->value) throw Error("--" + name + " takes no value");
  return flag.has_value();
}

const OptionEntry* FindOption(const OptionList& options,
                              const std::string& name) {
  for (const OptionEntry& entry : options) {
    if (entry.name == name) return &entry;
  }
  return nullptr;
}

bool IsBool(const OptionEntry* option) {
  return option != nullptr &&
         std::holds_alternative<bool>(option->default_value);
}

OptionAdvice AdviceFor(const OptionList& options) {
  return [&options](const std::string& name) {
    return AdviceOnOption(name, options);
  };
}

void SetFlags(const std::vector<Flag>& flags, const OptionList& options) {
  std::vector<std::string> names;
  for (const Flag& flag : flags) names.push_back(flag.name);
  // An unknown name is a likelier mistake than a missing value.
  CheckOptionNames(options, names, AdviceFor(options));
  std::set<std::string> known;
  for (const Flag& flag : flags) {
    if (!known.insert(flag.name).second) {
      throw Error("--" + flag.name + " is given twice");
    }
    if (flag.value) {
      SetOption(options, flag.name, *flag.value);
    } else if (IsBool(FindOption(options, flag.name))) {
      SetOption(options, flag.name, "true");
    } else {
      throw Error("--" + flag.name + " needs a value");
    }
  }
}

}  // namespace

Switches SetOptions(const std::vector<std::string>& arguments,
                    const OptionList& options) {
  std::vector<Flag> flags = SplitFlags(arguments);
  Switches switches;
  if (TakeSwitch("help", &flags)) switches.help = HelpLevel::kBasic;
  if (TakeSwitch("help_all", &flags)) switches.help = HelpLevel::kAll;
  if (switches.help) return switches;
  switches.dump_config = TakeSwitch("dump_config", &flags);
  if (const auto config = TakeFlag("config_path", &flags)) {
    if (!config->value) throw Error("--config_path needs a value");
    switches.config_path = *config->value;
    LoadOptions(std::filesystem::path(switches.config_path), options,
                AdviceFor(options));
  }
  SetFlags(flags, options);
  return switches;
}

bool ParseArguments(const std::string& name, const std::string& summary,
                    const std::vector<std::string>& arguments,
                    const OptionList& options) {
  const Switches switches = SetOptions(arguments, options);
  if (switches.help) {
    std::cout << MakeHelp(name, summary, options, *switches.help);
    return false;
  }
  if (switches.dump_config) {
    std::cout << DumpOptions(options);
    return false;
  }
  CheckCommandOptions(name, options, switches.config_path);
  return true;
}

void CheckCommandOptions(const std::string& name, const OptionList& options,
                         const std::string& config_path) {
  CheckOptions(options);
  CheckOutputsAreNoInputs(name, options, config_path);
}

LogLevel CommonOptions::MinLogLevel() const {
  return quiet ? std::max<LogLevel>(log_level, LogLevel::kWarning) : *log_level;
}

Context ApplyCommonOptions(const CommonOptions& options, Context environment) {
  environment.num_threads = ResolveNumThreads(options.num_threads);
  environment.random_seed = static_cast<uint64_t>(options.random_seed);
  environment.log = [min_level = options.MinLogLevel(),
                     log = std::move(environment.log)](
                        LogLevel level, const std::string& message) {
    if (level >= min_level) log(level, message);
  };
  return environment;
}

int PrintResult(const CommandResult& result, const Context& context) {
  std::cout << result.text;
  if (result.has_files && !std::cout.flush()) {
    context.Warning(
        "the table cannot be written to the standard output; the model is "
        "complete");
    std::ignore = std::freopen("/dev/null", "w", stdout);
    std::cout.clear();
  }
  return result.exit_code;
}

}  // namespace mgsfm
