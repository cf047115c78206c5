// SPDX-License-Identifier: BSD-3-Clause
#include "evaluation/evaluation_plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <regex>

#include "evaluation/svg.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

constexpr double kWidth = 960.0;

size_t Count(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos;
       at = text.find(part, at + 1)) {
    ++count;
  }
  return count;
}

// A quarter of a circle of radius 100 m; y is down, as in cameras.
std::vector<ImagePoses> Drive(double error_m) {
  std::vector<ImagePoses> images;
  for (int i = 0; i <= 30; ++i) {
    const double angle = 0.05 * i;
    const Eigen::Vector3d center(100.0 * std::sin(angle), 0.0,
                                 100.0 * std::cos(angle));
    const Eigen::Quaterniond rotation = ExpSO3({0.0, -angle, 0.0});
    const Eigen::Vector3d off(0.0, i % 2 == 0 ? error_m : -error_m, 0.0);
    images.push_back({"cam0/" + std::to_string(i), true,
                      Rigid3::FromRotationAndCenter(rotation, center + off),
                      Rigid3::FromRotationAndCenter(rotation, center)});
  }
  return images;
}

std::string Plot(const std::vector<ImagePoses>& images) {
  return EvaluationToSvg(images, Evaluate(images, true, {}, {}));
}

// The points of all lines with a style.
std::vector<Eigen::Vector2d> PointsOfLines(const std::string& svg,
                                           const std::string& style) {
  std::vector<Eigen::Vector2d> points;
  const std::regex line("<polyline[^>]*" + style + "[^>]*points='([^']*)'");
  const std::regex point("([-0-9.]+),([-0-9.]+)");
  for (std::sregex_iterator l(svg.begin(), svg.end(), line), end; l != end;
       ++l) {
    const std::string list = (*l)[1];
    for (std::sregex_iterator p(list.begin(), list.end(), point); p != end;
         ++p) {
      points.emplace_back(std::stod((*p)[1]), std::stod((*p)[2]));
    }
  }
  return points;
}

constexpr const char* kTrueLine = "stroke='#9a9a9a'";
constexpr const char* kMissing = "stroke='#d1495b'";

// All elements are closed in the right order.
void ExpectWellFormed(const std::string& svg) {
  const std::regex tag("<(/?)([a-zA-Z]+)[^>]*?(/?)>");
  std::vector<std::string> open;
  for (std::sregex_iterator t(svg.begin(), svg.end(), tag), end; t != end;
       ++t) {
    if (!(*t)[3].str().empty()) continue;
    if ((*t)[1].str().empty()) {
      open.push_back((*t)[2]);
    } else {
      ASSERT_FALSE(open.empty());
      EXPECT_EQ(open.back(), (*t)[2].str());
      open.pop_back();
    }
  }
  EXPECT_TRUE(open.empty());
}

TEST(EvaluationPlot, ShowsThePathFromAboveToScale) {
  const std::string svg = Plot(Drive(0.1));
  ExpectWellFormed(svg);
  EXPECT_THAT(svg, HasSubstr("path from above [m]"));
  EXPECT_THAT(svg, HasSubstr("position error [m]"));
  EXPECT_THAT(svg, HasSubstr("rotation error [deg]"));
  EXPECT_THAT(svg, HasSubstr("distance driven [m]"));
  EXPECT_THAT(svg, HasSubstr("31 of 31 images registered"));
  EXPECT_EQ(Count(svg, kMissing), 2u);  // in the legend
  // The plot is a similarity of the path in top view (x to the right, z ahead),
  // so a right turn remains a right turn.
  const std::vector<Eigen::Vector2d> line = PointsOfLines(svg, kTrueLine);
  ASSERT_EQ(line.size(), 31u);
  const double step = 2.0 * 100.0 * std::sin(0.025);
  const double px_per_m = (line[1] - line[0]).norm() / step;
  for (size_t i = 1; i < line.size(); ++i) {
    EXPECT_NEAR((line[i] - line[i - 1]).norm(), px_per_m * step, 0.05);
  }
  const Eigen::Vector2d first = line[1] - line[0];
  const Eigen::Vector2d last = line[30] - line[29];
  // The page has y down: a right turn is positive.
  EXPECT_GT(first.x() * last.y() - first.y() * last.x(), 0.0);
  for (const Eigen::Vector2d& point : line) {
    EXPECT_GT(point.minCoeff(), 0.0);
    EXPECT_LT(point.x(), kWidth);
  }
}

