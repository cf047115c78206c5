// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "io/test_database.h"
#include "mgsfm/models/scene_loading.h"
#include "rigs/image_times.h"
#include "rigs/rig_inference.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::UnorderedElementsAre;

using Names = std::vector<std::string>;

constexpr int64_t kSecond = 1'000'000'000;

TEST(TimeInName, UnixTimesOfAllUnits) {
  const int64_t time_ns = 1403636579763555584;
  EXPECT_EQ(TimeInName("cam0/data/1403636579763555584.png"), time_ns);
  EXPECT_EQ(TimeInName("1403636579.763555584.png"), time_ns);
  EXPECT_EQ(TimeInName("left_1403636579_763555584.jpg"), time_ns);
  EXPECT_EQ(TimeInName("1403636579-763555584.jpg"), time_ns);
  EXPECT_EQ(TimeInName("1403636579763555.png"), time_ns / 1000 * 1000);
  EXPECT_EQ(TimeInName("1403636579763.png"), time_ns / 1000000 * 1000000);
  EXPECT_EQ(TimeInName("1403636579.png"), 1403636579 * kSecond);
  EXPECT_EQ(TimeInName("1305031102.175304.png"), 1305031102175304000);
  EXPECT_EQ(TimeInName("samples/CAM_FRONT/n015-2018-07-24-11-22-45+0800__"
                       "CAM_FRONT__1532402927612460.jpg"),
            1532402927612460000);
  EXPECT_EQ(TimeInName("ring_front_center/315968327799927220.jpg"),
            315968327799927220);
}

TEST(TimeInName, DatesAndSeconds) {
  // 2023-05-01 12:34:56 UTC, by `date -u -d ... +%s`.
  const int64_t time_ns = 1682944496 * kSecond;
  EXPECT_EQ(TimeInName("IMG_20230501_123456.jpg"), time_ns);
  EXPECT_EQ(TimeInName("IMG_20230501_123456_00_001.insp"), time_ns);
  EXPECT_EQ(TimeInName("PXL_20230501_123456789.jpg"), time_ns + 789000000);
  EXPECT_EQ(TimeInName("2023-05-01T12-34-56.25.jpg"), time_ns + 250000000);
  EXPECT_EQ(TimeInName("2024-02-29_00-00-00.jpg"), 1709164800 * kSecond);
  EXPECT_EQ(TimeInName("12.345.png"), 12345000000);
}

// 1403636579-5 is 5 ns after the second in file names of ROS, or image 5.
TEST(TimeInName, DoubtfulFractionsAreNone) {
  for (const char* name : {"1403636579-5.png", "1403636579-63555584.png",
                           "1403636579_12.png", "1403636579-763.png"}) {
    EXPECT_EQ(TimeInName(name), std::nullopt) << name;
  }
}

TEST(TimeInName, CountersAreNone) {
  for (const char* name :
       {"image_00/data/0000000250.png", "000123.png", "frame000001.jpg",
        "GX010123_000123.jpg", "cam1.000123.png", "99.png", "a.png",
        "20231301_123456.jpg", "12345678901234567890123.png"}) {
    EXPECT_EQ(TimeInName(name), std::nullopt) << name;
  }
}

class FramesByTimeTest : public testing::Test {
 protected:
  FramesByTimeTest() {
    context_.log = [this](LogLevel level, const std::string& text) {
      (level == LogLevel::kWarning ? warnings_ : infos_) += text + "\n";
    };
    options_.frame_max_time_difference_s = 1e-5;
  }

  Scene Load(const Names& names) {
    return LoadScene(MakeContents(names), options_, context_).scene;
  }
  std::string LoadError(const Names& names) {
    return ErrorOf([&] { Load(names); });
  }

  SceneLoadingOptions options_;
  Context context_;
  std::string infos_, warnings_;
};

// Nanoseconds after 2014-06-24, as EuRoC names images.
std::string At(const std::string& folder, int64_t ns) {
  return folder + "/" + std::to_string(1403636579 * kSecond + ns) + ".png";
}

