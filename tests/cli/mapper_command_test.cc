// SPDX-License-Identifier: BSD-3-Clause
// The mapper command: its input, output, messages, and files that it must keep.
#include <nlohmann/json.hpp>

#include "cli/shared_drive.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using Json = nlohmann::json;

class MapperCommand : public SharedDriveTest {
 protected:
  static void SetUpTestSuite() {
    Simulate(
        "--rig kitti360 --num_frames 12 --max_num_features 150 "
        "--pixel_noise 0.3");
  }
  std::string Out() const { return Path("out"); }
  CommandOutput Map(const std::string& more_flags = "") const {
    return MapFrom(Database(), more_flags);
  }
  CommandOutput MapFrom(const std::string& database,
                        const std::string& more_flags = "") const {
    return RunMgsfm("mapper --database_path " + database + " --output_path " +
                    Out() + " " + more_flags);
  }
  Json Report() const {
    return Json::parse(ReadTextFile(Out() + "/report.json"));
  }
  // Errors of one model relative to another.
  Json Evaluate(const std::string& model, const std::string& truth) const {
    const std::string json = Path("evaluation.json");
    const CommandOutput output =
        RunMgsfm("model_evaluator --input_path " + model + " --gt_path " +
                 truth + " --json " + json);
    EXPECT_EQ(output.exit_code, 0) << output.err;
    EXPECT_THAT(output.out, HasSubstr("registered"));
    return Json::parse(ReadTextFile(json));
  }
  // A model of an earlier run and a file of the user.
  void PutEarlierOutput() const {
    fs::create_directories(Out() + "/0");
    WriteTextFile(Out() + "/0/images.bin", "earlier");
    WriteTextFile(Out() + "/report.json", "earlier");
    WriteTextFile(Out() + "/notes.txt", "mine");
  }
  void ExpectRefused(const CommandOutput& output, const std::string& message,
                     const Files& before) const {
    EXPECT_EQ(output.exit_code, 1) << output.err;
    EXPECT_THAT(LastWord(output), HasSubstr(message)) << output.err;
    EXPECT_TRUE(FilesIn(dir_.path()) == before) << message;
  }
};

TEST_F(MapperCommand, ModelOfASmallDriveAgreesWithTheTruth) {
  const CommandOutput output = Map();
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const Json errors = Evaluate(Out() + "/0", In() + "/truth");
  EXPECT_EQ(errors["num_images"], 48);
  EXPECT_EQ(errors["num_registered"], 48);
  EXPECT_LT(errors["position_m"]["max"], 0.05);
  EXPECT_LT(errors["rotation_deg"]["max"], 0.1);
  ASSERT_EQ(errors["sensors"].size(), 3u);
  for (const Json& sensor : errors["sensors"]) {
    EXPECT_LT(sensor["rotation_deg"], 0.1);
    EXPECT_NEAR(sensor["length_m"], sensor["true_length_m"], 0.03);
  }
}

TEST_F(MapperCommand, IncrementalModelAgreesWithTheTruth) {
  const CommandOutput output = Map("--method incremental");
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const Json errors = Evaluate(Out() + "/0", In() + "/truth");
  EXPECT_EQ(errors["num_registered"], 48);
  EXPECT_LT(errors["position_m"]["max"], 0.05);
  EXPECT_LT(errors["rotation_deg"]["max"], 0.1);
  const Json report = Report();
  EXPECT_FALSE(report.contains("rotation_averaging"));
  const Json& placed = report["incremental"]["placed_sensors"];
  ASSERT_EQ(placed.size(), 3u);
  for (const Json& sensor : placed) EXPECT_GE(sensor["num_frames"], 1);
}

