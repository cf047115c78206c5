// SPDX-License-Identifier: BSD-3-Clause
// Models of other programs: round trips through our writers, and files written
// by hand, whose numbers follow from the definitions of the formats.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "exchange/exchange_formats.h"
#include "exchange/import_formats.h"
#include "exchange/ply.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/simulator/simulation.h"
#include "support/error_of.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

class Import : public testing::Test {
 protected:
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }
  // Only the header of an image; its format is that of the content.
  void WriteImage(const std::string& name, int width, int height) const {
    const fs::path path = dir_.path() / "images" / name;
    fs::create_directories(path.parent_path());
    WriteTextFile(path, "P5 " + std::to_string(width) + " " +
                            std::to_string(height) + " 255\n");
  }
  Model Read(const std::string& file) const {
    return GuessImportFormat(file)->read(
        {Path(file), dir_.path() / "images", ""}, Context());
  }
  Model ReadText(const std::string& file, const std::string& text) const {
    WriteTextFile(Path(file), text);
    return Read(file);
  }
  void ExpectRefused(const std::string& file, const std::string& text,
                     const testing::Matcher<std::string>& message) const {
    try {
      ReadText(file, text);
      ADD_FAILURE() << text << "is read";
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), AllOf(HasSubstr(Path(file)), message));
    }
  }

  const TempDir dir_;
};

// A stereo drive whose cameras all of these formats can hold.
Simulation Drive() {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.num_frames = 5;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 30;
  Simulation drive = Simulate(options);
  for (Camera& camera : drive.ground_truth.cameras) {
    camera.model = CameraModelId::kSimpleRadial;
    camera.params = {camera.params[0], 0.5 * camera.width_px,
                     0.5 * camera.height_px, -0.01};
  }
  drive.scene.cameras = drive.ground_truth.cameras;
  for (size_t i = 0; i < drive.ground_truth.points.size(); ++i) {
    drive.ground_truth.points[i].color = {static_cast<uint8_t>(i), 7, 255};
  }
  return drive;
}

// Points by their coordinates, with the names and pixels of their images.
using Tracks = std::map<std::vector<double>,
                        std::set<std::pair<std::string, std::vector<double>>>>;

Tracks TracksOf(const Simulation& drive) {
  Tracks tracks;
  for (const Point3D& point : drive.ground_truth.points) {
    const Eigen::Vector3d& p = point.point_in_world;
    auto& track = tracks[{p.x(), p.y(), p.z(), double(point.color.x())}];
    for (const Observation& o : point.track) {
      const Image& image = drive.scene.images[o.image_idx];
      const Eigen::Vector2f& pixel = image.keypoints_px[o.keypoint_idx];
      // Bundler's pixels are differences from the center.
      track.insert(
          {image.name,
           {std::round(1e3 * pixel.x()), std::round(1e3 * pixel.y())}});
    }
  }
  return tracks;
}

Tracks TracksOf(const Model& model) {
  std::map<ImageId, size_t> position_of_id;
  for (size_t i = 0; i < model.poses.images.size(); ++i) {
    position_of_id[model.poses.images[i].id] = i;
  }
  Tracks tracks;
  for (const ModelPoint& point : model.points) {
    const Eigen::Vector3d& p = point.point_in_world;
    auto& track = tracks[{p.x(), p.y(), p.z(), double(point.color.x())}];
    for (const ModelObservation& o : point.track) {
      const size_t i = position_of_id.at(o.image_id);
      const ModelKeypoint& keypoint = model.keypoints[i].at(o.keypoint_idx);
      EXPECT_EQ(keypoint.point_id, point.id);
      track.insert({model.poses.images[i].name,
                    {std::round(1e3 * keypoint.position_px.x()),
                     std::round(1e3 * keypoint.position_px.y())}});
    }
  }
  return tracks;
}

