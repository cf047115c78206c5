// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/report_page/report_page.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <regex>

#include "mgsfm/simulator/simulation.h"
#include "report_page/page_model.h"
#include "report_page/page_selection.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using Json = nlohmann::json;

Simulation SmallDrive() {
  SimulationOptions options;
  options.num_frames = 12;
  return Simulate(options);
}

std::string Page(const Simulation& drive, const std::string& report = "",
                 const Context& context = {}) {
  ReportPageInput input{"drive", drive.scene, drive.ground_truth};
  input.view_graph = &drive.view_graph;
  input.report_json = report;
  return MakeReportPage(input, {}, context);
}

// The header of the 3D view.
Json Header(const std::string& page) {
  const std::string begin = "id=\"header\">";
  const size_t at = page.find(begin) + begin.size();
  return Json::parse(page.substr(at, page.find("</script>", at) - at));
}

// The page of a model of somebody else must not show other files.
TEST(Thumbnails, ShowNoFileOutsideOfTheFolder) {
  const TempDir dir;
  Simulation drive = SmallDrive();
  const std::string file = "P5 64 48 255\n" + std::string(64 * 48, 'a');
  std::filesystem::create_directories(dir.path() / "images" / "a");
  WriteTextFile(dir.path() / "secret.pgm", file);
  WriteTextFile(dir.path() / "images" / "a" / "own.pgm", file);
  for (Image& image : drive.scene.images) image.name = "missing";
  drive.scene.images[0].name = "../secret.pgm";
  drive.scene.images[1].name = "a/../../secret.pgm";
  drive.scene.images[2].name = (dir.path() / "secret.pgm").string();
  drive.scene.images[3].name = "a/own.pgm";
  drive.scene.frames.erase(drive.scene.frames.begin() + 1,
                           drive.scene.frames.end());
  drive.scene.frames[0].image_idxs = {0, 1, 2, 3};
  const std::vector<Thumbnail> thumbnails = MakeThumbnails(
      drive.scene, (dir.path() / "images").string(), 100'000, {});
  ASSERT_EQ(thumbnails.size(), 1u);
  EXPECT_EQ(thumbnails[0].image_idx, 3);
}

// A small file that states 4 billion pixels is not decoded, and decoders print
// nothing.
TEST(Thumbnails, HaveABudgetOfPixels) {
  const TempDir dir;
  Simulation drive = SmallDrive();
  drive.scene.images.erase(drive.scene.images.begin() + 3,
                           drive.scene.images.end());
  drive.scene.frames.erase(drive.scene.frames.begin() + 1,
                           drive.scene.frames.end());
  drive.scene.frames[0].image_idxs = {0, 1, 2};
  const std::string files[] = {"P5 64 48 255\n" + std::string(64 * 48, 'a'),
                               "P5 65536 65536 255\n123", "P5 64 48 255\n1"};
  for (int i = 0; i < 3; ++i) {
    drive.scene.images[i].name = std::to_string(i) + ".pgm";
    WriteTextFile(dir.path() / drive.scene.images[i].name, files[i]);
  }
  testing::internal::CaptureStderr();
  const std::vector<Thumbnail> thumbnails =
      MakeThumbnails(drive.scene, dir.path().string(), 100'000, {});
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  ASSERT_EQ(thumbnails.size(), 1u);
  EXPECT_EQ(thumbnails[0].image_idx, 0);
  EXPECT_EQ(thumbnails[0].jpeg.substr(0, 2), "\xff\xd8");
}

TEST(Statistics, AreThoseOfProjectionsOneByOne) {
  Simulation drive = SmallDrive();
  const Reconstruction& model = drive.ground_truth;
  // Known residuals: all keypoints of one image are moved.
  const Eigen::Vector2f shift_px(0.6f, -0.8f);
  for (auto& keypoint_px : drive.scene.images[5].keypoints_px) {
    keypoint_px -= shift_px;
  }
  const Projector projector(drive.scene, model);
  const PageStatistics statistics =
      ComputeStatistics(drive.scene, model, projector, {});
  size_t num_observations = 0;
  std::vector<size_t> num_points(drive.scene.images.size());
  for (const Point3D& point : model.points) {
    num_observations += point.track.size();
    for (const Observation& o : point.track) ++num_points[o.image_idx];
  }
  EXPECT_EQ(statistics.num_observations, num_observations);
  EXPECT_EQ(statistics.num_registered_images, drive.scene.images.size());
  for (size_t i = 0; i < num_points.size(); ++i) {
    EXPECT_EQ(statistics.images[i].num_points, num_points[i]);
    if (num_points[i] == 0) continue;
    // Keypoints are stored in single precision.
    EXPECT_NEAR(*statistics.images[i].MeanErrorPx(), i == 5 ? 1.0 : 0.0, 1e-3);
  }
  const int shifted = drive.scene.images[5].sensor_idx;
  ImageCell sum;
  for (const ImageCell& cell : statistics.sensors[shifted].cells) {
    sum.num_residuals += cell.num_residuals;
    sum.sum_residuals_px += cell.sum_residuals_px;
  }
  EXPECT_EQ(sum.num_residuals, statistics.sensors[shifted].errors.num_points);
  EXPECT_NEAR(
      (sum.sum_residuals_px / num_points[5] - shift_px.cast<double>()).norm(),
      0.0, 1e-3);
  EXPECT_EQ(statistics.sensors[shifted].error_histogram[9] +
                statistics.sensors[shifted].error_histogram[10],
            num_points[5]);
}

TEST(ReportPage, DoesNotDependOnThreads) {
  const Simulation drive = SmallDrive();
  Context three;
  three.num_threads = 3;
  EXPECT_EQ(Page(drive), Page(drive, "", three));
}

TEST(ReportPage, StatesWarningsOfTheReportFirst) {
  const Simulation drive = SmallDrive();
  const std::string page = Page(drive, R"({
    "warnings": ["wheels <b>fell</b> off",
                 {"message": "too dark", "remedy": "switch on the light"}],
    "summary": {"num_seams": 3},
    "models": [{"rejected_groups": [{"num_pairs": 4}], "seconds": {"abc": 1}}],
    "unregistered_frames": [{"name": "f</td>", "reason": "no match"}]})");
  EXPECT_THAT(page,
              AllOf(HasSubstr("wheels &lt;b&gt;fell&lt;/b&gt; off"),
                    HasSubstr("too dark"), HasSubstr("switch on the light"),
                    HasSubstr("num seams"), HasSubstr("abc"),
                    HasSubstr("f&lt;/td&gt;"), Not(HasSubstr("No warning"))));
  EXPECT_LT(page.find("too dark"), page.find("id=\"view\""));
  EXPECT_THAT(Page(drive), HasSubstr("No warning"));
}

// A model that is right opens calmly, whatever else the report has.
TEST(ReportPage, InformationIsNoWarning) {
  Simulation drive = SmallDrive();
  drive.ground_truth.rig_from_world[3].reset();
  EXPECT_THAT(Page(drive, R"({"models": [{"rejected_groups": [{}, {}],
                              "seams": [{}]}]})"),
              AllOf(HasSubstr("No warning"),
                    HasSubstr("1 frames are <a href=\"#missing\">"),
                    HasSubstr("2 groups of image pairs contradict"),
                    HasSubstr("1 <a href=\"#seams\">")));
}