TEST(EvaluationPlot, MarksFramesThatAreNotRegistered) {
  std::vector<ImagePoses> images = Drive(0.1);
  images[4].cam_from_model.reset();
  images[20].cam_from_model.reset();
  const std::string svg = Plot(images);
  ExpectWellFormed(svg);
  EXPECT_THAT(svg, HasSubstr("29 of 31 images registered"));
  // Two strokes per frame in the map, in both panels and in the legend.
  EXPECT_EQ(Count(svg, kMissing), 2u * 3 * 2 + 2);
}

TEST(EvaluationPlot, AFrameThatFlewAwayDoesNotHideTheOthers) {
  std::vector<ImagePoses> images = Drive(0.1);
  images[7].cam_from_model->translation += Eigen::Vector3d(1e6, 0.0, 0.0);
  const std::string svg = Plot(images);
  EXPECT_THAT(svg, HasSubstr("beyond the axis"));
  EXPECT_EQ(PointsOfLines(svg, kTrueLine),
            PointsOfLines(Plot(Drive(0.1)), kTrueLine));
}

TEST(EvaluationPlot, SequencesFarApartAreNotJoined) {
  std::vector<ImagePoses> images = Drive(0.1);
  EXPECT_EQ(Count(Plot(images), "<polyline"), 4u);
  for (const ImagePoses& image : Drive(0.1)) {
    images.push_back(image);
    for (Rigid3* pose :
         {&*images.back().cam_from_model, &images.back().cam_from_world}) {
      *pose = Rigid3::FromRotationAndCenter(
          pose->rotation, pose->Center() + Eigen::Vector3d(0.0, 0.0, 900.0));
    }
  }
  EXPECT_EQ(Count(Plot(images), "<polyline"), 8u);
}

TEST(EvaluationPlot, PathsOfOnePointOrNoneAreDrawn) {
  std::vector<ImagePoses> images = Drive(0.0);
  for (const size_t size : {2u, 1u, 0u}) {
    images.resize(size);
    const std::string svg = Plot(images);
    ExpectWellFormed(svg);
    EXPECT_THAT(svg, Not(HasSubstr("nan")));
    EXPECT_THAT(svg, Not(HasSubstr("inf")));
  }
  std::vector<ImagePoses> standing(5, Drive(0.0)[0]);
  EXPECT_THAT(Plot(standing), Not(HasSubstr("nan")));
}

TEST(SvgDrawing, EscapesTextAndClosesWhatItOpens) {
  SvgDrawing drawing(10.0, 20.0);
  drawing.BeginClip({1.0, 2.0}, {3.0, 4.0});
  drawing.Text({0.0, 0.0}, "a < b & c > d");
  drawing.EndClip();
  const std::string svg = drawing.ToString();
  ExpectWellFormed(svg);
  EXPECT_THAT(svg, HasSubstr("a &lt; b &amp; c &gt; d"));
}

TEST(FormatNumber, HasNoUselessDigits) {
  EXPECT_EQ(FormatNumber(1.50, 3), "1.5");
  EXPECT_EQ(FormatNumber(200.0, 2), "200");
  EXPECT_EQ(FormatNumber(-0.0001, 2), "0");
  EXPECT_EQ(FormatNumber(-3.25, 1), "-3.2");
  EXPECT_EQ(FormatNumber(100.0, 0), "100");
}

TEST(MakeTicks, AreRoundNumbersWithinTheRange) {
  EXPECT_THAT(MakeTicks(0.0, 10.0, 5).values, ElementsAre(0, 2, 4, 6, 8, 10));
  EXPECT_THAT(MakeTicks(-0.07, 0.12, 4).values,
              ElementsAre(DoubleNear(-0.05, 1e-12), DoubleNear(0.0, 1e-12),
                          DoubleNear(0.05, 1e-12), DoubleNear(0.1, 1e-12)));
  EXPECT_EQ(MakeTicks(-0.07, 0.12, 4).digits, 2);
  for (const double range : {1e-6, 0.3, 7.0, 99.0, 1234567.0}) {
    const Ticks ticks = MakeTicks(0.0, range, 6);
    EXPECT_GE(ticks.values.size(), 3u) << range;
    EXPECT_LE(ticks.values.size(), 8u) << range;
  }
}

}  // namespace
}  // namespace mgsfm