void ExpectDrive(const Model& model, const Simulation& drive) {
  ASSERT_EQ(model.poses.images.size(), drive.scene.images.size());
  ASSERT_EQ(model.cameras.size(), 2u);
  for (size_t i = 0; i < drive.scene.images.size(); ++i) {
    const ModelImage& image = model.poses.images[i];
    EXPECT_EQ(image.name, drive.scene.images[i].name);
    const Rigid3 pose =
        *drive.ground_truth.CamFromWorld(drive.scene, static_cast<int>(i));
    EXPECT_LT(AngleBetween(image.cam_from_world.rotation, pose.rotation),
              1e-12);
    EXPECT_LT((image.cam_from_world.Center() - pose.Center()).norm(), 1e-11);
    const Camera& camera = model.cameras.at(image.camera_id.value() - 1);
    const Camera& expected =
        drive.ground_truth.cameras[drive.scene.images[i].camera_idx];
    EXPECT_EQ(camera.model, expected.model);
    EXPECT_EQ(camera.params, expected.params);
    EXPECT_EQ(camera.width_px, expected.width_px);
  }
  EXPECT_EQ(TracksOf(model), TracksOf(drive));
}

TEST_F(Import, ReadsWhatIsWritten) {
  const Simulation drive = Drive();
  for (const Image& image : drive.scene.images) {
    const Camera& camera = drive.scene.cameras[image.camera_idx];
    WriteImage(image.name, camera.width_px, camera.height_px);
  }
  for (const auto& [format, file] :
       {std::pair("nvm", "a.nvm"), std::pair("bundler", "a.bundle.out")}) {
    for (const ExportedFile& written : FindExchangeFormat(format)->write(
             {drive.scene, drive.ground_truth, {}, {}})) {
      WriteTextFile(
          Path((format == std::string("nvm") ? "a.nvm" : "a") + written.suffix),
          written.content);
    }
    ExpectDrive(Read(file), drive);
  }
}

// ---------------------------------------------------------------- VisualSFM

// A camera at (1, 2, 3) that is turned by 180 degrees about its axis.
constexpr char kNvmImage[] = "cam a/1.jpg\t500 0 0 0 1 1 2 3 0.25 0\n";

TEST_F(Import, PixelsOfVisualSfmCountFromThePrincipalPoint) {
  WriteImage("cam a/1.jpg", 640, 480);
  const Model model =
      ReadText("a.nvm", "NVM_V3 \n\n1\n" + std::string(kNvmImage) +
                            "\n1\n5 6 7 1 2 3 1 0 17 -20.5 4\n\n0\n");
  ASSERT_EQ(model.poses.images.size(), 1u);
  const ModelImage& image = model.poses.images[0];
  EXPECT_EQ(image.name, "cam a/1.jpg");
  EXPECT_LT((image.cam_from_world * Eigen::Vector3d(2, 4, 13) -
             Eigen::Vector3d(-1, -2, 10))
                .norm(),
            1e-12);
  EXPECT_EQ(model.cameras[0].model, CameraModelId::kSimpleRadial);
  EXPECT_THAT(model.cameras[0].params, ElementsAre(500, 320, 240, -0.25));
  EXPECT_EQ(model.keypoints[0].at(0).position_px,
            Eigen::Vector2d(320 - 20.5, 244));
}

TEST_F(Import, FixedCalibrationsAreKept) {
  WriteImage("cam a/1.jpg", 640, 480);
  const Model model = ReadText(
      "a.nvm", "NVM_V3 FixedK 500 310 510 230\n\n1\n" + std::string(kNvmImage) +
                   "\n1\n5 6 7 1 2 3 1 0 17 -20.5 4\n");
  EXPECT_EQ(model.cameras[0].model, CameraModelId::kOpenCV);
  EXPECT_THAT(model.cameras[0].params,
              ElementsAre(500, 510, 310, 230, -0.25, 0, 0, 0));
  EXPECT_EQ(model.keypoints[0].at(0).position_px,
            Eigen::Vector2d(310 - 20.5, 234));
}