TEST_F(MapperCommand, ReportSaysWhatWasDoneAndHowWell) {
  ASSERT_EQ(Map("--random_seed 3").exit_code, 0);
  const Json report = Report();
  EXPECT_EQ(report["random_seed"], 3);
  EXPECT_EQ(report["input"]["num_frames"], 12);
  EXPECT_EQ(report["input"]["num_images"], 48);
  EXPECT_GT(report["input"]["num_pairs"], 0);
  EXPECT_GT(report["input"]["num_matches"], 0);
  EXPECT_GT(report["peak_memory_mib"], 1.0);
  for (const char* stage :
       {"reading", "view graph", "rotation averaging", "writing"}) {
    EXPECT_TRUE(report["seconds"][stage].is_number()) << stage;
    EXPECT_GE(report["processor_seconds"][stage], 0.0) << stage;
    EXPECT_GT(report["peak_memory_mib_after"][stage], 1.0) << stage;
  }
  EXPECT_TRUE(report["view_graph"]["dropped"].is_object());
  for (const char* solve : {"frames", "joint"}) {
    const Json& summary = report["rotation_averaging"][solve];
    EXPECT_TRUE(summary["termination"].is_string());
    EXPECT_TRUE(summary["num_iterations"].is_number());
  }
  EXPECT_TRUE(report["rotation_averaging"]["dropped"].is_object());
  EXPECT_TRUE(report["unregistered_frames"].empty());

  ASSERT_EQ(report["models"].size(), 1u);
  const Json& model = report["models"][0];
  EXPECT_EQ(model["num_frames"], 12);
  EXPECT_GT(model["num_points"], 0);
  EXPECT_LT(model["mean_reprojection_error_px"], 1.0);
  for (const char* stage :
       {"tracks", "translation averaging", "bundle adjustment"}) {
    EXPECT_TRUE(model["seconds"][stage].is_number()) << stage;
  }
  for (const char* solve :
       {"initialization", "camera_refinement", "joint_refinement"}) {
    const Json& summary = model["translation_averaging"][solve];
    EXPECT_TRUE(summary["termination"].is_string()) << solve;
  }
  for (const char* part : {"solves", "rounds"}) {
    EXPECT_FALSE(model["bundle_adjustment"][part].empty()) << part;
  }
  ASSERT_EQ(model["rigs"].size(), 1u);
  ASSERT_EQ(model["rigs"][0]["sensors"].size(), 4u);
  for (const Json& sensor : model["rigs"][0]["sensors"]) {
    EXPECT_EQ(sensor["sensor_from_rig"]["translation"].size(), 3u);
    if (sensor["is_reference"]) continue;
    EXPECT_TRUE(sensor["rotation"]["is_observable"]);
    EXPECT_GT(sensor["rotation"]["num_samples"], 0);
    EXPECT_LT(sensor["rotation"]["median_deviation_deg"], 1.0);
    EXPECT_TRUE(sensor["translation"]["is_observable"]);
  }
}

TEST_F(MapperCommand, ModelIsTheCalibrationOfTheNextRun) {
  ASSERT_EQ(Map().exit_code, 0);
  const Json first = Report()["models"][0]["rigs"][0]["sensors"];
  fs::rename(Out(), Path("first"));
  ASSERT_EQ(Map("--rig_config_path " + Path("first/0")).exit_code, 0);
  const Json second = Report()["models"][0]["rigs"][0]["sensors"];
  ASSERT_EQ(second.size(), first.size());
  for (size_t i = 0; i < first.size(); ++i) {
    EXPECT_TRUE(second[i]["was_known"]);
    EXPECT_EQ(second[i]["sensor_from_rig"], first[i]["sensor_from_rig"]);
  }
}

TEST_F(MapperCommand, MeasuredPositionsPlaceTheModel) {
  ASSERT_EQ(RunMgsfm("simulate --rig stereo --path loop --num_frames 20 "
                     "--pixel_noise 0.3 --prior_sigma 0.1 --output_path " +
                     Path("gps"))
                .exit_code,
            0);
  const CommandOutput output =
      MapFrom(Path("gps/database.db"), "--use_prior_position 1");
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const Json priors = Report()["models"][0]["position_priors"];
  EXPECT_TRUE(priors["is_registered"]);
  EXPECT_EQ(priors["num_priors"], 20);
  const Json errors =
      Evaluate(Out() + "/0", Path("gps/truth") + " --alignment none");
  EXPECT_LT(errors["position_m"]["max"], 0.2);
}

TEST_F(MapperCommand, PositionsThatAreNoneAreRefused) {
  WriteTextFile(Path("positions.txt"), "cam0/000000.png nan 0 0\n");
  PutEarlierOutput();
  const Files before = FilesIn(dir_.path());
  ExpectRefused(Map("--ref_images_path " + Path("positions.txt")),
                "finite number", before);
  ExpectRefused(Map("--use_prior_position 1"), "no positions", before);
}

