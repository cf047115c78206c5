// SPDX-License-Identifier: BSD-3-Clause
// `mgsfm bundle_adjuster` as users run it, on the true model of the demo and on
// others made of it.
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

class BundleAdjusterCommand : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string Out() const { return Path("out"); }
  CommandOutput Adjust(const std::string& input,
                       const std::string& more_flags = "") const {
    return RunMgsfm("bundle_adjuster --input_path " + input +
                    " --output_path " + Out() + " " + more_flags);
  }
  // A copy of the demo's truth that may be changed.
  std::string CopyOfTruth() const {
    fs::copy(DemoTruth(), Path("in"));
    return Path("in");
  }
  void ExpectRefused(const std::string& input, const std::string& message,
                     const std::string& more_flags = "") const {
    const Files before = FilesIn(dir_.path());
    const CommandOutput output = Adjust(input, more_flags);
    EXPECT_EQ(output.exit_code, 1) << output.err;
    EXPECT_THAT(LastWord(output), HasSubstr(message)) << output.err;
    EXPECT_TRUE(FilesIn(dir_.path()) == before);
  }

  const TempDir dir_;
};

// The number in column `column` of the line that starts with `name`.
double ValueOf(const std::string& table, const std::string& name, int column) {
  const size_t begin = table.find("\n" + name);
  if (begin == std::string::npos) return -1.0;
  std::istringstream line(table.substr(begin + 1 + name.size()));
  std::string word;
  double value = -1.0;
  while (column >= 0 && line >> word) {
    if (word == "px") continue;
    value = std::stod(word);
    --column;
  }
  return value;
}

TEST_F(BundleAdjusterCommand, LowersTheCostAndSaysSo) {
  const CommandOutput output = Adjust(DemoTruth());
  ASSERT_EQ(output.exit_code, 0) << output.err;
  EXPECT_LT(ValueOf(output.out, "cost", 1), ValueOf(output.out, "cost", 0));
  EXPECT_LT(ValueOf(output.out, "reprojection, mean", 1),
            ValueOf(output.out, "reprojection, mean", 0));
  EXPECT_EQ(ValueOf(output.out, "points", 1), ValueOf(output.out, "points", 0));
  EXPECT_GT(ValueOf(output.out, "iterations", 0), 0);
  EXPECT_THAT(output.out, HasSubstr("in 1 solve, converged"));

  const CommandOutput evaluation =
      RunMgsfm("model_evaluator --input_path " + Out() + " --gt_path " +
               DemoTruth() + " --json " + Path("errors.json"));
  ASSERT_EQ(evaluation.exit_code, 0) << evaluation.err;
  const auto errors = nlohmann::json::parse(ReadTextFile(Path("errors.json")));
  EXPECT_EQ(errors["num_registered"], errors["num_images"]);
  EXPECT_LT(errors["position_m"]["max"], 0.1);
  EXPECT_LT(errors["rotation_deg"]["max"], 0.1);
}

TEST_F(BundleAdjusterCommand, ColmapReadsTheResult) {
  if (RunShell("command -v colmap").exit_code != 0) {
    GTEST_SKIP() << "colmap is not installed";
  }
  const PoseModel truth = ReadModelPoses(DemoTruth());
  for (const char* format : {"bin", "txt"}) {
    ASSERT_EQ(
        Adjust(DemoTruth(), std::string("--output_format ") + format).exit_code,
        0);
    const CommandOutput output =
        RunShell("QT_QPA_PLATFORM=offscreen colmap model_analyzer --path " +
                 Out() + " 2>&1");
    EXPECT_EQ(output.exit_code, 0) << output.out;
    EXPECT_THAT(output.out,
                HasSubstr("mages: " + std::to_string(truth.images.size())));
  }
}

TEST_F(BundleAdjusterCommand, ModelsWithoutRigsBecomeRigs) {
  const std::string in = CopyOfTruth();
  fs::remove(in + "/rigs.bin");
  fs::remove(in + "/frames.bin");
  ASSERT_EQ(Adjust(in).exit_code, 0);
  const PoseModel model = ReadModelPoses(Out());
  EXPECT_EQ(model.rigs.size(), 1u);
  EXPECT_EQ(model.frames.size(), ReadModelPoses(DemoTruth()).frames.size());
  EXPECT_TRUE(fs::exists(Out() + "/rig_config.json"));

  ASSERT_EQ(Adjust(in, "--rig_name_rule none").exit_code, 0);
  EXPECT_EQ(ReadModelPoses(Out()).frames.size(), model.images.size());
}

