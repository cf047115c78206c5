// SPDX-License-Identifier: BSD-3-Clause
#include "program.h"

#include <ceres/version.h>
#include <cholmod.h>
#include <fcntl.h>
#include <flann/config.h>
#include <poll.h>
#include <sqlite3.h>
#include <unistd.h>

#include <Eigen/Core>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exiv2/version.hpp>
#include <filesystem>
#include <iostream>
#include <new>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/core/version.hpp>
#include <system_error>

#include "base/ranges.h"
#include "base/text.h"
#include "commands.h"
#include "help.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/version.h"
#include "mgsfm/pair_filtering/pair_filtering.h"
#include "terminal.h"

namespace mgsfm {
namespace {

#ifdef __clang__
constexpr char kCompiler[] = __VERSION__;
#else
constexpr char kCompiler[] = "GCC " __VERSION__;
#endif

std::string Join(int major, int minor, int patch) {
  return std::to_string(major) + "." + std::to_string(minor) + "." +
         std::to_string(patch);
}

// The version, the commit, the compiler and the libraries.
std::string VersionText(const std::string& commit) {
  return std::string("mgsfm ") + Version() + ", commit " + commit +
         "\ncompiler:  " + kCompiler + "\nEigen:     " +
         Join(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION) +
         "\nCeres:     " CERES_VERSION_STRING + "\nCHOLMOD:   " +
         Join(CHOLMOD_MAIN_VERSION, CHOLMOD_SUB_VERSION,
              CHOLMOD_SUBSUB_VERSION) +
         "\nOpenCV:    " CV_VERSION "\nExiv2:     " + Exiv2::versionString() +
         "\nFLANN:     " FLANN_VERSION_ "\nSQLite:    " + sqlite3_libversion() +
         "\nJSON:      " +
         Join(NLOHMANN_JSON_VERSION_MAJOR, NLOHMANN_JSON_VERSION_MINOR,
              NLOHMANN_JSON_VERSION_PATCH) +
         "\n";
}

struct CommandGroup {
  const char* title;
  std::vector<Command> commands;
};

// The groups are in the order in which a first session needs them.
std::vector<CommandGroup> CommandGroups() {
  return {{"Reconstruction",
           {AutomaticReconstructorCommand(), MapperCommand(),
            BundleAdjusterCommand(), PointTriangulatorCommand()}},
          {"Images, features and matches",
           Concatenated(std::vector{ImageCommands(), MatchingCommands()})},
          {"Models", Concatenated(std::vector<std::vector<Command>>{
                         {ReportCommand(), ModelEvaluatorCommand(),
                          ModelAnalyzerCommand(), ModelConverterCommand(),
                          ImageUndistorterCommand(), ModelAlignerCommand(),
                          ModelMergerCommand()},
                         ModelEditCommands()})},
          {"Databases", DatabaseCommands()},
          {"Simulation", {SimulateCommand()}}};
}

}  // namespace

std::vector<Command> AllCommands() {
  return Concatenated(Transformed(CommandGroups(), &CommandGroup::commands));
}

namespace {

// Prints docs/reference/options.md.
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

// Prints the table of rules of docs/maths/pair_filtering.md.
void PrintRulesMarkdown() {
  std::cout << "| rule | follows | `rejected_pairs` | option | rejects |\n"
               "|---|---|---|---|---|\n";
  const PairFilteringOptions options;
  for (const PairRule& rule : kPairRules) {
    std::cout << "| " << rule.name << " | " << rule.stage << " | `"
              << EnumName(rule.reason) << "` | `"
              << (options.*rule.option).Info().name << "` | " << rule.rejects
              << " |\n";
  }
}

void PrintUsage() {
  std::cout << "mgsfm " << Version()
            << ": global structure from motion for multi-camera rigs\n\n"
               "Usage: mgsfm COMMAND [--option value ...]\n";
  for (const CommandGroup& group : CommandGroups()) {
    std::printf("\n%s\n", group.title);
    for (const Command& command : group.commands) {
      std::printf("  %-23s %s\n", command.name.c_str(),
                  command.summary.c_str());
    }
  }
  std::cout << "\nmgsfm COMMAND --help shows the basic options of a command, "
               "--help_all "
               "all.\n"
               "Exit codes: 0 done, 1 bad usage or input, 2 nothing to "
               "reconstruct, 3 internal error;\n"
               "stopped by a signal: 128 + its number, as 130 for Ctrl-C.\n";
}

int EndInterrupted(const Command& command) {
  std::fprintf(
      stderr, "mgsfm: stopped by signal %d (%s); %s\n", InterruptionSignal(),
      strsignal(InterruptionSignal()),
      command.is_resumable
          ? "finished work is kept; run the same command again to continue"
          : "nothing was written");
  return EndByInterruption();
}

int RunCommand(const std::string& name,
               const std::vector<std::string>& arguments) {
  std::vector<std::string> names;
  for (const Command& command : AllCommands()) {
    names.push_back(command.name);
    if (command.name != name) continue;
    try {
      return command.run(arguments);
    } catch (const Interrupted&) {
      return EndInterrupted(command);
    }
  }
  if (const auto advice = AdviceOnCommand(name)) {
    throw Error("unknown command '" + name + "': " + *advice);
  }
  throw Error("unknown command '" + name + "'" + SuggestName(name, names) +
              "; mgsfm --help lists them");
}

int Dispatch(std::vector<std::string> arguments, const std::string& commit) {
  if (arguments.empty()) {
    throw Error("no command given; mgsfm --help lists them");
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
    std::cout << VersionText(commit);
  } else if (name == "print_options_markdown") {
    PrintOptionsMarkdown();
  } else if (name == "print_rules_markdown") {
    PrintRulesMarkdown();
  } else {
    return RunCommand(name, arguments);
  }
  return kExitSuccess;
}

int PrintError(const std::string& message, ExitCode exit_code) {
  std::fprintf(stderr, "%s %s\n",
               Colored(TerminalColor::kRed, "mgsfm:").c_str(),
               Printable(message).c_str());
  return exit_code;
}

int PrintLackOfMemory() {
  return PrintError(
      "not enough memory; close other programs, raise the limit (ulimit -v) "
      "or use fewer images or threads (--num_threads)",
      kExitBadInput);
}

int PrintInternalError(const std::exception& error) {
  return PrintError(
      std::string("internal error, please report it: ") + error.what(),
      kExitInternalError);
}

// Describes the files and the reason in an exception of <filesystem>.
std::string Describe(const std::filesystem::filesystem_error& error) {
  std::string paths = "'" + error.path1().string() + "'";
  if (!error.path2().empty()) paths += " and '" + error.path2().string() + "'";
  return "cannot use " + paths + ": " + error.code().message() +
         "; check the path and its permissions";
}

// The standard output is a pipe to a program that has read enough (`| head`).
bool ReaderIsGone() {
  pollfd out = {STDOUT_FILENO, POLLOUT, 0};
  return poll(&out, 1, 0) == 1 && (out.revents & POLLERR) != 0;
}

int Run(const std::vector<std::string>& arguments, const std::string& commit) {
  const int exit_code = Dispatch(arguments, commit);
  const bool is_written = std::cout.flush() && std::fflush(stdout) == 0;
  if (!is_written && !ReaderIsGone()) {
    throw Error("cannot write to the standard output; redirect it");
  }
  return exit_code;
}

// Files opened later must not take the place of closed standard streams.
// Writing to these streams still fails.
void ReserveStandardStreams() {
  for (const int fd : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    if (fcntl(fd, F_GETFD) >= 0) continue;
    open("/dev/null", fd == STDIN_FILENO ? O_WRONLY : O_RDONLY);
  }
}

ProgramCall& MutableCall() {
  static ProgramCall call;
  return call;
}

std::string QuotedForShell(const std::string& word) {
  constexpr char kPlain[] =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-./"
      ",:=+@%";
  if (!word.empty() && word.find_first_not_of(kPlain) == std::string::npos) {
    return word;
  }
  std::string quoted = "'";
  for (const char c : word) {
    if (c == '\'') {
      quoted += R"('\'')";
    } else {
      quoted += c;
    }
  }
  return quoted + "'";
}

}  // namespace

const ProgramCall& ThisCall() { return MutableCall(); }

int RunProgram(const std::vector<std::string>& arguments,
               const std::string& commit) {
  MutableCall() = {"mgsfm", commit};
  for (const std::string& word : arguments) {
    MutableCall().command += " " + QuotedForShell(word);
  }
  ReserveStandardStreams();
  CatchInterruptions();
  // Turns these signals into failed writes: a closed log reader must not end
  // the run, and a file size limit must not leave half a file.
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
  try {
    return Run(arguments, commit);
  } catch (const Error& error) {
    return PrintError(error.what(), kExitBadInput);
  } catch (const std::filesystem::filesystem_error& error) {
    return PrintError(Describe(error), kExitBadInput);
  } catch (const std::bad_alloc&) {
    return PrintLackOfMemory();
  } catch (const cv::Exception& error) {
    return error.code == cv::Error::StsNoMem ? PrintLackOfMemory()
                                             : PrintInternalError(error);
  } catch (const std::system_error& error) {
    return PrintError("the system refuses a thread or another resource (" +
                          error.code().message() +
                          "); close other programs, raise the limits (ulimit "
                          "-a) or use fewer threads (--num_threads)",
                      kExitBadInput);
  } catch (const std::exception& error) {
    return PrintInternalError(error);
  }
}

}  // namespace mgsfm