TEST_F(MapperCommand, LateCamerasAreFound) {
  ASSERT_EQ(RunMgsfm("simulate --rig stereo --num_frames 25 --pixel_noise 0.3 "
                     "--trigger_offset 30 --output_path " +
                     Path("late"))
                .exit_code,
            0);
  const std::string times =
      "--SoftRig.method time_offset --image_timestamps_path ";
  const CommandOutput output =
      MapFrom(Path("late/database.db"), times + Path("late/timestamps.txt"));
  ASSERT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.err, HasSubstr("time offset"));
  const Json summary = Report()["models"][0]["soft_rig"];
  ASSERT_EQ(summary["sensors"].size(), 2u);
  EXPECT_NEAR(summary["sensors"][1]["time_offset_s"], 0.03, 0.003);
  const Json errors = Evaluate(Out() + "/0", Path("late/truth_images"));
  EXPECT_EQ(errors["num_registered"], 50);
  EXPECT_LT(errors["position_m"]["max"], 0.05);
  const Json rig = Json::parse(ReadTextFile(Out() + "/0/rig_config.json"));
  EXPECT_EQ(rig[0]["cameras"].size(), 2u);
}

TEST_F(MapperCommand, TimesThatAreNoneAreRefused) {
  WriteTextFile(Path("times.txt"), "cam0/000000.png nan\n");
  PutEarlierOutput();
  const Files before = FilesIn(dir_.path());
  ExpectRefused(Map("--image_timestamps_path " + Path("times.txt")),
                "finite number of seconds", before);
  ExpectRefused(Map("--SoftRig.method time_offset"), "--image_timestamps_path",
                before);
}

// The world of the simulation has y down, as leveled ones have.
TEST_F(MapperCommand, GravityLevelsTheModel) {
  ASSERT_EQ(RunMgsfm("simulate --rig stereo --path curve --num_frames 20 "
                     "--pixel_noise 0.3 --gravity_sigma 0.5 "
                     "--gravity_outlier_ratio 0.1 --output_path " +
                     Path("level"))
                .exit_code,
            0);
  const CommandOutput output =
      MapFrom(Path("level/database.db"), "--output_format txt --gravity_path " +
                                             Path("level/gravity.txt"));
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const Json gravity = Report()["models"][0]["gravity"];
  EXPECT_EQ(gravity["num_priors"], 20);
  EXPECT_LT(gravity["median_error_deg"], 1.0);
  EXPECT_LT(gravity["outliers"].size(), 6u);
  const Json errors = Evaluate(Out() + "/0", Path("level/truth"));
  EXPECT_LT(errors["rotation_deg"]["max"], 0.5);
}

TEST_F(MapperCommand, GravityThatIsNoneIsRefused) {
  PutEarlierOutput();
  const auto expect_refused = [&](const std::string& text,
                                  const std::string& message) {
    WriteTextFile(Path("gravity.txt"), text);
    const Files before = FilesIn(dir_.path());
    ExpectRefused(Map("--gravity_path " + Path("gravity.txt")), message,
                  before);
  };
  expect_refused("cam0/000000.png 0 nan 0\n", "finite number");
  expect_refused("cam0/000000.png 0 0 0\n", "not all zero");
  expect_refused("cam9/000000.png 0 1 0\n", "which the database does not have");
  expect_refused("cam0/000000.png 0 1\n", "expected 'image_name GX GY GZ'");
  expect_refused("# nothing\n", "there is no line");
}

// A processor without AVX2 and FMA runs these kernels
// (docs/guides/reproducibility.md).
TEST_F(MapperCommand, PortableKernelsGiveTheSameModel) {
  ASSERT_EQ(Map().exit_code, 0);
  fs::rename(Out(), Path("fast"));
  ASSERT_EQ(setenv("MGSFM_PORTABLE", "1", 1), 0);
  const CommandOutput output = Map();
  ASSERT_EQ(unsetenv("MGSFM_PORTABLE"), 0);
  ASSERT_EQ(output.exit_code, 0) << output.err;
  const Json errors = Evaluate(
      Out() + "/0", Path("fast/0") + " --gt_format colmap --alignment none");
  EXPECT_EQ(errors["num_registered"], 48);
  EXPECT_LT(errors["position_m"]["max"], 1e-5);
  EXPECT_LT(errors["rotation_deg"]["max"], 1e-5);
}

TEST_F(MapperCommand, CovariancesAreWritten) {
  ASSERT_EQ(Map("--compute_covariances 1").exit_code, 0);
  const std::string csv = ReadTextFile(Out() + "/0/covariances.csv");
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 1 + 4 + 12);
  const Json model = Report()["models"][0];
  EXPECT_TRUE(model["covariances"]["is_usable"]);
  EXPECT_EQ(model["covariances"]["message"], "");
  for (const Json& sensor : model["rigs"][0]["sensors"]) {
    if (sensor["is_reference"]) continue;
    EXPECT_GT(sensor["sigma"]["rotations_deg"][0], 0.0);
    EXPECT_LT(sensor["sigma"]["rotations_deg"][0], 1.0);
  }
}

