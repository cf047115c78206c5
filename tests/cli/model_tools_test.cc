// SPDX-License-Identifier: BSD-3-Clause
// Commands on finished models, on the truth of the demo.
#include <nlohmann/json.hpp>
#include <sstream>
#include <vector>

#include "base/random.h"
#include "cli/program_runs.h"
#include "geometry/so3.h"
#include "mgsfm/io/models/model_io.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class ModelTools : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  CommandOutput Run(const std::string& arguments) const {
    const CommandOutput output = RunMgsfm(arguments);
    EXPECT_EQ(output.exit_code, 0) << arguments << output.err;
    return output;
  }
  // One line with the text; no file has changed.
  void ExpectRefused(const std::string& arguments,
                     const testing::Matcher<std::string>& message) const {
    const Files before = FilesIn(dir_.path());
    const CommandOutput output = RunMgsfm(arguments);
    EXPECT_EQ(output.exit_code, 1) << arguments;
    EXPECT_THAT(LastWord(output), message) << arguments << output.err;
    EXPECT_TRUE(FilesIn(dir_.path()) == before) << arguments;
  }
  void Convert(const std::string& input, const std::string& output,
               const std::string& type) const {
    Run("model_converter --input_path " + input + " --output_path " +
        Path(output) + " --output_type " + type);
  }
  double MaxError(const std::string& model, const std::string& truth,
                  const std::string& more = "") const {
    Run("model_evaluator --input_path " + model + " --gt_path " + truth +
        " --json " + Path("errors.json") + " " + more);
    return nlohmann::json::parse(
        ReadTextFile(Path("errors.json")))["position_m"]["max"];
  }
  // "image_name X Y Z" of the images of cam0 and cam2, in another world.
  void WritePositions(const std::string& name, double scale) const {
    const PoseModel truth = ReadModelPoses(DemoTruth());
    std::ostringstream lines;
    lines.precision(17);
    lines << "elsewhere/1.jpg 1 2 3\n";
    for (const ModelImage& image : truth.images) {
      if (image.name[3] != '0' && image.name[3] != '2') continue;
      const Eigen::Vector3d position =
          scale * (ExpSO3({0.3, -1.0, 0.5}) * image.cam_from_world.Center()) +
          Eigen::Vector3d(100.0, 20.0, -3.0);
      lines << image.name << ' ' << position.transpose() << '\n';
    }
    WriteTextFile(Path(name), lines.str());
  }

  const TempDir dir_;
};

void ExpectEqual(const PoseModel& a, const PoseModel& b) {
  ASSERT_EQ(a.images.size(), b.images.size());
  for (size_t i = 0; i < a.images.size(); ++i) {
    EXPECT_EQ(a.images[i].name, b.images[i].name);
    EXPECT_EQ(a.images[i].id, b.images[i].id);
    EXPECT_EQ(a.images[i].camera_id, b.images[i].camera_id);
    EXPECT_LT((a.images[i].cam_from_world.Center() -
               b.images[i].cam_from_world.Center())
                  .norm(),
              1e-12);
  }
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (size_t i = 0; i < a.frames.size(); ++i) {
    EXPECT_EQ(a.frames[i].id, b.frames[i].id);
    EXPECT_EQ(a.frames[i].image_ids.size(), b.frames[i].image_ids.size());
  }
  ASSERT_EQ(a.rigs.size(), b.rigs.size());
  EXPECT_EQ(a.rigs[0].sensors.size(), b.rigs[0].sensors.size());
}

TEST_F(ModelTools, TextAndBinaryHoldTheSameModel) {
  Convert(DemoTruth(), "text", "TXT");
  Convert(Path("text"), "binary", "BIN");
  EXPECT_TRUE(fs::exists(Path("text/images.txt")));
  ExpectEqual(ReadModelPoses(Path("text")), ReadModelPoses(DemoTruth()));
  ExpectEqual(ReadModelPoses(Path("binary")), ReadModelPoses(DemoTruth()));
  const Model before = ReadModel(DemoTruth()),
              after = ReadModel(Path("binary"));
  ASSERT_EQ(after.points.size(), before.points.size());
  for (size_t i = 0; i < before.points.size(); ++i) {
    EXPECT_EQ(after.points[i].point_in_world, before.points[i].point_in_world);
    EXPECT_EQ(after.points[i].track.size(), before.points[i].track.size());
  }
}

TEST_F(ModelTools, ModelsWithoutRigsKeepTheirPoses) {
  fs::copy(DemoTruth(), Path("single"), fs::copy_options::recursive);
  fs::remove(Path("single/rigs.bin"));
  fs::remove(Path("single/frames.bin"));
  Convert(Path("single"), "out", "bin");
  EXPECT_EQ(ReadModelPoses(Path("out")).rigs.size(), 4u);
  EXPECT_LT(MaxError(Path("out"), DemoTruth(), "--alignment none"), 1e-12);
  ExpectRefused("model_converter --input_path " + Path("single") +
                    " --output_path " + Path("chain.yaml") +
                    " --output_type kalibr",
                AllOf(HasSubstr("4"), HasSubstr("cam3")));
}

