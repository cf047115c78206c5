// SPDX-License-Identifier: BSD-3-Clause
#include "imaging/image_splitting.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <exiv2/exiv2.hpp>
#include <opencv2/imgcodecs.hpp>

#include "frontend/imaging/test_cameras.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/rigs/rig_config.h"
#include "support/temp_dir.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class ImageSplittingTest : public testing::Test {
 protected:
  fs::path Path(const std::string& name) const { return dir_.path() / name; }

  void Write(const std::string& name, const cv::Mat& image) {
    fs::create_directories(Path("in/" + name).parent_path());
    cv::imwrite(Path("in/" + name).string(), image);
    names_.push_back(name);
  }

  ImageRunSummary Split(CombinedImages kind,
                        const fs::path& camera_params_path = {},
                        const fs::path& rig_config_path = {},
                        const std::string& output = "out",
                        int num_threads = 1) const {
    return SplitImages({Path("in"),
                        names_,
                        {},
                        camera_params_path,
                        Path(output),
                        rig_config_path},
                       kind, SplittingOptions(), Threads(num_threads));
  }

  cv::Mat Read(const std::string& name) const {
    return cv::imread(Path("out/images/" + name).string(),
                      cv::IMREAD_GRAYSCALE);
  }

  TempDir dir_;
  std::vector<std::string> names_;
};

cv::Mat PaintPanorama() {
  const Camera camera = Panorama();
  cv::Mat image(camera.height_px, camera.width_px, CV_8U);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const Eigen::Vector3d ray =
          *RayFromPixel(camera.model, camera.params.data(), {x + 0.5, y + 0.5});
      image.at<uint8_t>(y, x) = cv::saturate_cast<uint8_t>(Brightness(ray));
    }
  }
  return image;
}

// Random gray values, so that shifts do not go unnoticed.
cv::Mat Noise(int width_px, int height_px) {
  cv::Mat image(height_px, width_px, CV_8U);
  cv::theRNG().state = 5;
  cv::randu(image, 0, 256);
  return image;
}

// rig_config.json says where the views look.
TEST_F(ImageSplittingTest, PanoramasBecomeRigsOfKnownCameras) {
  Write("seq/pano/000.png", PaintPanorama());
  Write("seq/pano/001.png", PaintPanorama());
  Write("seq/stereo/000.png", Noise(60, 40));
  EXPECT_THROW(Split(CombinedImages::kPanorama), Error);  // of the intrinsics
  const std::string line = "seq/stereo SIMPLE_PINHOLE 60 40 50 30 20\n";
  WriteTextFile(Path("cameras.txt"),
                "seq/pano EQUIRECTANGULAR 800 400 800 400\n" + line);
  const ImageRunSummary summary =
      Split(CombinedImages::kPanorama, Path("cameras.txt"));
  EXPECT_EQ(summary.num_written, 3u);
  const std::vector<RigConfig> rigs =
      ReadRigConfig(Path("out/rig_config.json").string());
  ASSERT_EQ(rigs.size(), 1u);
  ASSERT_EQ(rigs[0].cameras.size(), 7u);
  for (size_t i = 0; i < 6; ++i) {
    const RigConfigCamera& camera = rigs[0].cameras[i];
    EXPECT_EQ(camera.is_reference, i == 0);
    const cv::Mat view = Read(camera.image_prefix + "001.png");
    ASSERT_FALSE(view.empty()) << camera.image_prefix;
    const Camera pinhole = MakeCamera(*camera.camera_model, view.cols,
                                      view.rows, camera.camera_params);
    double sum = 0.0;
    for (int y = 0; y < view.rows; ++y) {
      for (int x = 0; x < view.cols; ++x) {
        const Eigen::Vector3d ray = camera.cam_from_rig->rotation.conjugate() *
                                    PinholeRay(pinhole, x + 0.5, y + 0.5);
        sum += std::abs(view.at<uint8_t>(y, x) - Brightness(ray));
      }
    }
    EXPECT_LT(sum / static_cast<double>(view.total()), 2.0)
        << camera.image_prefix;
  }
  // The other camera of the rig is as before, at an unknown pose.
  EXPECT_EQ(rigs[0].cameras[6].image_prefix, "seq/stereo/");
  EXPECT_FALSE(rigs[0].cameras[6].cam_from_rig);
  EXPECT_EQ(ReadTextFile(Path("out/images/seq/stereo/000.png")),
            ReadTextFile(Path("in/seq/stereo/000.png")));
  const std::string cameras = ReadTextFile(Path("out/cameras.txt"));
  EXPECT_THAT(cameras, HasSubstr("seq/pano_left PINHOLE 255 255 "));
  EXPECT_THAT(cameras, HasSubstr(line));
  EXPECT_THAT(cameras, testing::Not(HasSubstr("EQUIRECTANGULAR")));
  // A second run has nothing to do.
  EXPECT_EQ(Split(CombinedImages::kPanorama, Path("cameras.txt")).num_present,
            3u);
}

