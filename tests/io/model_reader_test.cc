// SPDX-License-Identifier: BSD-3-Clause
// ReadModel, which reads all that is in a model, against what was written.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>

#include "io/test_database.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/simulator/simulation.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

Simulation SmallDrive() {
  SimulationOptions options;
  options.rig = RigPreset::kKitti360;
  options.num_frames = 4;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 30;
  options.missing_image_ratio = 0.2;
  return Simulate(options);
}

class ReadModelTest : public testing::TestWithParam<ModelFormat> {
 protected:
  void Write(const Simulation& simulation) const {
    WriteModel(dir_.path(), simulation.scene, simulation.ground_truth,
               GetParam());
  }
  fs::path File(const std::string& stem) const {
    return dir_.path() /
           (stem + (GetParam() == ModelFormat::kText ? ".txt" : ".bin"));
  }

  const TempDir dir_;
};

INSTANTIATE_TEST_SUITE_P(Formats, ReadModelTest,
                         testing::Values(ModelFormat::kBinary,
                                         ModelFormat::kText),
                         [](const auto& format) {
                           return format.param == ModelFormat::kText ? "Text"
                                                                     : "Binary";
                         });

TEST_P(ReadModelTest, ReadsBackCamerasKeypointsAndPoints) {
  const Simulation simulation = SmallDrive();
  const Scene& scene = simulation.scene;
  const std::vector<Point3D>& points = simulation.ground_truth.points;
  Write(simulation);
  const Model model = ReadModel(dir_.path());

  ASSERT_EQ(model.cameras.size(), scene.cameras.size());
  for (size_t i = 0; i < scene.cameras.size(); ++i) {  // ids ascend here
    EXPECT_EQ(model.cameras[i].id, scene.cameras[i].id);
    EXPECT_EQ(model.cameras[i].model, scene.cameras[i].model);
    EXPECT_EQ(model.cameras[i].width_px, scene.cameras[i].width_px);
    EXPECT_EQ(model.cameras[i].height_px, scene.cameras[i].height_px);
    EXPECT_EQ(model.cameras[i].params, scene.cameras[i].params);
  }
  ASSERT_EQ(model.poses.images.size(), scene.images.size());
  ASSERT_EQ(model.keypoints.size(), scene.images.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    EXPECT_EQ(model.poses.images[i].id, scene.images[i].id);
    const auto& keypoints_px = scene.images[i].keypoints_px;
    ASSERT_EQ(model.keypoints[i].size(), keypoints_px.size());
    for (size_t k = 0; k < keypoints_px.size(); ++k) {
      EXPECT_EQ(model.keypoints[i][k].position_px,
                keypoints_px[k].cast<double>());
    }
  }
  ASSERT_EQ(model.points.size(), points.size());
  for (size_t i = 0; i < points.size(); ++i) {
    EXPECT_EQ(model.points[i].id, i + 1);
    EXPECT_EQ(model.points[i].point_in_world, points[i].point_in_world);
    EXPECT_EQ(model.points[i].color, points[i].color);
    EXPECT_EQ(model.points[i].error_px, points[i].error_px);
    ASSERT_EQ(model.points[i].track.size(), points[i].track.size());
    for (size_t k = 0; k < points[i].track.size(); ++k) {
      const Observation& o = points[i].track[k];
      EXPECT_EQ(model.points[i].track[k].image_id,
                scene.images[o.image_idx].id);
      EXPECT_EQ(model.points[i].track[k].keypoint_idx,
                static_cast<uint32_t>(o.keypoint_idx));
      EXPECT_EQ(model.keypoints[o.image_idx][o.keypoint_idx].point_id, i + 1);
    }
  }
}

// The pose of each image is the product of the poses of rig and frame.
TEST_P(ReadModelTest, FramesRigsAndImagesAgree) {
  const Simulation simulation = SmallDrive();
  Write(simulation);
  const PoseModel model = ReadModel(dir_.path()).poses;
  std::map<ImageId, const ModelImage*> image_of_id;
  for (const ModelImage& image : model.images) image_of_id[image.id] = &image;
  ASSERT_EQ(model.frames.size(), simulation.scene.frames.size());
  ASSERT_EQ(model.rigs.size(), 1u);
  size_t num_images = 0;
  for (const ModelFrame& frame : model.frames) {
    EXPECT_EQ(frame.rig_id, model.rigs[0].id);
    for (const ImageId id : frame.image_ids) {
      const ModelImage& image = *image_of_id.at(id);
      for (const RigSensorRow& sensor : model.rigs[0].sensors) {
        if (sensor.camera_id != image.camera_id) continue;
        const Rigid3 pose = *sensor.sensor_from_rig * frame.rig_from_world;
        EXPECT_LT((pose.Center() - image.cam_from_world.Center()).norm(), 1e-9);
        EXPECT_LT(pose.rotation.angularDistance(image.cam_from_world.rotation),
                  1e-9);
        ++num_images;
      }
    }
  }
  EXPECT_EQ(num_images, model.images.size());
}