TEST(ReportPage, WarningsAreThoseOfTheModelByCause) {
  Simulation drive = SmallDrive();
  drive.ground_truth.rig_from_world[3].reset();
  Json warnings = Json::array();
  const auto add = [&](size_t frame_idx, const std::string& text) {
    const std::string& name = drive.scene.frames[frame_idx].name;
    warnings.push_back(
        {{"cause", "rig_moved"}, {"frames", {name, name}}, {"text", text}});
  };
  add(3, "of another model");
  add(4, "first of this one");
  add(5, "second of this one");
  const std::string page = Page(drive, Json({{"warnings", warnings}}).dump());
  EXPECT_THAT(
      page,
      AllOf(Not(HasSubstr("of another model")), HasSubstr("first of this one"),
            HasSubstr("1 more of this cause"),
            HasSubstr("data-frame=\"" + drive.scene.frames[4].name)));
}

TEST(ReportPage, LengthsHaveTheUnitOfTheSummary) {
  const Simulation drive = SmallDrive();
  const auto page = [&](const std::string& unit) {
    return Page(drive, R"({"summary": {"models": [{"unit_of_length": ")" +
                           unit + R"("}]}})");
  };
  EXPECT_THAT(page("metric, that of the known rig"),
              AllOf(HasSubstr("center in the rig [m]"),
                    Not(HasSubstr("center in the rig [units]"))));
  for (const std::string& arbitrary : {page("arbitrary scale"), Page(drive)}) {
    EXPECT_THAT(arbitrary, AllOf(HasSubstr("center in the rig [units]"),
                                 Not(HasSubstr("in the rig [m]"))));
  }
}

