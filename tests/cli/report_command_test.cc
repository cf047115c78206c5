// SPDX-License-Identifier: BSD-3-Clause
// The command report, on the truth of the demo.
#include "cli/program_runs.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;
using testing::Not;

using ReportCommandTest = CommandTest;

TEST_F(ReportCommandTest, WritesFigures) {
  Run("report --input_path " + DemoTruth() + " --database_path " +
      DemoDatabase() + " --gt_path " + DemoTruth() + " --output_path " +
      Path("report.html") + " --figures " + Path("figures"));
  for (const char* name :
       {"trajectory", "rig", "residuals", "view_graph", "errors"}) {
    EXPECT_THAT(ReadTextFile(Path("figures/") + name + ".svg"),
                HasSubstr("</svg>"));
  }
}

// The file quotes names, which may hold commas and quotes.
TEST_F(ReportCommandTest, ShowsTheConfidenceBesideAModel) {
  const std::string model = Path("model");
  std::filesystem::copy(DemoTruth(), model);
  const std::string call = "report --input_path " + model + " --output_path ";
  std::string messages;
  const auto page_of = [&](const std::string& rows) {
    WriteTextFile(model + "/frames.csv",
                  "frame,num_images,num_observations,confidence\n" + rows);
    messages = Run(call + Path("page.html")).err;
    return ReadTextFile(Path("page.html"));
  };
  const std::string low = page_of("\"000001\",4,100,0.25\n");
  EXPECT_THAT(messages, Not(HasSubstr("frames.csv")));
  EXPECT_EQ(low, page_of("\"000001\",4,100,0.25\r\n\"a,\"\"\",1,1,1\n"));
  EXPECT_THAT(messages, HasSubstr("1 of 2 frames that the model does not"));
  EXPECT_NE(low, page_of("\"000001\",4,100,0.75\n"));
  // The model has other images in this frame.
  page_of("\"000001\",3,100,0.25\n");
  EXPECT_THAT(messages, HasSubstr("1 of 1 frames that the model does not"));
  for (const char* row :
       {"\"000001\",4,x\n", "\"000001\"\n", "\"000001\",4,1.5\n"}) {
    const std::string table =
        std::string("frame,num_images,confidence\n") + row;
    WriteTextFile(model + "/frames.csv", table);
    const CommandOutput bad = RunMgsfm(call + Path("bad.html"));
    EXPECT_EQ(bad.exit_code, 1);
    EXPECT_THAT(bad.err, HasSubstr("frames.csv', line 2"));
  }
}

}  // namespace
}  // namespace mgsfm
