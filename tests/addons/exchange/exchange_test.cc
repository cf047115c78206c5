// SPDX-License-Identifier: BSD-3-Clause
// Every format is read back by a small parser here, by OpenCV or by COLMAP.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <regex>
#include <set>
#include <sstream>

#include "addons/exchange/exchange_fixture.h"
#include "calibration/calibration.h"
#include "exchange/exchange_formats.h"
#include "geometry/geodetic.h"
#include "geometry/so3.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/trajectory_io.h"
#include "mgsfm/rigs/rig_config.h"
#include "mgsfm/simulator/simulation.h"
#include "support/subprocess.h"

namespace mgsfm {
namespace {

using testing::AllOf;
using testing::HasSubstr;

void ExpectRefused(const std::string& format, const Simulation& drive,
                   const testing::Matcher<std::string>& message,
                   TrajectoryPoses poses = TrajectoryPoses::kFrame) {
  try {
    Export(format, drive, poses);
    ADD_FAILURE() << format << " is written";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), message) << format;
  }
}

std::vector<double> Numbers(const std::string& text) {
  std::vector<double> numbers;
  std::istringstream words(text);
  for (double value = 0.0; words >> value;) numbers.push_back(value);
  return numbers;
}

void ExpectPose(const Rigid3& pose, const Rigid3& expected) {
  EXPECT_LT(AngleBetween(pose.rotation, expected.rotation), 1e-12);
  EXPECT_LT((pose.translation - expected.translation).norm(), 1e-12);
}

// ------------------------------------------------------------ trajectories

// Gives each image the time of its frame.
void SetTimes(Simulation* drive) {
  for (Image& image : drive->scene.images) {
    image.timestamp_s = 1403636579.25 + 0.05 * image.frame_idx;
  }
}

TEST(Exchange, TrajectoriesOfFramesAreThoseOfTheReference) {
  Simulation drive = Drive(RigPreset::kKitti360);
  SetTimes(&drive);
  const std::vector<ExportedFile> tum = Export("tum", drive);
  const std::vector<ExportedFile> euroc = Export("euroc", drive);
  const std::vector<ExportedFile> kitti = Export("KITTI", drive);
  ASSERT_EQ(tum.size() + euroc.size() + kitti.size(), 3u);
  EXPECT_EQ(tum[0].suffix, "");
  for (size_t i = 0; i < drive.scene.frames.size(); ++i) {
    const Rigid3 world_from_rig =
        drive.ground_truth.rig_from_world[i]->Inverse();
    const std::vector<double> t = Numbers(Lines(tum[0].content).at(i));
    ASSERT_EQ(t.size(), 8u);
    EXPECT_NEAR(t[0], 1403636579.25 + 0.05 * static_cast<double>(i), 1e-6);
    ExpectPose({{t[7], t[4], t[5], t[6]}, {t[1], t[2], t[3]}}, world_from_rig);

    std::string line = Lines(euroc[0].content).at(i);
    std::replace(line.begin(), line.end(), ',', ' ');
    const std::vector<double> e = Numbers(line);
    ASSERT_EQ(e.size(), 8u);
    EXPECT_EQ(line.substr(0, 10), "1403636579");
    EXPECT_EQ(line.find(' '), 19u);  // ns
    ExpectPose({{e[4], e[5], e[6], e[7]}, {e[1], e[2], e[3]}}, world_from_rig);

    const std::vector<double> k = Numbers(Lines(kitti[0].content).at(i));
    ASSERT_EQ(k.size(), 12u);
    Eigen::Matrix3d rotation;
    rotation << k[0], k[1], k[2], k[4], k[5], k[6], k[8], k[9], k[10];
    ExpectPose({Eigen::Quaterniond(rotation), {k[3], k[7], k[11]}},
               world_from_rig);
  }
}

