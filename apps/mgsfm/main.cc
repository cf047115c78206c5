// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>
#include <filesystem>
#include <iostream>

#include "commands.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

std::vector<Command> AllCommands() {
  return {MapperCommand(), ModelEvaluatorCommand(), SimulateCommand()};
}

// For docs/options.md.
void PrintOptionsMarkdown() {
  std::cout << "# Options\n\n"
               "Made by `scripts/gen_docs.sh` from the program itself; do not "
               "edit.\n\n"
               "Every option is a flag `--name value`, and a key of the file "
               "that `--config_path`\nnames ([formats.md](formats.md)).\n\n"
               "## All commands\n\n";
  CommonOptions common;
  std::cout << OptionsToMarkdown(ListOptions(&common));
  for (const Command& command : AllCommands()) {
    std::cout << "\n## " << command.name << "\n\n" << command.summary << "\n\n";
    command.list([](const OptionList& options) {
      std::cout << OptionsToMarkdown(options);
    });
  }
}

void PrintUsage() {
  std::cout << "mgsfm " MGSFM_VERSION
               ": global structure from motion for rigs of cameras\n\n"
               "Usage: mgsfm COMMAND [--option value ...]\n\n";
  for (const Command& command : AllCommands()) {
    std::printf("  %-20s %s\n", command.name.c_str(), command.summary.c_str());
  }
  std::cout << "\nmgsfm COMMAND --help lists the options of a command.\n"
               "Exit codes: 0 done, 1 bad usage or input, 2 nothing to "
               "reconstruct, 3 internal error.\n";
}

int RunCommand(const std::string& name,
               const std::vector<std::string>& arguments) {
  std::vector<std::string> names;
  for (const Command& command : AllCommands()) {
    if (command.name == name) return command.run(arguments);
    names.push_back(command.name);
  }
  throw Error("unknown command '" + name + "'" + SuggestName(name, names) +
              "; mgsfm --help lists all");
}

int Dispatch(std::vector<std::string> arguments) {
  if (arguments.empty()) {
    throw Error("no command given; mgsfm --help lists all");
  }
  const std::string name = arguments.front();
  arguments.erase(arguments.begin());
  const bool is_help = name == "help" || name == "--help" || name == "-h";
  if (is_help && !arguments.empty()) {
    return RunCommand(arguments.front(), {"--help"});
  }
  if (is_help) {
    PrintUsage();
  } else if (name == "--version" || name == "version") {
    std::cout << "mgsfm " MGSFM_VERSION "\n";
  } else if (name == "print_options_markdown") {
    PrintOptionsMarkdown();
  } else {
    return RunCommand(name, arguments);
  }
  return kExitSuccess;
}

int PrintError(const char* kind, const char* message, ExitCode exit_code) {
  std::fprintf(stderr, "mgsfm: %s%s\n", kind, message);
  return exit_code;
}

}  // namespace
}  // namespace mgsfm

int main(int argc, char** argv) {
  using mgsfm::PrintError;
  try {
    return mgsfm::Dispatch(std::vector<std::string>(argv + 1, argv + argc));
  } catch (const mgsfm::Error& error) {
    return PrintError("", error.what(), mgsfm::kExitBadInput);
  } catch (const std::filesystem::filesystem_error& error) {
    return PrintError("", error.what(), mgsfm::kExitBadInput);
  } catch (const std::exception& error) {
    return PrintError("internal error, please report it: ", error.what(),
                      mgsfm::kExitInternalError);
  }
}