TEST_F(Import, DamagedNvmIsRefused) {
  WriteImage("cam a/1.jpg", 640, 480);
  const std::string head = "NVM_V3\n\n1\n";
  const std::string image = kNvmImage;
  // R9T has rotation matrices.
  for (const char* version : {"NVM_V2\n", "NVM_V3_R9T\n"}) {
    ExpectRefused("a.nvm", version,
                  AllOf(HasSubstr("line 1"), HasSubstr("NVM_V3")));
  }
  ExpectRefused("a.nvm", head + "1.jpg 500 1 0 0\n",
                AllOf(HasSubstr("line 4"), HasSubstr("an image:")));
  ExpectRefused("a.nvm", head + "1.jpg 500 0 0 0 0 1 2 3 0 0\n",
                AllOf(HasSubstr("line 4"), HasSubstr("'1.jpg'")));
  ExpectRefused("a.nvm", head + "b.jpg 500 1 0 0 0 1 2 3 0 0\n",
                AllOf(HasSubstr("'b.jpg'"), HasSubstr("image_path")));
  ExpectRefused("a.nvm", head + image + "\n1\n5 6 7 1 2 300 1 0 17 2 4\n",
                AllOf(HasSubstr("line 7"), HasSubstr("color")));
  ExpectRefused("a.nvm", head + image + "\n1\n5 6 7 1 2 3 1 4 17 2 4\n",
                AllOf(HasSubstr("line 7"), HasSubstr("image 4")));
  ExpectRefused("a.nvm", head + image + "\n1\n5 6 x 1 2 3 1 0 17 2 4\n",
                AllOf(HasSubstr("line 7"), HasSubstr("'x'")));
  ExpectRefused("a.nvm", "NVM_V3\n2\n" + image + image + "0\n",
                HasSubstr("two images"));
  ExpectRefused("a.nvm", "NVM_V3\n0\n0\n", HasSubstr("no image"));
  // Every truncated file.
  const std::string whole = head + image + "\n1\n5 6 7 1 2 3 1 0 17 2 41\n";
  for (size_t size = 0; size + 3 < whole.size(); ++size) {
    ExpectRefused("a.nvm", whole.substr(0, size), testing::_);
  }
  try {
    WriteTextFile(Path("a.nvm"), whole);
    ReadNvm({Path("a.nvm"), "", ""}, Context());
    ADD_FAILURE();
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("image_path"));
  }
}

// ------------------------------------------------------------------ Bundler

// The second camera has no pose. The first one looks along +z of the world,
// which is -z of Bundler's camera, from (0, 0, -2).
constexpr char kBundle[] =
    "# Bundle file v0.3\n2 1\n"
    "500 0.1 -0.02\n1 0 0\n0 -1 0\n0 0 -1\n0 0 -2\n"
    "0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n"
    "1 2 3\n9 8 7\n1 0 33 10 20\n";

TEST_F(Import, CamerasOfBundlerLookBackwards) {
  WriteImage("1.jpg", 640, 480);
  WriteTextFile(Path("list.txt"), "./1.jpg 0 500.5\n2.jpg\n");
  const Model model = ReadText("bundle.out", kBundle);
  ASSERT_EQ(model.poses.images.size(), 1u);
  EXPECT_EQ(model.poses.images[0].name, "1.jpg");
  EXPECT_LT((model.poses.images[0].cam_from_world * Eigen::Vector3d(1, 2, 3) -
             Eigen::Vector3d(1, 2, 5))
                .norm(),
            1e-12);
  EXPECT_THAT(model.cameras[0].params, ElementsAre(500, 320, 240, 0.1, -0.02));
  EXPECT_EQ(model.keypoints[0].at(0).position_px, Eigen::Vector2d(330, 220));
  EXPECT_EQ(model.points[0].color.x(), 9);
}

