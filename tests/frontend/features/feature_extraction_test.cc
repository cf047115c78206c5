// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/features/feature_extraction.h"

#include <gmock/gmock.h>

#include <exiv2/exiv2.hpp>
#include <set>

#include "frontend/features/extraction_fixture.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

class FeatureExtractionTest : public ExtractionTest {
 protected:
  void WriteFolders() const {
    WriteBlobs("left/1.png", 11);
    WriteBlobs("left/2.png", 12);
    WriteBlobs("right/1.png", 13);
  }
  size_t NumCameras(const FeatureExtractionOptions& options,
                    const std::string& database) {
    Extract(options, database);
    std::set<CameraId> used;
    for (const auto& [name, image] : Images(database)) {
      used.insert(image.camera_id);
    }
    EXPECT_EQ(Structure(database).cameras.size(), used.size());
    return used.size();
  }
  // The message of the Error.
  std::string Problem(const FeatureExtractionOptions& options) {
    try {
      Extract(options, "problem.db");
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }
};

TEST_F(FeatureExtractionTest, WritesCamerasImagesAndFeaturesInOrderOfNames) {
  WriteFolders();
  const FeatureExtractionSummary summary = Extract();
  EXPECT_EQ(summary.num_images, 3u);
  EXPECT_EQ(summary.num_extracted, 3u);
  const auto images = Images();
  size_t num_features = 0;
  uint32_t id = 0;
  for (const auto& [name, image] : images) {
    EXPECT_EQ(image.id, ImageId(++id)) << name;
    EXPECT_GT(image.keypoints.size(), 20u);
    EXPECT_EQ(image.descriptors.rows(),
              static_cast<Eigen::Index>(image.keypoints.size()));
    num_features += image.keypoints.size();
  }
  EXPECT_EQ(summary.num_features, num_features);
  const Camera camera = Structure().cameras.front();
  EXPECT_EQ(camera.model, CameraModelId::kSimpleRadial);
  EXPECT_EQ(camera.params, (std::vector<double>{1.2 * 120, 60.0, 45.0, 0.0}));
  EXPECT_FALSE(camera.has_prior_focal_length);
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(FeatureExtractionTest, ThreadsDoNotChangeTheDatabase) {
  for (uint64_t i = 0; i < 9; ++i) {
    // The images that take longest come first.
    const int size = 200 - 20 * static_cast<int>(i);
    WriteBlobs("cam" + std::to_string(i) + "/1.png", i, size, size - 10);
  }
  Extract({}, "one.db", 1);
  Extract({}, "five.db", 5);
  ExpectEqual(Images("one.db"), Images("five.db"));
}

TEST_F(FeatureExtractionTest, CamerasAreSharedAsRequested) {
  WriteFolders();
  FeatureExtractionOptions options;
  EXPECT_EQ(NumCameras(options, "default.db"), 2u);
  options.reader.single_camera_per_folder = true;
  EXPECT_EQ(NumCameras(options, "folder.db"), 2u);
  options.reader.single_camera = true;
  EXPECT_THAT(Problem(options), HasSubstr("only one of"));
  options.reader.single_camera_per_folder = false;
  EXPECT_EQ(NumCameras(options, "single.db"), 1u);
  options.reader.single_camera = false;
  options.reader.single_camera_per_image = true;
  EXPECT_EQ(NumCameras(options, "image.db"), 3u);
}

TEST_F(FeatureExtractionTest, UsesCameraParams) {
  WriteFolders();
  FeatureExtractionOptions options;
  options.reader.camera_model = "PINHOLE";
  options.reader.camera_params = "100, 101,60,45";
  Extract(options);
  for (const Camera& camera : Structure().cameras) {
    EXPECT_EQ(camera.model, CameraModelId::kPinhole);
    EXPECT_EQ(camera.params, (std::vector<double>{100, 101, 60, 45}));
    EXPECT_TRUE(camera.has_prior_focal_length);
  }
  options.reader.camera_params = "100,60,45";
  EXPECT_THAT(Problem(options), HasSubstr("PINHOLE has 4 parameters, not 3"));
  options.reader.camera_params = "100,x,60,45";
  EXPECT_THAT(Problem(options), HasSubstr("'x' is not a number"));
  const auto expect_impossible = [&](const char* params, const char* text) {
    options.reader.camera_params = params;
    EXPECT_THAT(Problem(options), HasSubstr(text)) << params;
  };
  expect_impossible("-100,101,60,45", "focal length -100 is not positive");
  expect_impossible("100,0,60,45", "focal length 0 is not positive");
  expect_impossible("9000,9000,60,45", "focal length of 9000 px");
  expect_impossible("100,100,-1,45", "principal point");
  expect_impossible("50,50,30,22.5", "60 x 45 px");
  options.reader.camera_model = "PINHOLES";
  EXPECT_THAT(Problem(options), HasSubstr("no camera model 'PINHOLES'"));
}

TEST_F(FeatureExtractionTest, ReadsCameraParamsPerFolderFromFile) {
  WriteFolders();
  FeatureExtractionOptions options;
  options.reader.camera_params_path = (dir_.path() / "cameras.txt").string();
  WriteTextFile(*options.reader.camera_params_path,
                "# a comment\n"
                "left SIMPLE_PINHOLE 120 90 99 61 44\n"
                "right OPENCV_FISHEYE 120 90 80 80 60 45 0.1 0 0 0\n");
  Extract(options);
  const auto images = Images();
  for (const Camera& camera : Structure().cameras) {
    const bool is_left = camera.id == images.at("left/1.png").camera_id;
    EXPECT_EQ(camera.model, is_left ? CameraModelId::kSimplePinhole
                                    : CameraModelId::kOpenCVFisheye);
    EXPECT_EQ(camera.params[0], is_left ? 99.0 : 80.0);
  }
  WriteTextFile(*options.reader.camera_params_path,
                "left SIMPLE_PINHOLE 120 90 99 61 44\n");
  EXPECT_THAT(Problem(options), HasSubstr("no line for the folder 'right'"));
  for (const char* line :
       {"left 120 90 99 61 44", "left SIMPLE_PINHOLE 1e12 90 99 61 44",
        "left SIMPLE_PINHOLE 120.5 90 99 61 44",
        "left SIMPLE_PINHOLE 120 90 99 61 44 0.1",
        "left SIMPLE_PINHOLE 120 90 99 961 44"}) {
    WriteTextFile(*options.reader.camera_params_path,
                  std::string("# a comment\r\n") + line + "\r\n");
    EXPECT_THAT(Problem(options), HasSubstr("line 2")) << line;
  }
}

TEST_F(FeatureExtractionTest, ReadsFocalLengthAndPositionFromExif) {
  WriteBlobs("film/1.jpg", 1);
  WriteBlobs("plane/1.jpg", 2);
  const auto tag = [&](const std::string& name, const auto& set) {
    const auto image = Exiv2::ImageFactory::open(ImagePath(name).string());
    set(image->exifData());
    image->writeMetadata();
  };
  tag("film/1.jpg", [](Exiv2::ExifData& tags) {
    tags["Exif.Photo.FocalLengthIn35mmFilm"] = uint16_t{28};
    tags["Exif.GPSInfo.GPSLatitude"] = "48/1 30/1 0/1";
    tags["Exif.GPSInfo.GPSLatitudeRef"] = "S";
    tags["Exif.GPSInfo.GPSLongitude"] = "11/1 15/1 36/1";
    tags["Exif.GPSInfo.GPSLongitudeRef"] = "E";
    tags["Exif.GPSInfo.GPSAltitude"] = "1025/2";
  });
  // 4 mm at 10 pixels per mm.
  tag("plane/1.jpg", [](Exiv2::ExifData& tags) {
    tags["Exif.Photo.FocalLength"] = "4/1";
    tags["Exif.Photo.FocalPlaneXResolution"] = "100/1";
    tags["Exif.Photo.FocalPlaneResolutionUnit"] = uint16_t{3};
  });
  Extract();
  const auto images = Images();
  for (const Camera& camera : Structure().cameras) {
    const bool is_film = camera.id == images.at("film/1.jpg").camera_id;
    // The image diagonal is 150 px; that of 35 mm film is that of 36 x 24 mm.
    const double expected = is_film ? 28.0 * 150.0 / std::hypot(36, 24) : 40.0;
    EXPECT_NEAR(camera.params[0], expected, 1e-6);
    EXPECT_TRUE(camera.has_prior_focal_length);
  }
  const auto priors =
      FeatureDatabase(DatabasePath(), FeatureDatabase::OpenMode::kExisting)
          .ReadPosePriors();
  ASSERT_EQ(priors.size(), 1u);
  EXPECT_EQ(priors[0].image_id, images.at("film/1.jpg").id);
  EXPECT_EQ(priors[0].coordinate_system,
            PosePriorRow::CoordinateSystem::kWgs84);
  EXPECT_LT((priors[0].position - Eigen::Vector3d(-48.5, 11.26, 512.5)).norm(),
            1e-9);
}

// The orientation is ignored as in COLMAP, so that masks and calibrations fit
// the stored pixels.
TEST_F(FeatureExtractionTest, IgnoresTheOrientationOfExif) {
  WriteBlobs("upright.jpg", 1);
  std::filesystem::copy(ImagePath("upright.jpg"), ImagePath("turned.jpg"));
  const auto image =
      Exiv2::ImageFactory::open(ImagePath("turned.jpg").string());
  image->exifData()["Exif.Image.Orientation"] = uint16_t{6};
  image->writeMetadata();
  Extract();
  const auto images = Images();
  EXPECT_EQ(images.at("turned.jpg").descriptors,
            images.at("upright.jpg").descriptors);
  const Camera camera = Structure().cameras.at(0);
  EXPECT_GT(camera.width_px, camera.height_px);
}

TEST_F(FeatureExtractionTest, DropsFeaturesWhereMasksAreBlack) {
  WriteFolders();
  Extract({}, "all.db");
  cv::Mat mask(90, 120, CV_8U, cv::Scalar(255));
  mask.colRange(0, 70).setTo(0);
  std::filesystem::create_directories(dir_.path() / "masks/left");
  cv::imwrite((dir_.path() / "masks/left/1.png.png").string(), mask);
  FeatureExtractionOptions options;
  options.reader.mask_path = (dir_.path() / "masks").string();
  Extract(options, "masked.db");
  auto all = Images("all.db");
  auto masked = Images("masked.db");
  std::vector<float> kept;
  for (const FeatureKeypoint& keypoint : all["left/1.png"].keypoints) {
    if (keypoint.x_px >= 70.0f) kept.push_back(keypoint.x_px);
  }
  std::vector<float> found;
  for (const FeatureKeypoint& keypoint : masked["left/1.png"].keypoints) {
    found.push_back(keypoint.x_px);
  }
  EXPECT_FALSE(kept.empty());
  EXPECT_EQ(found, kept);
  EXPECT_EQ(masked["left/1.png"].descriptors.rows(),
            static_cast<Eigen::Index>(kept.size()));
  // The others have no mask.
  all.erase("left/1.png");
  masked.erase("left/1.png");
  ExpectEqual(all, masked);

  FeatureExtractionOptions camera_options;
  camera_options.reader.camera_mask_path =
      (dir_.path() / "masks/left/1.png.png").string();
  Extract(camera_options, "camera.db");
  for (const auto& [name, image] : Images("camera.db")) {
    for (const FeatureKeypoint& k : image.keypoints) EXPECT_GE(k.x_px, 70.0f);
  }
}

TEST_F(FeatureExtractionTest, CountsImagesThatMasksDoNotFit) {
  WriteFolders();
  Extract({}, "unmasked.db");
  cv::Mat mask(90, 120, CV_8U, cv::Scalar(255));
  const auto write = [&](const std::string& name) {
    const auto path = dir_.path() / "masks" / (name + ".png");
    std::filesystem::create_directories(path.parent_path());
    ASSERT_TRUE(cv::imwrite(path.string(), mask));
  };
  FeatureExtractionOptions options;
  options.reader.mask_path = (dir_.path() / "masks").string();
  std::filesystem::create_directory(dir_.path() / "masks");
  EXPECT_THAT(Problem(options), HasSubstr("no image has a mask in"));
  warnings_.clear();
  write("left/1.png");
  Extract(options, "white.db");
  EXPECT_THAT(warnings_,
              testing::ElementsAre(
                  testing::AllOf(HasSubstr("2 of 3 images have no mask"),
                                 HasSubstr("'left/2.png.png'")),
                  HasSubstr("1 of 1 masks in")));
  warnings_.clear();
  mask.colRange(0, 70).setTo(0);
  for (const char* name : {"left/1.png", "left/2.png", "right/1.png"}) {
    write(name);
  }
  Extract(options, "masked.db");
  Extract(options, "masked.db");
  EXPECT_THAT(warnings_, testing::IsEmpty());
  Extract(options, "unmasked.db");
  EXPECT_THAT(warnings_, testing::ElementsAre(HasSubstr(
                             "features of 3 of 3 images were made without")));
}

// Beside their images, or in a folder among those of images.
TEST_F(FeatureExtractionTest, MasksAmongTheImagesAreNoImages) {
  WriteFolders();
  Extract({}, "all.db");
  const std::vector<std::string> names = ListImages(ImagePath("").string(), "");
  const cv::Mat mask(90, 120, CV_8U, cv::Scalar(255));
  for (const char* folder : {"", "masks/"}) {
    for (const std::string& name : names) {
      const std::filesystem::path path = ImagePath(folder + name + ".png");
      std::filesystem::create_directories(path.parent_path());
      ASSERT_TRUE(cv::imwrite(path.string(), mask));
    }
    FeatureExtractionOptions options;
    options.reader.mask_path = ImagePath(folder).string();
    const std::string database = std::string(folder).empty() ? "a.db" : "b.db";
    Extract(options, database);
    ExpectEqual(Images(database), Images("all.db"));
    for (const std::string& name : names) {
      std::filesystem::remove(ImagePath(folder + name + ".png"));
    }
  }
}

TEST_F(FeatureExtractionTest, IntrinsicsThatTheDatabaseContradictsAreNamed) {
  WriteFolders();
  FeatureExtractionOptions options;
  options.reader.camera_model = "PINHOLE";
  for (const char* params :
       {"100,100,60,45", "100,100,60,45", "110,110,60,45"}) {
    EXPECT_THAT(warnings_, testing::IsEmpty());
    options.reader.camera_params = params;
    Extract(options, "all.db");
  }
  EXPECT_THAT(warnings_,
              testing::ElementsAre(HasSubstr("other intrinsics of 3 images")));
  Extract({}, "all.db");
  EXPECT_EQ(warnings_.size(), 1u);
}

// Instances are numbered from 1; 0 is the background.
TEST_F(FeatureExtractionTest, MasksOfSixteenBitsHideZerosOnly) {
  WriteFolders();
  Extract({}, "all.db");
  cv::Mat mask(90, 120, CV_16U, cv::Scalar(1));
  mask.at<uint16_t>(89, 119) = 65535;
  for (const auto& [name, image] : Images("all.db")) {
    const auto path = dir_.path() / "masks" / (name + ".png");
    std::filesystem::create_directories(path.parent_path());
    ASSERT_TRUE(cv::imwrite(path.string(), mask));
  }
  FeatureExtractionOptions options;
  options.reader.mask_path = (dir_.path() / "masks").string();
  Extract(options, "masked.db");
  ExpectEqual(Images("masked.db"), Images("all.db"));
}

// The first image of a folder defines its camera.
TEST_F(FeatureExtractionTest, WarnsOfZoom) {
  for (const int number : {1, 2, 3}) {
    const std::string name = "left/" + std::to_string(number) + ".jpg";
    WriteBlobs(name, 1);
    const auto image = Exiv2::ImageFactory::open(ImagePath(name).string());
    // 28 mm, the same but for rounding, and 50 mm.
    const uint16_t lengths_mm[] = {28, 29, 50};
    image->exifData()["Exif.Photo.FocalLengthIn35mmFilm"] =
        lengths_mm[number - 1];
    image->writeMetadata();
  }
  Extract();
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_THAT(warnings_[0], testing::AllOf(HasSubstr("shares a camera"),
                                           HasSubstr("'left/3.jpg'")));
}

TEST_F(FeatureExtractionTest, SkipsImagesWithFeatures) {
  WriteFolders();
  Extract();
  const auto before = Images();
  WriteBlobs("left/0.png", 55);
  // These options would change the features if they were extracted again.
  FeatureExtractionOptions options;
  options.sift.max_num_features = 5;
  const FeatureExtractionSummary summary = Extract(options);
  EXPECT_EQ(summary.num_present, 3u);
  EXPECT_EQ(summary.num_extracted, 1u);
  auto after = Images();
  EXPECT_EQ(after["left/0.png"].keypoints.size(), 5u);
  EXPECT_EQ(after["left/0.png"].camera_id, after["left/1.png"].camera_id);
  after.erase("left/0.png");
  ExpectEqual(before, after);
}

TEST_F(FeatureExtractionTest, ResumesAfterAnInterruption) {
  for (uint64_t i = 0; i < 30; ++i) {
    WriteBlobs("cam" + std::to_string(i % 2) + "/" + std::to_string(i) + ".png",
               i);
  }
  Extract({}, "whole.db");
  bool is_canceled = false;
  Context context;
  context.progress = [&](const Progress& progress) {
    is_canceled = progress.done > 0;
  };
  context.is_canceled = [&] { return is_canceled; };
  EXPECT_THROW(ExtractWith(context, {}, "parts.db"), Interrupted);
  const size_t num_done = Images("parts.db").size();
  EXPECT_GT(num_done, 0u);
  EXPECT_LT(num_done, 30u);
  EXPECT_EQ(Extract({}, "parts.db").num_present, num_done);
  ExpectEqual(Images("whole.db"), Images("parts.db"));
}

TEST_F(FeatureExtractionTest, UsesTheImagesOfAList) {
  WriteFolders();
  FeatureExtractionOptions options;
  options.image_list_path = (dir_.path() / "list.txt").string();
  WriteTextFile(*options.image_list_path, "right/1.png\r\n\nleft/2.png\n");
  Extract(options);
  EXPECT_EQ(Images().size(), 2u);
  WriteTextFile(*options.image_list_path, "right/3.png\nright/1.png\n");
  Extract(options, "b.db");
  EXPECT_TRUE(IsWarned("right/3.png", "does not exist"));
}

}  // namespace
}  // namespace mgsfm
