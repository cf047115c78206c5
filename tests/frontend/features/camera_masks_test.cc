// SPDX-License-Identifier: BSD-3-Clause
// Masks of cameras: one per folder of images.
#include <gmock/gmock.h>

#include "frontend/features/extraction_fixture.h"
#include "support/error_of.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class CameraMasks : public ExtractionTest {
 protected:
  CameraMasks() {
    WriteBlobs("left/1.png", 11);
    WriteBlobs("left/2.png", 12);
    WriteBlobs("trip/right/1.png", 13);
    options_.reader.camera_mask_path = (dir_.path() / "cameras").string();
  }
  static cv::Mat White() { return cv::Mat(90, 120, CV_8U, cv::Scalar(255)); }
  static cv::Mat LeftHalf() {
    cv::Mat mask = White();
    mask.colRange(0, 60).setTo(0);
    return mask;
  }
  static cv::Mat UpperHalf() {
    cv::Mat mask = White();
    mask.rowRange(0, 45).setTo(0);
    return mask;
  }
  void WriteMask(const std::string& name, const cv::Mat& mask) const {
    const auto path = dir_.path() / name;
    std::filesystem::create_directories(path.parent_path());
    ASSERT_TRUE(cv::imwrite(path.string(), mask));
  }
  std::string Problem() {
    return ErrorOf([&] { Extract(options_, "problem.db"); });
  }

  FeatureExtractionOptions options_;
};

// Independent of each other and of the order, as for one mask of both.
TEST_F(CameraMasks, PixelsMustBeFreeInTheMasksOfImageAndCamera) {
  WriteMask("cameras/left.png", LeftHalf());
  WriteMask("cameras/trip.png", UpperHalf());  // of all folders below
  WriteMask("images_masks/left/1.png.png", UpperHalf());
  options_.reader.mask_path = (dir_.path() / "images_masks").string();
  Extract(options_, "camera.db");

  FeatureExtractionOptions by_image;
  by_image.reader.mask_path = (dir_.path() / "both").string();
  WriteMask("both/left/1.png.png", LeftHalf() & UpperHalf());
  WriteMask("both/left/2.png.png", LeftHalf());
  WriteMask("both/trip/right/1.png.png", UpperHalf());
  Extract(by_image, "image.db");
  ExpectEqual(Images("camera.db"), Images("image.db"));
  for (const auto& [name, image] : Images("camera.db")) {
    EXPECT_FALSE(image.keypoints.empty()) << name;
  }
  Extract({}, "all.db");
  warnings_.clear();
  Extract(options_, "all.db");
  EXPECT_THAT(warnings_,
              testing::Contains(HasSubstr("features of 3 of 3 images were")));
}

TEST_F(CameraMasks, FoldersWithoutMaskAndMisspelledMasksAreNamed) {
  std::filesystem::create_directory(dir_.path() / "cameras");
  EXPECT_THAT(Problem(), AllOf(HasSubstr("no folder of images has a mask"),
                               HasSubstr("ImageReader.camera_mask_path"),
                               HasSubstr("name its mask 'trip/right.png'")));
  WriteMask("cameras/left.png", LeftHalf());
  WriteMask("cameras/rigth.png", LeftHalf());
  Extract(options_);
  EXPECT_THAT(warnings_,
              ElementsAre(AllOf(HasSubstr("1 of 2 folders of images"),
                                HasSubstr("'trip/right.png'"),
                                HasSubstr("'rigth.png' is named after no"))));
}

TEST_F(CameraMasks, UselessAndDamagedMasksAreNamed) {
  WriteMask("cameras/left.png", White());
  WriteMask("cameras/trip.png", cv::Mat(90, 120, CV_8U, cv::Scalar(0)));
  Extract(options_);
  EXPECT_THAT(warnings_,
              testing::IsSupersetOf(
                  {HasSubstr("1 of 2 masks in"), HasSubstr("1 of 2 masks in"),
                   HasSubstr("'trip/right/1.png' has no features")}));
  WriteTextFile(dir_.path() / "cameras/left.png", "no image");
  EXPECT_THAT(Problem(), AllOf(HasSubstr("cameras/left.png"),
                               HasSubstr("ImageReader.camera_mask_path")));
  options_.reader.camera_mask_path = (dir_.path() / "nowhere").string();
  EXPECT_THAT(Problem(), HasSubstr("neither a file nor a folder"));
}

TEST_F(CameraMasks, ImagesOfAnotherSizeAreRejected) {
  WriteMask("cameras/left.png", LeftHalf());
  WriteMask("cameras/trip.png", cv::Mat(90, 100, CV_8U, cv::Scalar(1)));
  EXPECT_EQ(Extract(options_).num_rejected, 1u);
  EXPECT_TRUE(IsWarned("trip/right/1.png", "trip.png' has 100 x 90"));
}

// In a folder among those of images, beside those folders, or a single file.
TEST_F(CameraMasks, MasksAmongTheImagesAreNoImages) {
  Extract({}, "all.db");
  for (const char* folder : {"masks/", ""}) {
    for (const char* name : {"left.png", "trip.png"}) {
      WriteMask("images/" + std::string(folder) + name, White());
    }
    options_.reader.camera_mask_path = ImagePath(folder).string();
    const std::string database = folder + std::string("x.db");
    std::filesystem::create_directory(dir_.path() / "masks");
    Extract(options_, database);
    ExpectEqual(Images(database), Images("all.db"));
    std::filesystem::remove_all(ImagePath("masks"));
  }
  std::filesystem::remove(ImagePath("trip.png"));
  options_.reader.camera_mask_path = ImagePath("left.png").string();
  Extract(options_, "file.db");
  ExpectEqual(Images("file.db"), Images("all.db"));
}

TEST_F(CameraMasks, ImagesInNoFolderNeedTheFileOfAMask) {
  WriteBlobs("1.png", 14);
  WriteMask("cameras/left.png", LeftHalf());
  WriteMask("cameras/trip/right.png", LeftHalf());
  Extract(options_);
  EXPECT_THAT(warnings_,
              ElementsAre(HasSubstr("the image folder itself; give the file")));
}

}  // namespace
}  // namespace mgsfm