TEST(Exchange, TrajectoriesOfCamerasHaveAFileEach) {
  Simulation drive = Drive(RigPreset::kKitti360);
  SetTimes(&drive);
  const std::vector<ExportedFile> files =
      Export("tum", drive, TrajectoryPoses::kCamera);
  ASSERT_EQ(files.size(), drive.scene.sensors.size());
  for (size_t s = 0; s < files.size(); ++s) {
    EXPECT_EQ(files[s].suffix, "/" + drive.scene.sensors[s].name + ".txt");
    size_t line_idx = 0;
    for (size_t i = 0; i < drive.scene.images.size(); ++i) {
      if (drive.scene.images[i].sensor_idx != static_cast<int>(s)) continue;
      const std::vector<double> t =
          Numbers(Lines(files[s].content).at(line_idx++));
      ExpectPose(
          {{t[7], t[4], t[5], t[6]}, {t[1], t[2], t[3]}},
          drive.ground_truth.CamFromWorld(drive.scene, static_cast<int>(i))
              ->Inverse());
    }
    EXPECT_EQ(Lines(files[s].content).size(), line_idx);
  }
}

// Also where names are in another order than times.
TEST(Exchange, LinesOfCamerasAreInTheOrderOfFrames) {
  Simulation drive = Drive(RigPreset::kStereo);
  for (Image& image : drive.scene.images) {
    image.timestamp_s = 100.0 - image.frame_idx;
  }
  const auto of_camera = Export("kitti", drive, TrajectoryPoses::kCamera);
  EXPECT_THAT(Numbers(of_camera[0].content),
              testing::Pointwise(testing::DoubleNear(1e-9),
                                 Numbers(Export("kitti", drive)[0].content)));
}

TEST(Exchange, TimesAreThoseOfTheNames) {
  Simulation drive = Drive(RigPreset::kStereo);
  const auto rename = [&](const std::string& prefix) {
    for (Image& image : drive.scene.images) {
      image.name = "cam/" + prefix + std::to_string(image.frame_idx) + ".png";
      image.timestamp_s.reset();
    }
  };
  // More digits than a double has.
  rename("140363657926355552");
  EXPECT_THAT(Export("euroc", drive)[0].content,
              HasSubstr("\n1403636579263555523,"));
  EXPECT_THAT(Export("tum", drive)[0].content,
              HasSubstr("\n1403636579.263555523 "));
  rename("12.");
  EXPECT_THAT(Export("tum", drive)[0].content, HasSubstr("\n12.300000000 "));
  rename("frame");
  ExpectRefused(
      "tum", drive,
      AllOf(HasSubstr("'cam/frame0.png'"), HasSubstr("image_timestamps_path")));
  Export("kitti", drive);
}

TEST(Exchange, WhatTrajectoriesCannotHoldIsRefused) {
  Simulation drive = Drive(RigPreset::kStereo);
  drive.ground_truth.rig_from_world[3].reset();
  ExpectRefused(
      "kitti", drive,
      AllOf(HasSubstr("000002"), HasSubstr("000004"), HasSubstr("tum")));
  // Counters count after a text as well, but times have any intervals.
  for (const bool are_times : {false, true}) {
    for (Image& image : drive.scene.images) {
      const int i = image.frame_idx;
      image.name = are_times
                       ? "cam/" + std::to_string(1403636579000000 + 90 * i * i)
                       : "cam/left_000" + std::to_string(i);
      image.name += ".png";
    }
    if (are_times) {
      EXPECT_EQ(Lines(Export("kitti", drive)[0].content).size(), 4u);
    } else {
      ExpectRefused("kitti", drive, HasSubstr("left_0004"));
    }
  }
  EXPECT_EQ(Lines(Export("tum", drive)[0].content).size(), 4u);
  drive.scene = SeparateImages(drive.scene);
  drive.ground_truth = SeparateImages(
      drive.ground_truth,
      std::vector<std::optional<Rigid3>>(drive.scene.images.size(), Rigid3()));
  ExpectRefused("tum", drive, AllOf(HasSubstr("2"), HasSubstr("camera")));
}

// ------------------------------------------------------------ calibrations

// OpenCV reads YAML only with this line.
cv::FileStorage OpenYaml(const std::string& text) {
  return {"%YAML:1.0\n---\n" + text,
          cv::FileStorage::READ | cv::FileStorage::MEMORY};
}

std::vector<double> Values(const cv::FileNode& node) {
  std::vector<double> values;
  for (const cv::FileNode& item : node) values.push_back(item.real());
  return values;
}

