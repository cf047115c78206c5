// SPDX-License-Identifier: BSD-3-Clause
// Cameras without calibration: the lens is found with the model.
#include "lenses/lens_calibration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "scene/intrinsics_check.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

Simulation Drive(PathPreset path, int num_frames = 30) {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.path = path;
  options.num_frames = num_frames;
  options.frame_spacing_m = 1.5;
  options.max_num_features_per_image = 300;
  options.pixel_noise_px = 0.3;
  return Simulate(options);
}

// Replaces the lenses of all cameras, which see the same rays.
void Relens(CameraModelId model, const std::vector<double>& params,
            Simulation* drive) {
  for (Image& image : drive->scene.images) {
    const Camera& camera = drive->scene.cameras[image.camera_idx];
    for (Eigen::Vector2f& keypoint : image.keypoints_px) {
      const auto ray = RayFromPixel(camera.model, camera.params.data(),
                                    keypoint.cast<double>());
      const auto pixel =
          ray ? ProjectToPixel(model, params.data(), *ray) : std::nullopt;
      // A keypoint that the new lens does not see is far outside.
      keypoint = pixel ? pixel->cast<float>() : Eigen::Vector2f(-1e4f, -1e4f);
    }
  }
  for (Camera& camera : drive->scene.cameras) {
    camera.model = model;
    camera.params = params;
  }
}

// What feature extraction knows of images without EXIF.
MapperInput Uncalibrated(const Simulation& drive) {
  MapperInput input{drive.scene, drive.view_graph};
  for (Camera& camera : input.scene.cameras) {
    camera.model = CameraModelId::kSimpleRadial;
    camera.params = {1.2 * std::max(camera.width_px, camera.height_px),
                     0.5 * camera.width_px, 0.5 * camera.height_px, 0.0};
    camera.has_prior_focal_length = false;
  }
  for (ImagePair& pair : input.view_graph.pairs) {
    pair.config = TwoViewConfig::kUncalibrated;
    pair.relative_pose.reset();
    pair.E.reset();
    pair.F.reset();
  }
  return input;
}

struct Lens {
  const char* name;
  double focal_px, k1, k2;
};

class UnknownLensTest : public testing::TestWithParam<Lens> {};

TEST_P(UnknownLensTest, IsFoundWithItsPrincipalPoint) {
  const Lens& lens = GetParam();
  Simulation drive = Drive(PathPreset::kLoop);
  const std::vector<double> truth = {lens.focal_px, 630.0, 190.0, lens.k1,
                                     lens.k2};
  Relens(CameraModelId::kRadial, truth, &drive);
  const MapperResult result =
      RunMapper(Uncalibrated(drive), MapperOptions(), Threads(2));
  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  const Camera expected{CameraId(1), CameraModelId::kRadial, 1226, 370, truth,
                        false};
  for (const Camera& camera : result.models[0].reconstruction.cameras) {
    EXPECT_NEAR(camera.params[0], lens.focal_px, 0.01 * lens.focal_px);
    EXPECT_LT(LensChangePx(expected, camera), 2.0);
  }
}

INSTANTIATE_TEST_SUITE_P(Lenses, UnknownLensTest,
                         testing::Values(Lens{"Barrel", 600.0, -0.25, 0.06},
                                         Lens{"Pincushion", 900.0, 0.1, 0.0},
                                         Lens{"Long", 1500.0, 0.0, 0.0}),
                         [](const auto& info) {
                           return std::string(info.param.name);
                         });

// Image pairs alone find the focal length of a distorting lens within the
// standard deviation that they state.
TEST_P(UnknownLensTest, PairsFindTheFocalLength) {
  const Lens& lens = GetParam();
  Simulation drive = Drive(PathPreset::kLoop);
  Relens(CameraModelId::kRadial,
         {lens.focal_px, 630.0, 190.0, lens.k1, lens.k2}, &drive);
  const MapperInput input = Uncalibrated(drive);
  const FocalLengthResult result =
      CalibrateFocalLengths(input.scene, input.view_graph, {}, Threads(2));
  for (const FocalLengthEstimate& estimate : result.estimates) {
    const double error =
        std::log(result.cameras[estimate.camera_idx].params[0] / lens.focal_px);
    EXPECT_LT(std::abs(error), 2.0 * estimate.sigma.value());
  }
}

// Wrong EXIF is a start, and does not remain.
TEST(LensTest, WrongExifIsCorrected) {
  const Simulation drive = Drive(PathPreset::kLoop);
  MapperInput input = Uncalibrated(drive);
  for (size_t i = 0; i < input.scene.cameras.size(); ++i) {
    Camera& camera = input.scene.cameras[i];
    camera.params[0] = 1.2 * drive.scene.cameras[i].params[0];
    camera.has_prior_focal_length = true;
    EXPECT_TRUE(HasLensOfExif(camera));
    EXPECT_FALSE(HasLensOfExif(drive.scene.cameras[i]));
  }
  const MapperResult result = RunMapper(input, MapperOptions(), Threads(2));
  const auto& cameras = result.models.at(0).reconstruction.cameras;
  for (size_t i = 0; i < cameras.size(); ++i) {
    const double truth = drive.scene.cameras[i].params[0];
    EXPECT_NEAR(cameras[i].params[0], truth, 0.01 * truth);
  }
}

