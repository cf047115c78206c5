// SPDX-License-Identifier: BSD-3-Clause
// Output of the program to the standard error stream while it runs.
#include "terminal.h"

#include <string>

#include "cli/program_runs.h"

namespace mgsfm {
namespace {

using ::testing::AllOf;
using ::testing::Eq;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::Optional;

TEST(ProgressText, HoursAndMinutesAreRoundedUp) {
  EXPECT_EQ(FormatHoursMinutes(0.0), "0:00");
  EXPECT_EQ(FormatHoursMinutes(1.0), "0:01");
  EXPECT_EQ(FormatHoursMinutes(60.0), "0:01");
  EXPECT_EQ(FormatHoursMinutes(3601.0), "1:01");
  EXPECT_EQ(FormatHoursMinutes(100.0 * 3600.0), "100:00");
}

TEST(ProgressText, BarHasItsWidthWhateverTheShare) {
  for (const double share : {-1.0, 0.0, 0.3, 0.999, 1.0, 2.0}) {
    EXPECT_EQ(ProgressBar(share, 10).size(), 12u) << share;
  }
  EXPECT_EQ(ProgressBar(0.5, 10), "[=====>    ]");
  EXPECT_EQ(ProgressBar(1.0, 10), "[==========]");
}

TEST(ProgressText, SaysRateAndRemainingTime) {
  ProgressText text(60.0);
  EXPECT_EQ(text.Update({"matching", 0, 80}, 100.0), std::nullopt);
  EXPECT_EQ(text.Update({"matching", 0, 80}, 200.0), std::nullopt);
  EXPECT_THAT(text.Update({"matching", 20, 80}, 300.0),
              Optional(Eq("matching: 20 of 80, 0.1/s, 0:10 left")));
  EXPECT_DOUBLE_EQ(text.Share(), 0.25);
}

TEST(ProgressText, HighRatesHaveNoExponent) {
  ProgressText text(1.0);
  text.Update({"stage", 0, 90000}, 0.0);
  EXPECT_THAT(text.Update({"stage", 30000, 90000}, 2.0),
              Optional(Eq("stage: 30000 of 90000, 15000/s, 0:01 left")));
}

TEST(ProgressText, OneLinePerInterval) {
  ProgressText text(60.0);
  int num_lines = 0;
  for (size_t i = 0; i < 600; ++i) {
    if (text.Update({"stage", i, 600}, static_cast<double>(i))) ++num_lines;
  }
  EXPECT_EQ(num_lines, 9);
  text.Postpone(660.0);
  EXPECT_EQ(text.Update({"other", 1, 9}, 700.0), std::nullopt);
}

TEST(ProgressText, ARepeatedStageStartsAnew) {
  ProgressText text(1.0);
  text.Update({"stage", 0, 10}, 0.0);
  text.Update({"stage", 10, 10}, 1000.0);
  text.Update({"stage", 0, 10}, 1000.0);
  EXPECT_THAT(text.Update({"stage", 5, 10}, 1010.0),
              Optional(Eq("stage: 5 of 10, 0.5/s, 0:01 left")));
}

// The output that a user sees, control sequences included.
std::string OnTerminal(const std::string& variables,
                       const std::string& arguments) {
  return RunShell(variables + " script -qec '" MGSFM_EXECUTABLE " " +
                  arguments + "' /dev/null")
      .out;
}

TEST(Terminal, ColorsOnlyWhereTheyAreWelcome) {
  EXPECT_THAT(OnTerminal("TERM=xterm NO_COLOR=", "nothing"),
              HasSubstr("\033[31mmgsfm:\033[0m unknown command"));
  for (const char* variables : {"TERM=xterm NO_COLOR=1", "TERM=dumb"}) {
    EXPECT_THAT(OnTerminal(variables, "nothing"), Not(HasSubstr("\033")));
  }
  EXPECT_THAT(RunExecutable("nothing").err, Not(HasSubstr("\033")));
}

TEST(Terminal, ProgressIsABarThatIsRemovedAtTheEnd) {
  const TempDir dir;
  const std::string simulate =
      "simulate --preset standard --num_frames 300 --num_threads 1 "
      "--output_path " +
      dir.path().string();
  const std::string seen = OnTerminal("TERM=xterm", simulate + "/terminal");
  EXPECT_THAT(seen, AllOf(HasSubstr("\r\033[K["), HasSubstr("0:01 left")));
  const size_t last_bar = seen.rfind("[K[");
  EXPECT_NE(seen.find("\r\033[K", last_bar), std::string::npos);

  EXPECT_THAT(RunExecutable(simulate + "/file").err, Not(HasSubstr("left")));
  EXPECT_THAT(RunExecutable(simulate + "/quiet --quiet").err, IsEmpty());
}

}  // namespace
}  // namespace mgsfm