// All but the pixels, which count from the center of the first one.
void ExpectIntrinsics(double fx, double fy, double cx, double cy,
                      const Camera& camera) {
  const CameraModelInfo& info = InfoOf(camera.model);
  EXPECT_EQ(fx, camera.params[info.focal_length_idxs.front()]);
  EXPECT_EQ(fy, camera.params[info.focal_length_idxs.back()]);
  EXPECT_EQ(cx + 0.5, camera.params[info.principal_point_idxs[0]]);
  EXPECT_EQ(cy + 0.5, camera.params[info.principal_point_idxs[1]]);
}

TEST(Exchange, KalibrsChainLeadsToAllCameras) {
  Simulation drive = Drive(RigPreset::kKitti360);
  const std::string text = Export("kalibr", drive)[0].content;
  const cv::FileStorage file = OpenYaml(text);
  const Rig& rig = drive.scene.rigs[0];
  Rigid3 cam_from_cam0;
  for (size_t i = 0; i < rig.sensor_idxs.size(); ++i) {
    const cv::FileNode cam = file["cam" + std::to_string(i)];
    ASSERT_FALSE(cam.empty());
    std::string topic;
    cam["rostopic"] >> topic;
    const auto sensor = std::find_if(
        drive.scene.sensors.begin(), drive.scene.sensors.end(),
        [&](const Sensor& s) { return topic == "/" + s.name + "/image_raw"; });
    ASSERT_NE(sensor, drive.scene.sensors.end());
    const Camera& camera = drive.ground_truth.cameras[sensor->camera_idx];
    const std::vector<double> k = Values(cam["intrinsics"]);
    ExpectIntrinsics(k.at(0), k.at(1), k.at(2), k.at(3), camera);
    EXPECT_EQ(Values(cam["resolution"])[0], camera.width_px);
    EXPECT_EQ(Values(cam["distortion_coeffs"]).size(), 4u);
    EXPECT_EQ(
        cam["distortion_model"].string(),
        camera.model == CameraModelId::kPinhole ? "radtan" : "equidistant");
    if (i > 0) {
      Eigen::Matrix4d matrix;
      int row = 0;
      for (const cv::FileNode& line : cam["T_cn_cnm1"]) {
        const std::vector<double> values = Values(line);
        matrix.row(row++) = Eigen::Map<const Eigen::RowVector4d>(values.data());
      }
      const Rigid3 step{Eigen::Quaterniond(matrix.topLeftCorner<3, 3>()),
                        matrix.topRightCorner<3, 1>()};
      cam_from_cam0 = step * cam_from_cam0;
    }
    ExpectPose(cam_from_cam0,
               *drive.ground_truth
                    .sensor_from_rig[sensor - drive.scene.sensors.begin()]);
  }
}

TEST(Exchange, SensorsOfEurocHaveTheirPoseInTheRig) {
  const Simulation drive = Drive(RigPreset::kKitti360);
  const std::vector<ExportedFile> files = Export("euroc_sensor", drive);
  ASSERT_EQ(files.size(), drive.scene.sensors.size());
  for (const ExportedFile& exported : files) {
    const auto sensor =
        std::find_if(drive.scene.sensors.begin(), drive.scene.sensors.end(),
                     [&](const Sensor& s) {
                       return exported.suffix == "/" + s.name + "/sensor.yaml";
                     });
    ASSERT_NE(sensor, drive.scene.sensors.end()) << exported.suffix;
    const Camera& camera = drive.ground_truth.cameras[sensor->camera_idx];
    const bool is_pinhole = camera.model == CameraModelId::kPinhole;
    const cv::FileStorage file = OpenYaml(exported.content);
    EXPECT_EQ(file["sensor_type"].string(), "camera");
    EXPECT_EQ(file["camera_model"].string(), "pinhole");
    const std::vector<double> k = Values(file["intrinsics"]);
    ExpectIntrinsics(k.at(0), k.at(1), k.at(2), k.at(3), camera);
    EXPECT_EQ(Values(file["resolution"]).at(0), camera.width_px);
    EXPECT_EQ(Values(file["resolution"]).at(1), camera.height_px);
    EXPECT_EQ(file["distortion_model"].string(),
              is_pinhole ? "radial-tangential" : "equidistant");
    EXPECT_EQ(Values(file["distortion_coefficients"]),
              is_pinhole ? std::vector<double>(4, 0.0)
                         : std::vector<double>(camera.params.begin() + 4,
                                               camera.params.end()));
    const std::vector<double> pose = Values(file["T_BS"]["data"]);
    ASSERT_EQ(pose.size(), 16u);
    const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> matrix(
        pose.data());
    EXPECT_EQ(matrix.row(3), Eigen::RowVector4d(0, 0, 0, 1));
    const Eigen::Matrix3d rotation = matrix.topLeftCorner<3, 3>();
    const auto& truth = drive.ground_truth.sensor_from_rig;
    ExpectPose({Eigen::Quaterniond(rotation), matrix.topRightCorner<3, 1>()},
               truth[sensor - drive.scene.sensors.begin()]->Inverse());
  }
}

