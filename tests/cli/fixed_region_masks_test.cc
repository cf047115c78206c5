// SPDX-License-Identifier: BSD-3-Clause
// Masks of what moves along with the rig, as the mapper writes them.
#include "fixed_region_masks.h"

#include <gmock/gmock.h>

#include <opencv2/core.hpp>

#include "cli/shared_drive.h"
#include "files/image_masks.h"
#include "mgsfm/database/feature_database.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class FixedRegionMasks : public SharedDriveTest {
 protected:
  static void SetUpTestSuite() { Simulate("--world train --frame_rate 2"); }
  CommandOutput Map(const std::string& folder) const {
    return RunMgsfm("mapper --database_path " + Database() + " --output_path " +
                    Path("out") +
                    " --write_report 0 --fixed_region_mask_path " + folder);
  }
};

// The cabin fills a part of each image. The reader of masks finds it for all
// images of the folder.
TEST_F(FixedRegionMasks, CamerasGetTheMaskOfTheCabin) {
  const std::string folder = Path("masks");
  const CommandOutput output = Map(folder);
  ASSERT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.err,
              HasSubstr("'" + folder + "' to ImageReader.camera_mask_path"));
  std::vector<std::string> names;
  for (const ImageRow& image :
       FeatureDatabase(Database(), FeatureDatabase::OpenMode::kExisting)
           .ReadStructure(Context())
           .images) {
    names.push_back(image.name);
  }
  const ImageMasks masks({"", folder}, int64_t{1} << 30);
  masks.Check(names, "ImageReader.", Context());
  size_t num_masked = 0;
  for (const std::string& name : names) {
    const cv::Mat mask = masks.Read(name);
    if (mask.empty()) continue;
    const int num_hidden = mask.rows * mask.cols - cv::countNonZero(mask);
    EXPECT_GT(num_hidden, 0);
    EXPECT_LT(num_hidden, mask.rows * mask.cols);
    ++num_masked;
  }
  EXPECT_GT(num_masked, 0u);
}

// Cameras that share a folder, also by the folders around them.
TEST(WriteFixedRegionMasks, ImagesGetMasksIfFoldersDoNotTellTheirCameras) {
  for (const char* other : {"rig/b_1.jpg", "rig/b/1.jpg"}) {
    SCOPED_TRACE(other);
    Scene scene;
    scene.cameras = {
        {CameraId(1), CameraModelId::kPinhole, 64, 48, {50, 50, 32, 24}}};
    scene.images = {{ImageId(1), "rig/a_1.jpg", 0, 0, 0, {}},
                    {ImageId(2), other, 0, 1, 0, {}}};
    const TempDir dir;
    WriteFixedRegionMasks(dir.path(), scene, {{0, 1, 2, Mask{true, false}}},
                          Context());
    EXPECT_TRUE(fs::exists(dir.path() / "rig/a_1.jpg.png"));
    EXPECT_FALSE(fs::exists(dir.path() / "rig.png"));
    EXPECT_FALSE(fs::exists(dir.path() / (std::string(other) + ".png")));
  }
}

TEST_F(FixedRegionMasks, MasksOfTheUserAreKept) {
  fs::create_directories(Path("masks"));
  WriteTextFile(Path("masks") + "/mine.png", "mine");
  const CommandOutput output = Map(Path("masks"));
  EXPECT_EQ(output.exit_code, 1);
  EXPECT_THAT(output.err, HasSubstr("not an empty folder"));
  EXPECT_EQ(ReadTextFile(Path("masks") + "/mine.png"), "mine");
  EXPECT_FALSE(fs::exists(Path("out")));
}

}  // namespace
}  // namespace mgsfm
