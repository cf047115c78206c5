// SPDX-License-Identifier: BSD-3-Clause
// Commands with the poses of a body that carries the cameras of the demo.
#include <algorithm>
#include <sstream>

#include "cli/program_runs.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/trajectory_io.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

class BodyCommands : public CommandTest {
 protected:
  BodyCommands() {
    WriteTextFile(Path("body.yaml"),
                  "cam0: {T_cam_imu: [[0, -1, 0, 0.3], [0, 0, -1, 1.0], "
                  "[1, 0, 0, -1.5], [0, 0, 0, 1]]}\n");
    for (const ModelImage& image : ReadModelPoses(DemoTruth()).images) {
      if (image.name[3] == '0') images_.push_back(image);
    }
    std::sort(images_.begin(), images_.end(),
              [](const auto& a, const auto& b) { return a.name < b.name; });
  }
  std::vector<Rigid3> Export(const std::string& model) const {
    Run("model_converter --input_path " + model + " --output_path " +
        Path("imu.txt") + " --output_type kitti --body_calibration " +
        Path("body.yaml"));
    return ReadKittiPoses(Path("imu.txt"));
  }
  // The distance of the exported body from the truth.
  double MaxError(const std::string& model) const {
    const std::vector<Rigid3> poses = Export(model);
    EXPECT_EQ(poses.size(), images_.size());
    double most = 0.0;
    for (size_t i = 0; i < poses.size(); ++i) {
      most = std::max(most, (poses[i].Center() - BodyOf(images_[i])).norm());
    }
    return most;
  }
  static Vector3d BodyOf(const ModelImage& image) {
    return image.cam_from_world.Inverse() * Vector3d(0.3, 1.0, -1.5);
  }
  void WritePositions(const std::string& name) const {
    std::ostringstream lines;
    lines.precision(17);
    for (const ModelImage& image : images_) {
      lines << image.name << ' ' << BodyOf(image).transpose() << '\n';
    }
    WriteTextFile(Path(name), lines.str());
  }

  std::vector<ModelImage> images_;  // of the reference camera
};

TEST_F(BodyCommands, TheBodyIsExported) {
  EXPECT_LT(MaxError(DemoTruth()), 1e-6);
  // Forward in the body is forward in the camera.
  const Rigid3 body_from_world = Export(DemoTruth()).front();
  EXPECT_LT(
      (body_from_world.rotation.conjugate() * Vector3d::UnitX() -
       images_.front().cam_from_world.rotation.conjugate() * Vector3d::UnitZ())
          .norm(),
      1e-6);
}

TEST_F(BodyCommands, PositionsOfTheBodyPlaceModels) {
  WritePositions("ref.txt");
  const std::string priors = " --ref_is_gps 0 --ref_images_path " +
                             Path("ref.txt") + " --body_calibration " +
                             Path("body.yaml");
  Run("model_aligner --input_path " + DemoTruth() + priors +
      " --transform_path " + Path("sim3.txt") + " --output_path " +
      Path("placed"));
  std::istringstream transform(ReadTextFile(Path("sim3.txt")));
  for (const double expected : {1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0}) {
    double value = 0.0;
    transform >> value;
    EXPECT_NEAR(value, expected, 1e-6);
  }
  Run("mapper --database_path " + DemoDatabase() + priors +
      " --prior_position_std_x 0.05 --prior_position_std_y 0.05 "
      "--prior_position_std_z 0.05 --output_path " +
      Path("out"));
  EXPECT_LT(MaxError(Path("out") + "/0"), 0.1);
}

TEST_F(BodyCommands, OneAntennaHasTheEstimatedPositions) {
  const std::string command = "mapper --database_path " + DemoDatabase() +
                              " --output_path " + Path("out") +
                              " --estimate_antenna 1";
  EXPECT_THAT(LastWord(RunMgsfm(command)),
              testing::HasSubstr("estimate_antenna needs positions"));
  std::string lines;
  for (const ModelImage& image : ReadModelPoses(DemoTruth()).images) {
    lines += image.name + " 1 2 3\n";
  }
  WriteTextFile(Path("ref.txt"), lines);
  EXPECT_THAT(LastWord(RunMgsfm(command + " --ref_is_gps 0 --ref_images_path " +
                                Path("ref.txt"))),
              testing::HasSubstr("several cameras have positions"));
  EXPECT_FALSE(std::filesystem::exists(Path("out")));
}

}  // namespace
}  // namespace mgsfm
