// SPDX-License-Identifier: BSD-3-Clause
// Rendered drives of 360 degree cameras, from images to a model in one command.
#include <Eigen/Geometry>
#include <filesystem>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "cli/program_runs.h"
#include "geometry/so3.h"
#include "mgsfm/io/models/model_io.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

class PanoramaCommand : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }

  // Renders 8 frames, one metre apart.
  void Render(const std::string& cameras, const std::string& view_angle_deg) {
    WriteTextFile(Path("rig.json"), "[{\"cameras\": [" + cameras + "]}]");
    const CommandOutput run = RunMgsfm(
        "simulate --preset street --render --num_frames 8 --render_samples 1 "
        "--render_max_view_angle " +
        view_angle_deg + " --rig_config_path " + Path("rig.json") +
        " --output_path " + Path("drive"));
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }

  void Reconstruct(const std::string& images, const std::string& data_type) {
    const CommandOutput run = RunMgsfm("automatic_reconstructor --image_path " +
                                       images + " --data_type " + data_type +
                                       " --workspace_path " + Path("work"));
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }

  // Poses of the images in a folder, by the rest of their names.
  static std::map<std::string, Rigid3> PosesBelow(const std::string& folder,
                                                  const fs::path& model) {
    std::map<std::string, Rigid3> poses;
    for (const ModelImage& image : ReadModelPoses(model).images) {
      if (image.name.compare(0, folder.size(), folder) != 0) continue;
      const std::string file = image.name.substr(folder.size());
      poses[fs::path(file).stem()] = image.cam_from_world;
    }
    return poses;
  }

  // All frames of one camera agree with the truth.
  void ExpectAccurate(const std::string& folder, const std::string& true_folder,
                      double max_error_m, double max_error_deg) {
    const auto poses = PosesBelow(folder, Path("work/sparse/0"));
    const auto truth = PosesBelow(true_folder, Path("drive/truth"));
    ASSERT_EQ(poses.size(), truth.size());
    Eigen::Matrix3Xd centers(3, poses.size()), true_centers(3, poses.size());
    int i = 0;
    for (const auto& [name, pose] : poses) {
      centers.col(i) = pose.Center();
      true_centers.col(i++) = truth.at(name).Center();
    }
    const Eigen::Matrix4d align = Eigen::umeyama(centers, true_centers);
    const Eigen::Matrix3d scaled = align.topLeftCorner<3, 3>();
    const double error_m = ((scaled * centers).colwise() +
                            align.topRightCorner<3, 1>() - true_centers)
                               .colwise()
                               .norm()
                               .maxCoeff();
    EXPECT_LT(error_m, max_error_m);
    // Relative rotations do not depend on the alignment.
    const auto turn = [](const std::map<std::string, Rigid3>& camera) {
      return camera.rbegin()->second.rotation *
             camera.begin()->second.rotation.conjugate();
    };
    EXPECT_LT(RadToDeg(AngleBetween(turn(poses), turn(truth))), max_error_deg);
  }

  TempDir dir_;
};

TEST_F(PanoramaCommand, PanoramasBecomeAnAccurateModel) {
  Render(
      R"({"image_prefix": "pano/", "ref_sensor": true,
          "camera_model_name": "EQUIRECTANGULAR", "camera_params": [800, 400]})",
      "180");
  Reconstruct(Path("drive/images"), "panorama");
  ExpectAccurate("pano_front/", "pano/", 0.01, 0.05);
  const PoseModel model = ReadModelPoses(Path("work/sparse/0"));
  ASSERT_EQ(model.rigs.size(), 1u);
  for (const ModelSensor& sensor : model.rigs[0].sensors) {
    EXPECT_EQ(sensor.sensor_from_rig->translation.norm(), 0.0);
  }
}

TEST_F(PanoramaCommand, DualFisheyesBecomeAnAccurateModel) {
  Render(
      R"({"image_prefix": "a/", "ref_sensor": true,
          "camera_model_name": "OPENCV_FISHEYE",
          "camera_params": [120, 120, 200, 200, 0.008, -0.002, 0, 0]},
         {"image_prefix": "b/", "cam_from_rig_rotation": [0.01, 0, 1, 0],
          "cam_from_rig_translation": [0, 0, -0.03],
          "camera_model_name": "OPENCV_FISHEYE",
          "camera_params": [120, 120, 200, 200, 0.008, -0.002, 0, 0]})",
      "95");
  fs::create_directory(Path("raw"));
  for (const auto& entry : fs::directory_iterator(Path("drive/images/a"))) {
    const std::string name = entry.path().filename();
    cv::Mat both;
    cv::hconcat(cv::imread(entry.path().string()),
                cv::imread(Path("drive/images/b/" + name)), both);
    cv::imwrite(Path("raw/" + name), both);
  }
  Reconstruct(Path("raw"), "dual_fisheye");
  ExpectAccurate("left/", "a/", 0.03, 0.2);
  ExpectAccurate("right/", "b/", 0.03, 0.2);
}

}  // namespace
}  // namespace mgsfm
