// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/context.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

TEST(Context, WithoutCallbacksIsSilent) {
  const Context context;
  context.Debug("a");
  context.Info("b");
  context.Warning("c");
  context.ReportProgress("d", 1, 2);
}

TEST(Context, PassesMessagesWithTheirLevel) {
  std::vector<std::pair<LogLevel, std::string>> messages;
  Context context;
  context.log = [&](LogLevel level, const std::string& message) {
    messages.emplace_back(level, message);
  };
  context.Debug("a");
  context.Info("b");
  context.Warning("c");
  EXPECT_THAT(messages, ElementsAre(Pair(LogLevel::kDebug, "a"),
                                    Pair(LogLevel::kInfo, "b"),
                                    Pair(LogLevel::kWarning, "c")));
}

TEST(Context, PassesProgress) {
  std::vector<size_t> done;
  Context context;
  context.progress = [&](const Progress& progress) {
    EXPECT_EQ(progress.stage, "pairs");
    EXPECT_EQ(progress.total, 9u);
    done.push_back(progress.done);
  };
  context.ReportProgress("pairs", 0, 9);
  context.ReportProgress("pairs", 9, 9);
  EXPECT_THAT(done, ElementsAre(0u, 9u));
}

TEST(Context, AsksWhetherToStop) {
  Context context;
  EXPECT_NO_THROW(context.CheckInterrupted());
  bool shall_stop = false;
  context.is_canceled = [&] { return shall_stop; };
  EXPECT_NO_THROW(context.CheckInterrupted());
  EXPECT_NO_THROW(context.ReportProgress("pairs", 0, 9));
  shall_stop = true;
  EXPECT_THROW(context.CheckInterrupted(), Interrupted);
  EXPECT_THROW(context.ReportProgress("pairs", 1, 9), Interrupted);
}

}  // namespace
}  // namespace mgsfm
