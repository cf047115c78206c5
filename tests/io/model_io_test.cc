// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/models/model_io.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "io/model_parser.h"
#include "io/test_database.h"
#include "mgsfm/simulator/simulation.h"
#include "support/subprocess.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class ModelIo : public testing::TestWithParam<ModelFormat> {
 protected:
  bool is_text() const { return GetParam() == ModelFormat::kText; }
  void Write(const Simulation& simulation) const {
    WriteModel(dir_.path(), simulation.scene, simulation.ground_truth,
               GetParam());
  }
  ParsedModel Parse() const { return ParseModel(dir_.path(), is_text()); }

  const TempDir dir_;
};

INSTANTIATE_TEST_SUITE_P(Formats, ModelIo,
                         testing::Values(ModelFormat::kBinary,
                                         ModelFormat::kText),
                         [](const auto& format) {
                           return format.param == ModelFormat::kText ? "Text"
                                                                     : "Binary";
                         });

// Four cameras of two models; some images were never taken.
Simulation SmallDrive() {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.num_frames = 4;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 30;
  options.missing_image_ratio = 0.2;
  Simulation simulation = Simulate(options);
  for (size_t i = 0; i < simulation.ground_truth.points.size(); ++i) {
    Point3D& point = simulation.ground_truth.points[i];
    point.color = {static_cast<uint8_t>(i), 255, 0};
    if (i > 0) point.error_px = 0.1 * static_cast<double>(i);
  }
  return simulation;
}

// Mapper results have observations in registered images only.
void Unregister(int frame_idx, Simulation* simulation) {
  Reconstruction& model = simulation->ground_truth;
  model.rig_from_world[frame_idx].reset();
  for (Point3D& point : model.points) {
    auto& track = point.track;
    track.erase(std::remove_if(track.begin(), track.end(),
                               [&](const Observation& o) {
                                 return !model.IsRegistered(simulation->scene,
                                                            o.image_idx);
                               }),
                track.end());
  }
}

void ExpectPoseEq(const ParsedPose& parsed, const Rigid3& pose,
                  double tolerance = 0.0) {
  const Eigen::Quaterniond& q = pose.rotation;
  const Eigen::Vector3d& t = pose.translation;
  const ParsedPose expected = {q.w(), q.x(), q.y(), q.z(), t.x(), t.y(), t.z()};
  for (size_t i = 0; i < 7; ++i) {
    EXPECT_NEAR(parsed[i], expected[i], tolerance);
  }
}

// Consistency of the five files, as COLMAP requires it.
void ExpectFilesAgree(const ParsedModel& model) {
  std::set<uint32_t> cameras_in_rigs;
  for (const auto& [rig_id, sensors] : model.rigs) {
    ASSERT_FALSE(sensors.empty());
    for (const ParsedSensor& sensor : sensors) {
      EXPECT_EQ(model.cameras.count(sensor.camera_id), 1u);
      EXPECT_TRUE(cameras_in_rigs.insert(sensor.camera_id).second);
    }
  }
  std::map<uint64_t, uint32_t> camera_of_image;
  for (const auto& [frame_id, frame] : model.frames) {
    ASSERT_EQ(model.rigs.count(frame.rig_id), 1u);
    EXPECT_FALSE(frame.data.empty());
    for (const auto& [camera_id, image_id] : frame.data) {
      EXPECT_TRUE(camera_of_image.emplace(image_id, camera_id).second);
      const auto& sensors = model.rigs.at(frame.rig_id);
      EXPECT_TRUE(std::any_of(sensors.begin(), sensors.end(),
                              [id = camera_id](const ParsedSensor& sensor) {
                                return sensor.camera_id == id;
                              }));
    }
  }
  EXPECT_EQ(camera_of_image.size(), model.images.size());
  size_t num_marked = 0;
  for (const auto& [image_id, image] : model.images) {
    ASSERT_EQ(camera_of_image.count(image_id), 1u);
    EXPECT_EQ(camera_of_image.at(image_id), image.camera_id);
    for (const ParsedKeypoint& keypoint : image.keypoints) {
      num_marked += keypoint.point_id != -1;
    }
  }
  size_t num_observations = 0;
  for (const auto& [point_id, point] : model.points) {
    num_observations += point.track.size();
    for (const auto& [image_id, keypoint_idx] : point.track) {
      ASSERT_EQ(model.images.count(image_id), 1u);
      const auto& keypoints = model.images.at(image_id).keypoints;
      ASSERT_LT(keypoint_idx, keypoints.size());
      EXPECT_EQ(keypoints[keypoint_idx].point_id,
                static_cast<int64_t>(point_id));
    }
  }
  EXPECT_EQ(num_marked, num_observations);
}

