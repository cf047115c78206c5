// SPDX-License-Identifier: BSD-3-Clause
// Advice on names of COLMAP, shell completions and man pages, all of the
// running program.
#include <cstdlib>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include "cli/program_runs.h"

namespace mgsfm {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

std::vector<std::string> Words(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

// A man page or a completion, by its path in /usr/share.
std::string HelpFile(const std::string& name) {
  static const TempDir dir;
  static const CommandOutput output =
      RunShell("python3 -B " MGSFM_SOURCE_FOLDER
               "/scripts/help_files.py " MGSFM_EXECUTABLE " " +
               dir.path().string());
  EXPECT_EQ(output.exit_code, 0) << output.err;
  return ReadTextFile(dir.path() / name);
}

// Completions that a real bash offers for a command line, whose last word is
// being typed.
std::vector<std::string> CompletedByBash(const std::string& line) {
  const TempDir dir;
  const std::string script = (dir.path() / "mgsfm").string();
  WriteTextFile(script, HelpFile("bash-completion/completions/mgsfm"));
  WriteTextFile(dir.path() / "run",
                "source " + script + "\ncd " + dir.path().string() +
                    "\nCOMP_WORDS=(" + line +
                    ")\nCOMP_CWORD=$((${#COMP_WORDS[@]} - 1))\n"
                    "complete -p mgsfm | grep -q -- '-F _mgsfm' && _mgsfm\n"
                    "printf '%s\\n' \"${COMPREPLY[@]}\"\n");
  return Words(RunShell("bash " + (dir.path() / "run").string()).out);
}

std::set<std::string> OptionsIn(const std::string& help) {
  std::set<std::string> options;
  const std::regex flag("\n  (--[A-Za-z_0-9.]+)");
  for (std::sregex_iterator it(help.begin(), help.end(), flag), end; it != end;
       ++it) {
    options.insert((*it)[1]);
  }
  return options;
}

std::vector<std::string> CommandNames() { return CompletedByBash("mgsfm ''"); }

// The examples use options that exist.
TEST(Help, EveryCommandHasAnExample) {
  for (const std::string& command : CommandNames()) {
    if (command == "help" || command[0] == '-') continue;
    const std::string help = RunMgsfm(command + " --help").out;
    std::smatch example;
    ASSERT_TRUE(std::regex_search(
        help, example, std::regex("\nExample\n  (mgsfm " + command + " .*)\n")))
        << help;
    const std::set<std::string> options =
        OptionsIn(RunMgsfm(command + " --help_all").out);
    for (const std::string& word : Words(example[1])) {
      if (word.rfind("--", 0) != 0) continue;
      EXPECT_EQ(options.count(word), 1u) << command << ' ' << word;
    }
  }
}

TEST(BashCompletion, OffersCommandsOptionsAndValues) {
  EXPECT_THAT(CompletedByBash("mgsfm mapp"), ElementsAre("mapper"));
  EXPECT_THAT(CompletedByBash("mgsfm mapper --log_l"),
              ElementsAre("--log_level"));
  EXPECT_THAT(CompletedByBash("mgsfm mapper --log_level ''"),
              ElementsAre("debug", "info", "warning", "error"));
  EXPECT_THAT(CompletedByBash("mgsfm mapper --write_report t"),
              ElementsAre("true"));
  EXPECT_THAT(CompletedByBash("mgsfm mapper --output_path m"),
              ElementsAre("mgsfm"));
  EXPECT_THAT(CompletedByBash("mgsfm nothing --"), IsEmpty());
}

TEST(HelpFormats, EveryOptionOfEveryCommandIsInAll) {
  const std::string fish = HelpFile("fish/vendor_completions.d/mgsfm.fish");
  const std::string zsh = HelpFile("zsh/site-functions/_mgsfm");
  ASSERT_THAT(CommandNames(), Contains("mapper"));
  for (const std::string& name : CommandNames()) {
    if (name == "help" || name[0] == '-') continue;
    const std::vector<std::string> bash =
        CompletedByBash("mgsfm " + name + " --");
    std::string man = HelpFile("man/man1/mgsfm-" + name + ".1");
    man = std::regex_replace(man, std::regex("\\\\-"), "-");
    for (const std::string& option :
         OptionsIn(RunMgsfm(name + " --help_all").out)) {
      EXPECT_THAT(bash, Contains(option)) << name;
      EXPECT_THAT(zsh, HasSubstr("'" + option + "["));
      EXPECT_THAT(fish,
                  HasSubstr("from " + name + "' -l " + option.substr(2) + " "));
      EXPECT_THAT(man, HasSubstr("\n.B " + option));
    }
  }
}

TEST(HelpFormats, ManReadsThePagesWithoutWarning) {
  if (RunShell("command -v man").exit_code != 0) GTEST_SKIP() << "no man";
  const TempDir dir;
  const std::string path = (dir.path() / "page.1").string();
  for (const char* command : {"", "-mapper", "-simulate"}) {
    WriteTextFile(path,
                  HelpFile(std::string("man/man1/mgsfm") + command + ".1"));
    const CommandOutput page =
        RunShell("LC_ALL=C.UTF-8 MANWIDTH=80 man --warnings -l " + path);
    EXPECT_EQ(page.exit_code, 0);
    EXPECT_THAT(page.err, IsEmpty());
    EXPECT_THAT(page.out, HasSubstr("EXIT STATUS"));
  }
}

TEST(ColmapNames, AdviceNamesWhatExists) {
  const std::string all = RunMgsfm("print_options_markdown").out;
  for (const char* name : {"global_mapper", "hierarchical_mapper", "gui",
                           "model_comparer", "pose_prior_mapper"}) {
    const std::string error = RunMgsfm(name).err;
    EXPECT_THAT(error, HasSubstr("unknown command"));
    EXPECT_THAT(error, Not(HasSubstr("did you mean")));
    const std::regex flag("--([a-z_]+)");
    for (std::sregex_iterator it(error.begin(), error.end(), flag), end;
         it != end; ++it) {
      EXPECT_THAT(all, HasSubstr("`" + (*it)[1].str() + "`")) << error;
    }
  }
}

TEST(ColmapNames, HabitsOfColmapGetAnAnswer) {
  const std::vector<std::pair<std::string, std::string>> answers = {
      {"mapper --threads 2", "use --num_threads"},
      {"mapper --Mapper.num_threads 2", "use --num_threads"},
      {"mapper --project_path x", "use --config_path"},
      {"mapper --output x", "did you mean 'output_path'?"},
      {"mapper --split_rig_at x", "did you mean 'Mapper.split_rig_at'?"},
      {"mapper --PairFiltering.use_turning_loops 0", "leave it out"},
      {"automatic_reconstructor --camera_model x",
       "use --ImageReader.camera_model"},
      {"feature_extractor --SiftExtraction.use_gpu 0", "leave it out"},
      {"exhaustive_matcher --use_gpu 0", "leave it out"},
      {"mapper --Mapper.ba_refine_focal_length 0",
       "use --BundleAdjustment.refine_focal_length"}};
  const std::vector<std::string> several = {
      "use --ViewGraph.min_num_inliers", "Mapper.init_num_trials: leave it out",
      "SiftExtraction.use_gpu: leave it out", "quality: leave it out",
      "databse_path (did you mean 'database_path'?)"};
  const std::string all = RunMgsfm(
                              "mapper --Mapper.min_num_matches 15 "
                              "--Mapper.init_num_trials 3 --quality high "
                              "--SiftExtraction.use_gpu 0 --databse_path x")
                              .err;
  EXPECT_THAT(all, HasSubstr("5 unknown options: "));
  for (const std::string& answer : several) {
    EXPECT_THAT(all, HasSubstr(answer));
  }
  for (const auto& [arguments, answer] : answers) {
    EXPECT_THAT(RunMgsfm(arguments).err, HasSubstr(answer)) << arguments;
  }
  // No advice that this command would refuse as well.
  EXPECT_THAT(RunMgsfm("model_evaluator --images x").err,
              Not(HasSubstr("use --image_path")));
}

}  // namespace
}  // namespace mgsfm
