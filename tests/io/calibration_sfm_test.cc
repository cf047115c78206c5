// SPDX-License-Identifier: BSD-3-Clause
// Rigs of OpenSfM and kapture, by hand from their documentation.
#include <cmath>
#include <set>

#include "io/calibration_fixture.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr const char* kOpenSfm = R"({
  "front": {"rotation": [0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0],
            "camera": "a"},
  "left": {"rotation": [0.0, 1.5707963267948966, 0.0],
           "translation": [0.1, 0.2, 0.3], "camera": "b"},
  "up": {"rotation": [1.5707963267948966, 0.0, 0.0],
         "translation": [0.0, 0.0, 0.1], "camera": "c"}
})";
constexpr const char* kOpenSfmModels = R"({
  "a": {"projection_type": "brown", "width": 800, "height": 600,
        "focal_x": 0.7, "focal_y": 0.72, "c_x": 0.01, "c_y": -0.02,
        "k1": -0.1, "k2": 0.02, "p1": 0.001, "p2": -0.002, "k3": 0.003},
  "b": {"projection_type": "fisheye", "width": 600, "height": 800,
        "focal": 0.4, "k1": -0.05, "k2": 0.01},
  "c": {"projection_type": "spherical", "width": 800, "height": 400}
})";

constexpr const char* kKaptureSensors = R"(# kapture format: 1.1
# sensor_device_id, name, sensor_type, [sensor_params]+
cam01, Hero7, camera, OPENCV, 800, 600, 500, 501, 400, 300, 0.1, 0.2, 0.003, 0.004
cam02, , camera, UNKNOWN_CAMERA, 800, 600
phone01wifi, , wifi
)";
constexpr const char* kKaptureRigs = R"(# kapture format: 1.1
# rig_device_id, sensor_device_id, qw, qx, qy, qz, tx, ty, tz
rig, cam01, 1, 0, 0, 0, 0, 0, 0
rig, cam02, 0.7071067811865476, 0, 0.7071067811865476, 0, 0.1, 0.2, 0.3
)";

class CalibrationSfmTest : public CalibrationTest {
 protected:
  // Whether the camera projects as the normalized image coordinates of
  // OpenSfM's documentation, (0, 0) in the middle and 1 the larger side.
  template <class Function>
  static void ExpectNormalized(const CalibratedCamera& camera,
                               const Function& normalized) {
    const auto [width, height] = camera.size_px.value();
    for (const Eigen::Vector3d& ray :
         {Eigen::Vector3d(0.1, 0.2, 1.0), Eigen::Vector3d(-0.3, 0.25, 1.0)}) {
      const Eigen::Vector2d expected =
          std::max(width, height) * normalized(ray) +
          0.5 * Eigen::Vector2d(width, height);
      const auto pixel =
          ProjectToPixel(*camera.model, camera.params.data(), ray);
      ASSERT_TRUE(pixel.has_value());
      EXPECT_NEAR((*pixel - expected).norm(), 0.0, 1e-9);
    }
  }
};

TEST_F(CalibrationSfmTest, OpenSfmProjectsAndPlacesCamerasAsDocumented) {
  Write("rig_cameras.json", kOpenSfm);
  Write("camera_models.json", kOpenSfmModels);
  Write("reconstruction.json", "not read");
  const Cameras cameras = ReadCalibration(Path(""));
  ASSERT_EQ(cameras.size(), 3u);
  ExpectNormalized(cameras[0], [](const Eigen::Vector3d& ray) {
    const double x = ray.x() / ray.z(), y = ray.y() / ray.z();
    const double r2 = x * x + y * y;
    const double d = 1.0 - 0.1 * r2 + 0.02 * r2 * r2 + 0.003 * r2 * r2 * r2;
    return Eigen::Vector2d(
        0.7 * (d * x + 2 * 0.001 * x * y - 0.002 * (r2 + 2 * x * x)) + 0.01,
        0.72 * (d * y - 2 * 0.002 * x * y + 0.001 * (r2 + 2 * y * y)) - 0.02);
  });
  ExpectNormalized(cameras[1], [](const Eigen::Vector3d& ray) {
    const double r = ray.head<2>().norm();
    const double theta = std::atan2(r, ray.z());
    const double d = 1.0 - 0.05 * theta * theta + 0.01 * std::pow(theta, 4);
    return Eigen::Vector2d(0.4 * d * theta / r * ray.head<2>());
  });
  ExpectNormalized(cameras[2], [](const Eigen::Vector3d& ray) {
    return Eigen::Vector2d(
        std::atan2(ray.x(), ray.z()) / (2 * M_PI),
        std::atan2(ray.y(), std::hypot(ray.x(), ray.z())) / (2 * M_PI));
  });
  // A point of the rig on the axis of the front camera is to the left's right.
  const Rigid3 left = CamFromFirst(cameras, 1);
  EXPECT_NEAR(
      (left * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(1.1, 0.2, 0.3)).norm(),
      0.0, 1e-9);
}

