// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/rendering.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "base/random.h"
#include "simulator/road.h"
#include "simulator/street_painter.h"
#include "simulator/street_surfaces.h"
#include "simulator/world.h"

namespace mgsfm {
namespace {

SimulatedCamera SmallCamera(CameraModelId model) {
  if (model == CameraModelId::kPinhole) {
    return {"cam0/", model, 320, 160, {200, 205, 158, 83}, Rigid3()};
  }
  return {"cam0/", model, 200, 200, {62, 63, 101, 98, 0.01, -0.003, 0, 0},
          Rigid3()};
}

class RenderingTest : public testing::TestWithParam<CameraModelId> {
 protected:
  RenderingTest() {
    options_.num_frames = 4;
    options_.random_seed = 3;
    input_.rig = {SmallCamera(GetParam())};
    // Excludes the dark fade at the border of the image.
    rendering_.max_view_angle_deg = 180.0;
    simulation_ = SimulateWithoutFeatures(options_, input_);
    drive_ = MakeDrive(options_, input_);
    road_.emplace(drive_, kRoadExtension_m);
    surfaces_.emplace(*road_, 0, options_.random_seed);
    renderer_ = std::make_unique<StreetRenderer>(
        options_, input_, simulation_.scene.cameras, rendering_, Context());
  }

  ColorImage Render(int frame, int num_threads = 2) const {
    Context context;
    context.num_threads = num_threads;
    return renderer_->Render(0, simulation_.cam_from_world[frame], context);
  }

  // The first intersection of the exact ray of a pixel.
  std::optional<Eigen::Vector3d> PointAt(int frame,
                                         const Eigen::Vector2d& pixel) const {
    const Camera& camera = simulation_.scene.cameras[0];
    const auto ray = RayFromPixel(camera.model, camera.params.data(), pixel);
    if (!ray) return std::nullopt;
    const Rigid3 world_from_cam = simulation_.cam_from_world[frame].Inverse();
    const Eigen::Vector3d direction = world_from_cam.rotation * *ray;
    const auto distance =
        renderer_->DistanceAlong(world_from_cam.translation, direction);
    if (!distance) return std::nullopt;
    return world_from_cam.translation + *distance * direction;
  }

  std::optional<Eigen::Vector2d> Project(int frame,
                                         const Eigen::Vector3d& point) const {
    const Camera& camera = simulation_.scene.cameras[0];
    return ProjectToPixel(camera.model, camera.params.data(),
                          simulation_.cam_from_world[frame] * point);
  }

