// SPDX-License-Identifier: BSD-3-Clause
#include "video/sampling_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "mgsfm/base/error.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;

constexpr int64_t kMs = 1'000'000;

TEST(NamesOfTimesTest, AreMillisecondsSinceTheFirst) {
  EXPECT_THAT(NamesOfTimes({5 * kMs, 5 * kMs + 33'333'333, 12'350 * kMs}),
              ElementsAre("000000.000", "000000.033", "000012.345"));
}

TEST(NamesOfTimesTest, AreDistinct) {
  EXPECT_THAT(NamesOfTimes({0, 100'000}),
              ElementsAre("000000.000000000", "000000.000100000"));
}

TEST(FoldersOfVideosTest, AreNamedAfterVideosOrTheirFolders) {
  EXPECT_THAT(FoldersOfVideos({"a/front.mp4", "b/left.mkv"}),
              ElementsAre("front", "left"));
  EXPECT_THAT(FoldersOfVideos({"/a/cam0/v.mp4", "/a/cam1/v.mp4"}),
              ElementsAre("cam0", "cam1"));
  EXPECT_THROW(FoldersOfVideos({"/a/cam0/v.mp4", "/b/cam0/v.mp4"}), Error);
  EXPECT_THROW(FoldersOfVideos({"/a/v.mp4", "/a/v.mp4"}), Error);
}

TEST(SamplingPlanTest, IsReadForTheSameSettingsOnly) {
  const TempDir dir;
  EXPECT_FALSE(ReadPlan(dir.path(), "{}"));
  const SamplingPlan plan{{"a", "b"},
                          {0, -7},
                          {{"000000.000", {3, std::nullopt}},
                           {"000000.100", {100'000'003, 100'000'010}}}};
  WritePlan(dir.path(), R"({"rate": 2})", plan);
  const auto read = ReadPlan(dir.path(), R"({"rate": 2})");
  ASSERT_TRUE(read);
  EXPECT_EQ(read->folders, plan.folders);
  EXPECT_EQ(read->offsets_ns, plan.offsets_ns);
  ASSERT_EQ(read->frames.size(), 2u);
  EXPECT_EQ(read->frames[0].name, "000000.000");
  EXPECT_EQ(read->frames[0].times_ns, plan.frames[0].times_ns);
  EXPECT_EQ(read->frames[1].times_ns, plan.frames[1].times_ns);
  // Other settings may begin anew while there are no images.
  EXPECT_FALSE(ReadPlan(dir.path(), R"({"rate": 3})"));
  std::filesystem::create_directories(dir.path() / "images/a");
  EXPECT_THROW(ReadPlan(dir.path(), R"({"rate": 3})"), Error);
  WriteTextFile(dir.path() / "video_sampling.json", "{");
  EXPECT_THROW(ReadPlan(dir.path(), R"({"rate": 2})"), Error);
}

}  // namespace
}  // namespace mgsfm