TEST_F(Import, DamagedBundlesAreRefused) {
  WriteImage("1.jpg", 640, 480);
  const std::string bundle = kBundle;
  ExpectRefused("bundle.out", bundle,
                AllOf(HasSubstr("list.txt"), HasSubstr("list_path")));
  WriteTextFile(Path("list.txt"), "1.jpg\n");
  ExpectRefused("bundle.out", bundle,
                AllOf(HasSubstr("2 cameras"), HasSubstr("1 images")));
  WriteTextFile(Path("list.txt"), "1.jpg\n2.jpg\n");
  ExpectRefused("bundle.out", "# Bundle file v0.1\n", HasSubstr("line 1"));
  std::string changed = bundle;
  changed.replace(changed.find("1 0 33"), 6, "1 1 33");
  ExpectRefused("bundle.out", changed,
                AllOf(HasSubstr("line 15"), HasSubstr("camera 1")));
  changed = bundle;
  changed.replace(changed.find("0 -1 0"), 6, "0 -2 0");
  ExpectRefused("bundle.out", changed,
                AllOf(HasSubstr("'1.jpg'"), HasSubstr("rotation matrix")));
  for (size_t size = 0; size + 3 < bundle.size(); ++size) {
    ExpectRefused("bundle.out", bundle.substr(0, size), testing::_);
  }
}

// --------------------------------------------------------------- nerfstudio

// At (1, 2, 3), looking along +x of the world with z up: the right side is -y.
constexpr char kMatrix[] =
    R"("transform_matrix": [[0, 0, -1, 1], [-1, 0, 0, 2], [0, 1, 0, 3],
                            [0, 0, 0, 1]])";

std::string Transforms(const std::string& all, const std::string& frame) {
  return "{" + all + "\"frames\": [{\"file_path\": \"./images/a.jpg\", " +
         frame + kMatrix + "}]}";
}

TEST_F(Import, TransformsAreThoseOfOpenGl) {
  const Model model = ReadText(
      "t.json", Transforms(R"("camera_model": "OPENCV_FISHEYE", "fl_x": 300,
                              "fl_y": 301, "w": 1000, "h": 800, "k2": 0.1,)",
                           R"("cx": 490,)"));
  ASSERT_EQ(model.poses.images.size(), 1u);
  EXPECT_EQ(model.poses.images[0].name, "a.jpg");
  // 5 ahead, 2 to the right, 1 up.
  EXPECT_LT((model.poses.images[0].cam_from_world * Eigen::Vector3d(6, 0, 4) -
             Eigen::Vector3d(2, -1, 5))
                .norm(),
            1e-12);
  EXPECT_EQ(model.cameras[0].model, CameraModelId::kOpenCVFisheye);
  EXPECT_THAT(model.cameras[0].params,
              ElementsAre(300, 301, 490, 400, 0, 0.1, 0, 0));
}

TEST_F(Import, FocalLengthsMayBeAngles) {
  WriteImage("images/a.jpg", 200, 100);
  const Model model = ReadText(
      "t.json", Transforms(R"("camera_angle_x": 1.5707963267948966,)", ""));
  EXPECT_EQ(model.cameras[0].model, CameraModelId::kPinhole);
  EXPECT_THAT(model.cameras[0].params,
              ElementsAre(testing::DoubleNear(100, 1e-9),
                          testing::DoubleNear(100, 1e-9), 100, 50));
}

TEST_F(Import, FisheyesOfInstantNgp) {
  const std::string size = R"("fl_x": 370, "w": 640, "h": 200,)";
  const Model model = ReadText(
      "t.json", Transforms(size + R"("is_fisheye": true, "k1": 0.01,)", ""));
  EXPECT_EQ(model.cameras[0].model, CameraModelId::kOpenCVFisheye);
  EXPECT_THAT(model.cameras[0].params,
              ElementsAre(370, 370, 320, 100, 0.01, 0, 0, 0));
  ExpectRefused("t.json",
                Transforms(size + R"("is_fisheye": true,
                                     "camera_model": "OPENCV",)",
                           ""),
                HasSubstr("contradicts"));
  ExpectRefused("t.json",
                Transforms(size + R"("is_fisheye": true, "p2": 0.01,)", ""),
                HasSubstr("tangential"));
  // The angle of a fisheye does not define its focal length.
  ExpectRefused("t.json",
                Transforms(R"("is_fisheye": true, "camera_angle_x": 1.0,
                              "w": 640, "h": 200,)",
                           ""),
                HasSubstr("fl_x is missing"));
}