TEST_F(ModelTools, BadExportsWriteNothing) {
  const std::string call =
      "model_converter --input_path " + DemoTruth() + " --output_path ";
  ExpectRefused(call + Path("x") + " --output_type kmz", HasSubstr("kml"));
  ExpectRefused(call + Path("x") + " --output_type nvm", HasSubstr("cam2"));
  ExpectRefused(call + Path("x") + " --output_type kml",
                HasSubstr("geo_origin.json"));
  ExpectRefused(call + Path("x") + " --output_type kml --origin 91,0,0",
                HasSubstr("--origin"));
  ExpectRefused(call + Path("images.txt") + " --output_type tum",
                HasSubstr("choose another"));
  fs::create_directory(Path("folder"));
  ExpectRefused(call + Path("folder") + " --output_type tum",
                HasSubstr("is a folder"));
  fs::copy(DemoTruth(), Path("model"), fs::copy_options::recursive);
  for (const char* tool : {"model_converter",
                           "model_aligner --alignment_type "
                           "plane"}) {
    ExpectRefused(std::string(tool) + " --input_path " + Path("model") +
                      " --output_path " + Path("model"),
                  HasSubstr("choose another"));
  }
}

TEST_F(ModelTools, AlignsToPositionsAndToModels) {
  WritePositions("ref.txt", 3.0);
  const std::string call = "model_aligner --input_path " + DemoTruth() + " ";
  Run(call + "--ref_images_path " + Path("ref.txt") +
      " --ref_is_gps 0 --transform_path " + Path("sim3.txt") +
      " --output_path " + Path("placed"));
  std::istringstream transform(ReadTextFile(Path("sim3.txt")));
  double scale = 0.0;
  transform >> scale;
  EXPECT_NEAR(scale, 3.0, 1e-6);
  EXPECT_LT(MaxError(Path("placed"), DemoTruth()), 1e-6);
  for (const ModelImage& image : ReadModelPoses(Path("placed")).images) {
    if (image.name != "cam0/000000.png") continue;
    // The first camera of the truth is at its origin.
    EXPECT_LT(
        (image.cam_from_world.Center() - Eigen::Vector3d(100.0, 20.0, -3.0))
            .norm(),
        1e-6);
  }
  Run(call + "--ref_model_path " + Path("placed") + " --output_path " +
      Path("again"));
  EXPECT_LT(MaxError(Path("again"), Path("placed"), "--alignment none"), 1e-6);
  // Without a change of the unit, the model does not fit.
  Run(call + "--ref_model_path " + Path("placed") +
      " --estimate_scale 0 --output_path " + Path("rigid"));
  EXPECT_GT(MaxError(Path("rigid"), Path("placed"), "--alignment none"), 1.0);

  ExpectRefused(call + "--output_path " + Path("x"), HasSubstr("give one of"));
  ExpectRefused(call + "--output_path " + Path("x") + " --ref_images_path " +
                    Path("ref.txt") + " --min_common_images 49 --ref_is_gps 0",
                HasSubstr("48 images"));
  ExpectRefused(call + "--output_path " + Path("x") + " --ref_images_path " +
                    Path("ref.txt") + " --alignment_type enu --ref_is_gps 0",
                HasSubstr("enu"));
  ExpectRefused(call + "--output_path " + Path("x") + " --database_path " +
                    DemoDatabase(),
                HasSubstr("no positions"));
}

TEST_F(ModelTools, PlacesModelsOnTheEarth) {
  const PoseModel truth = ReadModelPoses(DemoTruth());
  std::ostringstream lines;
  lines.precision(17);
  // A metre is about 9e-6 degrees of latitude everywhere.
  for (const ModelImage& image : truth.images) {
    const Eigen::Vector3d c = image.cam_from_world.Center();
    lines << image.name << ' ' << 47.0 + 9e-6 * c.z() << ' '
          << 8.0 + 13.2e-6 * c.x() << ' ' << 400.0 - c.y() << '\n';
  }
  WriteTextFile(Path("gps.txt"), lines.str());
  Run("model_aligner --input_path " + DemoTruth() + " --ref_images_path " +
      Path("gps.txt") + " --alignment_type enu --output_path " + Path("enu"));
  Convert(Path("enu"), "path.json", "geojson");
  const auto json = nlohmann::json::parse(ReadTextFile(Path("path.json")));
  const auto& coordinates = json["features"][0]["geometry"]["coordinates"];
  ASSERT_EQ(coordinates.size(), 24u);
  for (size_t i = 0; i < coordinates.size(); ++i) {
    const Eigen::Vector3d c = truth.images[i].cam_from_world.Center();
    EXPECT_NEAR(coordinates[i][1].get<double>(), 47.0 + 9e-6 * c.z(), 2e-7);
    EXPECT_NEAR(coordinates[i][0].get<double>(), 8.0 + 13.2e-6 * c.x(), 2e-7);
  }
}

