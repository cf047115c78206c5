// SPDX-License-Identifier: BSD-3-Clause
// The built program reconstructs a model from the images in data/rendered_rig.
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/program_runs.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

class ReconstructionTest : public testing::Test {
 protected:
  // The first frames of the two cameras that look ahead.
  void SetUp() override {
    const std::filesystem::path data = MGSFM_SOURCE_DIR "/data/rendered_rig";
    for (const char* const camera : {"front_left", "front_right"}) {
      std::filesystem::create_directories(Path("images") / camera);
      for (const auto& entry :
           std::filesystem::directory_iterator(data / "images" / camera)) {
        const auto name = entry.path().filename();
        if (name.stem().string() >= "000008") continue;
        std::filesystem::copy(entry.path(), Path("images") / camera / name);
      }
    }
    line_ = "automatic_reconstructor --image_path " + Path("images").string() +
            " --workspace_path " + Path("work").string() +
            " --ImageReader.camera_params_path " +
            (data / "cameras.txt").string() + " ";
    truth_ = (data / "truth").string();
  }
  std::filesystem::path Path(const std::string& name) const {
    return dir_.path() / name;
  }

  TempDir dir_;
  std::string line_, truth_;
};

TEST_F(ReconstructionTest, ImagesGiveTheRigAndItsPath) {
  const CommandOutput first = RunMgsfm(line_);
  ASSERT_EQ(first.exit_code, 0) << first.err;
  const std::string json_path = Path("errors.json").string();
  const CommandOutput evaluated = RunMgsfm(
      "model_evaluator --input_path " + Path("work/sparse/0").string() +
      " --gt_path " + truth_ + " --json " + json_path);
  ASSERT_EQ(evaluated.exit_code, 0) << evaluated.err;
  const auto errors = nlohmann::json::parse(ReadTextFile(json_path));
  EXPECT_EQ(errors.at("num_registered"), 16) << errors;
  EXPECT_LT(errors.at("position_m").at("mean"), 0.02) << errors;
  EXPECT_LT(errors.at("sensors").at(0).at("rotation_deg"), 0.2) << errors;

  // Existing features and matches are reused.
  const CommandOutput again = RunMgsfm(line_ + "--data_type individual");
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("16 images already had features"));
}

// What names of files and options tell is said before features are extracted.
TEST_F(ReconstructionTest, ErrorsComeBeforeTheWork) {
  const std::string config = Path("rig.json").string();
  WriteTextFile(config, R"([{"cameras": [
      {"image_prefix": "front_left/", "ref_sensor": true},
      {"image_prefix": "front_rigt/"}]}])");
  const std::string unknown = Path("unknown.txt").string();
  WriteTextFile(unknown,
                "front_left/000000.jpg 1 2 3\nfront_left/9.jpg 1 2 3\n");
  const std::string bad = Path("bad.txt").string();
  WriteTextFile(bad, "front_left/000000.jpg soon\n");
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"--ref_images_path " + unknown, "line 2: names the image"},
      {"--gravity_path " + unknown, "line 2: names the image"},
      {"--image_timestamps_path " + bad, "line 1: has 'soon'"},
      {"--VocabTree.vocab_tree_path none.bin", "'none.bin' (--VocabTree"},
      {"--rig_config_path " + config, "'front_rigt/'"},
      {"--rig_config_path none.json", "'none.json' (--rig_config_path)"},
      {"--rig_name_rule '(?<camera>a.*)/.*'", "does not match the image name"},
      {"--calibration_path a.yaml,b.yaml", "'a.yaml' (--calibration_path)"},
      {"--gravity_path none.txt", "'none.txt' (--gravity_path)"},
      {"--ImageReader.mask_path masks", "'masks' (--ImageReader.mask_path)"}};
  for (const auto& [option, message] : cases) {
    const CommandOutput output = RunMgsfm(line_ + option);
    EXPECT_EQ(output.exit_code, 1) << option;
    EXPECT_THAT(output.err, HasSubstr(message)) << option;
    EXPECT_FALSE(std::filesystem::exists(Path("work"))) << option;
  }
  // A folder that is no output of a mapper is named, too.
  std::filesystem::create_directory(Path("work"));
  WriteTextFile(Path("work") / "sparse", "");
  const CommandOutput output = RunMgsfm(line_);
  EXPECT_EQ(output.exit_code, 1);
  EXPECT_FALSE(std::filesystem::exists(Path("work") / "database.db"));
}

TEST_F(ReconstructionTest, BadUseIsNamed) {
  std::filesystem::remove_all(Path("images"));
  const CommandOutput output = RunMgsfm(line_);
  EXPECT_EQ(output.exit_code, 1);
  EXPECT_THAT(output.err, HasSubstr("--image_path"));
  EXPECT_FALSE(std::filesystem::exists(Path("work")));
}

}  // namespace
}  // namespace mgsfm
