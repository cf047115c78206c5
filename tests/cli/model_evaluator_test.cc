// SPDX-License-Identifier: BSD-3-Clause
// The evaluator as users run it, on models and truths of all kinds.
#include <nlohmann/json.hpp>
#include <sstream>
#include <vector>

#include "cli/program_runs.h"
#include "io/test_database.h"
#include "mgsfm/geometry/rigid3.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;
using Json = nlohmann::json;

const Rigid3 kRightFromLeft{ExpSO3({0.0, 0.01, 0.0}), {-0.5, 0.0, 0.0}};

// A drive along a curve with some hills; y is down.
Rigid3 TruePose(int frame) {
  const double angle = 0.1 * frame;
  return Rigid3::FromRotationAndCenter(
      ExpSO3({0.02 * angle, -angle, 0.0}),
      {10.0 * std::sin(angle), 0.1 * frame, -10.0 * std::cos(angle)});
}

std::string Number(int frame) {
  const std::string digits = std::to_string(frame);
  return std::string(6 - digits.size(), '0') + digits;
}

struct NamedPose {
  std::string name;
  int camera_id;
  Rigid3 cam_from_world;
};

class ModelEvaluator : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }

  // A text model. Frames, if wanted, are of one rig of cameras 1 and 2; images
  // of a frame follow each other.
  void WriteModel(const std::string& folder,
                  const std::vector<NamedPose>& images,
                  int num_images_per_frame = 0) const {
    fs::create_directories(Path(folder));
    std::ostringstream image_lines, frame_lines;
    image_lines.precision(17);
    frame_lines.precision(17);
    for (size_t i = 0; i < images.size(); ++i) {
      WritePose(images[i].cam_from_world, image_lines << i + 1 << ' ');
      image_lines << images[i].camera_id << ' ' << images[i].name << "\n\n";
      if (num_images_per_frame == 0 || i % num_images_per_frame != 0) continue;
      WritePose(images[i].cam_from_world, frame_lines << i + 1 << " 1 ");
      frame_lines << num_images_per_frame;
      for (int k = 0; k < num_images_per_frame; ++k) {
        frame_lines << " CAMERA " << images[i + k].camera_id << ' '
                    << i + k + 1;
      }
      frame_lines << '\n';
    }
    WriteTextFile(Path(folder) + "/images.txt", image_lines.str());
    if (num_images_per_frame == 0) return;
    std::ostringstream rig_lines;
    rig_lines.precision(17);
    WritePose(kRightFromLeft, rig_lines << "1 2 CAMERA 1 CAMERA 2 1 ");
    rig_lines << '\n';
    WriteTextFile(Path(folder) + "/rigs.txt", rig_lines.str());
    WriteTextFile(Path(folder) + "/frames.txt", frame_lines.str());
  }
  static void WritePose(const Rigid3& pose, std::ostream& lines) {
    const Eigen::Quaterniond& q = pose.rotation;
    for (const double value : {q.w(), q.x(), q.y(), q.z()}) {
      lines << value << ' ';
    }
    for (const double value : pose.translation) lines << value << ' ';
  }

  // Left images of these frames.
  static std::vector<NamedPose> Mono(const std::vector<int>& frames) {
    std::vector<NamedPose> images;
    for (const int frame : frames) {
      images.push_back({"left/" + Number(frame) + ".png", 1, TruePose(frame)});
    }
    return images;
  }
  static std::vector<NamedPose> Stereo(const std::vector<int>& frames,
                                       const std::string& sequence = "") {
    std::vector<NamedPose> images;
    for (const int frame : frames) {
      const std::string file = Number(frame) + ".png";
      images.push_back({sequence + "cam0/" + file, 1, TruePose(frame)});
      images.push_back(
          {sequence + "cam1/" + file, 2, kRightFromLeft * TruePose(frame)});
    }
    return images;
  }

  std::string WriteKitti(int num_poses) const {
    std::ostringstream lines;
    lines.precision(17);
    for (int i = 0; i < num_poses; ++i) {
      const Eigen::Matrix<double, 3, 4> matrix = Matrix(TruePose(i).Inverse());
      for (int k = 0; k < 12; ++k) {
        lines << matrix(k / 4, k % 4) << (k < 11 ? ' ' : '\n');
      }
    }
    WriteTextFile(Path("kitti.txt"), lines.str());
    return "--gt_format kitti --gt_path " + Path("kitti.txt") + " ";
  }
  static Eigen::Matrix<double, 3, 4> Matrix(const Rigid3& pose) {
    Eigen::Matrix<double, 3, 4> matrix;
    matrix << pose.rotation.toRotationMatrix(), pose.translation;
    return matrix;
  }

  // A pose each `step_s`, of fractions of frames; frame i is at time begin + i.
  std::string WriteTum(int num_poses, double step_s,
                       const std::string& more = "",
                       double begin_s = 0.0) const {
    std::ostringstream lines;
    lines.precision(17);
    for (int i = 0; i < num_poses; ++i) {
      const int frame = static_cast<int>(std::lround(i * step_s));
      const Rigid3 pose = TruePose(frame).Inverse();
      lines << begin_s + i * step_s;
      for (const double value : pose.translation) lines << ' ' << value;
      for (const double value : pose.rotation.coeffs()) lines << ' ' << value;
      lines << '\n';
    }
    WriteTextFile(Path("tum.txt"), lines.str() + more);
    return "--gt_format tum --gt_path " + Path("tum.txt") + " ";
  }

  std::string Call(const std::string& flags) const {
    return "model_evaluator --input_path " + Path("model") + " --json " +
           Path("out.json") + " " + flags;
  }
  Json Evaluate(const std::string& flags) const {
    const CommandOutput output = RunMgsfm(Call(flags));
    EXPECT_EQ(output.exit_code, 0) << output.err;
    return output.exit_code == 0 ? Json::parse(ReadTextFile(Path("out.json")))
                                 : Json();
  }
  void ExpectCounts(const Json& evaluation, int registered, int all) const {
    EXPECT_EQ(evaluation["num_registered"], registered);
    EXPECT_EQ(evaluation["num_images"], all);
    EXPECT_LT(evaluation["position_m"]["max"], 1e-6);
  }
  void ExpectRefused(const std::string& flags,
                     const testing::Matcher<std::string>& message) const {
    const CommandOutput output = RunMgsfm(Call(flags));
    EXPECT_EQ(output.exit_code, 1);
    EXPECT_THAT(LastWord(output), message) << output.err;
    EXPECT_FALSE(fs::exists(Path("out.json")));
  }

  const TempDir dir_;
};