// Planar scenes contradict EXIF with certainty, and wrongly.
TEST(LensTest, PairsThatContradictExifAreNoStart) {
  const Camera exif{CameraId(1), CameraModelId::kSimpleRadial, 1000,
                    800,         {1000.0, 500.0, 400.0, 0.0},  true};
  const auto start = [&](double focal_px, double sigma) {
    FocalLengthResult of_pairs;
    of_pairs.cameras = WithoutExif({exif});
    of_pairs.cameras[0].params[0] = focal_px;
    of_pairs.estimates.push_back({0, 1000.0, focal_px, sigma, 100, ""});
    return StartOfLenses({exif}, of_pairs)[0].params[0];
  };
  EXPECT_EQ(start(1200.0, 0.02), 1200.0);
  EXPECT_EQ(start(1200.0, 0.2), 1000.0);  // less certain than EXIF
  EXPECT_EQ(start(500.0, 0.02), 1000.0);
}

TEST(LensTest, KnownLensesAreNotChanged) {
  const Simulation drive = Drive(PathPreset::kCurve);
  const MapperInput input{drive.scene, drive.view_graph};
  MapperOptions off;
  off.focal_lengths.calibrate = false;
  const MapperResult result = RunMapper(input, MapperOptions(), Threads(2));
  const MapperResult without = RunMapper(input, off, Threads(2));
  EXPECT_FALSE(result.lenses.has_value());
  const Reconstruction& a = result.models.at(0).reconstruction;
  const Reconstruction& b = without.models.at(0).reconstruction;
  ASSERT_EQ(a.points.size(), b.points.size());
  for (size_t i = 0; i < a.points.size(); ++i) {
    EXPECT_EQ(a.points[i].point_in_world, b.points[i].point_in_world);
  }
  for (size_t i = 0; i < a.cameras.size(); ++i) {
    EXPECT_EQ(a.cameras[i].params, drive.scene.cameras[i].params);
  }
}

// A chosen model and constant parameters stay.
TEST(LensTest, ChoicesOfTheUserStay) {
  const Simulation drive = Drive(PathPreset::kLoop);
  MapperOptions options;
  options.focal_lengths.select_camera_model = false;
  options.bundle_adjustment.refine_principal_point = RefineMode::kNo;
  const MapperInput input = Uncalibrated(drive);
  const MapperResult result = RunMapper(input, options, Threads(2));
  for (const Camera& camera : result.models.at(0).reconstruction.cameras) {
    EXPECT_EQ(camera.model, CameraModelId::kSimpleRadial);
    EXPECT_EQ(camera.params[1], 613.0);
    EXPECT_EQ(camera.params[2], 185.0);
  }
}

// A straight drive does not tell a focal length.
TEST(LensTest, UndeterminedFocalLengthsAreNamed) {
  const Simulation drive = Drive(PathPreset::kStraight);
  const MapperInput input = Uncalibrated(drive);
  const MapperResult result = RunMapper(input, MapperOptions(), Threads(2));
  ASSERT_FALSE(result.models.empty());
  for (const FocalLengthCheck& check : result.models[0].focal_lengths) {
    const double truth = drive.scene.cameras[check.camera_idx].params[0];
    const double error = std::abs(std::log(check.estimated_px / truth));
    EXPECT_TRUE(!check.message.empty() ||
                error < 2.0 * check.relative_sigma.value());
  }
}

// Rounds grow while focal lengths are undetermined, but not to all frames,
// which are mapped after the rounds.
TEST(LensTest, NoRoundHasAllFrames) {
  const Simulation drive = Drive(PathPreset::kStraight, 60);
  const MapperInput input = Uncalibrated(drive);
  const std::vector<Camera>& cameras = input.scene.cameras;
  std::vector<size_t> num_frames;  // per round
  const LensMapper map = [&](const Lenses&, const ViewGraph& matches) {
    std::set<int> frames;
    for (const ImagePair& pair : matches.pairs) {
      frames.insert(input.scene.images[pair.image_idx1].frame_idx);
      frames.insert(input.scene.images[pair.image_idx2].frame_idx);
    }
    num_frames.push_back(frames.size());
    LensModel model{drive.ground_truth, {}};
    model.reconstruction.cameras = cameras;
    for (size_t i = 0; i < cameras.size(); ++i) {
      model.focal_lengths.push_back(
          {static_cast<int>(i), 0.0, 0.0, 1.0, "the images do not tell it"});
    }
    return std::optional(std::move(model));
  };
  const MapperOptions options;
  const LensResult result = CalibrateLenses(
      {input.scene, cameras, cameras, input.view_graph}, map,
      {options.focal_lengths, options.bundle_adjustment, 1.0}, Threads(1));
  EXPECT_THAT(num_frames, testing::ElementsAre(24, 48));
  EXPECT_EQ(result.summary.num_rounds, 2);
}

// The change of a focal length by 1 % displaces pixels by 1 % of their distance
// to the principal point, and that of a principal point only turns the camera.
TEST(LensTest, ChangeIsThatOfRaysWithoutRotation) {
  const Camera camera{CameraId(1), CameraModelId::kSimplePinhole, 800,
                      800,         {1000.0, 400.0, 400.0},        false};
  Camera longer = camera, shifted = camera;
  longer.params[0] *= 1.01;
  shifted.params[1] += 5.0;
  EXPECT_NEAR(LensChangePx(camera, shifted), 0.0, 1e-6);
  double squares = 0.0;
  for (int i = -4; i <= 4; ++i) squares += 2.0 * std::pow(100.0 * i, 2) / 9.0;
  EXPECT_NEAR(LensChangePx(camera, longer), 0.01 * std::sqrt(squares), 1e-6);
}

}  // namespace
}  // namespace mgsfm