TEST_F(CalibrationSfmTest, OpenSfmWithoutCameraModelsHasPosesOnly) {
  const Cameras cameras = ReadCalibration(Write("rig_cameras.json", kOpenSfm));
  ASSERT_EQ(cameras.size(), 3u);
  for (const CalibratedCamera& camera : cameras) {
    EXPECT_FALSE(camera.model.has_value());
    EXPECT_EQ(camera.why_no_model, "");
    EXPECT_TRUE(camera.cam_from_base.has_value());
  }
  SceneLoadingOptions options;
  options.calibration_path = Path("rig_cameras.json");
  const Scene scene =
      LoadScene(MakeContents({"front/1.jpg", "left/1.jpg", "up/1.jpg"}),
                options, Context())
          .scene;
  EXPECT_EQ(scene.frames.size(), 1u);
  EXPECT_EQ(scene.cameras[0].model, CameraModelId::kSimpleRadial);
  EXPECT_TRUE(scene.sensors[1].sensor_from_rig.has_value());
}

// The names of images that are in one frame.
std::set<std::set<std::string>> FramesOf(const Scene& scene) {
  std::set<std::set<std::string>> frames;
  for (const Frame& frame : scene.frames) {
    std::set<std::string> names;
    for (const int i : frame.image_idxs) names.insert(scene.images[i].name);
    frames.insert(names);
  }
  return frames;
}

TEST_F(CalibrationSfmTest, OpenSfmInstancesAreFrames) {
  Write("rig_cameras.json", kOpenSfm);
  Write("camera_models.json",
        R"({"b": {"projection_type": "fisheye", "width": 1280, "height": 960,
                  "focal": 0.4, "k1": -0.05, "k2": 0.01}})");
  const DatabaseContents contents =
      MakeContents({"a.jpg", "a.png", "c.jpg", "d.jpg", "e.jpg", "seq/f.jpg"});
  const std::string first = R"([["a.jpg", "front"], ["c.jpg", "left"]])";
  const std::string second = R"([["a.png", "front"], ["seq/f.jpg", "left"],
      ["gone.jpg", "up"]])";
  SceneLoadingOptions options;
  for (const std::string& text :
       {"[" + first + ", " + second + "]",
        R"({"x": )" + first + R"(, "y": )" + second + "}"}) {
    Write("rig_assignments.json", text);
    for (const std::string& path : {Path("rig_cameras.json"), Path("")}) {
      options.calibration_path = path;
      const Scene scene = LoadScene(contents, options, Context()).scene;
      const std::set<std::set<std::string>> expected = {
          {"a.jpg", "c.jpg"}, {"a.png", "seq/f.jpg"}, {"d.jpg"}, {"e.jpg"}};
      EXPECT_EQ(FramesOf(scene), expected);
      const Image& front = scene.images[0];
      const Image& left = scene.images[2];
      EXPECT_EQ(scene.sensors[left.sensor_idx].name, "left");
      EXPECT_EQ(scene.cameras[left.camera_idx].model,
                CameraModelId::kOpenCVFisheye);
      // As in the files, whichever is the reference.
      const Rigid3 left_from_front =
          *scene.sensors[left.sensor_idx].sensor_from_rig *
          scene.sensors[front.sensor_idx].sensor_from_rig->Inverse();
      EXPECT_LT((left_from_front * Eigen::Vector3d(0, 0, 1) -
                 Eigen::Vector3d(1.1, 0.2, 0.3))
                    .norm(),
                1e-9);
    }
  }
  const auto error = [&](const std::string& text) {
    Write("rig_assignments.json", text);
    return ErrorOf([&] { (void)LoadScene(contents, options, Context()); });
  };
  EXPECT_THAT(error("[\n[[\"a.jpg\", \"rear\"]]]"),
              AllOf(HasSubstr("rig_assignments.json', line 2"),
                    HasSubstr("no camera of rig_cameras.json")));
  EXPECT_THAT(error("[" + first + ", " + first + "]"),
              HasSubstr("in two instances"));
  EXPECT_THAT(error(R"([["a.jpg", "front"]])"), HasSubstr("is no pair"));
}

