// SPDX-License-Identifier: BSD-3-Clause
// Masks of what moves along with the rig, as the mapper writes them.
#include <gmock/gmock.h>

#include <map>

#include "cli/shared_drive.h"
#include "features/image_file.h"

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

// The cabin fills a part of each image. All images of a camera have one mask,
// which the reader of masks accepts.
TEST_F(FixedRegionMasks, ImagesOfOneCameraShareTheMaskOfTheCabin) {
  const std::string folder = Path("masks");
  const CommandOutput output = Map(folder);
  ASSERT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.err, HasSubstr("ImageReader.mask_path"));
  std::map<fs::path, GrayImage> mask_of_camera;
  size_t num_masks = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    const auto mask = ReadMask(entry.path(), int64_t{1} << 30);
    ASSERT_TRUE(mask.has_value()) << entry.path();
    const auto num_hidden = (mask->array() == 0).count();
    EXPECT_GT(num_hidden, 0);
    EXPECT_LT(num_hidden, mask->size());
    const auto [found, is_new] =
        mask_of_camera.emplace(entry.path().parent_path(), *mask);
    EXPECT_TRUE(is_new || found->second == *mask);
    ++num_masks;
  }
  EXPECT_GT(num_masks, mask_of_camera.size());
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
