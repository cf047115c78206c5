// SPDX-License-Identifier: BSD-3-Clause
// Rendered drives of 360 degree cameras, from images to a model in one command.
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "cli/program_runs.h"
#include "cli/rendered_drives.h"
#include "mgsfm/models/model_io.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

class PanoramaCommand : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }

  // Renders 8 frames, one meter apart.
  void Render(const std::string& cameras, const std::string& view_angle_deg) {
    WriteTextFile(Path("rig.json"), "[{\"cameras\": [" + cameras + "]}]");
    const CommandOutput run = RunMgsfm(
        "simulate --preset street --render --num_frames 8 --render_samples 1 "
        "--render_max_view_angle " +
        view_angle_deg + " --rig_config_path " + Path("rig.json") +
        " --output_path " + Path("drive"));
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }

  void Reconstruct(const std::string& images, const std::string& more) {
    const CommandOutput run =
        RunMgsfm("automatic_reconstructor --image_path " + images +
                 " --workspace_path " + Path("work") + " " + more);
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }

  // All frames of one camera agree with the truth.
  void ExpectAccurate(const std::string& folder, const std::string& true_folder,
                      double max_error_m, double max_error_deg) {
    const auto poses = PosesBelow(folder, Path("work/sparse/0"));
    const auto truth = PosesBelow(true_folder, Path("drive/truth"));
    ASSERT_EQ(poses.size(), truth.size());
    ExpectSamePath(poses, truth, max_error_m, max_error_deg);
  }

  TempDir dir_;
};

TEST_F(PanoramaCommand, PanoramasBecomeAnAccurateModel) {
  Render(
      R"({"image_prefix": "pano/", "ref_sensor": true,
          "camera_model_name": "EQUIRECTANGULAR", "camera_params": [800, 400]})",
      "180");
  Reconstruct(Path("drive/images"), "--data_type panorama");
  ExpectAccurate("pano_front/", "pano/", 0.01, 0.05);
  const PoseModel model = ReadModelPoses(Path("work/sparse/0"));
  ASSERT_EQ(model.rigs.size(), 1u);
  for (const RigSensorRow& sensor : model.rigs[0].sensors) {
    EXPECT_EQ(sensor.sensor_from_rig->translation.norm(), 0.0);
  }
}

TEST_F(PanoramaCommand, DualFisheyesBecomeAnAccurateModel) {
  Render(
      R"({"image_prefix": "a/", "ref_sensor": true,
          "camera_model_name": "OPENCV_FISHEYE",
          "camera_params": [120, 120, 200, 200, 0.008, -0.002, 0, 0]},
         {"image_prefix": "b/",
          "cam_from_rig_rotation": [0.01, 0, 1, 0],
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
  Reconstruct(Path("raw"), "--data_type dual_fisheye");
  ExpectAccurate("left/", "a/", 0.03, 0.2);
  ExpectAccurate("right/", "b/", 0.03, 0.2);
}

// The advice of the matchers, which one command follows.
TEST_F(PanoramaCommand, FisheyesWithoutIntrinsicsBecomeAnAccurateModel) {
  Render(
      R"({"image_prefix": "a/", "ref_sensor": true,
          "camera_model_name": "OPENCV_FISHEYE",
          "camera_params": [120, 120, 200, 200, 0.008, -0.002, 0, 0]},
         {"image_prefix": "b/",
          "cam_from_rig_rotation": [0.9805807, 0, 0.1961161, 0],
          "cam_from_rig_translation": [-0.5, 0, 0],
          "camera_model_name": "OPENCV_FISHEYE",
          "camera_params": [120, 120, 200, 200, 0.008, -0.002, 0, 0]})",
      "95");
  const std::string database = Path("a.db");
  ASSERT_EQ(RunMgsfm("feature_extractor --database_path " + database +
                     " --image_path " + Path("drive/images"))
                .exit_code,
            0);
  const CommandOutput matched =
      RunMgsfm("exhaustive_matcher --database_path " + database);
  ASSERT_EQ(matched.exit_code, 0) << matched.err;
  EXPECT_THAT(matched.err,
              testing::HasSubstr("cameras 'a', 'b' seem to be fisheyes"));
  EXPECT_THAT(matched.err,
              testing::HasSubstr("ImageReader.camera_model OPENCV_FISHEYE"));
  Reconstruct(Path("drive/images"), "");
  ExpectAccurate("a/", "a/", 0.05, 0.3);
  ExpectAccurate("b/", "b/", 0.05, 0.3);
}

// Several 360 degree cameras and an ordinary one.
TEST_F(PanoramaCommand, PanoramasAndOtherCamerasFormOneRig) {
  Render(
      R"({"image_prefix": "a/", "ref_sensor": true,
          "camera_model_name": "EQUIRECTANGULAR", "camera_params": [640, 320]},
         {"image_prefix": "b/",
          "cam_from_rig_rotation": [0.9950372, 0, 0.0995037, 0],
          "cam_from_rig_translation": [-0.6, 0, 0],
          "camera_model_name": "EQUIRECTANGULAR", "camera_params": [640, 320]},
         {"image_prefix": "c/", "cam_from_rig_rotation": [1, 0, 0, 0],
          "cam_from_rig_translation": [0, 0.4, 0],
          "camera_model_name": "PINHOLE",
          "camera_params": [300, 300, 200, 150]})",
      "180");
  WriteTextFile(Path("cameras.txt"), "c PINHOLE 400 300 300 300 200 150\n");
  Reconstruct(Path("drive/images"),
              "--data_type panorama --ImageReader.camera_params_path " +
                  Path("cameras.txt"));
  const PoseModel model = ReadModelPoses(Path("work/sparse/0"));
  ASSERT_EQ(model.rigs.size(), 1u);
  ExpectAccurate("a_front/", "a/", 0.02, 0.1);
  ExpectAccurate("b_front/", "b/", 0.02, 0.1);
  ExpectAccurate("c/", "c/", 0.02, 0.1);
}

}  // namespace
}  // namespace mgsfm
