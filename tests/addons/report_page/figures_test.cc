// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/report_page/figures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <regex>

#include "mgsfm/simulator/simulation.h"
#include "report_page/chart_parts.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

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