TEST_F(FramesByTimeTest, NearestImagesMakeFrames) {
  const Names names = {At("cam0", 0),         At("cam0", 50000000),
                       At("cam0", 100000000), At("cam1", 4000),
                       At("cam1", 49993000),  At("cam2", 100002000),
                       At("cam2", 50000000)};
  const Scene scene = Load(names);
  EXPECT_EQ(scene.rigs.size(), 1u);
  EXPECT_THAT(NamesOfFrames(scene),
              UnorderedElementsAre(ElementsAre(names[0], names[3]),
                                   ElementsAre(names[1], names[4], names[6]),
                                   ElementsAre(names[2], names[5])));
  EXPECT_EQ(scene.frames[0].name, "1403636579.000000000");
  EXPECT_THAT(infos_, AllOf(HasSubstr("'cam1': 2 of 2 images paired with "
                                      "those of 'cam0'; times differ by"),
                            HasSubstr("by 7 us at most")));
  EXPECT_EQ(warnings_, "");
  for (const Image& image : scene.images) {
    EXPECT_NEAR(*image.timestamp_s,
                static_cast<double>(*TimeInName(image.name)) * 1e-9, 1e-6);
  }
}

// One frame cannot have two images of a camera, and of two candidates the
// nearer one is taken, the earlier one if both are equally near.
TEST_F(FramesByTimeTest, PairsAreOneToOne) {
  const Names nearer = {At("cam0", 0), At("cam1", 3000), At("cam1", 5000)};
  EXPECT_THAT(NamesOfFrames(Load(nearer)),
              UnorderedElementsAre(ElementsAre(nearer[0], nearer[1]),
                                   ElementsAre(nearer[2])));
  EXPECT_THAT(warnings_, HasSubstr("1 images of"));
  const Names tie = {At("cam0", 0), At("cam0", 90000), At("cam0", 4000),
                     At("cam1", 2000), At("cam1", 90000)};
  EXPECT_THAT(
      NamesOfFrames(Load(tie)),
      UnorderedElementsAre(ElementsAre(tie[0], tie[3]), ElementsAre(tie[2]),
                           ElementsAre(tie[1], tie[4])));
}

// A second implementation: all pairs of images, by brute force.
TEST_F(FramesByTimeTest, AgreesWithBruteForce) {
  Random random(3);
  std::vector<int64_t> times[2];
  Names names;
  for (int k = 0; k < 2; ++k) {
    std::set<int64_t> distinct;
    while (distinct.size() < 60) distinct.insert(random.Index(400) * 1000);
    times[k].assign(distinct.begin(), distinct.end());
    for (const int64_t time : times[k]) {
      names.push_back(At("cam" + std::to_string(k), time));
    }
  }
  const auto nearest = [&](int64_t time, int k) {
    return *std::min_element(times[k].begin(), times[k].end(),
                             [&](int64_t a, int64_t b) {
                               return std::abs(a - time) < std::abs(b - time);
                             });
  };
  std::set<Names> expected;
  for (const int64_t time : times[0]) {
    const int64_t partner = nearest(time, 1);
    if (nearest(partner, 0) == time && std::abs(partner - time) <= 10000) {
      expected.insert({At("cam0", time), At("cam1", partner)});
    }
  }
  std::set<Names> found;
  for (const Names& frame : NamesOfFrames(Load(names))) {
    if (frame.size() == 2) found.insert(frame);
  }
  EXPECT_EQ(found, expected);
  EXPECT_GT(found.size(), 20u);
}

TEST_F(FramesByTimeTest, ConstantOffsetsAreReported) {
  options_.frame_max_time_difference_s = 0.02;
  Names names;
  for (int64_t i = 0; i < 9; ++i) {
    names.push_back(At("cam0", i * 100000000));
    names.push_back(At("cam1", i * 100000000 + 12000000 + i * 1000));
  }
  EXPECT_EQ(Load(names).frames.size(), 9u);
  EXPECT_THAT(infos_, HasSubstr("a constant offset: later by 12 ms"));
}

TEST_F(FramesByTimeTest, TimesComeFromAFile) {
  const TempDir dir;
  options_.image_timestamps_path = (dir.path() / "times.txt").string();
  WriteTextFile(*options_.image_timestamps_path,
                "a/1.png 1.5\na/2.png 2.5\nb/x.png 2.500001\n");
  EXPECT_THAT(
      NamesOfFrames(Load({"a/1.png", "a/2.png", "b/x.png"})),
      ElementsAre(ElementsAre("a/1.png"), ElementsAre("a/2.png", "b/x.png")));
}