TEST_F(MapperCommand, DoesNotTouchTheDatabase) {
  fs::create_directory(Path("db"));
  fs::copy_file(Database(), Path("db/database.db"));
  const Files before = FilesIn(Path("db"));
  fs::permissions(Path("db"), fs::perms::owner_read | fs::perms::owner_exec);
  fs::permissions(Path("db/database.db"), fs::perms::owner_read);
  EXPECT_EQ(MapFrom(Path("db/database.db")).exit_code, 0);
  EXPECT_TRUE(FilesIn(Path("db")) == before);
  fs::permissions(Path("db"), fs::perms::owner_all);
}

TEST_F(MapperCommand, BothSchemasGiveTheSameModel) {
  ASSERT_EQ(RunMgsfm("simulate --rig kitti360 --num_frames 12 "
                     "--max_num_features 150 --pixel_noise 0.3 "
                     "--database_schema 3.12 --output_path " +
                     Path("in312"))
                .exit_code,
            0);
  ASSERT_EQ(Map().exit_code, 0);
  fs::rename(Out(), Path("out38"));
  ASSERT_EQ(MapFrom(Path("in312/database.db")).exit_code, 0);
  const Json errors = Evaluate(Out() + "/0", Path("out38/0"));
  EXPECT_EQ(errors["num_registered"], 48);
  EXPECT_LT(errors["position_m"]["max"], 1e-9);
  EXPECT_LT(errors["rotation_deg"]["max"], 1e-7);
  EXPECT_NEAR(errors["world_from_model"]["scale"], 1.0, 1e-9);
}

TEST_F(MapperCommand, TextHoldsTheSameModel) {
  ASSERT_EQ(Map().exit_code, 0);
  fs::rename(Out(), Path("binary"));
  ASSERT_EQ(Map("--output_format txt").exit_code, 0);
  for (const char* name : {"cameras", "images", "points3D", "rigs", "frames"}) {
    EXPECT_TRUE(fs::exists(Out() + "/0/" + name + ".txt")) << name;
    EXPECT_FALSE(fs::exists(Out() + "/0/" + name + ".bin")) << name;
  }
  const Json errors = Evaluate(Out() + "/0", Path("binary/0"));
  EXPECT_LT(errors["position_m"]["max"], 1e-9);
}

TEST_F(MapperCommand, ReplacesAnEarlierModelAndKeepsOtherFiles) {
  PutEarlierOutput();
  fs::create_directories(Out() + "/1");
  ASSERT_EQ(Map().exit_code, 0);
  EXPECT_GT(fs::file_size(Out() + "/0/images.bin"), 1000u);
  EXPECT_FALSE(fs::exists(Out() + "/1"));
  EXPECT_EQ(ReadTextFile(Out() + "/notes.txt"), "mine");
  EXPECT_EQ(Report()["models"].size(), 1u);
}

// An earlier model would be taken for the result of this run.
TEST_F(MapperCommand, WithoutMatchesAReportAloneIsLeft) {
  ASSERT_EQ(RunMgsfm("simulate --num_frames 5 --num_matched_frames 0 "
                     "--match_different_sensors false --output_path " +
                     Path("unmatched"))
                .exit_code,
            0);
  PutEarlierOutput();
  const CommandOutput output = MapFrom(Path("unmatched/database.db"));
  EXPECT_EQ(output.exit_code, 2);
  EXPECT_THAT(output.err, HasSubstr("report.json"));
  EXPECT_FALSE(fs::exists(Out() + "/0"));
  EXPECT_EQ(ReadTextFile(Out() + "/notes.txt"), "mine");
  const Json report = Report();
  EXPECT_TRUE(report["models"].empty());
  ASSERT_EQ(report["unregistered_frames"].size(), 5u);
  for (const Json& frame : report["unregistered_frames"]) {
    EXPECT_FALSE(frame["reason"].get<std::string>().empty());
    EXPECT_TRUE(frame["name"].is_string());
  }
}

