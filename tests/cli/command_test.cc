// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "foundation/base/sample_options.h"
#include "mgsfm/base/error.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using ::testing::HasSubstr;
using Arguments = std::vector<std::string>;

std::string ErrorOf(const Arguments& arguments) {
  SampleOptions options;
  try {
    ParseArguments("sample", "", arguments, ListOptions(&options));
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(ParseArguments, TakesValuesInAllForms) {
  SampleOptions options;
  ASSERT_TRUE(ParseArguments("sample", "",
                             {"--input_path", "x", "--verbose",
                              "--Solver.max_num_iterations=4", "--title", "-1"},
                             ListOptions(&options)));
  EXPECT_EQ(*options.input_path, "x");
  EXPECT_TRUE(options.verbose);
  EXPECT_EQ(options.solver.max_num_iterations, 4);
  EXPECT_EQ(*options.title, "-1");

  ASSERT_TRUE(ParseArguments("sample", "",
                             {"--title=--a=b", "--verbose", "false"},
                             ListOptions(&options)));
  EXPECT_EQ(*options.title, "--a=b");
  EXPECT_FALSE(options.verbose);
}

TEST(ParseArguments, FlagsOverrideTheFileWhereverItStands) {
  const TempDir dir;
  const std::string config_path = (dir.path() / "c.ini").string();
  WriteTextFile(config_path,
                "input_path = file\ntitle = file\n"
                "[Solver]\nmax_num_iterations = 9\n");
  for (const bool file_is_first : {true, false}) {
    Arguments arguments = {"--title", "flag"};
    arguments.insert(file_is_first ? arguments.begin() : arguments.end(),
                     {"--config_path", config_path});
    SampleOptions options;
    ASSERT_TRUE(ParseArguments("sample", "", arguments, ListOptions(&options)));
    EXPECT_EQ(*options.input_path, "file");
    EXPECT_EQ(*options.title, "flag");
    EXPECT_EQ(options.solver.max_num_iterations, 9);
    EXPECT_EQ(options.solver.loss.scale_px, 1.5);
  }
}

TEST(ParseArguments, DumpIsReadBackAsConfigFile) {
  const Arguments arguments = {"--title", " t ", "--Solver.Loss.kind", "cauchy",
                               "--verbose"};
  Arguments dump_arguments = arguments;
  dump_arguments.push_back("--dump_config");
  SampleOptions dumped;
  ::testing::internal::CaptureStdout();
  EXPECT_FALSE(
      ParseArguments("sample", "", dump_arguments, ListOptions(&dumped)));
  const TempDir dir;
  const std::string config_path = (dir.path() / "c.ini").string();
  WriteTextFile(config_path, ::testing::internal::GetCapturedStdout());

  SampleOptions loaded;
  ASSERT_TRUE(ParseArguments("sample", "",
                             {"--config_path", config_path, "--input_path=x"},
                             ListOptions(&loaded)));
  dumped.input_path = "x";
  EXPECT_EQ(SampleDump(loaded), SampleDump(dumped));
}

TEST(ParseArguments, HelpNeedsNothingElse) {
  SampleOptions options;
  ::testing::internal::CaptureStdout();
  EXPECT_FALSE(
      ParseArguments("sample", "Tries.", {"--help"}, ListOptions(&options)));
  EXPECT_THAT(::testing::internal::GetCapturedStdout(),
              ::testing::AllOf(HasSubstr("Tries."), HasSubstr("--config_path"),
                               HasSubstr("--Solver.Loss.scale_px")));
}

TEST(ParseArguments, RefusesBadUsage) {
  EXPECT_THAT(ErrorOf({}), HasSubstr("input_path is required"));
  EXPECT_THAT(ErrorOf({"--input_path"}), HasSubstr("input_path"));
  EXPECT_THAT(ErrorOf({"--title"}), HasSubstr("--title needs a value"));
  EXPECT_THAT(ErrorOf({"input_path", "x"}),
              HasSubstr("unexpected argument 'input_path'"));
  EXPECT_THAT(ErrorOf({"--input_path", "x", "y"}), HasSubstr("'y'"));
  EXPECT_THAT(ErrorOf({"--input_pth", "x"}),
              HasSubstr("did you mean 'input_path'?"));
  EXPECT_THAT(ErrorOf({"--title", "a", "--title", "b"}), HasSubstr("twice"));
  EXPECT_THAT(ErrorOf({"--config_path"}), HasSubstr("needs a value"));
  EXPECT_THAT(ErrorOf({"--config_path", "/none"}), HasSubstr("/none"));
  EXPECT_THAT(ErrorOf({"--help", "x"}), HasSubstr("takes no value"));
}

int RunSample(const SampleOptions& options, const Context& context) {
  EXPECT_EQ(*options.input_path, "x");
  EXPECT_EQ(context.num_threads, 2);
  EXPECT_EQ(context.random_seed, 5u);
  return kExitNotSolvable;
}

TEST(MakeCommand, PassesOptionsContextAndExitCode) {
  const Command command = MakeCommand("sample", "Tries.", RunSample);
  EXPECT_EQ(command.run({"--input_path=x", "--num_threads=2", "--random_seed=5",
                         "--log_level=error"}),
            kExitNotSolvable);
  EXPECT_THROW(command.run({"--input_path=x", "--random_seed=-1"}), Error);
}

TEST(MakeCommand, CallChecksAndPassesTheSame) {
  const Command command = MakeCommand("sample", "Tries.", RunSample);
  Context environment;
  environment.log = [](LogLevel, const std::string&) {};
  const auto call = [&](const std::string& path) {
    return command.call(
        [&](const OptionList& options) {
          SetOption(options, "input_path", path);
          SetOption(options, "num_threads", "2");
          SetOption(options, "random_seed", "5");
        },
        environment);
  };
  EXPECT_EQ(call("x").exit_code, kExitNotSolvable);
  EXPECT_THROW(call(""), Error);
}

CommandResult ReturnText(const SampleOptions&, const Context& context) {
  context.Info("info");
  context.Warning("warning");
  CommandResult result(kExitSuccess);
  result.text = "a table\n";
  return result;
}

TEST(MakeCommand, TextIsPrintedByTheProgramOnly) {
  const Command command = MakeCommand("sample", "Tries.", ReturnText);
  ::testing::internal::CaptureStdout();
  EXPECT_EQ(command.run({"--input_path=x"}), kExitSuccess);
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "a table\n");

  Context environment;
  std::vector<std::string> messages;
  environment.log = [&](LogLevel, const std::string& message) {
    messages.push_back(message);
  };
  ::testing::internal::CaptureStdout();
  const CommandResult result = command.call(
      [](const OptionList& options) {
        SetOption(options, "input_path", "x");
        SetOption(options, "log_level", "warning");
      },
      environment);
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(result.text, "a table\n");
  EXPECT_EQ(messages, std::vector<std::string>{"warning"});
}

TEST(CommonOptions, DefaultsAreInRange) {
  EXPECT_NO_THROW(CheckOptionsOf(CommonOptions()));
}

}  // namespace
}  // namespace mgsfm
