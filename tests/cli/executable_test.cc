// SPDX-License-Identifier: BSD-3-Clause
// Help, version and messages on bad usage.
#include <algorithm>
#include <sstream>
#include <string>
#include <vector>

#include "cli/program_runs.h"
#include "commands.h"
#include "mgsfm/base/version.h"

namespace mgsfm {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

// The commands that the usage lists: the first words of its indented lines.
std::vector<std::string> CommandNames() {
  std::vector<std::string> names;
  std::istringstream usage(RunMgsfm("--help").out);
  for (std::string line; std::getline(usage, line);) {
    if (line.compare(0, 2, "  ") != 0) continue;
    names.emplace_back();
    std::istringstream(line) >> names.back();
  }
  return names;
}

void ExpectOneLineError(const std::string& arguments,
                        const std::string& message) {
  const CommandOutput output = RunMgsfm(arguments);
  EXPECT_EQ(output.exit_code, 1) << arguments;
  EXPECT_THAT(output.out, IsEmpty());
  EXPECT_THAT(output.err, AllOf(StartsWith("mgsfm: "), HasSubstr(message)));
  EXPECT_EQ(std::count(output.err.begin(), output.err.end(), '\n'), 1);
}

TEST(Executable, EndsQuietlyWhenItsReaderHasEnded) {
  const CommandOutput output =
      RunShell("{ sleep 0.2; " MGSFM_EXECUTABLE
               " mapper --help_all; echo $? >&2; } | true");
  EXPECT_EQ(output.err, "0\n");
}

TEST(Executable, HelpAndVersion) {
  for (const char* arguments : {"help", "--help", "-h"}) {
    const CommandOutput output = RunExecutable(arguments);
    EXPECT_EQ(output.exit_code, 0);
    EXPECT_THAT(output.out, HasSubstr("Usage: mgsfm COMMAND"));
    EXPECT_THAT(output.err, IsEmpty());
  }
  EXPECT_THAT(RunExecutable("--version").out,
              AllOf(StartsWith("mgsfm " + std::string(Version()) + ", commit "),
                    HasSubstr("Ceres: "), HasSubstr("SQLite: ")));
  EXPECT_EQ(RunExecutable("--version").exit_code, 0);
}

TEST(Executable, EveryCommandHasHelpAndDumpsItsDefaults) {
  const std::vector<std::string> names = CommandNames();
  ASSERT_FALSE(names.empty());
  for (const std::string& name : names) {
    const CommandOutput help = RunMgsfm(name + " --help");
    EXPECT_EQ(help.exit_code, 0) << name;
    EXPECT_THAT(help.out,
                AllOf(StartsWith("mgsfm " + name + ": "),
                      HasSubstr("--num_threads"), HasSubstr("--help_all")));
    std::istringstream lines(help.out);
    int num_lines = 0;
    for (std::string line; std::getline(lines, line); ++num_lines) {
      if (line.rfind("  mgsfm ", 0) == 0) continue;  // the example
      EXPECT_LE(line.size(), 80u) << line;
    }
    EXPECT_LE(num_lines, 50) << name;
    EXPECT_EQ(RunMgsfm("help " + name).out, help.out);

    const CommandOutput dump = RunMgsfm(name + " --dump_config");
    EXPECT_EQ(dump.exit_code, 0) << name;
    const TempDir dir;
    const std::string path = (dir.path() / "config.ini").string();
    WriteTextFile(path, dump.out);
    EXPECT_EQ(RunMgsfm(name + " --dump_config --config_path " + path).out,
              dump.out)
        << "defaults of " << name << " are not in their own ranges";
  }
}

// The tables of options name what an option does: "Reject", not "Maximum".
TEST(Executable, HelpTextsStartWithAVerb) {
  const std::vector<std::string> nouns = {
      "Whether", "Maximum", "Minimum",  "Largest",   "Smallest", "Number",
      "Folder",  "File",    "Format",   "Kind",      "Standard", "A",
      "The",     "Ratio",   "Fraction", "Tolerance", "Size",     "If"};
  for (const Command& command : AllCommands()) {
    command.list([&](const OptionList& options) {
      for (const OptionEntry& entry : options) {
        const std::string word = entry.help.substr(0, entry.help.find(' '));
        EXPECT_TRUE(word[0] >= 'A' && word[0] <= 'Z') << entry.name;
        EXPECT_THAT(nouns, Not(Contains(word)))
            << command.name << ' ' << entry.name;
      }
    });
  }
}

// Of these, each rule of pair filtering has a switch, and each kind of input
// file names its path.
TEST(Executable, TheMapperHasFewOptions) {
  for (const Command& command : AllCommands()) {
    if (command.name != "mapper") continue;
    command.list(
        [](const OptionList& options) { EXPECT_LE(options.size(), 69u); });
  }
}

TEST(Executable, HelpShowsTheBasicOptionsAndHelpAllShowsAll) {
  const std::string basic = RunMgsfm("mapper --help").out;
  EXPECT_THAT(basic, AllOf(HasSubstr("Example\n  mgsfm mapper --database_path"),
                           HasSubstr("--image_path"), HasSubstr("--help_all")));
  EXPECT_THAT(basic, Not(HasSubstr("--Tracks.min_track_length")));
  for (const std::string& name : CommandNames()) {
    const CommandOutput all = RunMgsfm(name + " --help_all");
    EXPECT_EQ(all.exit_code, 0) << name;
    std::istringstream dump(RunMgsfm(name + " --dump_config").out);
    std::string section;
    for (std::string line; std::getline(dump, line);) {
      if (line.empty() || line[0] == '#') continue;
      if (line.compare(0, 13, "mgsfm_version") == 0) continue;  // no option
      if (line[0] == '[') {
        section = line.substr(1, line.find(']') - 1) + ".";
      } else {
        const std::string option = line.substr(0, line.find(' '));
        EXPECT_THAT(all.out, HasSubstr("--" + section + option + "\n"));
      }
    }
  }
}

TEST(Executable, BadUsageIsOneLineAndExitCode1) {
  ExpectOneLineError("", "no command given");
  ExpectOneLineError("maper", "unknown command 'maper'");
  for (const std::string& name : CommandNames()) {
    ExpectOneLineError(name + " --num_thread 3", "did you mean 'num_threads'?");
    ExpectOneLineError(name + " --num_threads 3x", "'3x' is not an integer");
    ExpectOneLineError(name + " --config_path /no/such/file", "/no/such/file");
    ExpectOneLineError(name + " stray", "'stray'");
  }
}

TEST(Executable, DocumentsTheOptionsOfAllCommands) {
  const CommandOutput output = RunMgsfm("print_options_markdown");
  EXPECT_EQ(output.exit_code, 0);
  for (const std::string& name : CommandNames()) {
    EXPECT_THAT(output.out, HasSubstr("\n## " + name + "\n"));
  }
}

}  // namespace
}  // namespace mgsfm