  SimulationOptions options_;
  SimulationInput input_;
  RenderingOptions rendering_;
  Simulation simulation_;
  Drive drive_;
  std::optional<Road> road_;
  std::optional<StreetSurfaces> surfaces_;
  std::unique_ptr<StreetRenderer> renderer_;
};

double Gray(const ColorImage& image, double x, double y) {
  const auto at = [&](int column, int row) {
    const uint8_t* pixel =
        image.rgb.data() + 3 * (row * image.width_px + column);
    return (pixel[0] + pixel[1] + pixel[2]) / 3.0;
  };
  const int column = static_cast<int>(std::floor(x - 0.5));
  const int row = static_cast<int>(std::floor(y - 0.5));
  const double u = x - 0.5 - column, v = y - 0.5 - row;
  return (1 - v) * ((1 - u) * at(column, row) + u * at(column + 1, row)) +
         v * ((1 - u) * at(column, row + 1) + u * at(column + 1, row + 1));
}

double Correlation(const std::vector<double>& a, const std::vector<double>& b) {
  double mean_a = 0, mean_b = 0, aa = 0, bb = 0, ab = 0;
  const auto size = static_cast<double>(a.size());
  for (size_t i = 0; i < a.size(); ++i) {
    mean_a += a[i] / size;
    mean_b += b[i] / size;
  }
  for (size_t i = 0; i < a.size(); ++i) {
    aa += (a[i] - mean_a) * (a[i] - mean_a);
    bb += (b[i] - mean_b) * (b[i] - mean_b);
    ab += (a[i] - mean_a) * (b[i] - mean_b);
  }
  return ab / std::sqrt(aa * bb);
}

// A point of the street has the same brightness in the next image at its
// projection, with a smaller difference than a few pixels away.
TEST_P(RenderingTest, PointsLieWhereTheCameraModelProjectsThem) {
  const ColorImage image1 = Render(0), image2 = Render(1);
  std::vector<double> gray1, gray2, beside;
  for (int y = 10; y < image1.height_px - 10; y += 2) {
    for (int x = 10; x < image1.width_px - 10; x += 2) {
      const auto point = PointAt(0, {x + 0.5, y + 0.5});
      if (!point) continue;
      const auto pixel2 = Project(1, *point);
      if (!pixel2 || pixel2->x() < 10 || pixel2->y() < 10 ||
          pixel2->x() > image1.width_px - 10 ||
          pixel2->y() > image1.height_px - 10) {
        continue;
      }
      // Skips occluded points.
      const auto seen = PointAt(1, *pixel2);
      if (!seen || (*seen - *point).norm() > 0.05) continue;
      gray1.push_back(Gray(image1, x + 0.5, y + 0.5));
      gray2.push_back(Gray(image2, pixel2->x(), pixel2->y()));
      beside.push_back(Gray(image2, pixel2->x() + 4.0, pixel2->y()));
    }
  }
  ASSERT_GT(gray1.size(), 1000u);
  const double correlation = Correlation(gray1, gray2);
  EXPECT_GT(correlation, 0.9);
  EXPECT_GT(1.0 - Correlation(gray1, beside), 1.5 * (1.0 - correlation));
}

// The ends of a row of facades: one side of the projected corner shows the wall
// at its distance; the other side shows neither the wall nor anything nearer.
TEST_P(RenderingTest, CornersOfFacadesLieWhereTheyProject) {
  const Eigen::Quaterniond world_from_level =
      road_->level_from_world().conjugate();
  const Rigid3& cam_from_world = simulation_.cam_from_world[0];
  int num_corners = 0;
  for (const Surface& surface : surfaces_->surfaces()) {
    if (surface.side == 0) continue;
    const Eigen::Vector3d middle(0.5 * (surface.a.x() + surface.b.x()),
                                 0.5 * (surface.a.y() + surface.b.y()),
                                 surface.top_m);
    const Eigen::Vector3d edge = world_from_level * middle;
    const auto above =
        Project(0, edge + world_from_level * Eigen::Vector3d(0, 0, 0.02));
    const auto below =
        Project(0, edge - world_from_level * Eigen::Vector3d(0, 0, 0.02));
    if (!above || !below || (*above - *below).norm() < 0.05) continue;
    const auto wall = PointAt(0, *below);
    const double distance = (edge - cam_from_world.Center()).norm();
    if (!wall || (*wall - edge).norm() > 0.1) continue;  // hidden
    ++num_corners;
    const auto beyond = PointAt(0, *above);
    if (beyond) {
      EXPECT_GT((*beyond - cam_from_world.Center()).norm(), distance);
    }
  }
  EXPECT_GT(num_corners, 3);
}

TEST_P(RenderingTest, TheFirstSurfaceOfAllIsSeen) {
  const Eigen::Quaterniond& level_from_world = road_->level_from_world();
  for (int y = 5; y < 160; y += 7) {
    for (int x = 5; x < 195; x += 7) {
      const auto point = PointAt(2, {x + 0.5, y + 0.5});
      const Eigen::Vector3d center = simulation_.cam_from_world[2].Center();
      if (!point) continue;
      const double distance = (*point - center).norm();
      const Eigen::Vector3d direction =
          level_from_world * ((*point - center) / distance);
      EXPECT_FALSE(surfaces_->Cast(level_from_world * center, direction,
                                   distance - 1e-6));
    }
  }
}

TEST_P(RenderingTest, ThreadsMakeNoDifference) {
  EXPECT_EQ(Render(1, 1).rgb, Render(1, 3).rgb);
}

INSTANTIATE_TEST_SUITE_P(Models, RenderingTest,
                         testing::Values(CameraModelId::kPinhole,
                                         CameraModelId::kOpenCVFisheye));

// The first intersection of a ray with the ground, by small steps.
TEST(GroundTest, RaysMeetItFirstWhereStepsDo) {
  SimulationOptions options;
  options.num_frames = 60;
  const Drive drive = MakeDrive(options, {});
  const Road road(drive, 20);
  const Ground ground(road,
                      {Eigen::Vector2d(-100, -100), Eigen::Vector2d(100, 100)});
  const Eigen::Vector3d origin =
      road.level_from_world() * drive.PoseOfFrame(10).Center();
  for (int i = 0; i < 200; ++i) {
    Random random(7, i);
    const Eigen::Vector3d direction =
        Eigen::Vector3d(random.Uniform(-1, 1), random.Uniform(-1, 1),
                        random.Uniform(-0.5, 0.05))
            .normalized();
    const auto distance = ground.Cast(origin, direction, 60.0);
    double stepped = 0.0;
    const auto is_above = [&](double t) {
      const Eigen::Vector3d at = origin + t * direction;
      return at.z() > ground.HeightAt(at.head<2>());
    };
    while (stepped < 60.0 && is_above(stepped)) stepped += 0.005;
    ASSERT_EQ(distance.has_value(), stepped < 60.0) << i;
    if (distance) {
      EXPECT_NEAR(*distance, stepped, 0.006) << i;
    }
  }
}

TEST(ScaledRigTest, ProjectionsScaleExactly) {
  for (const RigPreset preset : {RigPreset::kKitti360, RigPreset::kCube6}) {
    const auto rig = MakeRig(preset);
    const auto scaled = ScaledRig(rig, 0.37);
    const Eigen::Vector3d point(0.3, -0.2, 1.1);
    for (size_t i = 0; i < rig.size(); ++i) {
      const auto a = ProjectToPixel(rig[i].model, rig[i].params.data(), point);
      const auto b =
          ProjectToPixel(scaled[i].model, scaled[i].params.data(), point);
      EXPECT_LT((0.37 * *a - *b).norm(), 1e-9);
      EXPECT_GE(scaled[i].width_px, 0.37 * rig[i].width_px);
    }
  }
}

}  // namespace
}  // namespace mgsfm
