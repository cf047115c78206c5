// SPDX-License-Identifier: BSD-3-Clause
// `mgsfm mapper --input_path` and `mgsfm point_triangulator` as users run them,
// on the demo: 24 frames of four cameras.
#include <sqlite3.h>

#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "cli/program_runs.h"
#include "geometry/so3.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Matcher;
using Json = nlohmann::json;

// With a model of the first 14 frames, made once for all tests.
class GoingOnCommand : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new TempDir();
    std::string list;
    for (const ModelImage& image : ReadModelPoses(DemoTruth()).images) {
      const size_t dot = image.name.rfind('.');
      if (std::stoi(image.name.substr(dot - 6, 6)) < 14) {
        list += image.name + "\n";
      }
    }
    WriteTextFile(shared_->path() / "list.txt", list);
    const CommandOutput output = RunMgsfm(
        "mapper --database_path " + DemoDatabase() + " --output_path " +
        shared_->path().string() + "/first --image_list_path " + List());
    ASSERT_EQ(output.exit_code, 0) << output.err;
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }
  static std::string List() { return (shared_->path() / "list.txt").string(); }
  static std::string First() {
    return (shared_->path() / "first" / "0").string();
  }
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string Out() const { return Path("out"); }
  CommandOutput Run(const std::string& command, const std::string& input,
                    const std::string& more_flags = "") const {
    return RunMgsfm(command + " --database_path " + DemoDatabase() +
                    " --input_path " + input + " --output_path " + Out() + " " +
                    more_flags);
  }
  Json ErrorsOf(const std::string& model) const {
    const CommandOutput output =
        RunMgsfm("model_evaluator --input_path " + model + " --gt_path " +
                 DemoTruth() + " --json " + Path("errors.json"));
    EXPECT_EQ(output.exit_code, 0) << output.err;
    return Json::parse(ReadTextFile(Path("errors.json")));
  }
  void ExpectRefused(const CommandOutput& output,
                     const Matcher<std::string>& message) const {
    EXPECT_EQ(output.exit_code, 1) << output.err;
    EXPECT_THAT(LastWord(output), message) << output.err;
    EXPECT_FALSE(fs::exists(Out()));
  }

  static inline TempDir* shared_ = nullptr;
  const TempDir dir_;
};

TEST_F(GoingOnCommand, TheListSaysWhichImagesAreMapped) {
  EXPECT_EQ(ReadModelPoses(First()).images.size(), 14u * 4u);
}

TEST_F(GoingOnCommand, TheOtherImagesAreAdded) {
  const CommandOutput output = Run("mapper", First());
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const Json errors = ErrorsOf(Out() + "/0");
  EXPECT_EQ(errors["num_registered"], errors["num_images"]);
  EXPECT_LT(errors["position_m"]["max"], 0.1);
  EXPECT_LT(errors["rotation_deg"]["max"], 0.1);
  const Json report = Json::parse(ReadTextFile(Out() + "/report.json"));
  EXPECT_EQ(report["input"]["input_path"], First());
  EXPECT_FALSE(report.contains("rotation_averaging"));
  const Json& extension = report["models"][0]["extension"];
  EXPECT_EQ(extension["num_existing_frames"], 14);
  EXPECT_EQ(extension["added_frames"].size(), 10u);
  EXPECT_EQ(report["unregistered_frames"].size(), 0u);
}

void ExpectSamePoses(const PoseModel& model, const PoseModel& old_model,
                     double max_difference) {
  size_t k = 0;
  for (const ModelImage& image : old_model.images) {
    while (k < model.images.size() && model.images[k].name != image.name) ++k;
    ASSERT_LT(k, model.images.size());
    const Rigid3& pose = model.images[k].cam_from_world;
    EXPECT_LE(AngleBetween(pose.rotation, image.cam_from_world.rotation),
              max_difference);
    EXPECT_LE((pose.translation - image.cam_from_world.translation).norm(),
              max_difference);
  }
}

TEST_F(GoingOnCommand, FixedFramesStay) {
  const CommandOutput output =
      Run("mapper", First(), "--Mapper.fix_existing_frames 1");
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const PoseModel model = ReadModelPoses(Out() + "/0");
  EXPECT_EQ(model.images.size(), 24u * 4u);
  ExpectSamePoses(model, ReadModelPoses(First()), 1e-12);
}

TEST_F(GoingOnCommand, GeoOriginIsKept) {
  fs::copy(First(), Path("in"));
  WriteTextFile(Path("in/geo_origin.json"), "{}");
  ASSERT_EQ(Run("mapper", Path("in")).exit_code, 0);
  EXPECT_EQ(ReadTextFile(Out() + "/0/geo_origin.json"), "{}");
}

TEST_F(GoingOnCommand, BadInputIsExitCode1AndWritesNothing) {
  ExpectRefused(Run("mapper", Path("none")), HasSubstr(Path("none")));
  ExpectRefused(Run("mapper", First(), "--image_list_path " + Path("none")),
                HasSubstr(Path("none")));
  WriteTextFile(Path("list"), "cam9/000000.png\n");
  ExpectRefused(Run("mapper", First(), "--image_list_path " + Path("list")),
                AllOf(HasSubstr("'cam9/000000.png'"), HasSubstr(Path("list"))));
  WriteTextFile(Path("list"), "\n");
  ExpectRefused(Run("mapper", First(), "--image_list_path " + Path("list")),
                HasSubstr("lists no image"));
  ExpectRefused(Run("mapper", First(), "--rig_name_rule none"),
                AllOf(HasSubstr(First()), HasSubstr("rig_config_path")));
  // A database of other images.
  fs::create_directory(Path("in"));
  WriteTextFile(Path("in/cameras.txt"),
                "1 SIMPLE_PINHOLE 640 480 500 320 240\n");
  WriteTextFile(Path("in/images.txt"), "1 1 0 0 0 0 0 0 1 a.png\n\n");
  WriteTextFile(Path("in/points3D.txt"), "");
  ExpectRefused(Run("mapper", Path("in")),
                AllOf(HasSubstr(Path("in")), HasSubstr("'a.png'"),
                      HasSubstr(DemoDatabase())));
  ExpectRefused(Run("point_triangulator", Path("in")), HasSubstr("'a.png'"));
  // A database with another camera.
  WriteTextFile(Path("in/images.txt"),
                "1 1 0 0 0 0 0 0 1 " +
                    ReadModelPoses(DemoTruth()).images[0].name + "\n\n");
  ExpectRefused(Run("mapper", Path("in")), HasSubstr("SIMPLE_PINHOLE of 640"));
}