TEST_F(Import, ContradictionsOfTransformsAreNamed) {
  std::string warning;
  Context context;
  context.log = [&](LogLevel, const std::string& text) { warning += text; };
  const auto read = [&](const std::string& all) {
    warning.clear();
    WriteTextFile(Path("t.json"), Transforms(all, ""));
    return ReadNerfstudio({Path("t.json"), "", ""}, context);
  };
  const std::string size = R"("w": 640, "h": 200,)";
  // 2 atan(320 / 370)
  read(size + R"("fl_x": 370, "camera_angle_x": 1.4262,)");
  EXPECT_EQ(warning, "");
  const Model model = read(size + R"("fl_x": 370, "camera_angle_x": 0.5,)");
  EXPECT_EQ(model.cameras[0].params[0], 370);
  EXPECT_THAT(warning, AllOf(HasSubstr("370"), HasSubstr("1253.2")));
  WriteImage("images/a.jpg", 640, 200);
  read(size + R"("fl_x": 370,)");
  WriteImage("images/a.jpg", 320, 100);
  ExpectRefused("t.json", Transforms(size + R"("fl_x": 370,)", ""),
                AllOf(HasSubstr("640 x 200"), HasSubstr("320 x 100")));
}

TEST_F(Import, AnglesAreRadians) {
  ExpectRefused("t.json",
                Transforms(R"("camera_angle_x": 70, "w": 640, "h": 200,)", ""),
                AllOf(HasSubstr("camera_angle_x is 70"), HasSubstr("radians")));
}

TEST_F(Import, TransposedTransformsAreRefused) {
  std::string text = Transforms(R"("fl_x": 370, "w": 640, "h": 200,)", "");
  text.replace(text.find("[0, 0, 0, 1]"), 12, "[3, 4, 5, 1]");
  ExpectRefused("t.json", text, HasSubstr("0 0 0 1"));
}

TEST_F(Import, DamagedTransformsAreRefused) {
  const std::string size = R"("fl_x": 300, "w": 1000, "h": 800,)";
  ExpectRefused("t.json", "{", HasSubstr("transforms.json"));
  const std::string frame =
      R"(, "w": 640, "h": 200, "fl_x": 370, "frames": [{"file_path": "0.jpg",
      "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]})";
  ExpectRefused("t.json", R"({"cx": -9000)" + frame,
                AllOf(HasSubstr("'0.jpg'"), HasSubstr("principal point")));
  ExpectRefused("t.json", R"({"k1": -44.9, "k2": 1017)" + frame,
                AllOf(HasSubstr("'0.jpg'"), HasSubstr("distortion")));
  ExpectRefused(
      "t.json", Transforms(R"("w": 1000, "h": 800,)", ""),
      AllOf(HasSubstr("frame 0"), HasSubstr("a.jpg"), HasSubstr("fl_x")));
  ExpectRefused("t.json", Transforms("", size + R"("k4": 1,)"),
                HasSubstr("fourth radial"));
  ExpectRefused("t.json", Transforms(R"("camera_model": "X",)", size),
                HasSubstr("'X'"));
  ExpectRefused("t.json", Transforms(R"("h": 800, "w": -1, "fl_x": 1,)", ""),
                HasSubstr("number of pixels"));
  std::string text = Transforms(size, "");
  text.replace(text.find("[-1, 0, 0, 2]"), 13, "[-1, 0, 9, 2]");
  ExpectRefused("t.json", text, HasSubstr("rotation matrix"));
  text.replace(text.find("[-1, 0, 9, 2]"), 13, "[-1, 0, 2]");
  ExpectRefused("t.json", text, HasSubstr("four numbers"));
}