// Cameras of instances, and by names for other images, also if no frame has
// both; a file that names no image decides nothing.
TEST_F(CalibrationSfmTest, OpenSfmInstancesKeepTheCalibration) {
  Write("opensfm/rig_cameras.json", kOpenSfm);
  Write("opensfm/camera_models.json",
        R"({"b": {"projection_type": "fisheye", "width": 1280, "height": 960,
                  "focal": 0.4, "k1": -0.05, "k2": 0.01}})");
  SceneLoadingOptions options;
  options.calibration_path = Path("");
  for (const std::string listed :
       {"[[\"a.jpg\", \"left\"]]", "[]", "[[\"images/a.jpg\", \"left\"]]"}) {
    Write("opensfm/rig_assignments.json", "[" + listed + "]");
    std::vector<std::string> warnings;
    Context context;
    context.log = [&](LogLevel level, const std::string& message) {
      if (level == LogLevel::kWarning) warnings.push_back(message);
    };
    const bool is_used = listed.find("[\"a.jpg") != std::string::npos;
    const Scene scene =
        LoadScene(MakeContents({"a.jpg", "left/1.png", "left/2.png"}), options,
                  context)
            .scene;
    EXPECT_EQ(scene.frames.size(), 3u);
    for (const Image& image : scene.images) {
      const bool is_left = is_used || image.name != "a.jpg";
      EXPECT_EQ(scene.cameras[image.camera_idx].model ==
                    CameraModelId::kOpenCVFisheye,
                is_left)
          << image.name << listed;
    }
    EXPECT_EQ(
        testing::Value(
            warnings, testing::Contains(HasSubstr("names none of the images"))),
        !is_used);
  }
}

TEST_F(CalibrationSfmTest, KaptureHasTheModelsOfColmapAndPosesFromTheRig) {
  Write("sensors/sensors.txt", kKaptureSensors);
  Write("sensors/rigs.txt", kKaptureRigs);
  for (const std::string& path :
       {Path(""), Path("sensors"), Path("sensors/sensors.txt")}) {
    const Cameras cameras = ReadCalibration(path);
    ASSERT_EQ(cameras.size(), 2u);
    EXPECT_EQ(cameras[0].model, CameraModelId::kOpenCV);
    EXPECT_EQ(cameras[0].params,
              (Params{500, 501, 400, 300, 0.1, 0.2, 0.003, 0.004}));
    EXPECT_FALSE(cameras[1].model.has_value());
    EXPECT_EQ(cameras[1].size_px, std::make_pair(800, 600));
    const Rigid3 pose = CamFromFirst(cameras, 1);
    EXPECT_NEAR(
        (pose * Eigen::Vector3d(0, 0, 1) - Eigen::Vector3d(1.1, 0.2, 0.3))
            .norm(),
        0.0, 1e-9);
  }
  std::filesystem::remove(Path("sensors/rigs.txt"));
  EXPECT_FALSE(ReadCalibration(Path("sensors"))[0].cam_from_base.has_value());
}

TEST_F(CalibrationSfmTest, MalformedFilesAreNamedWithTheirLine) {
  const std::string name = "sensors/sensors.txt";
  EXPECT_THAT(ErrorOfChange(name, kKaptureSensors, "501", "x"),
              AllOf(HasSubstr("line 3"), HasSubstr("'x'")));
  EXPECT_THAT(ErrorOfChange(name, kKaptureSensors, ", 0.004", ""),
              HasSubstr("has 7 parameters of the model OPENCV, which has 8"));
  EXPECT_THAT(ErrorOfChange(name, kKaptureSensors, ", 800, 600\n", "\n"),
              HasSubstr("line 4"));
  Write("sensors/rigs.txt",
        std::string(kKaptureRigs) + "other, cam03, 1, 0, 0\n");
  EXPECT_THAT(ErrorOfFile(name, kKaptureSensors),
              AllOf(HasSubstr("rigs.txt"), HasSubstr("line 5")));
  Write("camera_models.json", R"({"a": {"projection_type": "brown"}})");
  EXPECT_THAT(ErrorOfFile("rig_cameras.json", kOpenSfm),
              HasSubstr("camera_models.json"));
  EXPECT_THAT(
      ErrorOfFile("rig.xml", "<document/>"),
      AllOf(HasSubstr("Metashape"), HasSubstr("cam_from_rig_rotation")));
}

}  // namespace
}  // namespace mgsfm
