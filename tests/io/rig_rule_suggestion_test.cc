// SPDX-License-Identifier: BSD-3-Clause
// The rule that the log proposes for images without a rig.
#include <gtest/gtest.h>

#include <cstdio>

#include "io/test_database.h"
#include "mgsfm/models/scene_loading.h"
#include "rigs/rig_inference.h"
#include "support/error_of.h"
#include "support/shared_data.h"

namespace mgsfm {
namespace {

// What the log says about images of these names.
std::string LogOf(const std::vector<std::string>& names) {
  std::string log;
  Context context;
  context.log = [&log](LogLevel level, const std::string& message) {
    if (level != LogLevel::kDebug) log += message + '\n';
  };
  (void)LoadScene(MakeContents(names), {}, context);
  return log;
}

// A folder per frame, whose files are called like cameras, is no camera.
TEST(RuleSuggestionTest, FoldersOfFramesAreNoCameras) {
  const auto names_of = [](int num_frames) {
    std::vector<std::string> names;
    for (int frame = 0; frame < num_frames; ++frame) {
      for (const char* camera : {"left", "right"}) {
        names.push_back(std::to_string(1000 + frame) + '/' + camera + ".jpg");
      }
    }
    return names;
  };
  for (const int num_frames : {3, 40}) {
    const std::string error = ErrorOf([&] { LogOf(names_of(num_frames)); });
    const size_t begin = error.find("rig_name_rule '");
    ASSERT_NE(begin, std::string::npos) << error;
    const size_t rule = begin + std::string("rig_name_rule '").size();
    const Scene scene =
        LoadScene(MakeContents(names_of(num_frames)),
                  LoadingBy(error.substr(rule, error.find('\'', rule) - rule)),
                  Context())
            .scene;
    EXPECT_EQ(scene.frames.size(), static_cast<size_t>(num_frames));
    EXPECT_EQ(scene.sensors.size(), 2u);
  }
}

// The rule in the log makes frames of all cameras.
TEST(RuleSuggestionTest, FlatFoldersGetARuleThatFits) {
  using Name = std::string (*)(const std::string& camera, int frame);
  static const auto kNumber = [](int f) {
    return std::to_string(1000 + 3 * f);
  };
  const std::vector<std::pair<std::vector<std::string>, Name>> cases = {
      {{"left", "right"},
       [](const std::string& c, int f) {
         return c + "_" + kNumber(f) + ".jpg";
       }},
      {{"cam1", "cam2", "cam10"},
       [](const std::string& c, int f) {
         return "IMG_" + kNumber(f) + "_" + c + ".jpg";
       }},
      {{"L", "R"},
       [](const std::string& c, int f) { return kNumber(f) + c + ".png"; }},
      {{"a", "b"}, [](const std::string& c, int f) {
         return "images/" + kNumber(f) + "-" + c + ".png";
       }}};
  for (const auto& [cameras, name_of] : cases) {
    std::vector<std::string> names;
    for (int frame = 0; frame < 9; ++frame) {
      for (const std::string& camera : cameras) {
        names.push_back(name_of(camera, frame));
      }
    }
    const std::string log = LogOf(names);
    const size_t begin = log.find("rig_name_rule '");
    ASSERT_NE(begin, std::string::npos) << names[0] << "\n" << log;
    const size_t rule = begin + std::string("rig_name_rule '").size();
    const Scene scene =
        LoadScene(MakeContents(names),
                  LoadingBy(log.substr(rule, log.find('\'', rule) - rule)),
                  Context())
            .scene;
    EXPECT_EQ(scene.frames.size(), 9u) << log;
    EXPECT_EQ(scene.sensors.size(), cameras.size()) << log;
  }
}

using Names = std::vector<std::string>;

// Four cameras, told apart at two positions, in 12 frames.
Names NamesOfFourCameras() {
  Names names;
  for (int frame = 10; frame < 22; ++frame) {
    for (const char* end : {"front", "rear"}) {
      for (const char* side : {"left", "right"}) {
        names.push_back(std::string(end) + '_' + side + '_' +
                        std::to_string(frame) + ".jpg");
      }
    }
  }
  return names;
}

// Names of `cameras`, where '*' stands for the camera and '#' for the frame.
Names NamesLike(const std::string& pattern, const Names& cameras) {
  Names names;
  for (int frame = 100; frame < 120; ++frame) {
    for (const std::string& camera : cameras) {
      std::string name = pattern;
      name.replace(name.find('*'), 1, camera);
      name.replace(name.find('#'), 1, std::to_string(frame));
      names.push_back(name);
    }
  }
  return names;
}

TEST(AutoRuleTest, PrefixesInfixesAndSuffixesOfOneFolderAreCameras) {
  for (const char* pattern : {"*_#.jpg", "#_*.jpg", "trip_*_#.jpg",
                              "all/#*.jpg", "trip-#-*-raw.jpg"}) {
    for (const Names& cameras : {Names{"left", "right"}, Names{"L", "R"},
                                 Names{"cam1", "cam2", "cam10"}}) {
      SCOPED_TRACE(pattern + cameras[0]);
      const Names names = NamesLike(pattern, cameras);
      const Scene scene = LoadScene(MakeContents(names), {}, Context()).scene;
      EXPECT_EQ(scene.rigs.size(), 1u);
      EXPECT_EQ(scene.sensors.size(), cameras.size());
      EXPECT_EQ(scene.frames.size(), 20u);
      const Scene single =
          LoadScene(MakeContents(names), LoadingBy("none"), Context()).scene;
      EXPECT_EQ(single.frames.size(), names.size());
    }
  }
}

TEST(AutoRuleTest, SeveralPositionsAreAnErrorWithTheRulesToPaste) {
  const Names names = NamesOfFourCameras();
  const std::string error = ErrorOf([&] { LogOf(names); });
  std::vector<size_t> num_frames;
  for (size_t begin = error.find("'("); begin != std::string::npos;
       begin = error.find("'(", begin + 1)) {
    const size_t end = error.find('\'', begin + 1);
    const std::string rule = error.substr(begin + 1, end - begin - 1);
    num_frames.push_back(
        LoadScene(MakeContents(names), LoadingBy(rule), Context())
            .scene.frames.size());
  }
  const size_t second = error.find("'.*");
  ASSERT_NE(second, std::string::npos) << error;
  EXPECT_EQ(num_frames, (std::vector<size_t>{12, 24})) << error;
  const std::string rule =
      error.substr(second + 1, error.find('\'', second + 1) - second - 1);
  EXPECT_EQ(LoadScene(MakeContents(names), LoadingBy(rule), Context())
                .scene.frames.size(),
            24u);
}

TEST(AutoRuleTest, IncompletePairsAndSizesThatDifferAreSuggestedOnly) {
  Names names = NamesLike("*_#.jpg", {"left", "right"});
  for (int i = 0; i < 4; ++i) names.erase(names.begin() + 5 * i);
  EXPECT_NE(LogOf(names).find("if these are mounted"), std::string::npos);
  DatabaseContents contents =
      MakeContents(NamesLike("*_#.jpg", {"left", "right"}));
  EXPECT_EQ(LoadScene(contents, {}, Context()).scene.frames.size(), 20u);
  Camera other = contents.cameras[0];
  other.id = CameraId(99);
  ++other.width_px;
  contents.cameras.push_back(other);
  contents.images[3].camera_id = other.id;
  EXPECT_EQ(LoadScene(contents, {}, Context()).scene.frames.size(), 40u);
}

// Counters that pair, but no text that means a camera.
TEST(AutoRuleTest, TextsWithoutMeaningAreSuggestedOnly) {
  const Names a_few = {"cam1.jpg", "cam2.jpg", "cam3.jpg", "cam4.jpg"};
  for (const Names& names :
       {NamesLike("#_*.jpg", {"a", "b"}), NamesLike("#_*.jpg", {"1", "2"}),
        NamesLike("*_#.jpg", {"image1", "image2"}), a_few}) {
    EXPECT_NE(LogOf(names).find("rig_name_rule '"), std::string::npos);
    EXPECT_EQ(LoadScene(MakeContents(names), {}, Context()).scene.frames.size(),
              names.size())
        << names[0];
  }
}

TEST(AutoRuleTest, FramesByTimeNeedNoRule) {
  Names names;
  for (int frame = 0; frame < 20; ++frame) {
    const int64_t time_ns = 1403636579763555584 + int64_t{50000000} * frame;
    names.push_back("left_" + std::to_string(time_ns) + ".png");
    names.push_back("right_" + std::to_string(time_ns + 3000 + 7 * frame) +
                    ".png");
  }
  SceneLoadingOptions options;
  options.frame_max_time_difference_s = 0.01;
  const Scene scene = LoadScene(MakeContents(names), options, Context()).scene;
  EXPECT_EQ(scene.sensors.size(), 2u);
  EXPECT_EQ(scene.frames.size(), 20u);
}

TEST(RuleSuggestionTest, NamesOfOneCameraGetNone) {
  for (const char* format : {"%04d.png", "IMG_%d.jpg", "2024_%03d_x.png"}) {
    std::vector<std::string> names;
    for (int frame = 0; frame < 40; ++frame) {
      char name[40];
      std::snprintf(name, sizeof(name), format, frame);
      names.emplace_back(name);
    }
    EXPECT_EQ(LogOf(names).find("rig_name_rule"), std::string::npos) << format;
  }
  EXPECT_EQ(LogOf({"cam0/0.png", "cam0/1.png", "cam1/0.png", "cam1/1.png"})
                .find("rig_name_rule"),
            std::string::npos);
}

TEST(RealDataTest, Kitti06IsOneStereoRig) {
  const auto data = FindSharedData("kitti06_stereo");
  if (!data) GTEST_SKIP() << "no kitti06_stereo; see shared_data.h";
  const LoadedScene loaded =
      LoadScene((*data / "database.db").string(), {}, Context());
  ASSERT_EQ(loaded.scene.rigs.size(), 1u);
  ASSERT_EQ(loaded.scene.sensors.size(), 2u);
  EXPECT_EQ(loaded.scene.sensors[0].name, "cam0");
  EXPECT_EQ(loaded.scene.sensors[1].name, "cam1");
  EXPECT_EQ(loaded.scene.frames.size(), 51u);
  EXPECT_EQ(loaded.scene.images.size(), 102u);
  EXPECT_EQ(loaded.view_graph.pairs.size(), 1159u);
}

}  // namespace
}  // namespace mgsfm
