// SPDX-License-Identifier: BSD-3-Clause
// Undistorts the rendered rig, two perspective cameras and two fisheyes of 180
// degrees, into the layouts of other programs.
#include <Eigen/Geometry>
#include <chrono>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <thread>

#include "cli/program_runs.h"
#include "cli/running_program.h"
#include "files/image_reading.h"
#include "io/model_parser.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;
using testing::HasSubstr;

constexpr char kImages[] = MGSFM_SOURCE_DIR "/data/rendered_rig/images";
constexpr char kModel[] = MGSFM_SOURCE_DIR "/data/rendered_rig/truth";

Eigen::Isometry3d CamFromWorld(const ParsedImage& image) {
  const ParsedPose& p = image.cam_from_world;
  return Eigen::Translation3d(p[4], p[5], p[6]) *
         Eigen::Quaterniond(p[0], p[1], p[2], p[3]);
}

std::map<std::string, ParsedImage> OriginalImages() {
  std::map<std::string, ParsedImage> by_name;
  for (const auto& [id, image] : ParseModel(kModel, false).images) {
    by_name[image.name] = image;
  }
  return by_name;
}

// Paths relative to the folder.
Files FilesBelow(const fs::path& folder) {
  Files files;
  for (auto& [path, content] : FilesIn(folder)) {
    files[fs::relative(path, folder).string()] = content;
  }
  return files;
}

class ImageUndistorterTest : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  std::string Line(const std::string& output,
                   const std::string& images = kImages) const {
    return "image_undistorter --image_path " + images + " --input_path " +
           kModel + " --output_path " + Path(output) + " ";
  }

  TempDir dir_;
};

// Loads a model as splatting trainers do: by the base name of each image, which
// they cut at its first dot, with the size, focal lengths and pose, and with
// the principal point in the center.
TEST_F(ImageUndistorterTest, SplattingLoaderFindsAllImages) {
  const CommandOutput run =
      RunMgsfm(Line("splats") + "--output_type gaussian_splatting");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("images/s"));
  const ParsedModel model = ParseModel(Path("splats/sparse/0"), false);
  const std::map<std::string, ParsedImage> originals = OriginalImages();
  ASSERT_EQ(model.images.size(), 24u * (2 + 2 * 5));
  std::set<std::string> stems;
  for (const auto& [id, image] : model.images) {
    const std::string base_name = fs::path(image.name).filename();
    stems.insert(base_name.substr(0, base_name.find('.')));
    const auto size =
        ReadImageSize(ReadTextFile(Path("splats/images/" + base_name)));
    ASSERT_TRUE(size) << base_name;
    const ParsedCamera& camera = model.cameras.at(image.camera_id);
    EXPECT_EQ(camera.model_id, 1);  // PINHOLE
    EXPECT_EQ(size->width, static_cast<int64_t>(camera.width));
    EXPECT_EQ(size->height, static_cast<int64_t>(camera.height));
    EXPECT_EQ(camera.params[2], 0.5 * static_cast<double>(camera.width));
    EXPECT_EQ(camera.params[3], 0.5 * static_cast<double>(camera.height));
    // side_left_up_000003.jpg shows what side_left/000003.jpg shows.
    const std::string original = std::regex_replace(
        image.name,
        std::regex("(side_left|side_right)_[a-z]*|(front_left|front_right)"),
        "$1$2");
    const std::string name =
        std::regex_replace(original, std::regex("_([0-9]{6})"), "/$1");
    ASSERT_EQ(originals.count(name), 1u) << name;
    EXPECT_LT((CamFromWorld(image).inverse().translation() -
               CamFromWorld(originals.at(name)).inverse().translation())
                  .norm(),
              1e-9);
  }
  EXPECT_EQ(stems.size(), model.images.size());
}