// COLMAP 3.8 writes neither rigs nor frames.
TEST_P(ReadModelTest, ReadsModelsWithoutRigsAndFrames) {
  const Simulation simulation = SmallDrive();
  Write(simulation);
  fs::remove(File("rigs"));
  fs::remove(File("frames"));
  const Model model = ReadModel(dir_.path());
  EXPECT_EQ(model.points.size(), simulation.ground_truth.points.size());
  EXPECT_TRUE(model.poses.rigs.empty());
  EXPECT_TRUE(model.poses.frames.empty());
}

TEST_P(ReadModelTest, NamesTheFileThatIsMissing) {
  for (const char* stem : {"cameras", "points3D"}) {
    Write(SmallDrive());
    fs::remove(File(stem));
    EXPECT_THAT(ErrorOf([&] { ReadModel(dir_.path()); }),
                HasSubstr(File(stem).string()));
  }
}

TEST_P(ReadModelTest, RefusesAnIdThatOccursTwice) {
  Simulation simulation = SmallDrive();
  simulation.scene.images[1].id = simulation.scene.images[0].id;
  Write(simulation);
  EXPECT_THAT(ErrorOf([&] { ReadModel(dir_.path()); }),
              AllOf(HasSubstr("has image "), HasSubstr("twice")));
  EXPECT_THAT(ErrorOf([&] { ReadModelPoses(dir_.path()); }),
              HasSubstr("twice"));
}

TEST_P(ReadModelTest, RefusesPointsAndKeypointsThatDoNotAgree) {
  Simulation simulation = SmallDrive();
  std::vector<Observation>& track = simulation.ground_truth.points[2].track;
  // A second reference from one keypoint: the first point loses its own.
  track.push_back(simulation.ground_truth.points[1].track[0]);
  Write(simulation);
  EXPECT_THAT(ErrorOf([&] { ReadModel(dir_.path()); }),
              AllOf(HasSubstr("inconsistent"), HasSubstr("point 2,")));
}

TEST_P(ReadModelTest, RefusesAnImageWithoutCamera) {
  Write(SmallDrive());
  const std::string cameras =
      GetParam() == ModelFormat::kText ? "" : std::string(8, '\0');
  WriteTextFile(File("cameras"), cameras);
  EXPECT_THAT(ErrorOf([&] { ReadModel(dir_.path()); }),
              HasSubstr("lacks camera"));
}

TEST(ModelFileReaders, NameTheFileThatIsTruncatedAnywhere) {
  Simulation simulation = SmallDrive();
  for (Image& image : simulation.scene.images) image.keypoints_px.resize(3);
  std::vector<Point3D>& points = simulation.ground_truth.points;
  points.resize(2);
  for (size_t i = 0; i < points.size(); ++i) {
    points[i].track = {{0, static_cast<int>(i)}, {1, static_cast<int>(i)}};
  }
  const TempDir dir;
  WriteModel(dir.path(), simulation.scene, simulation.ground_truth,
             ModelFormat::kBinary);
  for (const char* name :
       {"cameras.bin", "points3D.bin", "frames.bin", "rigs.bin"}) {
    const fs::path path = dir.path() / name;
    const std::string whole = ReadTextFile(path);
    for (size_t length = 0; length < whole.size(); ++length) {
      WriteTextFile(path, whole.substr(0, length));
      ASSERT_THAT(ErrorOf([&] { ReadModel(dir.path()); }),
                  HasSubstr(path.string()))
          << length;
    }
    WriteTextFile(path, whole);
  }
  EXPECT_EQ(ReadModel(dir.path()).points.size(), 2u);
}

TEST(ModelFileReaders, NameAnUnknownCameraModel) {
  const TempDir dir;
  WriteTextFile(dir.path() / "images.txt", "");
  WriteTextFile(dir.path() / "points3D.txt", "");
  WriteTextFile(dir.path() / "cameras.txt", "# x\n1 PERISCOPE 9 9 1 2 3\n");
  EXPECT_THAT(ErrorOf([&] { ReadModel(dir.path()); }),
              AllOf(HasSubstr("cameras.txt"), HasSubstr("line 2"),
                    HasSubstr("PERISCOPE")));

  const Simulation simulation = SmallDrive();
  WriteModel(dir.path(), simulation.scene, simulation.ground_truth,
             ModelFormat::kBinary);
  std::string cameras = ReadTextFile(dir.path() / "cameras.bin");
  cameras[12] = 99;  // the model of the first camera
  WriteTextFile(dir.path() / "cameras.bin", cameras);
  EXPECT_THAT(ErrorOf([&] { ReadModel(dir.path()); }),
              AllOf(HasSubstr("cameras.bin"), HasSubstr("99")));
}