// --------------------------------------------------------------------- PLY

TEST_F(Import, PointsOfPlyFilesAreRead) {
  const Simulation drive = Drive();
  WriteTextFile(Path("a.ply"), PointsToPly(drive.ground_truth));
  const std::vector<ImportedPoint> points = ReadPly(Path("a.ply"));
  ASSERT_EQ(points.size(), drive.ground_truth.points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    const Point3D& expected = drive.ground_truth.points[i];
    EXPECT_EQ(points[i].point_in_world.cast<float>(),
              expected.point_in_world.cast<float>());
    EXPECT_EQ(points[i].color, expected.color);
  }
  const std::string text =
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty double nx\n"
      "property uchar blue\nproperty float z\nproperty float y\n"
      "property float x\nelement face 0\nend_header\n9 200 3 2 1\n";
  WriteTextFile(Path("b.ply"), text);
  EXPECT_EQ(ReadPly(Path("b.ply")).at(0).point_in_world,
            Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(ReadPly(Path("b.ply")).at(0).color.z(), 200);
  for (size_t size = 0; size + 2 < text.size(); ++size) {
    WriteTextFile(Path("b.ply"), text.substr(0, size));
    EXPECT_THROW((void)ReadPly(Path("b.ply")), Error) << size;
  }
  std::string bad_count = text;
  bad_count.replace(text.find("vertex 1"), 8, "vertex 1x");
  WriteTextFile(Path("b.ply"), bad_count);
  EXPECT_THROW((void)ReadPly(Path("b.ply")), Error);
}

TEST_F(Import, PlyFilesHaveWhatTheirHeaderSays) {
  const auto error = [&](const std::string& format, const std::string& axes,
                         const std::string& content) {
    std::string text =
        "ply\nformat " + format + " 1.0\nelement vertex 1\nproperty ";
    for (const char axis : axes)
      text += std::string("uchar ") + axis + "\n" +
              (axis == axes.back() ? "" : "property ");
    WriteTextFile(Path("d.ply"), text + "end_header\n" + content);
    return ErrorOf([&] { (void)ReadPly(Path("d.ply")); });
  };
  EXPECT_EQ(error("ascii", "xyz", "1 2 3\n"), "no error");
  EXPECT_EQ(error("binary_little_endian", "xyz", "123"), "no error");
  for (const char* format : {"ascii", "binary_little_endian"}) {
    EXPECT_THAT(error(format, "xyz", "1 2 3\n4 5 6\n"),
                HasSubstr("more points"));
    EXPECT_THAT(error(format, "xzw", "1 2 3\n"), HasSubstr("coordinate y"));
    EXPECT_THAT(error(format, "xyx", "1 2 3\n"), HasSubstr("coordinate x"));
  }
}

// The values decide whether colors in floating point end at 1 or at 255.
TEST_F(Import, ColorsOfPlyFilesMayBeShares) {
  const auto color = [&](const std::string& rgb) {
    WriteTextFile(Path("c.ply"),
                  "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                  "property float y\nproperty float z\n"
                  "property float red\nproperty float green\n"
                  "property float blue\nend_header\n1 2 3 " +
                      rgb + "\n");
    return ReadPly(Path("c.ply")).at(0).color;
  };
  EXPECT_THAT(color("0 0.2 1"), ElementsAre(0, 51, 255));
  EXPECT_THAT(color("0 51 255"), ElementsAre(0, 51, 255));
  EXPECT_THROW((void)color("0 51 256"), Error);
  EXPECT_THROW((void)color("0 -0.5 1"), Error);
}

TEST_F(Import, KeysThatOccurTwiceAreNamed) {
  ExpectRefused("t.json", R"({"frames": [], "fl_x": 1, "w": 2, "fl_x": 3})",
                HasSubstr("'fl_x' twice"));
}

}  // namespace
}  // namespace mgsfm