TEST_F(ModelEvaluator, KittiFramesInGapsAreNotRegistered) {
  WriteModel("model", Mono({0, 1, 2, 3, 4, 7, 8, 9, 10, 11, 13, 14}));
  const Json evaluation = Evaluate(WriteKitti(20));
  ExpectCounts(evaluation, 12, 15);
  // Frames that are missing have no part in the area: 12 of 15 have no error.
  EXPECT_NEAR(evaluation["position_auc"][0]["area"], 12.0 / 15.0, 1e-4);
}

// Programs that know no rigs write images beside rigs of an earlier model.
TEST_F(ModelEvaluator, PosesMustBeThoseOfFramesAndRigs) {
  WriteModel("truth", Stereo({0, 1, 2, 3}), 2);
  WriteModel("model", Stereo({0, 1, 2, 3}), 2);
  EXPECT_LT(Evaluate("--gt_path " + Path("truth"))["position_m"]["max"], 1e-9);
  fs::remove(Path("out.json"));
  std::vector<NamedPose> moved = Stereo({0, 1, 2, 3});
  moved[3].cam_from_world = TruePose(7);
  const std::string rigs = ReadTextFile(Path("model/rigs.txt"));
  const std::string frames = ReadTextFile(Path("model/frames.txt"));
  WriteModel("model", moved);
  const auto message = AllOf(HasSubstr("'cam1/000001.png'"),
                             HasSubstr("frame 3"), HasSubstr("remove"));
  WriteTextFile(Path("model/rigs.txt"), rigs);
  WriteTextFile(Path("model/frames.txt"), frames);
  ExpectRefused("--gt_path " + Path("truth"), message);
  fs::rename(Path("model"), Path("bad"));
  WriteModel("model", Stereo({0, 1, 2, 3}), 2);
  ExpectRefused("--gt_path " + Path("bad"), message);
  // The remedy.
  fs::remove(Path("bad/rigs.txt"));
  fs::remove(Path("bad/frames.txt"));
  Evaluate("--gt_path " + Path("bad"));
}