TEST_F(ImageSplittingTest, ThreadsDoNotChangeAFile) {
  for (int i = 0; i < 4; ++i) {
    Write("pano/" + std::to_string(i) + ".png", PaintPanorama());
  }
  Split(CombinedImages::kPanorama, {}, {}, "one", 1);
  Split(CombinedImages::kPanorama, {}, {}, "three", 3);
  size_t num_files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(Path("one"))) {
    if (!entry.is_regular_file()) continue;
    const fs::path name = entry.path().lexically_relative(Path("one"));
    EXPECT_EQ(ReadTextFile(entry.path()), ReadTextFile(Path("three") / name));
    ++num_files;
  }
  EXPECT_GT(num_files, 4u);
}

TEST_F(ImageSplittingTest, ViewsKeepPositionAndTime) {
  Write("pano/000.jpg", PaintPanorama());
  Write("pano/001.jpg", PaintPanorama());
  const auto original =
      Exiv2::ImageFactory::open(Path("in/pano/000.jpg").string());
  Exiv2::ExifData& tags = original->exifData();
  tags["Exif.GPSInfo.GPSLatitude"] = "48/1 30/1 0/1";
  tags["Exif.GPSInfo.GPSLatitudeRef"] = "N";
  tags["Exif.Photo.DateTimeOriginal"] = "2023:05:01 12:34:56";
  tags["Exif.Photo.FocalLengthIn35mmFilm"] = uint16_t{28};
  original->writeMetadata();
  Split(CombinedImages::kPanorama);
  for (const char* const view :
       {"front", "right", "left", "up", "down", "back"}) {
    const auto image = Exiv2::ImageFactory::open(
        Path(std::string("out/images/pano_") + view + "/000.jpg").string());
    image->readMetadata();
    Exiv2::ExifData& copied = image->exifData();
    EXPECT_EQ(copied["Exif.GPSInfo.GPSLatitude"].toString(), "48/1 30/1 0/1");
    EXPECT_EQ(copied["Exif.GPSInfo.GPSLatitudeRef"].toString(), "N");
    EXPECT_EQ(copied["Exif.Photo.DateTimeOriginal"].toString(),
              "2023:05:01 12:34:56");
    // The views have another focal length.
    EXPECT_EQ(
        copied.findKey(Exiv2::ExifKey("Exif.Photo.FocalLengthIn35mmFilm")),
        copied.end());
    EXPECT_FALSE(Read(std::string("pano_") + view + "/000.jpg").empty());
  }
  const auto without =
      Exiv2::ImageFactory::open(Path("out/images/pano_up/001.jpg").string());
  without->readMetadata();
  EXPECT_TRUE(without->exifData().empty());
}

TEST_F(ImageSplittingTest, ViewsKeepTheirDepth) {
  cv::Mat deep;
  PaintPanorama().convertTo(deep, CV_16U, 16.0);
  Write("000.png", deep);
  Split(CombinedImages::kPanorama);
  const cv::Mat view = cv::imread(Path("out/images/front/000.png").string(),
                                  cv::IMREAD_UNCHANGED);
  ASSERT_EQ(view.depth(), CV_16U);
  double max = 0.0;
  cv::minMaxLoc(view, nullptr, &max);
  EXPECT_GT(max, 256.0);
}

