// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "help.h"
#include "mgsfm/base/context.h"
#include "mgsfm/base/options_io.h"

// How to add a command `foo`:
// 1. Write apps/mgsfm/cmd_foo.cc, or add to the file of its topic, with the
//    options in one struct (see mgsfm/base/options.h).
//    Paths are strings named `*_path`; those that
//    must be given have the range Required(). The options of a stage go into a
//    group of their own; those of a whole pipeline can be listed along:
//
//      namespace mgsfm {
//      namespace {
//
//      struct FooCommandOptions {
//        Option<std::string> input_path{"input_path", "", Required(),
//                                       "Read the model in this folder."};
//        TrackOptions tracks;
//
//        template <class Visitor>
//        void Describe(Visitor& visit) {
//          visit(input_path);
//          visit.Group("Tracks", tracks);
//        }
//      };
//
//      int RunFoo(const FooCommandOptions& options, const Context& context) {
//        ...
//        return kExitSuccess;
//      }
//
//      }  // namespace
//
//      Command FooCommand() {
//        return MakeCommand("foo", "Does this to that.", RunFoo);
//      }
//      }  // namespace mgsfm
//
// 2. Declare FooCommand in commands.h and add it to the table in program.cc, or
//    add the command to the list of its file.
// 3. Add cmd_foo.cc, and the modules it uses, to apps/mgsfm/CMakeLists.txt.
// 4. List its outputs in command.cc and its basic options in help.cc.
//
// The flags, their checks, --help, --config_path, --dump_config, the common
// options below and the section of docs/reference/options.md are generated.

namespace mgsfm {

enum ExitCode : int {
  kExitSuccess = 0,  // the output was written
  // Bad usage, input or file, or too little memory; nothing was written.
  kExitBadInput = 1,
  kExitNotSolvable = 2,    // valid input from which nothing can be estimated
  kExitInternalError = 3,  // a defect of mgsfm
  // A run stopped by a signal ends by this signal, so that shells see 128 plus
  // its number. Only resumable commands have then written anything.
};

// The end of a run. Commands that only write files return their ExitCode.
struct CommandResult {
  // NOLINTNEXTLINE(google-explicit-constructor)
  CommandResult(int code, std::string text_of_result = "",
                std::string json_of_result = "")
      : exit_code(code),
        text(std::move(text_of_result)),
        json(std::move(json_of_result)) {}

  int exit_code;
  std::string text;  // for the standard output
  std::string json;  // the same for programs; may be empty
  // The output files are complete, so losing the text is harmless.
  bool has_files = false;
};

// Sets options by SetOption or LoadOptions.
using OptionSetter = std::function<void(const OptionList&)>;

struct Command {
  std::string name;
  std::string summary;  // one line
  // Runs with the arguments after the name of the command; returns an
  // ExitCode. Throws Error for bad input.
  std::function<int(const std::vector<std::string>&)> run;
  // Runs within another program, and prints nothing. Makes the same checks.
  // `environment` must have a log; the common options set its threads and seed.
  std::function<CommandResult(const OptionSetter& set,
                              const Context& environment)>
      call;
  // Calls the function with all options at their defaults.
  std::function<void(const std::function<void(const OptionList&)>&)> list;
  // A stopped run keeps its finished work, and the next run continues from it.
  bool is_resumable = false;
};

template <>
struct EnumTable<LogLevel> {
  static constexpr std::pair<std::string_view, LogLevel> kNames[] = {
      {"debug", LogLevel::kDebug},
      {"info", LogLevel::kInfo},
      {"warning", LogLevel::kWarning},
      {"error", LogLevel::kError}};
};

// The options that every command has.
struct CommonOptions {
  Option<int> num_threads{
      "num_threads", -1, Between(-1, 1024), "threads",
      "Set the number of threads; -1 or 0 uses all processor cores. Results do "
      "not depend on it."};
  Option<int> random_seed{"random_seed", 0, AtLeast(0),
                          "Seed the random numbers. Equal input, options and "
                          "seed give equal results."};
  Option<LogLevel> log_level{
      "log_level", LogLevel::kInfo,
      "Print messages of at least this level to the standard error stream."};
  Option<bool> quiet{"quiet", false,
                     "Print only warnings and errors, and no progress."};