double LargestSensorChange(const PoseModel& a, const PoseModel& b) {
  double change = 0.0;
  for (size_t i = 0; i < a.rigs[0].sensors.size(); ++i) {
    const Rigid3& pose_a = *a.rigs[0].sensors[i].sensor_from_rig;
    const Rigid3& pose_b = *b.rigs[0].sensors[i].sensor_from_rig;
    change = std::max({change, (pose_a.translation - pose_b.translation).norm(),
                       AngleBetween(pose_a.rotation, pose_b.rotation)});
  }
  return change;
}

double LargestFrameChange(const PoseModel& a, const PoseModel& b) {
  double change = 0.0;
  for (size_t i = 0; i < a.frames.size(); ++i) {
    const Rigid3& pose_a = a.frames[i].rig_from_world;
    const Rigid3& pose_b = b.frames[i].rig_from_world;
    change = std::max({change, (pose_a.Center() - pose_b.Center()).norm(),
                       AngleBetween(pose_a.rotation, pose_b.rotation)});
  }
  return change;
}

TEST_F(BundleAdjusterCommand, OptionsSayWhatIsHeld) {
  const PoseModel truth = ReadModelPoses(DemoTruth());
  const std::string cameras = ReadTextFile(DemoTruth() + "/cameras.bin");
  constexpr double kSame = 1e-9;

  ASSERT_EQ(Adjust(DemoTruth()).exit_code, 0);
  EXPECT_GT(LargestSensorChange(ReadModelPoses(Out()), truth), kSame);
  EXPECT_GT(LargestFrameChange(ReadModelPoses(Out()), truth), kSame);
  EXPECT_TRUE(ReadTextFile(Out() + "/cameras.bin") == cameras);

  ASSERT_EQ(Adjust(DemoTruth(), "--BundleAdjustment.refine_sensor_from_rig no")
                .exit_code,
            0);
  EXPECT_LT(LargestSensorChange(ReadModelPoses(Out()), truth), kSame);
  EXPECT_GT(LargestFrameChange(ReadModelPoses(Out()), truth), kSame);

  ASSERT_EQ(Adjust(DemoTruth(), "--BundleAdjustment.refine_rig_from_world 0")
                .exit_code,
            0);
  EXPECT_GT(LargestSensorChange(ReadModelPoses(Out()), truth), kSame);
  EXPECT_LT(LargestFrameChange(ReadModelPoses(Out()), truth), kSame);

  ASSERT_EQ(Adjust(DemoTruth(), "--BundleAdjustment.refine_points 0").exit_code,
            0);
  const Model before = ReadModel(DemoTruth()), after = ReadModel(Out());
  for (size_t i = 0; i < before.points.size(); ++i) {
    EXPECT_EQ(after.points[i].point_in_world, before.points[i].point_in_world);
  }

  ASSERT_EQ(Adjust(DemoTruth(), "--BundleAdjustment.refine_focal_length yes")
                .exit_code,
            0);
  EXPECT_FALSE(ReadTextFile(Out() + "/cameras.bin") == cameras);
}

// The content of a rig_config.json from a calibration.
TEST_F(BundleAdjusterCommand, PosesOfARigConfigurationAreHeld) {
  ASSERT_EQ(Adjust(DemoTruth()).exit_code, 0);
  fs::copy(Out() + "/rig_config.json", Path("rig.json"));
  const PoseModel calibrated = ReadModelPoses(Out());
  ASSERT_EQ(
      Adjust(DemoTruth(), "--rig_config_path " + Path("rig.json")).exit_code,
      0);
  EXPECT_LT(LargestSensorChange(ReadModelPoses(Out()), calibrated), 1e-9);
}

TEST_F(BundleAdjusterCommand, ThreadsDoNotChangeTheModel) {
  ASSERT_EQ(Adjust(DemoTruth(), "--num_threads 1").exit_code, 0);
  const Files one = FilesIn(Out());
  ASSERT_EQ(Adjust(DemoTruth(), "--num_threads 3").exit_code, 0);
  EXPECT_TRUE(FilesIn(Out()) == one);
}

TEST_F(BundleAdjusterCommand, RetriangulationDropsOutliers) {
  const CommandOutput output =
      Adjust(DemoTruth(), "--retriangulate --BundleAdjustment.max_max_error 1");
  ASSERT_EQ(output.exit_code, 0) << output.err;
  EXPECT_LT(ValueOf(output.out, "observations", 1),
            ValueOf(output.out, "observations", 0));
}

