// SPDX-License-Identifier: BSD-3-Clause
// Commands on finished models, on the truth of the demo.
#include <sqlite3.h>

#include <cmath>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <vector>

#include "base/random.h"
#include "cli/program_runs.h"
#include "geometry/so3.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class ModelTools : public CommandTest {
 protected:
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
  const std::string rigid = call + "--ref_model_path " + Path("placed") +
                            " --estimate_scale 0 --output_path ";
  ExpectRefused(rigid + Path("x"), AllOf(HasSubstr("differs in shape"),
                                         HasSubstr("of 96 common")));
  Run(rigid + Path("rigid") + " --robust_alignment 0");
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
  // A meter is about 9e-6 degrees of latitude everywhere.
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

// The earth-centered coordinates of a place, by the definition of WGS84.
Eigen::Vector3d EarthCentered(double latitude_deg, double longitude_deg,
                              double height_m) {
  const double e2 = 6.69437999014e-3;
  const double lat = DegToRad(latitude_deg), lon = DegToRad(longitude_deg);
  const double n = 6378137.0 / std::sqrt(1.0 - e2 * std::pow(std::sin(lat), 2));
  return {(n + height_m) * std::cos(lat) * std::cos(lon),
          (n + height_m) * std::cos(lat) * std::sin(lon),
          (n * (1.0 - e2) + height_m) * std::sin(lat)};
}

TEST_F(ModelTools, TypesOfAlignmentDifferInTheWorld) {
  const PoseModel truth = ReadModelPoses(DemoTruth());
  std::ostringstream lines;
  lines.precision(17);
  std::map<std::string, Eigen::Vector3d> place_of_image;
  for (const ModelImage& image : truth.images) {
    const Eigen::Vector3d c = image.cam_from_world.Center();
    place_of_image[image.name] = {47.0 + 9e-6 * c.z(), 8.0 + 13.2e-6 * c.x(),
                                  400.0 - c.y()};
    lines << image.name << ' ' << place_of_image[image.name].transpose()
          << '\n';
  }
  WriteTextFile(Path("gps.txt"), lines.str());
  const std::string call = "model_aligner --input_path " + DemoTruth() +
                           " --ref_images_path " + Path("gps.txt") +
                           " --alignment_type ";
  Run(call + "ecef --output_path " + Path("ecef"));
  EXPECT_FALSE(fs::exists(Path("ecef/geo_origin.json")));
  for (const ModelImage& image : ReadModelPoses(Path("ecef")).images) {
    const Eigen::Vector3d& place = place_of_image.at(image.name);
    EXPECT_LT((image.cam_from_world.Center() -
               EarthCentered(place.x(), place.y(), place.z()))
                  .norm(),
              0.05);  // degrees are no meters
  }
  // The origin is at the center of the points; places stay the same.
  Run(call + "enu-plane --output_path " + Path("plane"));
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  const Model plane = ReadModel(Path("plane"));
  for (const ModelPoint& point : plane.points) mean += point.point_in_world;
  EXPECT_LT(mean.norm() / static_cast<double>(plane.points.size()), 1e-3);
  Convert(Path("plane"), "path.json", "geojson");
  const auto json = nlohmann::json::parse(ReadTextFile(Path("path.json")));
  const auto& coordinates = json["features"][0]["geometry"]["coordinates"];
  for (size_t i = 0; i < coordinates.size(); ++i) {
    const Eigen::Vector3d& place = place_of_image.at(truth.images[i].name);
    EXPECT_NEAR(coordinates[i][1].get<double>(), place.x(), 2e-7);
    EXPECT_NEAR(coordinates[i][2].get<double>(), place.z(), 0.05);
  }
  // The unit of the model here is nearly the meter.
  Run(call + "enu-plane-unscaled --output_path " + Path("unscaled") +
      " --transform_path " + Path("sim3.txt"));
  EXPECT_DOUBLE_EQ(std::stod(ReadTextFile(Path("sim3.txt"))), 1.0);
  EXPECT_FALSE(fs::exists(Path("unscaled/geo_origin.json")));
  ExpectRefused(call + "ecef --ref_is_gps 0 --output_path " + Path("x"),
                HasSubstr("needs GPS"));
}