TEST(Exchange, CameraInfoHoldsTheIntrinsics) {
  const Simulation drive = Drive(RigPreset::kKitti360);
  const std::vector<ExportedFile> files = Export("camera_info", drive);
  ASSERT_EQ(files.size(), drive.scene.sensors.size());
  for (size_t i = 0; i < files.size(); ++i) {
    const Sensor& sensor = drive.scene.sensors[i];
    const Camera& camera = drive.ground_truth.cameras[sensor.camera_idx];
    const bool is_pinhole = camera.model == CameraModelId::kPinhole;
    EXPECT_EQ(files[i].suffix, "/" + sensor.name + ".yaml");
    const cv::FileStorage file = OpenYaml(files[i].content);
    EXPECT_EQ(static_cast<int>(file["image_width"]), camera.width_px);
    EXPECT_EQ(static_cast<int>(file["image_height"]), camera.height_px);
    EXPECT_EQ(file["camera_name"].string(), sensor.name);
    EXPECT_EQ(file["distortion_model"].string(),
              is_pinhole ? "plumb_bob" : "equidistant");
    const std::vector<double> k = Values(file["camera_matrix"]["data"]);
    ASSERT_EQ(k.size(), 9u);
    ExpectIntrinsics(k[0], k[4], k[2], k[5], camera);
    const std::vector<double> p = Values(file["projection_matrix"]["data"]);
    ASSERT_EQ(p.size(), 12u);
    EXPECT_EQ(p[0], k[0]);
    EXPECT_EQ(p[6], k[5]);
    const std::vector<double> d =
        Values(file["distortion_coefficients"]["data"]);
    ASSERT_EQ(d.size(), is_pinhole ? 5u : 4u);
    const std::vector<double> expected =
        is_pinhole ? std::vector<double>(5, 0.0)
                   : std::vector<double>(camera.params.begin() + 4,
                                         camera.params.end());
    EXPECT_EQ(d, expected);
  }
}

TEST(Exchange, TransformsOfRosPlaceTheCamerasInTheRig) {
  const Simulation drive = Drive(RigPreset::kKitti360);
  const cv::FileStorage file = OpenYaml(Export("ros_tf", drive)[0].content);
  const std::string launch = Export("ros_launch", drive)[0].content;
  size_t num_transforms = 0;
  for (const cv::FileNode& item : file["transforms"]) {
    const std::string child = item["child_frame_id"].string();
    EXPECT_EQ(item["header"]["frame_id"].string(), "rig");
    const cv::FileNode q = item["transform"]["rotation"];
    const cv::FileNode t = item["transform"]["translation"];
    const Rigid3 rig_from_cam{Eigen::Quaterniond(q["w"].real(), q["x"].real(),
                                                 q["y"].real(), q["z"].real()),
                              {t["x"].real(), t["y"].real(), t["z"].real()}};
    for (size_t i = 0; i < drive.scene.sensors.size(); ++i) {
      if (child != drive.scene.sensors[i].name + "_optical_frame") continue;
      ++num_transforms;
      ExpectPose(rig_from_cam,
                 drive.ground_truth.sensor_from_rig[i]->Inverse());
    }
    // The launch file publishes the same.
    std::smatch found;
    const std::regex node(
        "--x (\\S+) --y (\\S+) --z (\\S+) --qx (\\S+) --qy "
        "(\\S+) --qz (\\S+) --qw (\\S+) --frame-id rig "
        "--child-frame-id " +
        child + "\"");
    ASSERT_TRUE(std::regex_search(launch, found, node)) << launch;
    ExpectPose(
        {Eigen::Quaterniond(std::stod(found[7]), std::stod(found[4]),
                            std::stod(found[5]), std::stod(found[6])),
         {std::stod(found[1]), std::stod(found[2]), std::stod(found[3])}},
        rig_from_cam);
  }
  EXPECT_EQ(num_transforms, drive.scene.sensors.size());
}

