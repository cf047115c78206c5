// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/imaging/undistorted_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>
#include <vector>

#include "frontend/imaging/test_cameras.h"
#include "geometry/so3.h"
#include "mgsfm/base/error.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/simulator/simulation.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

// A rig of two forward cameras, of which the second has distortion, and a
// fisheye to the side, which sees behind itself.
Simulation SimulateRig() {
  const auto camera = [](const std::string& prefix, const Camera& intrinsics,
                         const Rigid3& pose) {
    return SimulatedCamera{prefix,
                           intrinsics.model,
                           intrinsics.width_px,
                           intrinsics.height_px,
                           intrinsics.params,
                           pose};
  };
  SimulationInput input;
  input.rig = {
      camera("left/", Barrel(), Rigid3()),
      camera("right/", Barrel(), {ExpSO3({0, 0.02, 0}), {-0.5, 0, 0}}),
      camera("side/", Fisheye180(), {ExpSO3({0.1, -1.5, 0}), {0.3, 0, 0.2}})};
  SimulationOptions options;
  options.num_frames = 6;
  return Simulate(options, input);
}

std::vector<std::vector<View>> PlanAll(const Simulation& simulation,
                                       const ViewOptions& options) {
  std::vector<std::vector<View>> views;
  for (const Camera& camera : simulation.scene.cameras) {
    views.push_back(PlanViews(camera, options));
  }
  return views;
}

UndistortedModel Undistort(const Simulation& simulation,
                           const ViewOptions& options,
                           ViewNaming naming = ViewNaming::kFolders,
                           int num_threads = 1) {
  return UndistortModel(simulation.scene, simulation.ground_truth,
                        PlanAll(simulation, options), naming,
                        Threads(num_threads));
}

size_t CountObservations(const Reconstruction& model) {
  size_t count = 0;
  for (const Point3D& point : model.points) count += point.track.size();
  return count;
}

// The pixel of the original that shows the ray through a pixel of the view, by
// way of world coordinates and the definition of a pinhole camera.
Vector2d ThroughTheWorld(const Simulation& simulation,
                         const UndistortedModel& model, int image_idx,
                         const Vector2d& pixel) {
  const Image& image = model.scene.images[image_idx];
  const Rigid3 world_from_view =
      model.reconstruction.CamFromWorld(model.scene, image_idx)->Inverse();
  const Vector3d ray =
      PinholeRay(model.scene.cameras[image.camera_idx], pixel.x(), pixel.y());
  const int original_idx = model.sources[image_idx].image_idx;
  const Image& original = simulation.scene.images[original_idx];
  const Camera& camera = simulation.scene.cameras[original.camera_idx];
  const Rigid3 pose =
      *simulation.ground_truth.CamFromWorld(simulation.scene, original_idx);
  EXPECT_LT((pose.Center() - world_from_view.translation).norm(), 1e-9);
  return *ProjectToPixel(camera.model, camera.params.data(),
                         pose.rotation * (world_from_view.rotation * ray));
}

TEST(UndistortedModel, ProjectionsAgreeWithTheOriginals) {
  const Simulation simulation = SimulateRig();
  ViewOptions options;
  options.blank_pixels = 1.0;
  options.max_view_angle_deg = 180.0;
  const UndistortedModel model = Undistort(simulation, options);
  CheckConsistent(model.scene);
  ASSERT_EQ(model.reconstruction.points.size(),
            simulation.ground_truth.points.size());
  EXPECT_EQ(CountObservations(model.reconstruction),
            CountObservations(simulation.ground_truth));
  std::set<std::string> sensors;
  for (size_t i = 0; i < model.reconstruction.points.size(); ++i) {
    const Point3D& point = model.reconstruction.points[i];
    EXPECT_LT(point.error_px.value(), 1e-3);
    for (const Observation& o : point.track) {
      const Image& image = model.scene.images[o.image_idx];
      const Camera& camera = model.scene.cameras[image.camera_idx];
      sensors.insert(model.scene.sensors[image.sensor_idx].name);
      const Vector3d in_view =
          *model.reconstruction.CamFromWorld(model.scene, o.image_idx) *
          point.point_in_world;
      const auto pixel =
          ProjectToPixel(camera.model, camera.params.data(), in_view);
      ASSERT_TRUE(pixel);
      const int original_idx = model.sources[o.image_idx].image_idx;
      const Image& original = simulation.scene.images[original_idx];
      const Camera& lens = simulation.scene.cameras[original.camera_idx];
      const auto original_pixel =
          ProjectToPixel(lens.model, lens.params.data(),
                         *simulation.ground_truth.CamFromWorld(simulation.scene,
                                                               original_idx) *
                             simulation.ground_truth.points[i].point_in_world);
      ASSERT_TRUE(original_pixel);
      EXPECT_LT((ThroughTheWorld(simulation, model, o.image_idx, *pixel) -
                 *original_pixel)
                    .norm(),
                1e-3);
    }
  }
  EXPECT_THAT(sensors, testing::IsSupersetOf(
                           {"left", "right", "side_front", "side_right"}));
}