// In place, and in the other format: of the old model nothing is left that a
// reader could take for the new one.
TEST_F(BundleAdjusterCommand, ReplacesAModelAndNothingElse) {
  const std::string in = CopyOfTruth();
  fs::create_directory(in + "/0");
  WriteTextFile(in + "/0/images.bin", "mine");
  WriteTextFile(in + "/notes.txt", "mine");
  const CommandOutput output =
      RunMgsfm("bundle_adjuster --output_format txt --input_path " + in +
               " --output_path " + in);
  ASSERT_EQ(output.exit_code, 0) << output.err;
  EXPECT_FALSE(fs::exists(in + "/images.bin"));
  EXPECT_EQ(ReadModelPoses(in).images.size(),
            ReadModelPoses(DemoTruth()).images.size());
  EXPECT_EQ(ReadTextFile(in + "/0/images.bin"), "mine");
  EXPECT_EQ(ReadTextFile(in + "/notes.txt"), "mine");
}

TEST_F(BundleAdjusterCommand, BadInputIsExitCode1AndWritesNothing) {
  ExpectRefused(Path("none"), Path("none"));
  fs::create_directory(Path("empty"));
  ExpectRefused(Path("empty"), "holds no model");
  const std::string in = CopyOfTruth();
  ExpectRefused(in, "none.json", "--rig_config_path " + Path("none.json"));
  fs::resize_file(in + "/points3D.bin",
                  fs::file_size(in + "/points3D.bin") / 2);
  ExpectRefused(in, "points3D.bin");
  fs::remove(in + "/points3D.bin");
  ExpectRefused(in, "points3D.bin");
  fs::remove_all(in);
  fs::copy(DemoTruth(), in);
  fs::remove(in + "/frames.bin");
  WriteTextFile(in + "/frames.bin", "no frames");
  ExpectRefused(in, "frames.bin");
  WriteTextFile(Path("file"), "");
  const CommandOutput output =
      RunMgsfm("bundle_adjuster --input_path " + DemoTruth() +
               " --output_path " + Path("file"));
  EXPECT_EQ(output.exit_code, 1);
  EXPECT_THAT(LastWord(output), HasSubstr(Path("file")));
}

TEST_F(BundleAdjusterCommand, FramesThatContradictImagesAreRefused) {
  ASSERT_EQ(Adjust(DemoTruth(), "--output_format txt").exit_code, 0);
  fs::rename(Out(), Path("in"));
  // Another rotation for the last frame: w and x exchanged.
  std::string frames = ReadTextFile(Path("in/frames.txt"));
  const size_t line = frames.rfind('\n', frames.size() - 2) + 1;
  std::istringstream fields(frames.substr(line));
  std::string id, rig_id, w, x, rest;
  fields >> id >> rig_id >> w >> x;
  std::getline(fields, rest);
  frames.resize(line);
  frames += id + " " + rig_id + " " + x + " " + w + rest;
  WriteTextFile(Path("in/frames.txt"), frames + "\n");
  ExpectRefused(Path("in"), "from that of its frame");
}

void WriteModelOfTwoImages(const fs::path& folder, const std::string& images) {
  fs::create_directory(folder);
  WriteTextFile(folder / "cameras.txt",
                "1 SIMPLE_PINHOLE 640 480 500 320 240\n");
  WriteTextFile(folder / "images.txt", images);
  WriteTextFile(folder / "points3D.txt", "");
}

TEST_F(BundleAdjusterCommand, NothingToAdjustIsExitCode2AndWritesNothing) {
  WriteModelOfTwoImages(Path("in"),
                        "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n"
                        "\n");
  const Files before = FilesIn(dir_.path());
  const CommandOutput output = Adjust(Path("in"));
  EXPECT_EQ(output.exit_code, 2);
  EXPECT_THAT(output.err, HasSubstr("nothing was adjusted: no point"));
  const CommandOutput held =
      Adjust(DemoTruth(),
             "--BundleAdjustment.refine_rig_from_world 0 "
             "--BundleAdjustment.refine_sensor_from_rig no "
             "--BundleAdjustment.refine_points 0");
  EXPECT_EQ(held.exit_code, 2);
  EXPECT_THAT(held.err, HasSubstr("the options fix"));
  EXPECT_TRUE(FilesIn(dir_.path()) == before);

  WriteModelOfTwoImages(Path("none"), "");
  ExpectRefused(Path("none"), "it has no image");
}

}  // namespace
}  // namespace mgsfm
