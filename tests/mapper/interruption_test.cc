// SPDX-License-Identifier: BSD-3-Clause
// Every stage checks often enough for cancellation, and stops then.
#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <string>

#include "mgsfm/base/error.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/scene_loading.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

// A context that counts how often each stage checks for cancellation, and
// cancels at a chosen check of one stage.
class Questions {
 public:
  Context MakeContext() {
    Context context;
    context.num_threads = 1;
    context.log = [this](LogLevel, const std::string& message) {
      const size_t end = message.find(" started");
      if (end != std::string::npos) stage_ = message.substr(0, end);
    };
    context.is_canceled = [this] {
      const int number = ++counts_[stage_];
      return has_said_yes_ |= stage_ == stop_stage_ && number == stop_number_;
    };
    return context;
  }
  void StopAt(const std::string& stage, int number) {
    *this = Questions();
    stop_stage_ = stage;
    stop_number_ = number;
  }
  void Enter(const std::string& stage) { stage_ = stage; }
  const std::map<std::string, int>& counts() const { return counts_; }
  bool HasSaidYes() const { return has_said_yes_; }

 private:
  std::string stage_ = "reading";
  std::map<std::string, int> counts_;
  std::string stop_stage_;
  int stop_number_ = 0;
  bool has_said_yes_ = false;
};

void ReadMapAndWrite(Questions* questions,
                     const std::filesystem::path& output) {
  const Context context = questions->MakeContext();
  const LoadedScene loaded =
      LoadScene(MGSFM_SOURCE_DIR "/data/demo/database.db",
                SceneLoadingOptions(), context);
  const MapperResult result =
      RunMapper({loaded.scene, loaded.view_graph}, MapperOptions(), context);
  questions->Enter("writing");
  ASSERT_EQ(result.models.size(), 1u);
  WriteModel(output, loaded.scene, result.models[0].reconstruction,
             ModelFormat::kBinary, context);
}

TEST(InterruptionTest, EveryStageStopsWhereverItIsAsked) {
  const TempDir dir;
  Questions questions;
  ReadMapAndWrite(&questions, dir.path());
  const std::map<std::string, int> counts = questions.counts();
  // Checks beyond the one at the beginning of each stage.
  const std::map<std::string, int> at_least = {
      {"reading", 100},  // rows
      {"rays", 1},
      {"view graph", 100},         // pairs
      {"rotation averaging", 10},  // iterations
      {"tracks", 2},
      {"translation averaging", 100},  // pairs and iterations
      {"bundle adjustment", 5},        // solves
      {"writing", 100}};               // images and points
  for (const auto& [stage, least] : at_least) {
    ASSERT_TRUE(counts.count(stage) > 0) << stage;
    EXPECT_GE(counts.at(stage), least) << stage;
    for (const int number : {(counts.at(stage) + 1) / 2, counts.at(stage)}) {
      questions.StopAt(stage, number);
      EXPECT_THROW(ReadMapAndWrite(&questions, dir.path()), Interrupted)
          << stage << " " << number;
      EXPECT_TRUE(questions.HasSaidYes());
    }
  }
}

// Worker threads check as well.
TEST(InterruptionTest, StopsWithSeveralThreads) {
  const LoadedScene loaded =
      LoadScene(MGSFM_SOURCE_DIR "/data/demo/database.db",
                SceneLoadingOptions(), Context());
  for (const int number : {1, 3, 30, 300}) {
    std::atomic<int> count{0};
    Context context;
    context.num_threads = 3;
    context.is_canceled = [&] { return ++count >= number; };
    EXPECT_THROW(static_cast<void>(RunMapper({loaded.scene, loaded.view_graph},
                                             MapperOptions(), context)),
                 Interrupted);
  }
}

}  // namespace
}  // namespace mgsfm