TEST_F(ModelEvaluator, EverySecondFrameIsNoGap) {
  WriteModel("model", Mono({2, 4, 6, 8, 14, 16, 18}));
  ExpectCounts(Evaluate(WriteKitti(40)), 7, 9);
}

TEST_F(ModelEvaluator, ImagesOfTheDatabaseAreNotRegistered) {
  std::vector<std::string> names;
  for (int i = 0; i < 12; ++i) names.push_back("left/" + Number(i) + ".png");
  names.push_back("elsewhere/000003.png");
  WriteDatabase(Path("in.db"), MakeContents(names), DatabaseSchema::k38);
  // A gap in the database is not a gap in the model.
  WriteModel("model", Mono({2, 3, 4, 7, 8, 9}));
  ExpectCounts(Evaluate(WriteKitti(30) + "--database_path " + Path("in.db")), 6,
               12);
  fs::remove(Path("out.json"));
  ExpectRefused(WriteKitti(30) + "--database_path " + Path("none.db"),
                HasSubstr(Path("none.db")));
}

TEST_F(ModelEvaluator, AllCamerasOfAMissingFrameAreCounted) {
  WriteTextFile(Path("calib.txt"),
                "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n"
                "P1: 700 0 600 -350 0 700 180 0 0 0 1 0\n");
  for (const int images_per_frame : {0, 2}) {
    std::vector<NamedPose> images = Stereo({0, 1, 2, 4, 5, 6});
    WriteModel("model", images, images_per_frame);
    const std::string kitti = WriteKitti(10);
    const Json with_rig = Evaluate(kitti + "--calib_path " + Path("calib.txt"));
    EXPECT_EQ(with_rig["num_registered"], 12);
    EXPECT_EQ(with_rig["num_images"], 14);
    // Only the reference camera has true poses if there is no calibration.
    ExpectCounts(Evaluate(kitti), 6, 7);
  }
}

TEST_F(ModelEvaluator, TumFramesInGapsAreNotRegistered) {
  WriteModel("model", Mono({3, 4, 5, 6, 8, 9}));
  ExpectCounts(Evaluate(WriteTum(200, 0.1)), 6, 7);
}

// Microseconds, and a date.
TEST_F(ModelEvaluator, TimesAreReadFromNamesAsByOtherCommands) {
  const std::string begin_of_name[] = {"left/front_150000000",
                                       "left/2017-07-14T02-40-0"};
  const std::string end_of_name[] = {"000000.png", ".000000000.png"};
  for (int k = 0; k < 2; ++k) {
    std::vector<NamedPose> images;
    for (const int frame : {3, 4, 5, 6, 8, 9}) {
      images.push_back(
          {begin_of_name[k] + std::to_string(frame) + end_of_name[k], 1,
           TruePose(frame)});
    }
    WriteModel("model", images);
    SCOPED_TRACE(begin_of_name[k]);
    ExpectCounts(Evaluate(WriteTum(200, 0.1, "", 1.5e9)), 6, 7);
  }
}

// Images of one name in two sequences, with the cameras of one rig.
TEST_F(ModelEvaluator, NestedSequencesDoNotCollide) {
  std::vector<NamedPose> images = Stereo({0, 1, 2, 3}, "seq1/");
  for (const NamedPose& image : Stereo({0, 1, 2, 3}, "seq2/")) {
    images.push_back(image);
    // Elsewhere.
    images.back().cam_from_world =
        image.cam_from_world *
        Rigid3{ExpSO3({0.0, 2.0, 0.0}), {50.0, 0.0, 9.0}};
  }
  for (const int images_per_frame : {0, 2}) {
    WriteModel("truth", images, images_per_frame);
    std::vector<NamedPose> registered = images;
    registered.erase(registered.begin() + 10, registered.begin() + 12);
    WriteModel("model", registered, images_per_frame);
    const Json evaluation = Evaluate("--gt_path " + Path("truth"));
    ExpectCounts(evaluation, 14, 16);
    if (images_per_frame > 0) {
      ASSERT_EQ(evaluation["sensors"].size(), 1u);
      EXPECT_EQ(evaluation["sensors"][0]["name"], "cam1");
      EXPECT_LT(evaluation["sensors"][0]["rotation_deg"], 1e-6);
      EXPECT_NEAR(evaluation["sensors"][0]["length_m"], 0.5, 1e-6);
    }
    fs::remove(Path("out.json"));
    ExpectRefused(WriteKitti(10), AllOf(HasSubstr("seq2/cam0/000000.png"),
                                        HasSubstr("--image_prefix")));
    ExpectCounts(Evaluate(WriteKitti(10) + "--image_prefix seq1/"), 4, 4);
    fs::remove(Path("out.json"));
    ExpectRefused(WriteKitti(10) + "--image_prefix seq3/", HasSubstr("seq3/"));
  }
}