// The first panorama is the reference; the views of others are estimated.
TEST_F(ImageSplittingTest, SeveralPanoramasFormOneRig) {
  Write("a/000.png", PaintPanorama());
  Write("b/000.png", PaintPanorama());
  Split(CombinedImages::kPanorama);
  const std::vector<RigConfig> rigs =
      ReadRigConfig(Path("out/rig_config.json").string());
  ASSERT_EQ(rigs.size(), 1u);
  ASSERT_EQ(rigs[0].cameras.size(), 12u);
  for (size_t i = 0; i < 12; ++i) {
    const RigConfigCamera& camera = rigs[0].cameras[i];
    EXPECT_EQ(camera.is_reference, i == 0);
    EXPECT_EQ(camera.cam_from_rig.has_value(), i < 6) << camera.image_prefix;
    EXPECT_TRUE(camera.camera_model) << camera.image_prefix;
  }
}

TEST_F(ImageSplittingTest, DualFisheyesAreCutInTheMiddle) {
  const cv::Mat image = Noise(200, 100);
  Write("000.png", image);
  Split(CombinedImages::kDualFisheye);
  EXPECT_EQ(cv::norm(Read("left/000.png"), image.colRange(0, 100)), 0.0);
  EXPECT_EQ(cv::norm(Read("right/000.png"), image.colRange(100, 200)), 0.0);
}

TEST_F(ImageSplittingTest, ImagesOfAnotherShapeAreAnError) {
  Write("000.png", Noise(60, 40));
  EXPECT_THROW(Split(CombinedImages::kPanorama), Error);
  EXPECT_FALSE(fs::exists(Path("out")));
}

TEST_F(ImageSplittingTest, FilesThatDoNotFitAreLeftOut) {
  Write("000.png", PaintPanorama());
  Write("001.png", Noise(60, 40));
  WriteTextFile(Path("in/notes.txt"), "no image");
  names_.push_back("notes.txt");
  EXPECT_EQ(Split(CombinedImages::kPanorama).num_written, 1u);
  EXPECT_TRUE(Read("front/001.png").empty());
}

// The views of each panorama look where it does, from its place.
TEST_F(ImageSplittingTest, KnownPosesOfPanoramasReachTheirViews) {
  Write("a/0.png", PaintPanorama());
  Write("b/0.png", PaintPanorama());
  Write("c/0.png", PaintPanorama());
  WriteTextFile(Path("rig.json"), R"([{"cameras": [
      {"image_prefix": "b/", "ref_sensor": true},
      {"image_prefix": "a/", "cam_from_rig_rotation": [0.6, 0, 0.8, 0],
       "cam_from_rig_translation": [0.3, 0.1, -0.6]},
      {"image_prefix": "c/"}]}])");
  Split(CombinedImages::kPanorama, {}, Path("rig.json"));
  const auto rigs = ReadRigConfig(Path("out/rig_config.json").string());
  ASSERT_EQ(rigs.size(), 1u);
  ASSERT_EQ(rigs[0].cameras.size(), 18u);
  const auto pose_of = [&](const std::string& prefix) {
    for (const RigConfigCamera& camera : rigs[0].cameras) {
      if (camera.image_prefix == prefix) return camera.cam_from_rig;
    }
    return std::optional<Rigid3>();
  };
  const Rigid3 a_from_b{Eigen::Quaterniond(0.6, 0.0, 0.8, 0.0),
                        {0.3, 0.1, -0.6}};
  for (const std::string view : {"front", "right", "left", "up", "back"}) {
    const Rigid3 of_a = pose_of("a_" + view + "/").value();
    const Rigid3 of_b = pose_of("b_" + view + "/").value();
    EXPECT_LT(AngleBetween(of_b.rotation, (of_a * a_from_b.Inverse()).rotation),
              1e-12);
    // The center of b, in the axes of a.
    EXPECT_LT((of_b.Center() - a_from_b.translation).norm(), 1e-12);
    EXPECT_FALSE(pose_of("c_" + view + "/").has_value());
  }
  WriteTextFile(Path("rig.json"), R"([{"cameras": [
      {"image_prefix": "pano/", "ref_sensor": true}]}])");
  try {
    Split(CombinedImages::kPanorama, {}, Path("rig.json"));
    FAIL() << "no error";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("'pano/'"));
  }
}

}  // namespace
}  // namespace mgsfm
