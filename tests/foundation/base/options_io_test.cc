// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/options_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "foundation/base/sample_options.h"
#include "mgsfm/base/version.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;

void Load(const std::string& text, SampleOptions* options) {
  std::istringstream stream(text);
  LoadOptions(stream, "test.ini", ListOptions(options));
}

std::string LoadError(const std::string& text) {
  SampleOptions options;
  try {
    Load(text, &options);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

SampleOptions MakeUnusualOptions() {
  SampleOptions options;
  options.input_path = "  /folder with \"quotes\", spaces and # = [x] \\ ";
  options.verbose = true;
  options.solver.max_num_iterations = 3;
  options.solver.loss.kind = SampleLoss::kCauchy;
  options.solver.loss.scale_px = 1.0 / 3.0;
  options.title = "\"";
  return options;
}

TEST(LoadOptions, ReadsSectionsCommentsAndFullNames) {
  SampleOptions options;
  Load(
      "# a comment\n"
      "input_path = a=b # not a comment\r\n"
      "Solver.Loss.kind=cauchy\n"
      "\n"
      "[Solver]\n"
      " max_num_iterations\t=\t8\n"
      "; another\n"
      "[ Solver.Loss ]\n"
      "scale_px = 4",
      &options);
  EXPECT_EQ(*options.input_path, "a=b # not a comment");
  EXPECT_EQ(options.solver.loss.kind, SampleLoss::kCauchy);
  EXPECT_EQ(options.solver.max_num_iterations, 8);
  EXPECT_EQ(options.solver.loss.scale_px, 4.0);
}

TEST(LoadOptions, KeepsWhatTheFileDoesNotName) {
  SampleOptions options = MakeUnusualOptions();
  Load("verbose = false\n", &options);
  SampleOptions expected = MakeUnusualOptions();
  expected.verbose = false;
  EXPECT_EQ(SampleDump(options), SampleDump(expected));
}

TEST(LoadOptions, DumpIsReadBackAsIs) {
  const SampleOptions options = MakeUnusualOptions();
  SampleOptions loaded;
  Load(SampleDump(options), &loaded);
  EXPECT_EQ(*loaded.input_path, *options.input_path);
  EXPECT_EQ(loaded.verbose, options.verbose);
  EXPECT_EQ(loaded.solver.max_num_iterations,
            options.solver.max_num_iterations);
  EXPECT_EQ(loaded.solver.loss.kind, options.solver.loss.kind);
  EXPECT_EQ(loaded.solver.loss.scale_px, options.solver.loss.scale_px);
  EXPECT_EQ(*loaded.title, *options.title);
}

TEST(LoadOptions, DumpOfDefaultsLeavesOutWhatIsRequired) {
  SampleOptions loaded;
  EXPECT_NO_THROW(Load(SampleDump(SampleOptions()), &loaded));
  EXPECT_EQ(SampleDump(loaded), SampleDump(SampleOptions()));
}

TEST(LoadOptions, ErrorsNameFileLineAndKey) {
  EXPECT_EQ(LoadError("verbose = 1\n\n[Solver]\nmax_num_iteration = 3\n"),
            "test.ini:4: unknown option Solver.max_num_iteration (did you mean "
            "'Solver.max_num_iterations'?)");
  EXPECT_THAT(
      LoadError("[Solvr.Loss]\nscale_px = 3"),
      AllOf(StartsWith("test.ini:2: "), HasSubstr("'Solver.Loss.scale_px'")));
  EXPECT_THAT(LoadError("Solver.max_num_iterations = 0"),
              AllOf(StartsWith("test.ini:1: "), HasSubstr("[1, 100]")));
  EXPECT_THAT(LoadError("verbose = 1\nverbose = 1"),
              AllOf(StartsWith("test.ini:2: "), HasSubstr("twice")));
  EXPECT_THAT(LoadError("[Solver]\nLoss.scale_px = 1\n[Solver.Loss]\n"
                        "scale_px = 2"),
              HasSubstr("twice"));
  EXPECT_THAT(LoadError("verbose"), HasSubstr("key = value"));
  EXPECT_THAT(LoadError("[Solver\n"), HasSubstr("']' is missing"));
  for (const char* quoted : {"\"", "\"a", "\"a\" b", "\"a\"b\"", "\"a\\\"",
                             "\"a\" "
                             "\"b\""}) {
    EXPECT_THAT(LoadError("title = " + std::string(quoted)),
                HasSubstr("quotes"))
        << quoted;
  }
}

TEST(LoadOptions, AllUnknownOptionsAreNamedAtOnce) {
  const std::string error =
      LoadError("verbos = 1\ntitle = t\n[Other]\nkey = 1\n");
  EXPECT_THAT(error, AllOf(HasSubstr("test.ini:1: unknown option verbos"),
                           HasSubstr("test.ini:4: unknown option Other.key")));
  SampleOptions options;
  const OptionAdvice advice = [](const std::string& name) {
    return name == "verbos" ? std::optional<std::string>("use --verbose")
                            : std::nullopt;
  };
  try {
    CheckOptionNames(ListOptions(&options), {"verbos", "title", "x_y"}, advice);
    ADD_FAILURE() << "no error";
  } catch (const Error& named) {
    EXPECT_STREQ(named.what(), "2 unknown options: verbos: use --verbose; x_y");
  }
}

TEST(LoadOptions, FilesStateTheVersionThatWroteThem) {
  const std::string version = Version();
  EXPECT_THAT(SampleDump(SampleOptions()),
              StartsWith("mgsfm_version = " + version + "\n"));
  SampleOptions options;
  Load("mgsfm_version = 0.0.1\ntitle = t\n", &options);
  EXPECT_EQ(*options.title, "t");
  EXPECT_EQ(LoadError("mgsfm_version = 0.0.1\nheading = t"),
            "test.ini:2: unknown option heading; mgsfm 0.0.1 wrote the file, "
            "this is " +
                version);
  EXPECT_THAT(LoadError("mgsfm_version = " + version + "\nheading = t"),
              Not(HasSubstr("wrote")));
  EXPECT_THAT(LoadError("mgsfm_version = 1000.0.0"),
              AllOf(HasSubstr("newer than this"), HasSubstr("update")));
  EXPECT_THAT(LoadError("mgsfm_version = new"), HasSubstr("not a version"));
}

TEST(IsNewerVersion, PatchesAreCompatible) {
  EXPECT_FALSE(IsNewerVersion(Version()));
  EXPECT_FALSE(IsNewerVersion("0.0.9"));
  EXPECT_FALSE(IsNewerVersion("0.1.1000"));
  EXPECT_TRUE(IsNewerVersion("0.1000.0"));
  EXPECT_TRUE(IsNewerVersion("1000.0.0"));
  for (const char* text :
       {"", "1", "1.2", "1.2.", "1.2.3.4", "a.b.c", "1,2,3"}) {
    EXPECT_THROW(IsNewerVersion(text), Error) << text;
  }
}

TEST(LoadOptions, MissingFileIsAnError) {
  const TempDir dir;
  SampleOptions options;
  const OptionList list = ListOptions(&options);
  EXPECT_THROW(LoadOptions(dir.path() / "none.ini", list), Error);
  EXPECT_THROW(LoadOptions(dir.path(), list), Error);
  WriteTextFile(dir.path() / "some.ini", "title = t\n");
  LoadOptions(dir.path() / "some.ini", list);
  EXPECT_EQ(*options.title, "t");
}

TEST(OptionsToJson, KeepsTypes) {
  const auto json =
      nlohmann::json::parse(OptionsToJsonOf(MakeUnusualOptions()));
  EXPECT_EQ(json["input_path"], *MakeUnusualOptions().input_path);
  EXPECT_EQ(json["verbose"], true);
  EXPECT_EQ(json["Solver"]["max_num_iterations"], 3);
  EXPECT_EQ(json["Solver"]["Loss"]["kind"], "cauchy");
  EXPECT_EQ(json["Solver"]["Loss"]["scale_px"], 1.0 / 3.0);
  EXPECT_EQ(json["Solver"].size(), 2u);
}

TEST(OptionsToJson, PathsNeedNotBeUtf8) {
  SampleOptions options;
  options.input_path = "a\xff";
  EXPECT_NO_THROW(nlohmann::json::parse(OptionsToJsonOf(options)));
}

TEST(OptionsToHelp, ShowsDefaultsRangesAndUnits) {
  SampleOptions options;
  const std::string help = OptionsToHelp(ListOptions(&options));
  EXPECT_THAT(help, HasSubstr("--Solver.max_num_iterations\n"
                              "      int in [1, 100] iterations; default: 50\n"
                              "      Most iterations.\n"));
  EXPECT_THAT(help, HasSubstr("number in [1e-15, 1000000] px; default: 1.5"));
  EXPECT_THAT(help, HasSubstr("trivial|cauchy; default: trivial"));
  EXPECT_THAT(help, HasSubstr("text; default: required"));
  EXPECT_THAT(help, HasSubstr("text; default: none"));
}

TEST(OptionsToHelp, FitsIntoEightyColumns) {
  OptionEntry entry;
  entry.name = "name";
  entry.default_value = 1;
  for (int i = 0; i < 50; ++i) entry.help += "word" + std::to_string(i) + " ";
  std::istringstream help(OptionsToHelp({entry}));
  std::vector<std::string> lines;
  for (std::string line; std::getline(help, line);) lines.push_back(line);
  EXPECT_GT(lines.size(), 5u);
  EXPECT_THAT(lines, Each(SizeIs(::testing::Le(80u))));
}

TEST(OptionsToMarkdown, HasOneRowPerOptionAndEscapesPipes) {
  SampleOptions options;
  const std::string text = OptionsToMarkdown(ListOptions(&options));
  EXPECT_THAT(text, HasSubstr("| `verbose` | false | true\\|false |  | Say "
                              "more \\| less. |\n"));
  EXPECT_THAT(text, HasSubstr("\n### Solver.Loss\n"));
  // Top-level options precede all sections.
  EXPECT_LT(text.find("`title`"), text.find("### Solver"));
}

}  // namespace
}  // namespace mgsfm