TEST_F(ModelEvaluator, TheReferenceCanBeAnotherCamera) {
  // The true poses are those of cam1.
  std::vector<NamedPose> images;
  for (int frame = 0; frame < 6; ++frame) {
    const std::string file = Number(frame) + ".png";
    images.push_back(
        {"cam0/" + file, 1, kRightFromLeft.Inverse() * TruePose(frame)});
    images.push_back({"cam1/" + file, 2, TruePose(frame)});
  }
  WriteModel("model", images, 2);
  const std::string kitti = WriteKitti(6);
  ExpectCounts(Evaluate(kitti + "--reference cam1"), 6, 6);
  EXPECT_GT(Evaluate(kitti)["rotation_deg"]["max"], 0.1);
  fs::remove(Path("out.json"));
  ExpectRefused(kitti + "--reference cam7", HasSubstr("'cam7'"));
}

TEST_F(ModelEvaluator, TruthThatIsNoTruthIsRefused) {
  WriteModel("model", Mono({0, 1, 2}));
  ExpectRefused(WriteTum(5, 1.0, "5 0 nan 0 0 0 0 1\n"),
                AllOf(HasSubstr(Path("tum.txt")), HasSubstr("line 6")));
  ExpectRefused(WriteTum(5, 1.0, "5 0 0 0 0 0 0 1 end\n"), HasSubstr("line 6"));
  WriteKitti(2);
  ExpectRefused("--gt_format kitti --gt_path " + Path("kitti.txt"),
                AllOf(HasSubstr("2 poses"), HasSubstr("3 frames")));
  ExpectRefused("--gt_format kitti --gt_path " + Path("none"),
                HasSubstr(Path("none")));
  ExpectRefused("--gt_path " + Path("none"), HasSubstr(Path("none")));
  ExpectRefused("", HasSubstr("--gt_path is needed"));
}

TEST_F(ModelEvaluator, ARigConfigurationIsATrueRig) {
  WriteModel("model", Stereo({0, 1, 2, 3}), 2);
  WriteTextFile(Path("rig.json"),
                R"([{"cameras": [{"image_prefix": "cam1/", "ref_sensor": true},
                       {"image_prefix": "cam0/",
                        "cam_from_rig_rotation": [1, 0, 0, 0],
                        "cam_from_rig_translation": [2, 0, 0]}]}])");
  const std::string rig =
      "--gt_format rig --calib_path " + Path("rig.json") + " ";
  // The rotation of kRightFromLeft is 0.01 rad.
  for (const char* reference : {"", "--reference cam1"}) {
    const Json sensor = Evaluate(rig + reference)["sensors"][0];
    EXPECT_EQ(sensor["name"], *reference == 0 ? "cam1" : "cam0");
    EXPECT_NEAR(sensor["rotation_deg"], RadToDeg(0.01), 1e-9);
    EXPECT_NEAR(sensor["true_length_m"], 2.0, 1e-9);
  }
  fs::remove(Path("out.json"));
  fs::remove_all(Path("model"));
  WriteModel("model", Mono({0, 1, 2}));
  ExpectRefused(rig, AllOf(HasSubstr("rig.json"), HasSubstr("left")));
}

TEST_F(ModelEvaluator, WhatCannotBePairedIsRefused) {
  WriteModel("model", Mono({0, 1, 2}));
  WriteModel("truth", Stereo({0, 1, 2}), 2);
  ExpectRefused("--gt_path " + Path("truth"),
                AllOf(HasSubstr("no image in common"), HasSubstr("truth")));
  // Neither name says which of these is the left camera.
  WriteTextFile(Path("calib.txt"),
                "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n"
                "P1: 700 0 600 -350 0 700 180 0 0 0 1 0\n");
  ExpectRefused(WriteKitti(3) + "--calib_path " + Path("calib.txt"),
                AllOf(HasSubstr("2 cameras"), HasSubstr("'left'")));
}