TEST(ModelFileReaders, RefuseNumbersThatCannotBe) {
  const TempDir dir;
  WriteTextFile(dir.path() / "images.txt", "");
  WriteTextFile(dir.path() / "points3D.txt", "");
  for (const char* camera :
       {"-1 PINHOLE 9 9 1 1 0 0", "4294967296 PINHOLE 9 9 1 1 0 0",
        "1 PINHOLE 9999999999 9 1 1 0 0", "1 PINHOLE 9 9 1 1 0"}) {
    WriteTextFile(dir.path() / "cameras.txt", std::string(camera) + "\n");
    EXPECT_THAT(ErrorOf([&] { ReadModel(dir.path()); }),
                AllOf(HasSubstr("cameras.txt"), HasSubstr("line 1")))
        << camera;
  }
  WriteTextFile(dir.path() / "cameras.txt", "");
  for (const char* image : {"1 0 0 0 0 1 2 3 4 a.jpg", "1 1 0 0 0 nan 2 3 4 a",
                            "-2 1 0 0 0 1 2 3 4 a.jpg"}) {
    WriteTextFile(dir.path() / "images.txt", std::string(image) + "\n\n");
    EXPECT_THAT(ErrorOf([&] { ReadModelPoses(dir.path()); }),
                AllOf(HasSubstr("images.txt"), HasSubstr("line 1")))
        << image;
  }
}

// Values that no model can have, each in one element.
TEST(ModelValues, AreNeitherWrittenNorRead) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  using Change = std::function<void(double, Reconstruction*)>;
  const std::pair<std::string, Change> changes[] = {
      {"camera '",
       [](double value, Reconstruction* model) {
         model->cameras[0].params[0] = value;
       }},
      {"sensor 'cam1'",
       [](double value, Reconstruction* model) {
         model->sensor_from_rig[1]->translation.y() = value;
       }},
      {"frame ",
       [](double value, Reconstruction* model) {
         model->rig_from_world[2]->translation.x() = value;
       }},
      {"frame ",
       [](double value, Reconstruction* model) {
         model->rig_from_world[2]->rotation.w() = value;
       }},
      {"point '4'", [](double value, Reconstruction* model) {
         model->points[3].point_in_world.z() = value;
       }}};
  const Simulation simulation = SmallDrive();
  for (const auto& [element, change] : changes) {
    for (const double value : {kNaN, HUGE_VAL, -1e300, 1e16}) {
      const TempDir dir;
      Simulation bad = simulation;
      change(value, &bad.ground_truth);
      EXPECT_THAT(ErrorOf([&] {
                    WriteModel(dir.path(), bad.scene, bad.ground_truth,
                               ModelFormat::kBinary);
                  }),
                  AllOf(HasSubstr(element), HasSubstr("not written")));
      EXPECT_TRUE(fs::is_empty(dir.path()));
    }
  }
}

// The same in the text format, where any program may have put them.
TEST(ModelValues, AreRefusedWithFileAndElement) {
  const auto refuses = [](const std::string& file, const std::string& before,
                          const std::string& after) {
    const TempDir dir;
    WriteTextFile(dir.path() / "cameras.txt", "1 PINHOLE 9 9 5 5 4 4\n");
    WriteTextFile(dir.path() / "images.txt",
                  "7 1 0 0 0 0 0 0 1 a.png\n3 3 2\n");
    WriteTextFile(dir.path() / "points3D.txt", "2 1 2 3 0 0 0 0.5 7 0\n");
    ASSERT_EQ(ReadModel(dir.path()).points.size(), 1u);
    std::string text = ReadTextFile(dir.path() / file);
    text.replace(text.find(before), before.size(), after);
    WriteTextFile(dir.path() / file, text);
    EXPECT_THAT(ErrorOf([&] { (void)ReadModel(dir.path()); }), HasSubstr(file))
        << text;
  };
  for (const char* bad : {"1e300", "-1e16", "nan", "inf"}) {
    refuses("cameras.txt", "5 5 4", std::string(bad) + " 5 4");
    refuses("images.txt", "0 0 0 1 a", std::string(bad) + " 0 0 1 a");
    refuses("images.txt", "3 3 2", std::string(bad) + " 3 2");
    refuses("points3D.txt", "1 2 3", std::string("1 2 ") + bad);
  }
  refuses("cameras.txt", "9 9", "0 9");
  refuses("cameras.txt", "5 5 4", "-5 5 4");
  refuses("images.txt", "a.png", "a\x01.png");
  refuses("images.txt", "a.png", "a\xff.png");
}

}  // namespace
}  // namespace mgsfm
