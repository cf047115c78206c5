// SPDX-License-Identifier: BSD-3-Clause
// Masks of cameras from images to undistorted views: the hull of a vehicle in
// four fisheyes, and a 360 degree camera before and after it is split.
#include <cmath>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "cli/program_runs.h"
#include "cli/rendered_drives.h"
#include "mgsfm/database/feature_database.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

class CameraMasksCommand : public CommandTest {
 protected:
  void Render(const std::string& cameras, const std::string& view_angle_deg,
              int num_frames) const {
    WriteTextFile(Path("rig.json"), "[{\"cameras\": [" + cameras + "]}]");
    Run("simulate --preset street --render --num_frames " +
        std::to_string(num_frames) +
        " --render_samples 1 --render_max_view_angle " + view_angle_deg +
        " --rig_config_path " + Path("rig.json") + " --output_path " +
        Path("drive"));
  }
  void Reconstruct(const std::string& images, const std::string& workspace,
                   const std::string& more) const {
    Run("automatic_reconstructor --image_path " + Path(images) +
        " --workspace_path " + Path(workspace) + " " + more);
  }
  std::map<fs::path, std::string> FilesBelow(const std::string& folder) const {
    std::map<fs::path, std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(Path(folder))) {
      if (!entry.is_regular_file()) continue;
      files[entry.path().lexically_relative(Path(folder))] =
          ReadTextFile(entry.path());
    }
    return files;
  }
  // Gives each image of a folder of drive/images the mask of its camera.
  void CopyPerImage(const std::string& folder, const std::string& mask) const {
    for (const auto& entry :
         fs::directory_iterator(Path("drive/images/" + folder))) {
      const fs::path copy = Path("per_image/" + folder + "/" +
                                 entry.path().filename().string() + ".png");
      fs::create_directories(copy.parent_path());
      fs::copy_file(mask, copy);
    }
  }
};

std::string Fisheye(const std::string& prefix, double angle_deg) {
  const double half_rad = DegToRad(angle_deg) / 2;
  return "{\"image_prefix\": \"" + prefix +
         "/\", \"cam_from_rig_rotation\": [" +
         std::to_string(std::cos(half_rad)) + ", 0, " +
         std::to_string(std::sin(half_rad)) +
         ", 0], \"cam_from_rig_translation\": [0, 0, -0.3], "
         "\"camera_model_name\": \"OPENCV_FISHEYE\", \"camera_params\": "
         "[120, 120, 200, 200, 0.008, -0.002, 0, 0]}";
}

// The hull is below a wavy edge, with more texture than the street.
cv::Mat HullOf(const cv::Mat& image, uint64_t seed, cv::Mat* mask) {
  cv::RNG random(seed);
  cv::Mat hull(image.size(), image.type(), cv::Scalar::all(120));
  for (int i = 0; i < 400; ++i) {
    const cv::Point corner(random.uniform(0, image.cols - 8),
                           random.uniform(0, image.rows - 8));
    const int side_px = random.uniform(3, 12);
    hull(cv::Rect(corner, cv::Size(side_px, side_px)) &
         cv::Rect({0, 0}, image.size()))
        .setTo(cv::Scalar::all(random.uniform(0, 256)));
  }
  *mask = cv::Mat(image.size(), CV_8U, cv::Scalar(255));
  cv::Mat result = image.clone();
  for (int x = 0; x < image.cols; ++x) {
    const int top = 250 + static_cast<int>(20 * std::sin(0.05 * x));
    hull.col(x)
        .rowRange(top, image.rows)
        .copyTo(result.col(x).rowRange(top, image.rows));
    mask->col(x).rowRange(top, image.rows).setTo(0);
  }
  return result;
}