TEST_F(MapperCommand, BadInputLeavesEverythingAsItWas) {
  PutEarlierOutput();
  WriteTextFile(Path("no.db"),
                "not a database, but long enough to be read as "
                "the header of one, which has 100 bytes.........");
  WriteTextFile(Path("empty.db"), "");
  WriteTextFile(Path("config.json"),
                "[{\"cameras\": [{\"ref_sensor\": true}]}]");
  WriteTextFile(Path("broken.json"), "[{");
  WriteTextFile(Path("strange.json"),
                "[{\"cameras\": [{\"image_prefix\": \"other/\", "
                "\"ref_sensor\": true}]}]");
  const Files before = FilesIn(dir_.path());
  ExpectRefused(MapFrom(Path("none.db")), "none.db", before);
  ExpectRefused(MapFrom(Path("no.db")), "no.db", before);
  ExpectRefused(MapFrom(Path("empty.db")), "empty.db", before);
  ExpectRefused(MapFrom(Path("")), dir_.path().string(), before);
  for (const char* config :
       {"none.json", "config.json", "broken.json", "strange.json"}) {
    ExpectRefused(Map("--rig_config_path " + Path(config)), config, before);
  }
  ExpectRefused(Map("--rig_name_rule '('"), "rig_name_rule", before);
  ExpectRefused(Map("--image_path " + Path("none")), "--image_path", before);
  ExpectRefused(Map("--min_num_frame 3"), "did you mean", before);
  ExpectRefused(Map("--min_num_frames 1"), "min_num_frames", before);
  ExpectRefused(Map("--output_format pdf"), "output_format", before);
  ExpectRefused(Map("--num_threads -2"), "num_threads", before);
}

TEST_F(MapperCommand, BadInputMakesNoOutputFolder) {
  const Files before = FilesIn(dir_.path());
  ExpectRefused(MapFrom(Path("none.db")), "none.db", before);
  ExpectRefused(RunMgsfm("mapper --database_path " + Path("none.db") +
                         " --output_path " + Path("new/deep/out")),
                "none.db", before);
}

TEST_F(MapperCommand, OutputPathsThatHoldOtherThingsAreRefused) {
  WriteTextFile(Out(), "mine");
  ExpectRefused(Map(), Out(), FilesIn(dir_.path()));
  fs::remove(Out());
  fs::create_directories(Out());
  WriteTextFile(Out() + "/10", "mine");
  ExpectRefused(Map(), Out() + "/10", FilesIn(dir_.path()));
  fs::remove(Out() + "/10");
  fs::create_directories(Out() + "/10");
  WriteTextFile(Out() + "/10/cameras.txt", "mine");
  ExpectRefused(Map(), Out() + "/10/cameras.txt", FilesIn(dir_.path()));
}

TEST_F(MapperCommand, BlackPointsAreExplained) {
  const CommandOutput output = Map();
  EXPECT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.err,
              AllOf(HasSubstr("points are black"), HasSubstr("--image_path")));
}

TEST_F(MapperCommand, MissingImagesAreAWarning) {
  fs::create_directory(Path("images"));
  const CommandOutput output = Map("--image_path " + Path("images"));
  EXPECT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.err, AllOf(HasSubstr("48 images give no colors"),
                                HasSubstr("cam0/000000.png")));
}

TEST_F(MapperCommand, WritesThePageOfEachModelUnlessToldNotTo) {
  const fs::path page = fs::path(Out()) / "0" / "report.html";
  ASSERT_EQ(Map().exit_code, 0);
  EXPECT_THAT(ReadTextFile(page),
              AllOf(HasSubstr("<!doctype html>"),
                    HasSubstr("<b>48</b><span>images registered")));
  // The page of an earlier model must not stay beside the new one.
  ASSERT_EQ(Map("--write_report 0").exit_code, 0);
  EXPECT_FALSE(fs::exists(page));
}

// The limit of 550 kiB holds the files of the model, but not the page.
TEST_F(MapperCommand, PageThatCannotBeWrittenIsAWarning) {
  const CommandOutput output =
      RunShell("ulimit -f 1100; " MGSFM_EXECUTABLE " mapper --database_path " +
               DemoDatabase() + " --output_path " + Out());
  EXPECT_EQ(output.exit_code, 0) << output.err;
  EXPECT_THAT(output.err, AllOf(HasSubstr("the model is complete"),
                                HasSubstr("report.html")));
  EXPECT_TRUE(fs::exists(Out() + "/0/images.bin"));
  EXPECT_FALSE(fs::exists(Out() + "/0/report.html"));
}

}  // namespace
}  // namespace mgsfm