TEST_F(ModelTools, MostPositionsMayBeWrong) {
  WritePositions("ref.txt", 3.0);
  std::istringstream right(ReadTextFile(Path("ref.txt")));
  std::ostringstream wrong;
  Random random(1);
  int num_wrong = 0, num_lines = 0;
  for (std::string line; std::getline(right, line); ++num_lines) {
    if (num_lines % 8 < 5) {
      ++num_wrong;
      line = line.substr(0, line.find(' '));
      for (int k = 0; k < 3; ++k) {
        line += ' ' + std::to_string(200.0 * random.Uniform());
      }
    }
    wrong << line << '\n';
  }
  ASSERT_GT(2 * num_wrong, num_lines);
  WriteTextFile(Path("wrong.txt"), wrong.str());
  const std::string call = "model_aligner --input_path " + DemoTruth() +
                           " --ref_is_gps 0 --ref_images_path " +
                           Path("wrong.txt") + " --alignment_max_error 0.5 ";
  Run(call + "--transform_path " + Path("sim3.txt") + " --output_path " +
      Path("placed"));
  EXPECT_NEAR(std::stod(ReadTextFile(Path("sim3.txt"))), 3.0, 1e-6);
  Run(call + "--robust_alignment 0 --transform_path " + Path("sim3.txt") +
      " --output_path " + Path("squares"));
  EXPECT_GT(std::abs(std::stod(ReadTextFile(Path("sim3.txt"))) - 3.0), 0.1);
  ExpectRefused(call + "--min_common_images 30 --output_path " + Path("x"),
                HasSubstr("--min_common_images"));
  ExpectRefused(
      call + "--min_inlier_ratio 0.5 --output_path " + Path("x"),
      AllOf(HasSubstr("of 48 positions"), HasSubstr("--min_inlier_ratio")));
  ExpectRefused(
      call + "--robust_alignment_max_error 1 --output_path " + Path("x"),
      HasSubstr("--alignment_max_error"));
}

// Degrees would be 100 km each.
TEST_F(ModelTools, LengthsAreNotTakenForDegrees) {
  WritePositions("ref.txt", 30.0);
  Run("model_aligner --input_path " + DemoTruth() + " --ref_images_path " +
      Path("ref.txt") + " --transform_path " + Path("sim3.txt") +
      " --output_path " + Path("placed"));
  EXPECT_NEAR(std::stod(ReadTextFile(Path("sim3.txt"))), 30.0, 1e-6);
}

TEST_F(ModelTools, ModelsOfAnotherShapeAreNotAligned) {
  Convert(DemoTruth(), "other", "TXT");
  Random random(1);
  std::ostringstream lines;
  for (const ModelImage& image : ReadModelPoses(DemoTruth()).images) {
    lines << image.id.value() << " 1 0 0 0";
    for (int k = 0; k < 3; ++k) lines << ' ' << 50.0 * random.Uniform();
    lines << ' ' << image.camera_id.value() << ' ' << image.name << "\n\n";
  }
  WriteTextFile(Path("other/images.txt"), lines.str());
  WriteTextFile(Path("other/points3D.txt"), "");
  fs::remove(Path("other/rigs.txt"));
  fs::remove(Path("other/frames.txt"));
  ExpectRefused(
      "model_aligner --input_path " + DemoTruth() + " --ref_model_path " +
          Path("other") + " --output_path " + Path("x"),
      AllOf(HasSubstr("differs in shape"), HasSubstr("of 96 common")));
}

TEST_F(ModelTools, OriginsOfImageAndPositionAreMerged) {
  // One position is 0.1 off.
  WritePositions("ref.txt", 3.0);
  std::string lines = ReadTextFile(Path("ref.txt"));
  const size_t first = lines.find("cam0/000000.png");
  const size_t end = lines.find('\n', first);
  lines.replace(first, end - first, "cam0/000000.png 100.1 20 -3");
  WriteTextFile(Path("ref.txt"), lines);
  Run("model_aligner --input_path " + DemoTruth() +
      " --ref_is_gps 0 --merge_image_and_ref_origins 1 --ref_images_path " +
      Path("ref.txt") + " --output_path " + Path("placed"));
  const ModelImage image = ReadModelPoses(Path("placed")).images.front();
  ASSERT_EQ(image.name, "cam0/000000.png");
  EXPECT_LT((image.cam_from_world.Center() - Eigen::Vector3d(100.1, 20.0, -3.0))
                .norm(),
            1e-9);
}