// The mapper chooses camera models for unknown lenses and those of EXIF, so the
// model and the database that it was made from can differ.
TEST_F(GoingOnCommand, UnknownLensesAreThoseOfTheModel) {
  const std::string database = Path("database.db");
  fs::copy(DemoDatabase(), database);
  const auto set_cameras = [&](int prior_focal_length, double k) {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(database.c_str(), &db), SQLITE_OK);
    sqlite3_stmt* row = nullptr;
    ASSERT_EQ(sqlite3_prepare_v2(db,
                                 "UPDATE cameras SET model = 2, params = ?, "
                                 "prior_focal_length = ? WHERE width = 1226",
                                 -1, &row, nullptr),
              SQLITE_OK);
    const std::array<double, 4> params{500.0, 613.0, 185.0, k};
    sqlite3_bind_blob(row, 1, params.data(), sizeof(params), SQLITE_STATIC);
    sqlite3_bind_int(row, 2, prior_focal_length);
    EXPECT_EQ(sqlite3_step(row), SQLITE_DONE);
    sqlite3_finalize(row);
    sqlite3_close(db);
  };
  const auto extend = [&](const std::string& output_path) {
    return RunMgsfm("mapper --database_path " + database + " --input_path " +
                    First() + " --output_path " + output_path);
  };
  set_cameras(1, 0.1);
  ExpectRefused(extend(Out()), HasSubstr("SIMPLE_RADIAL of"));
  const Model first = ReadModel(First());
  for (const int prior_focal_length : {0, 1}) {
    set_cameras(prior_focal_length, 0.0);
    const std::string path = Out() + std::to_string(prior_focal_length);
    const CommandOutput output = extend(path);
    ASSERT_EQ(output.exit_code, 0) << output.err;
    const Model model = ReadModel(path + "/0");
    ASSERT_EQ(model.cameras.size(), first.cameras.size());
    for (size_t i = 0; i < model.cameras.size(); ++i) {
      EXPECT_EQ(model.cameras[i].model, first.cameras[i].model);
    }
    EXPECT_EQ(model.poses.images.size(), 24u * 4u);
  }
}

TEST_F(GoingOnCommand, PointsAreTriangulatedAndPosesHeld) {
  const CommandOutput output = Run("point_triangulator", DemoTruth());
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const Model truth = ReadModel(DemoTruth()), model = ReadModel(Out());
  ExpectSamePoses(model.poses, truth.poses, 1e-12);
  EXPECT_EQ(model.poses.images.size(), truth.poses.images.size());
  EXPECT_GT(model.points.size(), truth.points.size() / 4);
  const Json report = Json::parse(ReadTextFile(Out() + "/report.json"));
  EXPECT_EQ(report["models"][0]["num_points"], model.points.size());
  EXPECT_LT(report["models"][0]["mean_reprojection_error_px"], 2.0);
}

// COLMAP users do this with poses of another source, without any point.
TEST_F(GoingOnCommand, ModelsOfPosesAloneGetPoints) {
  fs::create_directory(Path("in"));
  const PoseModel truth = ReadModelPoses(DemoTruth());
  ASSERT_EQ(RunMgsfm("bundle_adjuster --output_format txt --input_path " +
                     DemoTruth() + " --output_path " + Path("text"))
                .exit_code,
            0);
  fs::copy(Path("text/cameras.txt"), Path("in/cameras.txt"));
  std::string images;
  char line[256];
  for (const ModelImage& image : truth.images) {
    const Eigen::Quaterniond& q = image.cam_from_world.rotation;
    const Eigen::Vector3d& t = image.cam_from_world.translation;
    std::snprintf(line, sizeof(line),
                  "%u %.17g %.17g %.17g %.17g %.17g %.17g "
                  "%.17g %u %s\n\n",
                  image.id.value(), q.w(), q.x(), q.y(), q.z(), t.x(), t.y(),
                  t.z(), image.camera_id.value(), image.name.c_str());
    images += line;
  }
  WriteTextFile(Path("in/images.txt"), images);
  WriteTextFile(Path("in/points3D.txt"), "");
  const CommandOutput output = Run("point_triangulator", Path("in"));
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const Model model = ReadModel(Out());
  ExpectSamePoses(model.poses, truth, 1e-12);
  EXPECT_GT(model.points.size(), 100u);
  ASSERT_FALSE(fs::exists(Out() + "/0"));

  fs::rename(Out(), Path("points"));
  const Matcher<std::string> remedy =
      AllOf(HasSubstr("no points"), HasSubstr("point_triangulator"));
  ExpectRefused(Run("mapper", Path("in")), remedy);
  ExpectRefused(Run("point_triangulator", Path("in"), "--clear_points 0"),
                remedy);
}

}  // namespace
}  // namespace mgsfm
