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

TEST(ProgressText, TheTimeLeftIsRoundedUp) {
  EXPECT_EQ(FormatTimeLeft(0.0), "0 s");
  EXPECT_EQ(FormatTimeLeft(0.1), "1 s");
  EXPECT_EQ(FormatTimeLeft(60.0), "60 s");
  EXPECT_EQ(FormatTimeLeft(61.0), "2 min");
  EXPECT_EQ(FormatTimeLeft(3601.0), "1 h 01 min");
  EXPECT_EQ(FormatTimeLeft(100.0 * 3600.0), "100 h 00 min");
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
              Optional(Eq("matching: 20 of 80, 0.1/s, 10 min left")));
  EXPECT_DOUBLE_EQ(text.Share(), 0.25);
}

TEST(ProgressText, HighRatesHaveNoExponent) {
  ProgressText text(1.0);
  text.Update({"stage", 0, 90000}, 0.0);
  EXPECT_THAT(text.Update({"stage", 30000, 90000}, 2.0),
              Optional(Eq("stage: 30000 of 90000, 15000/s, 4 s left")));
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
              Optional(Eq("stage: 5 of 10, 0.5/s, 10 s left")));
}

// A solver that always seems to need two more iterations, and its next solve.
TEST(ProgressText, EstimatedTotalsPromiseNothing) {
  ProgressText text(0.0);
  for (size_t i = 0; i < 100; ++i) {
    const size_t done = i % 50;
    const auto line =
        text.Update({"solver", done, done + 2}, 0.1 * static_cast<double>(i));
    if (done == 0) continue;
    EXPECT_THAT(
        line, Optional(AllOf(HasSubstr(" of about "), Not(HasSubstr("left")))));
  }
}

// Two quick steps of ten, and slow ones.
TEST(ProgressText, AForecastThatFailedIsNotRepeated) {
  ProgressText text(0.0);
  text.Update({"stage", 0, 10}, 0.0);
  EXPECT_THAT(text.Update({"stage", 1, 10}, 1.0),
              Optional(HasSubstr(", 9 s left")));
  EXPECT_THAT(text.Update({"stage", 2, 10}, 2.0),
              Optional(HasSubstr(", 8 s left")));
  EXPECT_THAT(text.Update({"stage", 3, 10}, 30.0),
              Optional(Not(HasSubstr("left"))));
}

TEST(ProgressText, ASteadyStageHasATimeUntilItsEnd) {
  ProgressText text(0.0);
  text.Update({"matching", 0, 100}, 0.0);
  for (size_t i = 1; i < 100; ++i) {
    const std::string left = FormatTimeLeft(static_cast<double>(100 - i));
    EXPECT_THAT(text.Update({"matching", i, 100}, static_cast<double>(i)),
                Optional(HasSubstr(", " + left + " left")));
  }
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
  EXPECT_THAT(seen, AllOf(HasSubstr("\r\033[K["), HasSubstr(" s left")));
  const size_t last_bar = seen.rfind("[K[");
  EXPECT_NE(seen.find("\r\033[K", last_bar), std::string::npos);

  EXPECT_THAT(RunExecutable(simulate + "/file").err, Not(HasSubstr("left")));
  EXPECT_THAT(RunExecutable(simulate + "/quiet --quiet").err, IsEmpty());
}

}  // namespace
}  // namespace mgsfm