TEST(UndistortedModel, DoesNotDependOnThreads) {
  const Simulation simulation = SimulateRig();
  const UndistortedModel one = Undistort(simulation, ViewOptions());
  const UndistortedModel three =
      Undistort(simulation, ViewOptions(), ViewNaming::kFolders, 3);
  ASSERT_EQ(one.scene.images.size(), three.scene.images.size());
  for (size_t i = 0; i < one.scene.images.size(); ++i) {
    EXPECT_EQ(one.scene.images[i].keypoints_px,
              three.scene.images[i].keypoints_px);
  }
  EXPECT_EQ(CountObservations(one.reconstruction),
            CountObservations(three.reconstruction));
}

TEST(UndistortedModel, RigsAndFramesRemain) {
  const Simulation simulation = SimulateRig();
  const UndistortedModel model = Undistort(simulation, ViewOptions());
  ASSERT_EQ(model.scene.rigs.size(), 1u);
  ASSERT_EQ(model.scene.frames.size(), simulation.scene.frames.size());
  EXPECT_EQ(model.scene.sensors.size(), 2u + 5u);
  for (size_t i = 0; i < model.scene.frames.size(); ++i) {
    EXPECT_EQ(model.scene.frames[i].image_idxs.size(), 7u);
  }
  for (size_t i = 1; i < model.scene.images.size(); ++i) {
    EXPECT_LT(model.scene.images[i - 1].name, model.scene.images[i].name);
  }
  // Points lose what cropping removes.
  EXPECT_LT(CountObservations(model.reconstruction),
            CountObservations(simulation.ground_truth));
  for (const Point3D& point : model.reconstruction.points) {
    EXPECT_GE(point.track.size(), 2u);
  }
}

TEST(UndistortedModel, UnregisteredImagesAreLeftOut) {
  Simulation simulation = SimulateRig();
  simulation.ground_truth.rig_from_world[2].reset();
  const UndistortedModel model = Undistort(simulation, ViewOptions());
  EXPECT_EQ(model.scene.frames.size(), simulation.scene.frames.size() - 1);
  for (const UndistortedModel::Source& source : model.sources) {
    EXPECT_NE(simulation.scene.images[source.image_idx].frame_idx, 2);
  }
}

TEST(UndistortedModel, FlatNamesAreUniqueUpToTheirFirstDot) {
  Simulation simulation = SimulateRig();
  simulation.scene.images[0].name = "a_b/c.x.png";
  simulation.scene.images[1].name = "a/b_c.x.jpg";
  const UndistortedModel model =
      Undistort(simulation, ViewOptions(), ViewNaming::kFlat);
  std::set<std::string> stems;
  for (const Image& image : model.scene.images) {
    EXPECT_EQ(image.name.find('/'), std::string::npos);
    stems.insert(image.name.substr(0, image.name.find('.')));
  }
  EXPECT_EQ(stems.size(), model.scene.images.size());
}

TEST(UndistortedModel, NamesDoNotLeaveTheirFolder) {
  for (const char* name : {"../a.png", "/a.png", "a/../../b.png"}) {
    Simulation simulation = SimulateRig();
    simulation.scene.images[0].name = name;
    EXPECT_THROW(Undistort(simulation, ViewOptions()), Error) << name;
  }
}

TEST(UndistortedModel, CollidingNamesAreErrors) {
  Simulation simulation = SimulateRig();
  simulation.scene.images[0].name = "side_front/000000.png";
  simulation.scene.images[1].name = "side_front/000000.png";
  EXPECT_THROW(Undistort(simulation, ViewOptions()), Error);
}

}  // namespace
}  // namespace mgsfm
