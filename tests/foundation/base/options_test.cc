// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/text.h"
#include "foundation/base/sample_options.h"
#include "mgsfm/base/options_io.h"

namespace mgsfm {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

class OptionsTest : public ::testing::Test {
 protected:
  std::string ErrorOf(const std::string& name, const std::string& text) {
    try {
      SetOption(list_, name, text);
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  }

  SampleOptions options_;
  OptionList list_ = ListOptions(&options_);
};

TEST(Range, ContainsClosedEndsOnly) {
  EXPECT_TRUE(AtLeast(2).Contains(2));
  EXPECT_FALSE(AtLeast(2).Contains(1.999));
  EXPECT_FALSE(GreaterThan(0).Contains(0));
  EXPECT_TRUE(GreaterThan(0).Contains(1e-300));
  EXPECT_TRUE(Between(0, 1).Contains(0));
  EXPECT_TRUE(Between(0, 1).Contains(1));
  EXPECT_FALSE(Between(0, 1).Contains(1.0001));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(AnyValue().Contains(nan));
}

TEST(Range, ToStringIsAnInterval) {
  EXPECT_EQ(AnyValue().ToString(), "");
  EXPECT_EQ(AtLeast(2).ToString(), "[2, inf)");
  EXPECT_EQ(GreaterThan(0).ToString(), "(0, inf)");
  EXPECT_EQ(Between(-0.5, 180).ToString(), "[-0.5, 180]");
  EXPECT_EQ(Between(1e-12, 100000).ToString(), "[1e-12, 100000]");
}

TEST(Option, ConvertsToItsValue) {
  const SampleSolverOptions options;
  const int num_iterations = options.max_num_iterations;
  EXPECT_EQ(num_iterations, 50);
  EXPECT_EQ(options.max_num_iterations + 1, 51);
  EXPECT_EQ(*options.loss.kind, SampleLoss::kTrivial);
  const Option<std::string> text("text", "abc", "A text.");
  EXPECT_EQ(text->size(), 3u);
  EXPECT_EQ(*text + "d", "abcd");
}

TEST(Option, AssignmentChangesTheValueOnly) {
  Option<int> a("a", 1, AtLeast(0), "s", "First.");
  const Option<int> b("b", 2, AtLeast(1), "m", "Second.");
  a = b;
  EXPECT_EQ(a, 2);
  a = 3;
  EXPECT_EQ(a, 3);
  EXPECT_STREQ(a.Info().name, "a");
  EXPECT_STREQ(a.Info().unit, "s");
  EXPECT_STREQ(a.Info().help, "First.");
  EXPECT_EQ(a.Info().range.min, 0.0);
  EXPECT_EQ(b, 2);
}

TEST(Option, CopyHasValueAndDocumentation) {
  Option<int> a("a", 1, AtLeast(0), "s", "First.");
  a = 5;
  const Option<int> copy = a;
  EXPECT_EQ(copy, 5);
  EXPECT_STREQ(copy.Info().name, "a");
  EXPECT_EQ(copy.Info().range.ToString(), "[0, inf)");
}

TEST(Option, ShortFormsHaveNeitherUnitNorBounds) {
  const Option<bool> flag("flag", true, "A flag.");
  EXPECT_TRUE(flag);
  EXPECT_EQ(flag.Info().range.ToString(), "");
  EXPECT_STREQ(flag.Info().unit, "");
  const Option<double> ratio("ratio", 0.5, Between(0.0, 1.0), "A ratio.");
  EXPECT_EQ(ratio.Info().range.ToString(), "[0, 1]");
  EXPECT_STREQ(ratio.Info().unit, "");
}

struct FlatOptions {
  SampleLossOptions loss;
  Option<bool> verbose{"verbose", false, "Say more."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(loss, verbose);
  }
};

TEST(ListOptions, NestedStructsWithoutGroupHaveNoPrefix) {
  FlatOptions options;
  std::vector<std::string> names;
  for (const OptionEntry& entry : ListOptions(&options)) {
    names.push_back(entry.name);
  }
  EXPECT_EQ(names, (std::vector<std::string>{"kind", "scale_px", "verbose"}));
}

TEST_F(OptionsTest, ListHasAllFieldsInOrder) {
  std::vector<std::string> names;
  for (const OptionEntry& entry : list_) names.push_back(entry.name);
  EXPECT_EQ(names, (std::vector<std::string>{
                       "input_path", "verbose", "Solver.max_num_iterations",
                       "Solver.Loss.kind", "Solver.Loss.scale_px", "title"}));
  EXPECT_EQ(list_[0].Section(), "");
  EXPECT_EQ(list_[2].Section(), "Solver");
  EXPECT_EQ(list_[3].Section(), "Solver.Loss");
  EXPECT_TRUE(list_[0].IsRequired());
  EXPECT_FALSE(list_[5].IsRequired());
}

TEST_F(OptionsTest, SetReachesTheField) {
  SetOption(list_, "input_path", "a b");
  SetOption(list_, "verbose", "1");
  SetOption(list_, "Solver.max_num_iterations", "7");
  SetOption(list_, "Solver.Loss.kind", "cauchy");
  SetOption(list_, "Solver.Loss.scale_px", "2.5e-1");
  EXPECT_EQ(*options_.input_path, "a b");
  EXPECT_TRUE(options_.verbose);
  EXPECT_EQ(options_.solver.max_num_iterations, 7);
  EXPECT_EQ(options_.solver.loss.kind, SampleLoss::kCauchy);
  EXPECT_EQ(options_.solver.loss.scale_px, 0.25);
}

TEST_F(OptionsTest, RefusesWhatIsNotExactlyOneValueOfTheType) {
  for (const char* text : {"", " 3", "3x", "3.0", "1e3", "three", "2147483648",
                           "-2147483649", "0x10", "+3"}) {
    EXPECT_THAT(ErrorOf("Solver.max_num_iterations", text),
                AllOf(HasSubstr("Solver.max_num_iterations"),
                      HasSubstr("'" + std::string(text) + "'")));
  }
  for (const char* text :
       {"", "1.5 ", "1.5px", "1,5", "nan", "inf", "-inf", "1e999", "0x1p3"}) {
    EXPECT_THAT(ErrorOf("Solver.Loss.scale_px", text),
                HasSubstr("Solver.Loss.scale_px"));
  }
  for (const char* text : {"", "yes", "True", "2"}) {
    EXPECT_THAT(ErrorOf("verbose", text), HasSubstr("true or false"));
  }
  EXPECT_THAT(ErrorOf("Solver.Loss.kind", "tukey"),
              HasSubstr("one of trivial, cauchy"));
  EXPECT_THAT(ErrorOf("title", "two\nlines"), HasSubstr("control character"));
  EXPECT_EQ(DumpOptions(list_), SampleDump(SampleOptions()));
}

TEST_F(OptionsTest, OutOfRangeNamesOptionValueRangeAndUnit) {
  EXPECT_THAT(ErrorOf("Solver.Loss.scale_px", "-2"),
              AllOf(HasSubstr("Solver.Loss.scale_px"), HasSubstr("'-2'"),
                    HasSubstr("[1e-15, 1000000] px")));
  EXPECT_THAT(ErrorOf("Solver.max_num_iterations", "101"),
              HasSubstr("[1, 100] iterations"));
}

TEST_F(OptionsTest, CheckFindsWhatCodeHasSet) {
  EXPECT_THROW(CheckOptions(list_), Error) << "input_path is required";
  options_.input_path = "x";
  EXPECT_NO_THROW(CheckOptions(list_));
  options_.solver.loss.scale_px = std::numeric_limits<double>::infinity();
  EXPECT_THROW(CheckOptions(list_), Error);
  EXPECT_THROW(CheckOptionsOf(options_), Error);
}

TEST_F(OptionsTest, UnknownNameSuggestsTheNearest) {
  EXPECT_THAT(ErrorOf("Solver.max_num_iteration", "3"),
              HasSubstr("did you mean 'Solver.max_num_iterations'?"));
  EXPECT_THAT(ErrorOf("scale_px", "3"),
              HasSubstr("did you mean 'Solver.Loss.scale_px'?"));
  EXPECT_THAT(ErrorOf("VERBOSE", "1"), HasSubstr("'verbose'"));
  EXPECT_EQ(ErrorOf("something_else", "3"), "unknown option something_else");
}

TEST(FormatOptionValue, IsReadBackAsTheSameNumber) {
  for (const double value :
       {0.1, 1.0 / 3.0, 1e-300, 123456789.123456789, 5e-324, 1.0, 1e-4,
        999999999.99999988, 1.7976931348623157e308}) {
    EXPECT_EQ(ParseDouble(FormatOptionValue(value)), value);
  }
  EXPECT_EQ(FormatOptionValue(0.1), "0.1");
}

}  // namespace
}  // namespace mgsfm