  LogLevel MinLogLevel() const {
    return quiet && *log_level < LogLevel::kWarning ? LogLevel::kWarning
                                                    : *log_level;
  }

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(num_threads, random_seed, log_level, quiet);
  }
};

// Options of a command and the common ones.
template <class Options>
struct AllOptions {
  Options command;
  CommonOptions common;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(command, common);
  }
};

struct Switches {
  std::optional<HelpLevel> help;
  bool dump_config = false;
  std::string config_path;  // empty: none
};

// Sets options: first from the file --config_path, then from the flags, each
// `--name value` or `--name=value`; `--name` alone means true. Sets nothing
// after --help or --help_all. Required options may still be missing.
Switches SetOptions(const std::vector<std::string>& arguments,
                    const OptionList& options);

// Sets the options and checks that none is missing and that no output replaces
// an input. Returns false after --help or --dump_config, which end the run.
bool ParseArguments(const std::string& name, const std::string& summary,
                    const std::vector<std::string>& arguments,
                    const OptionList& options);

// The checks of ParseArguments. Throws Error, naming the file and both options,
// if the outputs of a command would replace one of its inputs: a database,
// model, list, calibration or configuration file. An input_path that the
// command may adjust in place is allowed. Also throws Error if an output file
// would replace an image or a database, whether it is an input or not.
void CheckCommandOptions(const std::string& name, const OptionList& options,
                         const std::string& config_path = "");

// The environment with the threads and the seed of the options, and without log
// messages below their level.
Context ApplyCommonOptions(const CommonOptions& options, Context environment);

// Prints the text of a result; returns its exit code.
int PrintResult(const CommandResult& result, const Context& context);

// Prints log messages and progress to the standard error stream: on a terminal
// a bar, elsewhere a line per minute. Signals interrupt what is run with it;
// see terminal.h.
Context MakeTerminalContext(const CommonOptions& options);

// Command::call with options that already differ from their defaults.
template <class Options, class Result>
CommandResult CallWith(const std::string& name, AllOptions<Options> options,
                       const OptionSetter& set, const Context& environment,
                       Result (*run)(const Options&, const Context&)) {
  const OptionList list = ListOptions(&options);
  set(list);
  CheckCommandOptions(name, list);
  return run(options.command, ApplyCommonOptions(options.common, environment));
}

// Result is int (an ExitCode) or CommandResult.
template <class Options, class Result>
Command MakeCommand(const std::string& name, const std::string& summary,
                    Result (*run)(const Options&, const Context&)) {
  const auto run_with = [=](const std::vector<std::string>& arguments) -> int {
    AllOptions<Options> options;
    if (!ParseArguments(name, summary, arguments, ListOptions(&options))) {
      return kExitSuccess;
    }
    const Context context = MakeTerminalContext(options.common);
    return PrintResult(run(options.command, context), context);
  };
  const auto call = [=](const OptionSetter& set, const Context& environment) {
    return CallWith(name, AllOptions<Options>(), set, environment, run);
  };
  const auto list =
      [](const std::function<void(const OptionList&)>& use_options) {
        Options options;
        use_options(ListOptions(&options));
      };
  return {name, summary, run_with, call, list};
}

// The same for a command that continues where an interrupted run stopped.
template <class Options, class Result>
Command MakeResumableCommand(const std::string& name,
                             const std::string& summary,
                             Result (*run)(const Options&, const Context&)) {
  Command command = MakeCommand(name, summary, run);
  command.is_resumable = true;
  return command;
}

}  // namespace mgsfm
