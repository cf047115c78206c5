// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options_io.h"

// How to add a command `foo`:
// 1. Write apps/mgsfm/cmd_foo.cc with its options, in one struct with Describe
//    (see mgsfm/base/options.h). Paths are strings named `*_path`; those that
//    must be given have the range Required(). The options of a stage go into a
//    group of their own; those of a whole pipeline can be listed along:
//
//      namespace mgsfm {
//      namespace {
//
//      struct FooCommandOptions {
//        std::string input_path;
//        TrackOptions tracks;
//        template <class Self, class Visitor>
//        static void Describe(Self& self, Visitor& visit) {
//          visit("input_path", self.input_path, Required(), "",
//                "Folder of the model to read.");
//          visit.Group("Tracks", self.tracks);
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
// 2. Declare FooCommand in commands.h and add it to the table in program.cc.
// 3. Add cmd_foo.cc, and the modules it uses, to apps/mgsfm/CMakeLists.txt.
// 4. List its outputs in output_check.cc.
//
// The flags, their checks, --help, --config_path, --dump_config, the common
// options below and the section of docs/options.md come by themselves.

namespace mgsfm {

enum ExitCode : int {
  kExitSuccess = 0,        // what was asked for was written
  kExitBadInput = 1,       // bad usage, input or file; nothing was written
  kExitNotSolvable = 2,    // good input that held nothing to reconstruct
  kExitInternalError = 3,  // a defect of mgsfm, or out of memory
  // A run that a signal stopped ends by that signal, so that shells see 128
  // plus its number; nothing was written, but by commands that go on.
};

struct Command {
  std::string name;
  std::string summary;  // one line
  // Runs with the arguments after the name of the command; returns an
  // ExitCode. Throws Error for bad input.
  std::function<int(const std::vector<std::string>&)> run;
  // Calls the function with all options at their defaults.
  std::function<void(const std::function<void(const OptionList&)>&)> list;
  // A run that was stopped leaves what it has done so far, and the next one
  // goes on from there.
  bool goes_on = false;
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
  int num_threads = -1;
  int random_seed = 0;
  LogLevel log_level = LogLevel::kInfo;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("num_threads", self.num_threads, Between(-1, 1024), "threads",
          "-1 or 0: as many as the machine has. Does not change results.");
    visit("random_seed", self.random_seed, AtLeast(0), "",
          "The same input, options and seed give the same result.");
    visit("log_level", self.log_level, AnyValue(), "",
          "Least important messages to print, on the standard error stream.");
  }
};

// Options of a command and the common ones.
template <class Options>
struct AllOptions {
  Options command;
  CommonOptions common;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    Options::Describe(self.command, visit);
    CommonOptions::Describe(self.common, visit);
  }
};

struct Switches {
  bool help = false;
  bool dump_config = false;
  std::string config_path;  // empty: none
};

// Sets options: first from the file --config_path, then from the flags, each
// `--name value` or `--name=value`; for true, `--name` alone will do. After
// --help none is set. Required ones may still be missing.
Switches SetOptions(const std::vector<std::string>& arguments,
                    const OptionList& options);

// SetOptions, what the switches ask for, and the check that nothing is missing.
// Returns false if there is nothing left to do, as after --help or
// --dump_config.
bool ParseArguments(const std::string& name, const std::string& summary,
                    const std::vector<std::string>& arguments,
                    const OptionList& options);

// Prints log messages and, on a terminal, progress to the standard error
// stream. Signals interrupt what is run with it; see interruption.h.
Context MakeTerminalContext(const CommonOptions& options);

template <class Options>
Command MakeCommand(const std::string& name, const std::string& summary,
                    int (*run)(const Options&, const Context&)) {
  const auto run_with = [=](const std::vector<std::string>& arguments) -> int {
    AllOptions<Options> options;
    if (!ParseArguments(name, summary, arguments, ListOptions(&options))) {
      return kExitSuccess;
    }
    return run(options.command, MakeTerminalContext(options.common));
  };
  const auto list =
      [](const std::function<void(const OptionList&)>& use_options) {
        Options options;
        use_options(ListOptions(&options));
      };
  return {name, summary, run_with, list};
}

// The same for a command that goes on where an interrupted run stopped.
template <class Options>
Command MakeCommandThatGoesOn(const std::string& name,
                              const std::string& summary,
                              int (*run)(const Options&, const Context&)) {
  Command command = MakeCommand(name, summary, run);
  command.goes_on = true;
  return command;
}

}  // namespace mgsfm