// transform_matrix maps from a camera that looks along -z with y up. The frame
// of a face follows from that of the original by exchanging axes.
TEST_F(ImageUndistorterTest, TransformsFollowTheConventionOfNerfstudio) {
  const CommandOutput run = RunMgsfm(Line("nerf") + "--output_type nerfstudio");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const auto transforms =
      nlohmann::json::parse(ReadTextFile(Path("nerf/transforms.json")));
  EXPECT_THAT(ReadTextFile(Path("nerf/sparse_pc.ply")),
              HasSubstr("element vertex 0\n"));
  const std::map<std::string, ParsedImage> originals = OriginalImages();
  int num_front = 0, num_right = 0;
  for (const auto& frame : transforms.at("frames")) {
    const std::string path = frame.at("file_path");
    const auto size = ReadImageSize(ReadTextFile(Path("nerf/" + path)));
    ASSERT_TRUE(size) << path;
    EXPECT_EQ(frame.at("w"), size->width);
    EXPECT_EQ(frame.at("h"), size->height);
    EXPECT_TRUE(fs::exists(Path("nerf/" + std::string(frame.at("mask_path")))));
    Eigen::Matrix4d world_from_gl;
    for (int i = 0; i < 4; ++i) {
      for (int k = 0; k < 4; ++k) {
        world_from_gl(i, k) = frame.at("transform_matrix").at(i).at(k);
      }
    }
    // A point 3 to the right, 2 up and 10 ahead of the view.
    const Vector3d in_world =
        (world_from_gl * Eigen::Vector4d(3, 2, -10, 1)).head<3>();
    std::smatch match;
    if (std::regex_match(path, match, std::regex("images/front_left_(.*)"))) {
      const Vector3d in_cam =
          CamFromWorld(originals.at("front_left/" + std::string(match[1]))) *
          in_world;
      EXPECT_LT((in_cam - Vector3d(3, -2, 10)).norm(), 1e-9);
      ++num_front;
    } else if (std::regex_match(path, match,
                                std::regex("images/side_left_right_(.*)"))) {
      // Ahead is to the right of the fisheye, and right is behind it.
      const Vector3d in_cam =
          CamFromWorld(originals.at("side_left/" + std::string(match[1]))) *
          in_world;
      EXPECT_LT((in_cam - Vector3d(10, -2, -3)).norm(), 1e-9);
      ++num_right;
    }
  }
  EXPECT_EQ(num_front, 24);
  EXPECT_EQ(num_right, 24);

  // Back to the model from which they are.
  ASSERT_EQ(
      RunMgsfm("model_converter --input_path " + Path("nerf/transforms.json") +
               " --output_path " + Path("back"))
          .exit_code,
      0);
  std::map<std::string, ParsedImage> back;
  const ParsedModel returned = ParseModel(Path("back"), false);
  for (const auto& [id, image] : returned.images) back[image.name] = image;
  const ParsedModel model = ParseModel(Path("nerf/colmap/sparse/0"), false);
  ASSERT_EQ(back.size(), model.images.size());
  for (const auto& [id, image] : model.images) {
    const ParsedImage& other = back.at(image.name);
    EXPECT_TRUE(CamFromWorld(other).isApprox(CamFromWorld(image), 1e-12));
    EXPECT_EQ(returned.cameras.at(other.camera_id).params,
              model.cameras.at(image.camera_id).params);
  }
}

TEST_F(ImageUndistorterTest, ContinuesAfterAKill) {
  const CommandOutput whole = RunMgsfm(Line("whole") + "--output_type mvs");
  ASSERT_EQ(whole.exit_code, 0) << whole.err;
  {
    RunningProgram program({"image_undistorter", "--image_path", kImages,
                            "--input_path", kModel, "--output_path",
                            Path("parts"), "--output_type", "mvs"});
    while (!fs::exists(Path("parts/images/front_left/000005.jpg"))) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    program.Send(SIGKILL);
    program.End();
  }
  const CommandOutput rest = RunMgsfm(Line("parts") + "--output_type mvs");
  ASSERT_EQ(rest.exit_code, 0) << rest.err;
  std::smatch match;
  ASSERT_TRUE(std::regex_search(rest.err, match,
                                std::regex("([0-9]+) were already there")));
  EXPECT_GT(std::stoi(match[1]), 0);
  EXPECT_EQ(FilesBelow(Path("whole")), FilesBelow(Path("parts")));
}

TEST_F(ImageUndistorterTest, KeepsImagesOfOtherSettingsAndOriginals) {
  ASSERT_EQ(RunMgsfm(Line("out") + "--field_of_view 60").exit_code, 0);
  const Files before = FilesIn(Path("out"));
  const CommandOutput other = RunMgsfm(Line("out") + "--field_of_view 50");
  EXPECT_EQ(other.exit_code, 1);
  EXPECT_THAT(LastWord(other), HasSubstr("choose another folder"));
  EXPECT_EQ(FilesIn(Path("out")), before);

  fs::create_directory(Path("data"));
  fs::copy(kImages, Path("data/images"), fs::copy_options::recursive);
  const Files originals = FilesIn(Path("data"));
  const CommandOutput inside = RunMgsfm(Line("data", Path("data/images")));
  EXPECT_EQ(inside.exit_code, 1);
  EXPECT_THAT(LastWord(inside), HasSubstr("choose another output folder"));
  EXPECT_EQ(FilesIn(Path("data")), originals);
}