TEST_P(ModelIo, AnIndependentReaderFindsAllThatWasWritten) {
  const Simulation simulation = SmallDrive();
  const Scene& scene = simulation.scene;
  const Reconstruction& truth = simulation.ground_truth;
  Write(simulation);
  const ParsedModel model = Parse();
  ExpectFilesAgree(model);

  ASSERT_EQ(model.cameras.size(), scene.cameras.size());
  for (const Camera& camera : scene.cameras) {
    const ParsedCamera& parsed = model.cameras.at(camera.id.value());
    EXPECT_EQ(parsed.model_id, static_cast<int32_t>(camera.model));
    EXPECT_EQ(parsed.width, static_cast<uint64_t>(camera.width_px));
    EXPECT_EQ(parsed.height, static_cast<uint64_t>(camera.height_px));
    EXPECT_EQ(parsed.params, camera.params);
  }
  ASSERT_EQ(model.rigs.size(), 1u);
  const auto& sensors = model.rigs.at(scene.rigs[0].id.value());
  ASSERT_EQ(sensors.size(), scene.sensors.size());
  for (size_t i = 0; i < sensors.size(); ++i) {
    EXPECT_EQ(sensors[i].camera_id, scene.cameras[i].id.value());
    if (i > 0)
      ExpectPoseEq(*sensors[i].sensor_from_rig, *truth.sensor_from_rig[i]);
  }
  ASSERT_EQ(model.frames.size(), scene.frames.size());
  for (size_t i = 0; i < scene.frames.size(); ++i) {
    const ParsedFrame& frame = model.frames.at(scene.frames[i].id.value());
    ExpectPoseEq(frame.rig_from_world, *truth.rig_from_world[i]);
    EXPECT_EQ(frame.data.size(), scene.frames[i].image_idxs.size());
  }
  ASSERT_EQ(model.images.size(), scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const Image& image = scene.images[i];
    const ParsedImage& parsed = model.images.at(image.id.value());
    EXPECT_EQ(parsed.name, image.name);
    ExpectPoseEq(parsed.cam_from_world,
                 *truth.CamFromWorld(scene, static_cast<int>(i)));
    ASSERT_EQ(parsed.keypoints.size(), image.keypoints_px.size());
    for (size_t k = 0; k < image.keypoints_px.size(); ++k) {
      EXPECT_EQ(parsed.keypoints[k].x, image.keypoints_px[k].x());
      EXPECT_EQ(parsed.keypoints[k].y, image.keypoints_px[k].y());
    }
  }
  ASSERT_EQ(model.points.size(), truth.points.size());
  for (size_t i = 0; i < truth.points.size(); ++i) {
    const ParsedPoint& parsed = model.points.at(i + 1);
    const Point3D& point = truth.points[i];
    for (int k = 0; k < 3; ++k) {
      EXPECT_EQ(parsed.xyz[k], point.point_in_world[k]);
      EXPECT_EQ(parsed.rgb[k], point.color[k]);
    }
    EXPECT_EQ(parsed.error, point.error_px.value_or(-1.0));
    EXPECT_EQ(parsed.track.size(), point.track.size());
  }
}

TEST_P(ModelIo, ReadsBackImagesAndRigs) {
  const Simulation simulation = SmallDrive();
  const Scene& scene = simulation.scene;
  const Reconstruction& truth = simulation.ground_truth;
  Write(simulation);
  const PoseModel model = ReadModelPoses(dir_.path());
  ASSERT_EQ(model.images.size(), scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    // Images of scenes are sorted by name.
    EXPECT_EQ(model.images[i].name, scene.images[i].name);
    EXPECT_EQ(model.images[i].camera_id,
              scene.cameras[scene.images[i].camera_idx].id);
    const Rigid3 pose = *truth.CamFromWorld(scene, static_cast<int>(i));
    EXPECT_LT((model.images[i].cam_from_world.rotation.coeffs() -
               pose.rotation.coeffs())
                  .norm(),
              1e-15);
    EXPECT_EQ(model.images[i].cam_from_world.translation, pose.translation);
  }
  ASSERT_EQ(model.rigs.size(), 1u);
  EXPECT_EQ(model.rigs[0].id, scene.rigs[0].id);
  ASSERT_EQ(model.rigs[0].sensors.size(), 4u);
  for (size_t i = 0; i < 4; ++i) {
    const RigSensorRow& sensor = model.rigs[0].sensors[i];
    EXPECT_EQ(sensor.camera_id, scene.cameras[i].id);
    EXPECT_EQ(model.rigs[0].ref_camera_id == sensor.camera_id, i == 0);
    EXPECT_LT((sensor.sensor_from_rig->rotation.coeffs() -
               truth.sensor_from_rig[i]->rotation.coeffs())
                  .norm(),
              1e-15);
    EXPECT_EQ(sensor.sensor_from_rig->translation,
              truth.sensor_from_rig[i]->translation);
  }
}