TEST(ReportPage, IgnoresReportsOfOtherKinds) {
  const Simulation drive = SmallDrive();
  int num_warnings = 0;
  Context context;
  context.log = [&](LogLevel level, const std::string&) {
    num_warnings += level == LogLevel::kWarning ? 1 : 0;
  };
  EXPECT_THAT(Page(drive, "{ no json", context), HasSubstr("</html>"));
  EXPECT_EQ(num_warnings, 1);
  for (const char* report :
       {R"({"models": 3, "warnings": {"a": 1}, "summary": [1]})",
        R"({"models": [[]], "seconds": {"a": "b"}, "input": null})",
        R"({"models": [{"rigs": [{"sensors": [{"sigma": 1}, 2]}],
            "rejected_groups": [1, {"frames1": ["a"]}]}],
            "unregistered_frames": [null, {"name": 1}]})"}) {
    EXPECT_THAT(Page(drive, report), HasSubstr("</html>"));
  }
  EXPECT_EQ(num_warnings, 1);
  // Other versions: only newer and unreadable ones are worth a warning.
  Page(drive, R"({"mgsfm_version": "0.0.1"})", context);
  EXPECT_EQ(num_warnings, 1);
  Page(drive, R"({"mgsfm_version": "1000.0.0"})", context);
  Page(drive, R"({"mgsfm_version": "new"})", context);
  EXPECT_EQ(num_warnings, 3);
}

TEST(ReportPage, ListsAllFramesAndImages) {
  Simulation drive = SmallDrive();
  drive.ground_truth.rig_from_world[3].reset();
  const Json header = Header(Page(drive));
  EXPECT_EQ(header["frame_names"].size(), 2 * drive.scene.frames.size());
  EXPECT_EQ(header["image_names"].size(), 2 * drive.scene.images.size());
  EXPECT_EQ(header["num_points"], drive.ground_truth.points.size());
  EXPECT_THAT(header["arrays"]["frame_center"],
              ElementsAre("f32", testing::_, 3 * drive.scene.frames.size()));
}

TEST(ReportPage, ThinsOutFramesOfVeryManyImages) {
  Scene scene;
  constexpr int kNumFrames = 200'000;
  scene.cameras.push_back({CameraId(1),
                           CameraModelId::kSimplePinhole,
                           640,
                           480,
                           {500.0, 320.0, 240.0},
                           true});
  scene.rigs.push_back({RigId(1), 0, {0}});
  scene.sensors.push_back({"", 0, 0, Rigid3()});
  Reconstruction model;
  model.cameras = scene.cameras;
  model.sensor_from_rig = {Rigid3()};
  for (int i = 0; i < kNumFrames; ++i) {
    const std::string name = "a_rather_long_name_of_an_image_" +
                             std::to_string(1'000'000 + i) + ".png";
    scene.frames.push_back({FrameId(i + 1), name, 0, {i}});
    scene.images.push_back({ImageId(i + 1), name, 0, 0, i, {}});
    model.rig_from_world.emplace_back(Rigid3::FromRotationAndCenter(
        Eigen::Quaterniond::Identity(), {0.0, 0.0, 1.0 * i}));
  }
  const std::string page =
      MakeReportPage({"many images", scene, model}, {}, {});
  EXPECT_LE(page.size(), ReportPageOptions().max_bytes);
  const Json header = Header(page);
  const size_t step = header["frame_step"];
  EXPECT_GT(step, 1u);
  EXPECT_EQ(header["frame_names"].size(), 2 * ((kNumFrames - 1) / step + 1));
}

}  // namespace
}  // namespace mgsfm