TEST_F(FramesByTimeTest, RigsPairSeparately) {
  options_.rig_name_rule = "(?<rig>[^/]+)/(?<camera>[^/]+)/.*";
  const Names names = {At("r1/cam0", 0), At("r1/cam1", 1000), At("r2/cam0", 0),
                       At("r2/cam1", 2000)};
  EXPECT_THAT(NamesOfFrames(Load(names)),
              UnorderedElementsAre(ElementsAre(names[0], names[1]),
                                   ElementsAre(names[2], names[3])));
}

TEST_F(FramesByTimeTest, ConfigurationsNameTheCameras) {
  const TempDir dir;
  options_.rig_config_path = (dir.path() / "rig.json").string();
  WriteTextFile(*options_.rig_config_path, R"([{"cameras": [
      {"image_prefix": "cam1/", "ref_sensor": true},
      {"image_prefix": "cam0/"}]}])");
  const Names names = {At("cam0", 0), At("cam1", 1000), "other/1.png"};
  options_.image_timestamps_path = (dir.path() / "times.txt").string();
  WriteTextFile(*options_.image_timestamps_path,
                names[0] + " 1\n" + names[1] + " 1.000001\nother/1.png 1\n");
  EXPECT_THAT(
      NamesOfFrames(Load(names)),
      ElementsAre(ElementsAre(names[0], names[1]), ElementsAre("other/1.png")));
}

TEST_F(FramesByTimeTest, BadInputIsNamed) {
  EXPECT_THAT(LoadError({At("cam0", 0), "cam1/000001.png"}),
              AllOf(HasSubstr("'cam1/000001.png' has no time"),
                    HasSubstr("image_timestamps_path")));
  EXPECT_THAT(LoadError({At("cam0", 0), At("cam1", 30000)}),
              AllOf(HasSubstr("at most 10 us apart"), HasSubstr("30 us apart"),
                    HasSubstr("increase frame_max_time_difference_s")));
  EXPECT_THAT(LoadError({At("cam0", 0), At("cam0", 5000)}),
              HasSubstr("only one camera"));
  EXPECT_THAT(LoadError({At("cam0", 0), At("cam0/x", 0), At("cam1", 0)}),
              "no error");
  EXPECT_THAT(LoadError({"cam0/a1403636579.png", "cam0/b1403636579.png",
                         "cam1/a1403636579.png"}),
              HasSubstr("of one camera have the same time"));
}

TEST_F(FramesByTimeTest, TimesInNamesAreSuggested) {
  options_.frame_max_time_difference_s = 0.0;
  Names names;
  for (int64_t i = 0; i < 8; ++i) {
    names.push_back(At("cam0", i * 50000000));
    names.push_back(At("cam1", i * 50000000 + 3000 + i * 500));
    names.push_back(At("cam2", i * 50000000 - 2000));
  }
  EXPECT_EQ(Load(names).frames.size(), 24u);
  EXPECT_THAT(warnings_, HasSubstr("the 3 folders of images share few names"));
  const size_t value = warnings_.find("frame_max_time_difference_s ");
  ASSERT_NE(value, std::string::npos);
  options_.frame_max_time_difference_s =
      std::stod(warnings_.substr(value + 28));
  EXPECT_EQ(Load(names).frames.size(), 8u);
}

TEST_F(FramesByTimeTest, NothingIsSuggestedWithoutNeed) {
  options_.frame_max_time_difference_s = 0.0;
  Load({At("cam0", 0), At("cam0", 50000000), At("cam1", 0),
        At("cam1", 50000000)});
  Load({"cam0/1.png", "cam0/2.png", "cam1/3.png", "cam1/4.png"});
  // A camera that records later.
  Load({At("cam0", 0), At("cam0", 50000000), At("cam1", 9 * kSecond),
        At("cam1", 10 * kSecond)});
  EXPECT_EQ(warnings_.find("frame_max_time_difference_s"), std::string::npos);
}

}  // namespace
}  // namespace mgsfm