TEST_P(ModelIo, LeavesOutWhatIsNotRegistered) {
  Simulation simulation = SmallDrive();
  const Scene& scene = simulation.scene;
  const int sensor_idx = 3;
  simulation.ground_truth.sensor_from_rig[sensor_idx].reset();
  Unregister(1, &simulation);
  Write(simulation);
  const ParsedModel model = Parse();
  ExpectFilesAgree(model);
  for (const Image& image : scene.images) {
    EXPECT_EQ(model.images.count(image.id.value()),
              image.frame_idx != 1 && image.sensor_idx != sensor_idx);
  }
  EXPECT_EQ(model.frames.count(scene.frames[1].id.value()), 0u);
  EXPECT_EQ(model.frames.size(), scene.frames.size() - 1);
  // The sensor stays in the rig, without a pose.
  const auto& sensors = model.rigs.begin()->second;
  ASSERT_EQ(sensors.size(), 4u);
  EXPECT_FALSE(sensors[sensor_idx].sensor_from_rig.has_value());
  EXPECT_FALSE(ReadModelPoses(dir_.path())
                   .rigs[0]
                   .sensors[sensor_idx]
                   .sensor_from_rig.has_value());
}

TEST_P(ModelIo, SensorsThatShareACameraGetCopies) {
  Simulation simulation = SmallDrive();
  Scene& scene = simulation.scene;
  scene.sensors[1].camera_idx = 0;
  for (Image& image : scene.images) {
    if (image.sensor_idx == 1) image.camera_idx = 0;
  }
  Write(simulation);
  const ParsedModel model = Parse();
  ExpectFilesAgree(model);
  ASSERT_EQ(model.cameras.size(), 4u);
  const auto& sensors = model.rigs.begin()->second;
  const uint32_t copy_id = sensors[1].camera_id;
  for (const Camera& camera : scene.cameras) {
    EXPECT_NE(copy_id, camera.id.value());
  }
  EXPECT_EQ(model.cameras.at(copy_id).params, scene.cameras[0].params);
  for (const Image& image : scene.images) {
    if (image.sensor_idx != 1) continue;
    EXPECT_EQ(model.images.at(image.id.value()).camera_id, copy_id);
  }
}

TEST_P(ModelIo, AnEmptyModelAndAnImageWithoutKeypointsAreReadBack) {
  Simulation simulation = SmallDrive();
  simulation.ground_truth.points.clear();
  for (Image& image : simulation.scene.images) image.keypoints_px.clear();
  Write(simulation);
  EXPECT_EQ(Parse().images.size(), simulation.scene.images.size());
  EXPECT_EQ(ReadModelPoses(dir_.path()).images.size(),
            simulation.scene.images.size());
  for (auto& pose : simulation.ground_truth.rig_from_world) pose.reset();
  Write(simulation);
  EXPECT_TRUE(Parse().cameras.empty());
  EXPECT_TRUE(ReadModelPoses(dir_.path()).images.empty());
}

TEST_P(ModelIo, ColmapReadsIt) {
  if (RunShell("command -v colmap").exit_code != 0) {
    GTEST_SKIP() << "colmap is not installed";
  }
  const Simulation simulation = SmallDrive();
  Write(simulation);
  const CommandOutput output =
      RunShell("QT_QPA_PLATFORM=offscreen colmap model_analyzer --path " +
               dir_.path().string());
  EXPECT_EQ(output.exit_code, 0) << output.err;
  const std::string text = output.out + output.err;
  const auto has_count = [&](const std::string& what, size_t count) {
    return text.find(what + ": " + std::to_string(count) + "\n") !=
           std::string::npos;
  };
  EXPECT_TRUE(has_count("Cameras", 4)) << text;
  EXPECT_TRUE(has_count("Registered images", simulation.scene.images.size()))
      << text;
  EXPECT_TRUE(has_count("Points", simulation.ground_truth.points.size()))
      << text;
}

