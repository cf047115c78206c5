// SPDX-License-Identifier: BSD-3-Clause
// COLMAP 3.8 continues from models of mgsfm. Without COLMAP the tests are
// skipped; .ci/run installs it.
#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>

#include "cli/program_runs.h"
#include "files/image_reading.h"
#include "mgsfm/models/model_io.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr char kRendered[] = MGSFM_SOURCE_DIR "/data/rendered_rig";

class Colmap : public testing::Test {
 protected:
  void SetUp() override {
    if (RunShell("command -v colmap").exit_code != 0) {
      GTEST_SKIP() << "colmap is not installed";
    }
  }
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  void Run(const std::string& arguments) const {
    const CommandOutput output = RunMgsfm(arguments);
    ASSERT_EQ(output.exit_code, 0) << arguments << output.err;
  }
  // Returns what it prints.
  std::string RunColmap(const std::string& arguments) const {
    const CommandOutput output =
        RunShell("QT_QPA_PLATFORM=offscreen colmap " + arguments + " 2>&1");
    EXPECT_EQ(output.exit_code, 0) << arguments << output.out;
    return output.out;
  }
  double Statistic(const std::string& model, const std::string& name) const {
    const std::string text = RunColmap("model_analyzer --path " + model);
    std::smatch match;
    if (!std::regex_search(text, match, std::regex(name + ": ([0-9.]+)"))) {
      ADD_FAILURE() << text;
      return 0.0;
    }
    return std::stod(match[1]);
  }

  const TempDir dir_;
};

// The demo has perspective cameras and fisheyes.
TEST_F(Colmap, TriangulatesThePointsOfOurPoses) {
  // COLMAP adds tables to databases that it opens.
  fs::copy_file(DemoDatabase(), Path("demo.db"));
  for (const char* format : {"bin", "txt"}) {
    const std::string model = Path(format), points = Path("points") + format;
    Run("model_converter --input_path " + DemoTruth() + " --output_path " +
        model + " --output_type " + format);
    fs::create_directory(points);
    RunColmap("point_triangulator --database_path " + Path("demo.db") +
              " --image_path " + Path("") + " --input_path " + model +
              " --output_path " + points);
    const PoseModel before = ReadModelPoses(DemoTruth()),
                    after = ReadModelPoses(points);
    ASSERT_EQ(after.images.size(), before.images.size());
    for (size_t i = 0; i < after.images.size(); ++i) {
      EXPECT_LT((after.images[i].cam_from_world.Center() -
                 before.images[i].cam_from_world.Center())
                    .norm(),
                1e-9);
    }
    // The noise of the demo is 0.5 px; a wrong convention gives no points.
    EXPECT_GT(Statistic(points, "Points"), 0.5 * Statistic(model, "Points"));
    EXPECT_LT(Statistic(points, "Mean reprojection error"), 1.0);
  }
}

TEST_F(Colmap, ConvertsOurModels) {
  Run("model_converter --input_path " + DemoTruth() + " --output_path " +
      Path("ours") + " --output_type txt");
  fs::create_directory(Path("theirs"));
  RunColmap("model_converter --output_type TXT --input_path " + DemoTruth() +
            " --output_path " + Path("theirs"));
  const Model ours = ReadModel(Path("ours")),
              theirs = ReadModel(Path("theirs"));
  ASSERT_EQ(theirs.poses.images.size(), ours.poses.images.size());
  for (size_t i = 0; i < ours.poses.images.size(); ++i) {
    const ModelImage& image = ours.poses.images[i];
    const ModelImage& other = theirs.poses.images[i];
    EXPECT_EQ(other.name, image.name);
    EXPECT_LT(
        (other.cam_from_world.Center() - image.cam_from_world.Center()).norm(),
        1e-9);
  }
  EXPECT_EQ(theirs.points.size(), ours.points.size());
}

// Two frames of the rendered rig: pinhole images of our undistortion pass
// through COLMAP's as they are.
TEST_F(Colmap, UndistortsOurUndistortedImages) {
  std::string others;
  for (const ModelImage& image :
       ReadModelPoses(std::string(kRendered) + "/truth").images) {
    const int frame = std::stoi(image.name.substr(image.name.size() - 10, 6));
    if (frame > 1) others += image.name + "\n";
  }
  WriteTextFile(Path("others.txt"), others);
  Run("image_deleter --input_path " + std::string(kRendered) +
      "/truth --output_path " + Path("few") + " --image_names_path " +
      Path("others.txt"));
  Run("image_undistorter --image_path " + std::string(kRendered) +
      "/images --input_path " + Path("few") + " --output_path " + Path("ours"));
  RunColmap("image_undistorter --image_path " + Path("ours/images") +
            " --input_path " + Path("ours/sparse") + " --output_path " +
            Path("theirs"));
  const PoseModel model = ReadModelPoses(Path("theirs/sparse"));
  ASSERT_EQ(model.images.size(), 2u * (2 + 2 * 5));
  for (const ModelImage& image : model.images) {
    const auto ours =
        ReadImageSize(ReadTextFile(Path("ours/images/" + image.name)));
    const auto theirs =
        ReadImageSize(ReadTextFile(Path("theirs/images/" + image.name)));
    ASSERT_TRUE(ours && theirs) << image.name;
    EXPECT_EQ(theirs->width, ours->width);
    EXPECT_EQ(theirs->height, ours->height);
  }
}

// Features, matches and cameras of COLMAP, at focal lengths that it guesses.
TEST_F(Colmap, MakesDatabasesThatWeMap) {
  for (const char* camera : {"front_left", "front_right"}) {
    fs::create_directories(Path("images/") + camera);
    for (const char* file : {"/000000.jpg", "/000001.jpg", "/000002.jpg"}) {
      fs::copy_file(std::string(kRendered) + "/images/" + camera + file,
                    Path("images/") + camera + file);
    }
  }
  const std::string database = " --database_path " + Path("colmap.db");
  RunColmap(
      "feature_extractor --image_path " + Path("images") + database +
      " --ImageReader.single_camera_per_folder 1"
      " --SiftExtraction.use_gpu 0 --SiftExtraction.max_num_features 500");
  RunColmap("exhaustive_matcher --SiftMatching.use_gpu 0" + database);
  Run("mapper --write_report 0 --output_path " + Path("model") + database);
  Run("model_evaluator --input_path " + Path("model/0") + " --gt_path " +
      kRendered + "/truth --json " + Path("errors.json"));
  const auto errors = nlohmann::json::parse(ReadTextFile(Path("errors.json")));
  EXPECT_EQ(errors.at("num_registered"), 6) << errors;
  EXPECT_LT(errors.at("rotation_deg").at("mean"), 0.5) << errors;
  EXPECT_LT(errors.at("position_m").at("mean"), 0.02) << errors;
}

}  // namespace
}  // namespace mgsfm