// Replaces the table of priors by this direction of gravity in the world of the
// truth, and by places 1 m = 9e-6 degrees from (47, 8) for all images.
void WritePriors(const std::string& database, const Eigen::Vector3d& down) {
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(database.c_str(), &db), SQLITE_OK);
  const auto execute = [&](const std::string& sql) {
    EXPECT_EQ(sqlite3_exec(db, sql.c_str(), nullptr, nullptr, nullptr),
              SQLITE_OK)
        << sqlite3_errmsg(db);
  };
  const auto blob = [](const Eigen::Vector3d& v) {
    std::ostringstream hex;
    unsigned char bytes[sizeof(double) * 3];
    std::memcpy(bytes, v.data(), sizeof(bytes));
    for (const unsigned char byte : bytes) {
      hex << "0123456789ABCDEF"[byte / 16] << "0123456789ABCDEF"[byte % 16];
    }
    return "X'" + hex.str() + "'";
  };
  execute(
      "BEGIN; DROP TABLE IF EXISTS pose_priors; CREATE TABLE pose_priors "
      "(image_id "
      "INTEGER PRIMARY KEY NOT NULL, position BLOB, coordinate_system INTEGER "
      "NOT NULL, position_covariance BLOB, gravity BLOB);");
  for (const ModelImage& image : ReadModelPoses(DemoTruth()).images) {
    const Eigen::Vector3d c = image.cam_from_world.Center();
    execute("INSERT INTO pose_priors SELECT image_id, " +
            blob({47.0 + 9e-6 * c.z(), 8.0 + 13.2e-6 * c.x(), 400.0 - c.y()}) +
            ", 0, NULL, " + blob(image.cam_from_world.rotation * down) +
            " FROM images WHERE name = '" + image.name + "';");
  }
  execute("COMMIT;");
  sqlite3_close(db);
}

TEST_F(ModelTools, DatabasesHavePositionsAndGravity) {
  fs::copy_file(DemoDatabase(), Path("in.db"));
  const Eigen::Vector3d down = Eigen::Vector3d(0.2, 1.0, -0.1).normalized();
  WritePriors(Path("in.db"), down);
  const std::string call = "model_aligner --input_path " + DemoTruth() +
                           " --database_path " + Path("in.db") + " ";
  Run(call + "--alignment_type plane --use_prior_gravity 1 --transform_path " +
      Path("sim3.txt") + " --output_path " + Path("level"));
  std::istringstream numbers(ReadTextFile(Path("sim3.txt")));
  double scale = 0.0;
  Eigen::Quaterniond q;
  numbers >> scale >> q.w() >> q.x() >> q.y() >> q.z();
  EXPECT_EQ(scale, 1.0);
  EXPECT_LT((q * down + Eigen::Vector3d::UnitZ()).norm(), 1e-6);

  // A part of the model is in the same world, with the origin of the database.
  std::string early;
  for (const ModelImage& image : ReadModelPoses(DemoTruth()).images) {
    if (std::stoi(image.name.substr(5)) < 8) early += image.name + "\n";
  }
  WriteTextFile(Path("early.txt"), early);
  Run("image_deleter --input_path " + DemoTruth() + " --image_names_path " +
      Path("early.txt") + " --output_path " + Path("part"));
  Run(call + "--output_path " + Path("whole_enu"));
  Run("model_aligner --input_path " + Path("part") + " --database_path " +
      Path("in.db") + " --output_path " + Path("part_enu"));
  EXPECT_EQ(ReadTextFile(Path("whole_enu/geo_origin.json")),
            ReadTextFile(Path("part_enu/geo_origin.json")));
  // Degrees are no meters: over 20 m, they differ by a few centimeters.
  EXPECT_LT(MaxError(Path("part_enu"), Path("whole_enu"), "--alignment none"),
            0.05);
  Convert(Path("part_enu"), "path.kml", "kml");
  EXPECT_THAT(ReadTextFile(Path("path.kml")), HasSubstr("<coordinates>"));

  ExpectRefused(call + "--alignment_type plane --output_path " + Path("x"),
                HasSubstr("plane needs no reference"));
  ExpectRefused("model_aligner --input_path " + DemoTruth() +
                    " --alignment_type plane --use_prior_gravity 1 "
                    "--output_path " +
                    Path("x"),
                HasSubstr("--database_path"));
  ExpectRefused("model_aligner --input_path " + DemoTruth() +
                    " --alignment_type plane --use_prior_gravity 1 "
                    "--database_path " +
                    DemoDatabase() + " --output_path " + Path("x"),
                HasSubstr("gravity"));
}