TEST_F(ImageUndistorterTest, NamesImagesThatCannotBeUsed) {
  fs::copy(kImages, Path("images"), fs::copy_options::recursive);
  const std::string image = "side_left/000005.jpg";
  WriteTextFile(Path("images/" + image), "no image");
  const CommandOutput damaged = RunMgsfm(Line("out", Path("images")));
  EXPECT_EQ(damaged.exit_code, 1);
  EXPECT_THAT(LastWord(damaged), HasSubstr("'" + image + "' is damaged"));
  fs::copy_file(Path("images/front_left/000005.jpg"), Path("images/" + image),
                fs::copy_options::overwrite_existing);
  const CommandOutput size = RunMgsfm(Line("out", Path("images")));
  EXPECT_THAT(LastWord(size), HasSubstr("has 640 x 200 pixels"));
  fs::remove(Path("images/" + image));
  const CommandOutput missing = RunMgsfm(Line("other", Path("images")));
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_THAT(LastWord(missing), HasSubstr("'" + image + "' of the model"));
  EXPECT_FALSE(fs::exists(Path("other")));
}

constexpr char kColmap[] = "QT_QPA_PLATFORM=offscreen colmap ";

bool HasColmap() { return RunShell("command -v colmap").exit_code == 0; }

TEST_F(ImageUndistorterTest, ColmapReadsTheModel) {
  if (!HasColmap()) GTEST_SKIP() << "colmap is not installed";
  ASSERT_EQ(RunMgsfm(Line("out")).exit_code, 0);
  const CommandOutput analysis =
      RunShell(kColmap + ("model_analyzer --path " + Path("out/sparse")));
  EXPECT_EQ(analysis.exit_code, 0);
  EXPECT_THAT(analysis.out + analysis.err, HasSubstr("Cameras: 12"));
  EXPECT_THAT(analysis.out + analysis.err, HasSubstr("Images: 288"));
}

// A lens with barrel distortion, as if it had made the perspective images.
TEST_F(ImageUndistorterTest, OrdinaryLensesBecomeWhatColmapMakesOfThem) {
  if (!HasColmap()) GTEST_SKIP() << "colmap is not installed";
  fs::create_directory(Path("model"));
  WriteTextFile(Path("model/cameras.txt"),
                "1 OPENCV 640 200 370 372 318 101 -0.15 0.03 0.001 -0.002\n");
  WriteTextFile(Path("model/images.txt"),
                "1 1 0 0 0 0 0 0 1 front_left/000000.jpg\n\n"
                "2 1 0 0 0 1 0 0 1 front_left/000001.jpg\n\n");
  WriteTextFile(Path("model/points3D.txt"), "");
  for (const char* const blank_pixels : {"0", "0.4", "1"}) {
    const std::string arguments = "image_undistorter --image_path " +
                                  std::string(kImages) + " --input_path " +
                                  Path("model") + " --blank_pixels " +
                                  blank_pixels + " --output_path ";
    const std::string ours = Path(std::string("ours") + blank_pixels);
    const std::string theirs = Path(std::string("theirs") + blank_pixels);
    ASSERT_EQ(RunMgsfm(arguments + ours).exit_code, 0);
    ASSERT_EQ(RunShell(kColmap + arguments + theirs).exit_code, 0);
    const CommandOutput text =
        RunShell(kColmap + ("model_converter --output_type TXT --input_path " +
                            theirs + "/sparse --output_path " + theirs));
    ASSERT_EQ(text.exit_code, 0) << text.err;
    std::istringstream line(
        RunShell("grep -v '#' " + theirs + "/cameras.txt").out);
    int id = 0;
    std::string model;
    uint64_t width = 0, height = 0;
    line >> id >> model >> width >> height;
    const ParsedCamera camera =
        ParseModel(ours + "/sparse", false).cameras.begin()->second;
    EXPECT_EQ(camera.width, width);
    EXPECT_EQ(camera.height, height);
    for (const double param : camera.params) {
      double expected = 0.0;
      line >> expected;
      EXPECT_NEAR(param, expected, 1e-6);
    }
  }
}

}  // namespace
}  // namespace mgsfm