TEST(ModelReader, NamesTheFileThatIsTruncatedAnywhere) {
  Simulation simulation = SmallDrive();
  for (size_t i = 1; i < simulation.ground_truth.rig_from_world.size(); ++i) {
    Unregister(static_cast<int>(i), &simulation);
  }
  simulation.ground_truth.points.clear();
  for (Image& image : simulation.scene.images) image.keypoints_px.resize(2);
  const TempDir dir;
  WriteModel(dir.path(), simulation.scene, simulation.ground_truth,
             ModelFormat::kBinary);
  for (const char* name : {"images.bin", "rigs.bin"}) {
    const fs::path path = dir.path() / name;
    const std::string whole = ReadTextFile(path);
    for (size_t length = 0; length < whole.size(); ++length) {
      WriteTextFile(path, whole.substr(0, length));
      ASSERT_THAT(ErrorOf([&] { ReadModelPoses(dir.path()); }),
                  HasSubstr(path.string()))
          << length;
    }
    WriteTextFile(path, whole);
    ReadModelPoses(dir.path());
  }
}

TEST(ModelReader, NumbersThatCannotBeTrueAreRefused) {
  const TempDir dir;
  const fs::path path = dir.path() / "images.bin";
  WriteTextFile(path, std::string(1000, '\xff'));
  EXPECT_THAT(ErrorOf([&] { ReadModelPoses(dir.path()); }),
              HasSubstr(path.string()));
}

TEST(ModelReader, NamesFileAndLineOfBadText) {
  const TempDir dir;
  const fs::path path = dir.path() / "images.txt";
  for (const char* line : {"1 1 0 0 0 0 0 0 2", "1 1 0 0 x 0 0 0 2 a.jpg"}) {
    WriteTextFile(path, "# Images\n\n7 1 0 0 0 1 2 3 4 a.jpg\n\n" +
                            std::string(line) + "\n\n");
    EXPECT_THAT(ErrorOf([&] { ReadModelPoses(dir.path()); }),
                testing::AllOf(HasSubstr(path.string()), HasSubstr("line 5")));
  }
}

// Also with the comments and line ends that others write.
TEST(ModelReader, ReadsTextOfOtherWriters) {
  const TempDir dir;
  WriteTextFile(dir.path() / "images.txt",
                "# Image list\r\n2 1 0 0 0 1 2 3 4 b/x.jpg\r\n\r\n"
                "1 1.0004 0 0 0 4 5 6 4 a/x.jpg\r\n1.5 2.5 -1 3 4 7\r\n");
  const PoseModel model = ReadModelPoses(dir.path());
  ASSERT_EQ(model.images.size(), 2u);
  EXPECT_EQ(model.images[0].name, "a/x.jpg");
  EXPECT_EQ(model.images[0].cam_from_world.rotation.w(), 1.0);
  EXPECT_EQ(model.images[1].cam_from_world.translation,
            Eigen::Vector3d(1.0, 2.0, 3.0));
  EXPECT_TRUE(model.rigs.empty());
}

TEST(ModelReader, SaysThatAFolderHoldsNoModel) {
  const TempDir dir;
  EXPECT_THAT(ErrorOf([&] { ReadModelPoses(dir.path()); }),
              HasSubstr("holds no model"));
  EXPECT_THAT(ErrorOf([&] { ReadModelPoses(dir.path() / "none"); }),
              HasSubstr("none"));
}

TEST(ModelWriter, NamesTheFileThatCannotBeWritten) {
  const Simulation simulation = SmallDrive();
  const TempDir dir;
  fs::create_directory(dir.path() / "images.bin");
  EXPECT_THAT(ErrorOf([&] {
                WriteModel(dir.path(), simulation.scene,
                           simulation.ground_truth, ModelFormat::kBinary);
              }),
              HasSubstr((dir.path() / "images.bin").string()));
}

TEST(ModelWriter, TextRefusesNamesWithBlanks) {
  Simulation simulation = SmallDrive();
  simulation.scene.images[2].name = "cam 0/2.png";
  const TempDir dir;
  EXPECT_THAT(ErrorOf([&] {
                WriteModel(dir.path(), simulation.scene,
                           simulation.ground_truth, ModelFormat::kText);
              }),
              HasSubstr("cam 0/2.png"));
  EXPECT_TRUE(fs::is_empty(dir.path()));
  WriteModel(dir.path(), simulation.scene, simulation.ground_truth,
             ModelFormat::kBinary);
  const PoseModel model = ReadModelPoses(dir.path());
  EXPECT_TRUE(std::any_of(
      model.images.begin(), model.images.end(),
      [](const ModelImage& image) { return image.name == "cam 0/2.png"; }));
}

}  // namespace
}  // namespace mgsfm