TEST_F(ModelEvaluator, MissingImagesAreOfTheChosenReference) {
  WriteModel("truth", Stereo({0, 1, 2, 3, 4, 5}), 2);
  WriteModel("model", Stereo({0, 1, 2, 4, 5}), 2);
  const Json evaluation =
      Evaluate("--gt_path " + Path("truth") + " --reference cam1");
  // Between six images of cam1, one of which is missing.
  EXPECT_EQ(evaluation["rpe"]["num_steps"], 3);
  EXPECT_LT(evaluation["rpe"]["translation_m"]["rmse"], 1e-6);
  EXPECT_LT(evaluation["position_m"]["rmse"], 1e-6);
  EXPECT_TRUE(evaluation["kitti"].is_null());
}

TEST_F(ModelEvaluator, UnitsAreMetersOnlyIfTheTruthIsMetric) {
  WriteModel("model", Mono({0, 1, 2, 3}));
  WriteModel("truth", Mono({0, 1, 2, 3}));
  const auto text = [&](const std::string& flags) {
    return RunMgsfm(Call(flags)).out;
  };
  const std::string model = "--gt_path " + Path("truth") + " ";
  EXPECT_THAT(text(model), AllOf(HasSubstr(" units per unit of the model"),
                                 Not(testing::ContainsRegex("[0-9] m[ \n]"))));
  EXPECT_EQ(Evaluate(model)["length_unit"], "units");
  EXPECT_THAT(text(model + "--gt_unit m"), HasSubstr(" m per unit"));
  EXPECT_THAT(text(WriteKitti(4)), HasSubstr(" m per unit"));
  EXPECT_THAT(text(WriteTum(4, 1.0)), HasSubstr(" m per unit"));
  WriteTextFile(Path("truth/geo_origin.json"),
                R"({"latitude_deg": 1, "longitude_deg": 2, "altitude_m": 3})");
  EXPECT_EQ(Evaluate(model)["length_unit"], "m");
  EXPECT_EQ(Evaluate(model + "--gt_unit units")["length_unit"], "units");
}

TEST_F(ModelEvaluator, ImagesWithoutTruthAreReported) {
  WriteModel("model", Mono({0, 1, 2, 3, 4}));
  WriteModel("truth", Mono({0, 1, 2}));
  EXPECT_THAT(RunMgsfm(Call("--gt_path " + Path("truth"))).err,
              AllOf(HasSubstr("2 images"), HasSubstr("000003")));
}

TEST_F(ModelEvaluator, ImagesThatAnyAlignmentFitsAreNamed) {
  WriteModel("model", Mono({0, 1, 2, 3, 4}));
  const auto warnings = [&](const std::vector<int>& frames,
                            const std::string& alignment) {
    WriteModel("truth", Mono(frames));
    return RunMgsfm(
               Call("--gt_path " + Path("truth") + " --alignment " + alignment))
        .err;
  };
  const auto is_named = HasSubstr("for any model, as only");
  EXPECT_THAT(warnings({0, 1}, "similarity"), is_named);
  EXPECT_THAT(warnings({0}, "rigid"), is_named);
  for (const char* alignment : {"rigid", "none"}) {
    EXPECT_THAT(warnings({0, 1}, alignment), Not(is_named));
  }
  EXPECT_THAT(warnings({0, 1, 2}, "similarity"), Not(is_named));
}

// Frames 0 to 9, or at 0 s to 9 s?
TEST_F(ModelEvaluator, CountersAreNoTimes) {
  WriteModel("model", Mono({0, 1, 2, 3, 4, 5, 6, 7, 8, 9}));
  ExpectRefused(WriteTum(10, 0.5),
                AllOf(HasSubstr("times in s"), HasSubstr("tum.txt")));
  ExpectCounts(Evaluate(WriteTum(19, 0.5)), 10, 10);
}

TEST_F(ModelEvaluator, DrawsThePath) {
  WriteModel("model", Mono({0, 1, 2, 3, 4, 7, 8, 9}));
  Evaluate(WriteKitti(20) + "--svg_path " + Path("path.svg"));
  const std::string svg = ReadTextFile(Path("path.svg"));
  EXPECT_THAT(svg, HasSubstr("<svg xmlns="));
  EXPECT_THAT(svg, HasSubstr("8 of 10 images registered"));
  fs::remove(Path("out.json"));
  ExpectRefused("--gt_format rig --calib_path x --svg_path " + Path("y.svg"),
                HasSubstr("--svg_path"));
}

}  // namespace
}  // namespace mgsfm