TEST_F(CameraMasksCommand, NoFeatureIsOnTheHullInFourFisheyes) {
  const std::vector<std::string> folders = {"a", "b", "c", "d"};
  std::string cameras =
      R"({"image_prefix": "a/", "ref_sensor": true,
          "camera_model_name": "OPENCV_FISHEYE",
          "camera_params": [120, 120, 200, 200, 0.008, -0.002, 0, 0]})";
  for (int i = 1; i < 4; ++i) cameras += ", " + Fisheye(folders[i], 90.0 * i);
  Render(cameras, "95", 8);
  const std::string known =
      "--ImageReader.camera_params_path " + Path("drive/cameras.txt") + " ";
  Reconstruct("drive/images", "free", known);

  std::map<std::string, cv::Mat> masks;
  fs::create_directory(Path("masks"));
  for (size_t i = 0; i < folders.size(); ++i) {
    cv::Mat& mask = masks[folders[i]];
    for (const auto& entry :
         fs::directory_iterator(Path("drive/images/" + folders[i]))) {
      const std::string path = entry.path().string();
      cv::imwrite(path, HullOf(cv::imread(path), 7 + i, &mask));
    }
    cv::imwrite(Path("masks/" + folders[i] + ".png"), mask);
  }
  Reconstruct("drive/images", "masked",
              known + "--ImageReader.camera_mask_path " + Path("masks"));
  const FeatureDatabase database(Path("masked/database.db"),
                                 FeatureDatabase::OpenMode::kExisting);
  for (const ImageRow& image : database.ReadStructure(Context()).images) {
    const auto keypoints = database.ReadKeypoints(image.id);
    EXPECT_GT(keypoints.size(), 50u) << image.name;
    const cv::Mat& mask = masks.at(image.name.substr(0, 1));
    for (const FeatureKeypoint& keypoint : keypoints) {
      EXPECT_EQ(mask.at<uint8_t>(static_cast<int>(keypoint.y_px),
                                 static_cast<int>(keypoint.x_px)),
                255)
          << image.name;
    }
  }
  for (const char* workspace : {"free", "masked"}) {
    SCOPED_TRACE(workspace);
    for (const std::string& folder : folders) {
      ExpectSamePath(
          PosesBelow(folder, Path(workspace + std::string("/sparse/0"))),
          PosesBelow(folder, Path("drive/truth")), 0.03, 0.2);
    }
  }

  // The views of the undistorter show nothing of the hull either.
  const std::string undistort = "image_undistorter --image_path " +
                                Path("drive/images") + " --input_path " +
                                Path("masked/sparse/0") + " --output_path ";
  Run(undistort + Path("by_camera") + " --camera_mask_path " + Path("masks"));
  for (const std::string& folder : folders) {
    CopyPerImage(folder, Path("masks/" + folder + ".png"));
  }
  Run(undistort + Path("by_image") + " --mask_path " + Path("per_image"));
  EXPECT_EQ(FilesBelow("by_camera/masks"), FilesBelow("by_image/masks"));
  Run(undistort + Path("free_views"));
  EXPECT_NE(FilesBelow("by_camera/masks"), FilesBelow("free_views/masks"));
}

// The mask of the camera holds for the 360 degree images; masks of views are
// named after the folders of the views.
TEST_F(CameraMasksCommand, MasksOf360DegreeCamerasHoldBeforeAndAfterSplitting) {
  Render(
      R"({"image_prefix": "pano/", "ref_sensor": true,
          "camera_model_name": "EQUIRECTANGULAR", "camera_params": [400, 200]})",
      "180", 3);
  cv::Mat mask(200, 400, CV_8U, cv::Scalar(255));
  mask.rowRange(140, 200).setTo(0);
  fs::create_directory(Path("masks"));
  cv::imwrite(Path("masks/pano.png"), mask);
  const std::string split =
      "image_splitter --image_path " + Path("drive/images") + " --output_path ";
  Run(split + Path("by_camera") + " --camera_mask_path " + Path("masks"));
  CopyPerImage("pano", Path("masks/pano.png"));
  Run(split + Path("by_image") + " --mask_path " + Path("per_image"));
  EXPECT_EQ(FilesBelow("by_camera/masks"), FilesBelow("by_image/masks"));

  // After splitting: those of the first frame hold for all.
  fs::create_directory(Path("of_views"));
  for (const auto& entry : fs::directory_iterator(Path("by_camera/masks"))) {
    fs::copy_file(
        fs::directory_iterator(entry.path())->path(),
        Path("of_views/" + entry.path().filename().string() + ".png"));
  }
  const std::string extract =
      "feature_extractor --image_path " + Path("by_camera/images") + " ";
  Run(extract + "--ImageReader.mask_path " + Path("by_camera/masks") +
      " --database_path " + Path("image.db"));
  Run(extract + "--ImageReader.camera_mask_path " + Path("of_views") +
      " --database_path " + Path("camera.db"));
  Reconstruct(
      "drive/images", "work",
      "--data_type panorama --ImageReader.camera_mask_path " + Path("masks"));
  const auto keypoints = [&](const std::string& path) {
    const FeatureDatabase database(Path(path),
                                   FeatureDatabase::OpenMode::kExisting);
    std::map<std::string, size_t> counts;
    for (const ImageRow& image : database.ReadStructure(Context()).images) {
      counts[image.name] = database.ReadKeypoints(image.id).size();
    }
    return counts;
  };
  EXPECT_EQ(keypoints("camera.db"), keypoints("image.db"));
  EXPECT_EQ(keypoints("work/database.db"), keypoints("image.db"));
  EXPECT_EQ(keypoints("image.db").at("pano_down/000000.png"), 0u);
}

}  // namespace
}  // namespace mgsfm