TEST(Exchange, RigConfigurationsAreRead) {
  const Simulation drive = Drive(RigPreset::kKitti360);
  const TempDir dir;
  const std::string path = (dir.path() / "rig.json").string();
  WriteTextFile(path, Export("rig_config", drive)[0].content);
  const std::vector<RigConfig> rigs = ReadRigConfig(path);
  ASSERT_EQ(rigs.size(), 1u);
  ASSERT_EQ(rigs[0].cameras.size(), drive.scene.sensors.size());
  for (const RigConfigCamera& camera : rigs[0].cameras) {
    for (size_t i = 0; i < drive.scene.sensors.size(); ++i) {
      if (camera.image_prefix != drive.scene.sensors[i].name + "/") continue;
      ExpectPose(*camera.cam_from_rig, *drive.ground_truth.sensor_from_rig[i]);
    }
  }
}

// Fields of the lines of a file of kapture.
std::vector<std::vector<std::string>> KaptureFields(const std::string& text) {
  EXPECT_EQ(text.rfind("# kapture format: 1.1\n", 0), 0u);
  std::vector<std::vector<std::string>> lines;
  for (const std::string& line : Lines(text)) {
    std::vector<std::string>& fields = lines.emplace_back();
    std::istringstream stream(line);
    for (std::string field; std::getline(stream >> std::ws, field, ',');) {
      fields.push_back(field);
    }
  }
  return lines;
}

Rigid3 KapturePose(const std::vector<std::string>& fields) {
  std::vector<double> n;
  for (size_t i = 2; i < fields.size(); ++i) n.push_back(std::stod(fields[i]));
  return {Eigen::Quaterniond(n.at(0), n.at(1), n.at(2), n.at(3)),
          {n.at(4), n.at(5), n.at(6)}};
}

// By its definition, poses lead from the world to rigs, and from these to
// sensors. Our reader finds the cameras, too.
TEST(Exchange, KapturePosesLeadToImages) {
  const Simulation drive = Drive(RigPreset::kKitti360);
  const std::vector<ExportedFile> files = Export("kapture", drive);
  const TempDir dir;
  std::map<std::string, std::vector<std::vector<std::string>>> tables;
  std::filesystem::create_directory(dir.path() / "sensors");
  for (const ExportedFile& file : files) {
    WriteTextFile(dir.path().string() + file.suffix, file.content);
    tables[file.suffix] = KaptureFields(file.content);
  }
  std::map<std::string, Rigid3> sensor_from_rig, rig_from_world;
  std::set<std::string> rigs, sensors;
  for (const auto& line : tables["/sensors/sensors.txt"]) {
    sensors.insert(line.at(0));
  }
  for (const auto& line : tables["/sensors/rigs.txt"]) {
    sensor_from_rig[line.at(1)] = KapturePose(line);
    rigs.insert(line.at(0));
    EXPECT_EQ(sensors.count(line.at(0)), 0u);
    EXPECT_EQ(sensors.count(line.at(1)), 1u);
  }
  for (const auto& line : tables["/sensors/trajectories.txt"]) {
    rig_from_world[line.at(0)] = KapturePose(line);
    EXPECT_EQ(rigs.count(line.at(1)), 1u);
  }
  const auto& records = tables["/sensors/records_camera.txt"];
  ASSERT_EQ(records.size(), drive.scene.images.size());
  for (const auto& line : records) {
    for (size_t i = 0; i < drive.scene.images.size(); ++i) {
      if (drive.scene.images[i].name != line.at(2)) continue;
      ExpectPose(
          sensor_from_rig.at(line.at(1)) * rig_from_world.at(line.at(0)),
          *drive.ground_truth.CamFromWorld(drive.scene, static_cast<int>(i)));
    }
  }
  const std::vector<CalibratedCamera> cameras =
      ReadCalibration((dir.path() / "sensors").string());
  ASSERT_EQ(cameras.size(), drive.scene.sensors.size());
  for (size_t i = 0; i < drive.scene.sensors.size(); ++i) {
    const Sensor& sensor = drive.scene.sensors[i];
    const Camera& camera = drive.ground_truth.cameras[sensor.camera_idx];
    const auto read = std::find_if(
        cameras.begin(), cameras.end(),
        [&](const auto& c) { return c.names.at(0) == sensor.name; });
    ASSERT_NE(read, cameras.end());
    EXPECT_EQ(read->model, camera.model);
    EXPECT_EQ(read->params, camera.params);
    ExpectPose(*read->cam_from_base, *drive.ground_truth.sensor_from_rig[i]);
  }
}

