// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/report_page/figures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <regex>

#include "eval/svg.h"
#include "mgsfm/synthetic/simulation.h"
#include "report_page/chart_parts.h"
#include "report_page/label_placement.h"
#include "report_page/svg_raster.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

cv::Mat Decode(const std::string& png) {
  const std::vector<uint8_t> bytes(png.begin(), png.end());
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

// The colour as 0xrrggbb.
int ColorAt(const cv::Mat& image, double x, double y) {
  const auto& bgr =
      image.at<cv::Vec3b>(static_cast<int>(y), static_cast<int>(x));
  return bgr[2] << 16 | bgr[1] << 8 | bgr[0];
}

TEST(SvgRaster, DrawsAllElements) {
  SvgDrawing drawing(100.0, 60.0);
  drawing.Box({10.0, 10.0}, {10.0, 10.0}, "fill='#ff0000'");
  drawing.Frame({30.0, 10.0}, {10.0, 10.0},
                "stroke='#00ff00' stroke-width='2'");
  drawing.Dot({55.0, 15.0}, 5.0, "fill='#0000ff'");
  drawing.Line({70.0, 15.0}, {90.0, 15.0}, "stroke='#888' stroke-width='4'");
  drawing.Path({{70.0, 25.0}, {90.0, 25.0}},
               "stroke='#f0f' stroke-width='4' stroke-dasharray='6 6'");
  drawing.Ellipse({20.0, 45.0}, {12.0, 3.0}, 90.0,
                  "fill='#000000' fill-opacity='0.5'");
  drawing.BeginClip({40.0, 30.0}, {10.0, 20.0});
  drawing.Box({35.0, 35.0}, {30.0, 10.0}, "fill='#00ffff'");
  drawing.EndClip();
  drawing.Pixels({70.0, 35.0}, {20.0, 20.0},
                 PngUrl(2, 2,
                        {255, 0, 0, 255, 0, 255, 0, 255,  //
                         0, 0, 255, 255, 0, 0, 0, 0}));
  const cv::Mat image = Decode(RasterizeSvg(drawing.ToString(), 3.0));
  ASSERT_EQ(image.cols, 300);
  ASSERT_EQ(image.rows, 180);
  const auto color = [&](double x, double y) {
    return ColorAt(image, 3.0 * x, 3.0 * y);
  };
  EXPECT_EQ(color(5, 5), 0xffffff);
  EXPECT_EQ(color(15, 15), 0xff0000);
  EXPECT_EQ(color(30, 15), 0x00ff00);
  EXPECT_EQ(color(35, 15), 0xffffff);
  EXPECT_EQ(color(55, 15), 0x0000ff);
  EXPECT_EQ(color(58, 15), 0x0000ff);
  EXPECT_EQ(color(61.5, 15), 0xffffff);
  EXPECT_EQ(color(80, 15), 0x888888);
  EXPECT_EQ(color(80, 18.5), 0xffffff);
  EXPECT_EQ(color(73, 25), 0xff00ff);
  EXPECT_EQ(color(79.5, 25), 0xffffff);
  // Upright, half transparent.
  EXPECT_NEAR(color(20, 55) & 0xff, 0x80, 1);
  EXPECT_EQ(color(28, 45), 0xffffff);
  EXPECT_EQ(color(45, 40), 0x00ffff);
  EXPECT_EQ(color(37, 40), 0xffffff);
  EXPECT_EQ(color(55, 40), 0xffffff);
  EXPECT_EQ(color(75, 40), 0xff0000);
  EXPECT_EQ(color(85, 40), 0x00ff00);
  EXPECT_EQ(color(75, 50), 0x0000ff);
  EXPECT_EQ(color(85, 50), 0xffffff);
}

// Dark pixels in a part of the drawing.
int Ink(const cv::Mat& image, const cv::Rect& part) {
  cv::Mat dark;
  cv::inRange(image(part), cv::Scalar(0, 0, 0), cv::Scalar(127, 127, 127),
              dark);
  return cv::countNonZero(dark);
}

TEST(SvgRaster, TextIsAnchored) {
  for (const char* anchor : {"", "text-anchor='middle'", "text-anchor='end'"}) {
    SvgDrawing drawing(200.0, 30.0);
    drawing.Text({100.0, 20.0}, "<a&b>", anchor);
    const cv::Mat image = Decode(RasterizeSvg(drawing.ToString(), 2.0));
    const int left = Ink(image, {0, 0, 198, 60});
    const int right = Ink(image, {202, 0, 198, 60});
    EXPECT_EQ(left > 0, *anchor != 0);
    EXPECT_EQ(right > 0, anchor != std::string("text-anchor='end'"));
  }
  // One character that is not ASCII is one character.
  SvgDrawing two(100.0, 30.0), question(100.0, 30.0);
  two.Text({10.0, 20.0}, "\xc3\xa4");
  question.Text({10.0, 20.0}, "?");
  EXPECT_EQ(RasterizeSvg(two.ToString(), 2.0),
            RasterizeSvg(question.ToString(), 2.0));
}

class Figures : public testing::Test {
 protected:
  Figures() {
    SimulationOptions options;
    options.rig = RigPreset::kStereo;
    options.num_frames = 20;
    drive_ = Simulate(options);
  }
  std::vector<Figure> Make(const Context& context = {}) const {
    ReportPageInput input{"drive", drive_.scene, drive_.ground_truth};
    input.view_graph = &drive_.view_graph;
    return MakeFigures(input, context);
  }

  Simulation drive_{};
};

TEST_F(Figures, AreThoseOfTheModel) {
  Context three;
  three.num_threads = 3;
  const std::vector<Figure> figures = Make(), same = Make(three);
  std::vector<std::string> names;
  for (size_t i = 0; i < figures.size(); ++i) {
    names.push_back(figures[i].name);
    EXPECT_EQ(figures[i].svg, same[i].svg);
    const cv::Mat image = Decode(FigureToPng(figures[i], 2.0));
    std::smatch size;
    ASSERT_TRUE(
        std::regex_search(figures[i].svg, size,
                          std::regex("width='([0-9.]+)' height='([0-9.]+)'")));
    EXPECT_NEAR(image.cols, 2.0 * std::stod(size[1]), 1.0);
    EXPECT_NEAR(image.rows, 2.0 * std::stod(size[2]), 1.0);
  }
  EXPECT_THAT(names, testing::ElementsAre("trajectory", "rig", "residuals",
                                          "view_graph"));
}

// Distances on the page are those of the drive, up to one scale.
TEST_F(Figures, TrajectoriesAreToScale) {
  const std::string svg = Make().front().svg;
  std::smatch line;
  ASSERT_TRUE(
      std::regex_search(svg, line, std::regex("<polyline.*points='([^']*)'")));
  std::string text = line[1];
  std::replace(text.begin(), text.end(), ',', ' ');
  std::istringstream numbers(text);
  std::vector<Eigen::Vector2d> path;
  for (double x = 0.0, y = 0.0; numbers >> x >> y;) path.emplace_back(x, y);
  ASSERT_EQ(path.size(), drive_.scene.frames.size());
  const auto center = [&](size_t i) {
    return drive_.ground_truth.rig_from_world[i]->Center();
  };
  const double px_per_m = (path.back() - path.front()).norm() /
                          (center(path.size() - 1) - center(0)).norm();
  EXPECT_LT(path.front().x(), path.back().x());
  for (size_t i = 1; i < path.size(); ++i) {
    // The drive is flat; pixels have two decimals.
    EXPECT_NEAR((path[i] - path.front()).norm(),
                px_per_m * (center(i) - center(0)).norm(), 0.05);
  }
}

TEST_F(Figures, OfAnEmptyModelDoNotExist) {
  for (auto& pose : drive_.ground_truth.rig_from_world) pose.reset();
  drive_.ground_truth.points.clear();
  for (const Figure& figure : Make()) {
    EXPECT_NE(figure.name, "trajectory");
    EXPECT_NE(figure.name, "residuals");
  }
}

// The boxes of the texts in a drawing, by text.
std::vector<std::pair<std::string, Eigen::AlignedBox2d>> TextBoxes(
    const std::string& svg) {
  const std::regex element("<text x='([^']*)' y='([^']*)'[^>]*>([^<]*)</text>");
  std::vector<std::pair<std::string, Eigen::AlignedBox2d>> boxes;
  for (auto found = std::sregex_iterator(svg.begin(), svg.end(), element);
       found != std::sregex_iterator(); ++found) {
    const Eigen::Vector2d middle(std::stod((*found)[1]),
                                 std::stod((*found)[2]) - 4.0);
    const Eigen::Vector2d size = LabelPlacement::SizeOf((*found)[3]);
    boxes.emplace_back(
        (*found)[3],
        Eigen::AlignedBox2d(middle - 0.5 * size + Eigen::Vector2d(0.1, 0.1),
                            middle + 0.5 * size - Eigen::Vector2d(0.1, 0.1)));
  }
  return boxes;
}

// Cameras of a helmet: close together, and one behind the other from above.
TEST(RigFigure, LabelsDoNotOverlap) {
  SimulationOptions options;
  options.num_frames = 4;
  options.rig = RigPreset::kKitti360;
  Simulation drive = Simulate(options);
  for (size_t i = 0; i < drive.scene.sensors.size(); ++i) {
    drive.scene.sensors[i].name = "camera_number_" + std::to_string(i);
    auto& pose = drive.ground_truth.sensor_from_rig[i];
    const Eigen::Vector3d center(0.02 * static_cast<double>(i), 0.0, 0.0);
    pose = Rigid3::FromRotationAndCenter(pose->rotation, center);
  }
  for (const Figure& figure :
       MakeFigures({"", drive.scene, drive.ground_truth}, {})) {
    if (figure.name != "rig") continue;
    std::vector<Eigen::AlignedBox2d> labels;
    for (const auto& [text, box] : TextBoxes(figure.svg)) {
      if (text.find("camera_number") == 0) labels.push_back(box);
    }
    ASSERT_EQ(labels.size(), 2 * drive.scene.sensors.size());
    for (size_t i = 0; i < labels.size(); ++i) {
      for (size_t k = 0; k < i; ++k) {
        EXPECT_FALSE(labels[i].intersects(labels[k])) << i << " " << k;
      }
    }
    // The report does not state a unit.
    EXPECT_THAT(figure.svg, HasSubstr(" unit"));
    return;
  }
  ADD_FAILURE() << "no figure of the rig";
}

}  // namespace
}  // namespace mgsfm