TEST_F(ModelTools, PartsMergeToTheWhole) {
  std::string early, late;
  for (const ModelImage& image : ReadModelPoses(DemoTruth()).images) {
    const int frame = std::stoi(image.name.substr(5));
    if (frame < 8) early += image.name + "\n";
    if (frame > 14) late += image.name + "\n";
  }
  WriteTextFile(Path("early.txt"), early);
  WriteTextFile(Path("late.txt"), late);
  const std::string deleter =
      "image_deleter --input_path " + DemoTruth() + " --image_names_path ";
  Run(deleter + Path("late.txt") + " --output_path " + Path("first"));
  Run(deleter + Path("early.txt") + " --output_path " + Path("second"));
  Run("model_aligner --alignment_type plane --input_path " + Path("second") +
      " --output_path " + Path("moved"));
  Run("model_merger --input_path1 " + Path("first") + " --input_path2 " +
      Path("moved") + " --output_path " + Path("merged"));
  EXPECT_LT(MaxError(Path("merged"), DemoTruth(), "--alignment none"), 1e-6);
  const PoseModel merged = ReadModelPoses(Path("merged"));
  EXPECT_EQ(merged.rigs.size(), 1u);
  EXPECT_EQ(merged.frames.size(), 24u);
  EXPECT_EQ(merged.images.size(), 96u);
  ExpectRefused(deleter + Path("none.txt") + " --output_path " + Path("x"),
                HasSubstr("none.txt"));
  WriteTextFile(Path("bad.txt"), "cam0/nowhere.png\n");
  ExpectRefused(deleter + Path("bad.txt") + " --output_path " + Path("x"),
                AllOf(HasSubstr("bad.txt"), HasSubstr("cam0/nowhere.png")));
  const std::string cropper =
      "model_cropper --input_path " + DemoTruth() + " --output_path ";
  Run(cropper + Path("cropped") + " --boundary 0,0.5");
  EXPECT_LT(ReadModel(Path("cropped")).points.size(),
            ReadModel(DemoTruth()).points.size());
  ExpectRefused(cropper + Path("x") + " --boundary 1,2,3",
                HasSubstr("--boundary"));
  ExpectRefused(cropper + Path("x") + " --boundary 0,0,0,0,0,0",
                HasSubstr("no point"));
}

TEST_F(ModelTools, CountsWhatColmapCounts) {
  const std::string ours = Run("model_analyzer --path " + DemoTruth()).out;
  EXPECT_THAT(ours, HasSubstr("Rigs: 1\n"));
  EXPECT_THAT(ours, HasSubstr("Frames: 24\n"));
  EXPECT_THAT(ours, HasSubstr("cam0: 24 images, reference\n"));
  if (RunShell("command -v colmap").exit_code != 0) {
    GTEST_SKIP() << "colmap is not installed";
  }
  Convert(DemoTruth(), "text", "TXT");
  const std::string colmap =
      RunShell("QT_QPA_PLATFORM=offscreen colmap model_analyzer --path " +
               Path("text") + " 2>&1")
          .out;
  std::istringstream lines(ours);
  int num_lines = 0;
  for (std::string line; std::getline(lines, line);) {
    for (const char* key : {"Cameras:", "Images:", "Registered images:",
                            "Points:", "Observations:", "Mean track length:",
                            "Mean observations per image:"}) {
      if (line.rfind(key, 0) != 0) continue;
      EXPECT_THAT(colmap, HasSubstr(line + "\n"));
      ++num_lines;
    }
  }
  EXPECT_EQ(num_lines, 7);
}

TEST_F(ModelTools, DatabasesAreMergedAndCleaned) {
  fs::copy_file(DemoDatabase(), Path("in.db"));
  const std::string call = "database_merger --database_path1 " + Path("in.db") +
                           " --database_path2 ";
  ExpectRefused(call + DemoDatabase() + " --image_prefix a/ " +
                    "--merged_database_path " + Path("out.db"),
                HasSubstr("1 values for 2 databases"));
  ExpectRefused(
      call + DemoDatabase() + " --merged_database_path " + Path("in.db"),
      HasSubstr("choose another"));
  ExpectRefused(
      "database_cleaner --type nothing --database_path " + Path("in.db"),
      HasSubstr("--type"));
  Run("database_cleaner --type matches --database_path " + Path("in.db"));
  EXPECT_EQ(RunMgsfm("mapper --database_path " + Path("in.db") +
                     " --output_path " + Path("model"))
                .exit_code,
            2);
}

}  // namespace
}  // namespace mgsfm