TEST_F(ModelTools, TrajectoriesPlaceTheImagesOfADatabase) {
  std::string times;
  for (const ModelImage& image : ReadModelPoses(DemoTruth()).images) {
    times += image.name + ' ' +
             std::to_string(std::stoi(image.name.substr(5))) + ".25\n";
  }
  WriteTextFile(Path("times.txt"), times);
  const std::string time_flag = " --image_timestamps_path " + Path("times.txt");
  for (const char* type : {"tum", "euroc", "kitti"}) {
    const std::string poses = Path(std::string(type) + ".txt");
    const std::string model = Path(std::string("from_") + type);
    Run("model_converter --input_path " + DemoTruth() + " --output_path " +
        poses + " --output_type " + type + time_flag);
    const std::string call = "model_converter --input_path " + poses +
                             " --input_type " + type + time_flag;
    Run(call + " --database_path " + DemoDatabase() + " --rig_config_path " +
        DemoTruth() + " --output_path " + model);
    EXPECT_LT(MaxError(model, DemoTruth(), "--alignment none"), 1e-6);
    EXPECT_EQ(ReadModelPoses(model).images.size(), 96u);
    ExpectRefused(call + " --output_path " + Path("x"),
                  HasSubstr("--database_path"));
    ExpectRefused(call + " --database_path " + DemoDatabase() +
                      " --output_path " + Path("x"),
                  AllOf(HasSubstr("'cam1'"), HasSubstr("--rig_config_path")));
    WriteTextFile(poses, "1 2 3\n");
    ExpectRefused(call + " --database_path " + DemoDatabase() +
                      " --rig_config_path " + DemoTruth() + " --output_path " +
                      Path("x"),
                  AllOf(HasSubstr(poses), HasSubstr("line 1")));
  }
}

TEST_F(ModelTools, FilesOfOtherProgramsAreRecognized) {
  ExpectRefused("model_converter --input_path " + Path("none.nvm") +
                    " --output_path " + Path("x"),
                AllOf(HasSubstr("none.nvm"), HasSubstr("does not exist")));
  WriteTextFile(Path("a.xyz"), "");
  ExpectRefused("model_converter --input_path " + Path("a.xyz") +
                    " --output_path " + Path("x"),
                AllOf(HasSubstr("--input_type"), HasSubstr("bundler")));
  ExpectRefused("model_converter --input_type nvn --input_path " +
                    Path("a.xyz") + " --output_path " + Path("x"),
                AllOf(HasSubstr("'nvn'"), HasSubstr("nvm")));
  fs::create_directories(Path("images"));
  WriteTextFile(Path("images/1.jpg"), "P5 64 48 255\n");
  WriteTextFile(Path("a.nvm"), "NVM_V3\n1\n1.jpg 50 1 0 0 0 1 2 3 0 0\n0\n");
  const std::string call = "model_converter --input_path " + Path("a.nvm") +
                           " --image_path " + Path("images") +
                           " --output_path ";
  Run(call + Path("model"));
  const PoseModel model = ReadModelPoses(Path("model"));
  ASSERT_EQ(model.images.size(), 1u);
  EXPECT_LT((model.images[0].cam_from_world.Center() - Eigen::Vector3d(1, 2, 3))
                .norm(),
            1e-12);
  Run(call + Path("again.nvm") + " --output_type nvm");
  EXPECT_THAT(ReadTextFile(Path("again.nvm")),
              HasSubstr("1.jpg 50 1 0 0 0 1 2 3 0 0"));
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
  for (const char* input : {"first", "moved"}) {
    ExpectRefused("model_merger --input_path1 " + Path("first") +
                      " --input_path2 " + Path("moved") + " --output_path " +
                      Path(input),
                  HasSubstr("would replace"));
  }
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

TEST_F(ModelTools, FilesThatAConversionWouldNotReadAreNamed) {
  const std::string call = "model_converter --input_path " + DemoTruth() +
                           " --output_path " + Path("out.ply") +
                           " --output_type ply ";
  for (const char* option : {"image_path", "list_path", "database_path"}) {
    ExpectRefused(call + "--" + option + " " + DemoDatabase(),
                  AllOf(HasSubstr(option), HasSubstr("would not be read")));
  }
  EXPECT_FALSE(fs::exists(Path("out.ply")));
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