TEST(Exchange, KaptureHasNoCommas) {
  Simulation drive = Drive(RigPreset::kStereo);
  drive.scene.images[1].name = "cam0/a, b.png";
  ExpectRefused("kapture", drive,
                AllOf(HasSubstr("'cam0/a, b.png'"), HasSubstr("rename")));
}

TEST(Exchange, CamerasThatAFormatCannotRepresentAreNamed) {
  Simulation drive = Drive(RigPreset::kKitti360);
  for (const char* format : {"nvm", "bundler"}) {
    ExpectRefused(format, drive,
                  AllOf(HasSubstr("'cam2'"), HasSubstr("OPENCV_FISHEYE"),
                        HasSubstr("undistort")));
  }
  for (Camera& camera : drive.ground_truth.cameras) {
    camera.model = CameraModelId::kEquirectangular;
    camera.params = {1000.0, 500.0};
  }
  for (const char* format :
       {"nvm", "bundler", "kalibr", "euroc_sensor", "camera_info", "kapture"}) {
    ExpectRefused(format, drive,
                  AllOf(HasSubstr("'cam0'"), HasSubstr("EQUIRECTANGULAR")));
  }
  for (Camera& camera : drive.ground_truth.cameras) {
    camera.model = CameraModelId::kPinhole;
    camera.params = {500.0, 501.0, 300.0, 200.0};
  }
  ExpectRefused("nvm", drive, HasSubstr("two focal lengths"));
}

// What an omnidirectional calibration becomes on import goes back as an
// equidistant camera, which projects the same rays within the stated error.
TEST(Exchange, LensesWithoutEqualAreFitted) {
  Simulation drive = Drive(RigPreset::kStereo);
  for (Camera& camera : drive.ground_truth.cameras) {
    camera.model = CameraModelId::kThinPrismFisheye;
    camera.params = {300.0,
                     303.0,
                     0.51 * camera.width_px,
                     0.49 * camera.height_px,
                     0.02,
                     -0.003,
                     1e-5,
                     -2e-5,
                     1e-4,
                     0.0,
                     1e-6,
                     1e-6};
  }
  const Camera& camera = drive.ground_truth.cameras[0];
  for (const char* format : {"kalibr", "euroc_sensor", "camera_info"}) {
    SCOPED_TRACE(format);
    const auto losses = FindExchangeFormat(format)->losses(
        {drive.scene, drive.ground_truth, TrajectoryPoses::kFrame, {}});
    ASSERT_FALSE(losses.empty());
    EXPECT_THAT(losses[0], HasSubstr("equidistant fit of THIN_PRISM_FISHEYE"));
    const std::string content = Export(format, drive)[0].content;
    const size_t text = content.find("errors up to ");
    ASSERT_NE(text, std::string::npos);
    const double max_error_px = std::stod(content.substr(text + 13));
    EXPECT_LT(max_error_px, 0.5);
  }
  const cv::FileStorage file =
      OpenYaml(Export("euroc_sensor", drive)[0].content);
  const std::string content = Export("euroc_sensor", drive)[0].content;
  const double max_error_px =
      std::stod(content.substr(content.find("errors up to ") + 13));
  const std::vector<double> k = Values(file["intrinsics"]);
  std::vector<double> fisheye = {k[0], k[1], k[2] + 0.5, k[3] + 0.5};
  for (const double c : Values(file["distortion_coefficients"])) {
    fisheye.push_back(c);
  }
  for (int y = 20; y < camera.height_px; y += 57) {
    for (int x = 20; x < camera.width_px; x += 57) {
      const auto ray = RayFromPixel(camera.model, camera.params.data(), {x, y});
      ASSERT_TRUE(ray.has_value());
      const auto pixel =
          ProjectToPixel(CameraModelId::kOpenCVFisheye, fisheye.data(), *ray);
      ASSERT_TRUE(pixel.has_value());
      EXPECT_LT((*pixel - Eigen::Vector2d(x, y)).norm(), max_error_px + 0.02);
    }
  }
}

TEST(Exchange, WhatAFormatLacksIsNamed) {
  const auto losses = [](const std::string& format, const Simulation& drive) {
    return FindExchangeFormat(format)->losses(
        {drive.scene, drive.ground_truth, TrajectoryPoses::kFrame, {}});
  };
  Simulation drive = Drive(RigPreset::kStereo);
  for (Camera& camera : drive.ground_truth.cameras) {
    camera.model = CameraModelId::kSimplePinhole;
    camera.params = {700.0, 0.5 * camera.width_px, 0.5 * camera.height_px};
  }
  drive.ground_truth.cameras[1].params[1] += 3.0;
  drive.ground_truth.cameras[1].params[2] -= 4.0;
  for (const char* format : {"nvm", "bundler"}) {
    EXPECT_THAT(losses(format, drive),
                testing::ElementsAre(
                    AllOf(HasSubstr("'cam1'"), HasSubstr("+3.0, -4.0 px"))));
  }
  std::vector<Observation>& track = drive.ground_truth.points[0].track;
  track.insert(track.begin(), track.front());
  EXPECT_THAT(losses("nvm", drive),
              testing::Contains(HasSubstr("1 observations are left out")));
  for (const char* format : {"kalibr", "euroc_sensor", "ros_tf"}) {
    EXPECT_TRUE(losses(format, drive).empty()) << format;
  }
  drive.ground_truth.sensor_from_rig[1].reset();
  for (const char* format : {"kalibr", "euroc_sensor", "ros_tf"}) {
    EXPECT_THAT(losses(format, drive),
                testing::ElementsAre(
                    AllOf(HasSubstr("'cam1'"), HasSubstr("left out"))));
  }
}

// ------------------------------------------------------------------- earth

TEST(Exchange, PathsLieOnTheEarth) {
  const Simulation drive = Drive(RigPreset::kStereo);
  ExpectRefused("geojson", drive, HasSubstr("geo_origin.json"));
  const Eigen::Vector3d origin(47.37, 8.54, 408.0);
  const auto json = nlohmann::json::parse(
      Export("geojson", drive, TrajectoryPoses::kFrame, origin)[0].content);
  EXPECT_EQ(json["type"], "FeatureCollection");
  const auto& line = json["features"][0]["geometry"];
  EXPECT_EQ(line["type"], "LineString");
  ASSERT_EQ(line["coordinates"].size(), drive.scene.frames.size());
  const std::string kml =
      Export("kml", drive, TrajectoryPoses::kFrame, origin)[0].content;
  std::istringstream kml_lines(
      kml.substr(kml.find("<coordinates>") + std::strlen("<coordinates>\n")));
  for (size_t i = 0; i < drive.scene.frames.size(); ++i) {
    const auto& p = line["coordinates"][i];
    const Eigen::Vector3d enu = EastNorthUp(
        {p[1].get<double>(), p[0].get<double>(), p[2].get<double>()}, origin);
    const Eigen::Vector3d center =
        drive.ground_truth.rig_from_world[i]->Center();
    EXPECT_LT((enu - center).norm(), 1e-6);
    std::string kml_line;
    std::getline(kml_lines, kml_line);
    std::replace(kml_line.begin(), kml_line.end(), ',', ' ');
    EXPECT_EQ(Numbers(kml_line), p.get<std::vector<double>>());
  }
}

// ------------------------------------------------------------------ COLMAP

}  // namespace
}  // namespace mgsfm
