// SPDX-License-Identifier: BSD-3-Clause
#include "georegistration/pose_graph_deformation.h"

#include <gtest/gtest.h>

#include "geometry/so3.h"
#include "georegistration/position_registration.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/prior_measurement.h"

namespace mgsfm {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

Simulation LongDrive(RigPreset rig) {
  SimulationOptions options;
  options.rig = rig;
  options.path = PathPreset::kCurve;
  options.num_frames = 120;
  options.frame_spacing_m = 2.0;
  options.num_points_per_frame = 40;
  options.max_num_features_per_image = 60;
  options.pixel_noise_px = 0.3;
  return Simulate(options);
}

// The ground truth with drift: each frame adds a small error of rotation and
// scale.
Reconstruction Drifted(const Simulation& simulation, double rotation_deg,
                       double growth) {
  Reconstruction model = simulation.ground_truth;
  const auto& truth = simulation.ground_truth.rig_from_world;
  std::vector<Sim3> moves;
  for (size_t f = 0; f < truth.size(); ++f) {
    Sim3 move;
    if (f > 0) {
      const Vector3d axis(0.3, 1.0, 0.1);
      move.rotation = (moves.back().rotation *
                       ExpSO3(DegToRad(rotation_deg) * axis.normalized()))
                          .normalized();
      move.scale = moves.back().scale * growth;
      const Vector3d before = truth[f - 1]->Center();
      move.translation =
          moves.back() * before - move.scale * (move.rotation * before);
    }
    moves.push_back(move);
    model.rig_from_world[f] = Rigid3::FromRotationAndCenter(
        truth[f]->rotation * move.rotation.conjugate(),
        move * truth[f]->Center());
  }
  for (Point3D& point : model.points) {
    const int frame_idx =
        simulation.scene.images[point.track.front().image_idx].frame_idx;
    point.point_in_world = moves[frame_idx] * point.point_in_world;
  }
  return model;
}

struct Errors {
  double max_position = 0.0;
  double max_rotation_deg = 0.0;
  double max_point = 0.0;
};

// Errors without alignment.
Errors Compare(const Simulation& simulation, const Reconstruction& model) {
  Errors errors;
  for (size_t f = 0; f < model.rig_from_world.size(); ++f) {
    const Rigid3& pose = *model.rig_from_world[f];
    const Rigid3& truth = *simulation.ground_truth.rig_from_world[f];
    errors.max_position =
        std::max(errors.max_position, (pose.Center() - truth.Center()).norm());
    errors.max_rotation_deg =
        std::max(errors.max_rotation_deg,
                 RadToDeg(AngleBetween(pose.rotation, truth.rotation)));
  }
  for (size_t i = 0; i < model.points.size(); ++i) {
    errors.max_point = std::max(
        errors.max_point, (model.points[i].point_in_world -
                           simulation.ground_truth.points[i].point_in_world)
                              .norm());
  }
  return errors;
}

struct DeformedModel {
  Reconstruction model;
  Errors before;
  std::optional<ModelDeformation> deformation;
  PositionPriors used;
};

DeformedModel Deform(const Simulation& simulation, const Reconstruction& start,
                     const PositionPriors& priors, bool is_metric) {
  DeformedModel result;
  result.model = start;
  PositionRegistration registration = RegisterToPriors(
      simulation.scene, priors, {{}, is_metric}, &result.model);
  EXPECT_TRUE(registration.summary.is_registered);
  result.before = Compare(simulation, result.model);
  result.used = registration.used;
  const Mask all(simulation.view_graph.pairs.size(), true);
  result.deformation = DeformToPriors(
      {simulation.scene, simulation.view_graph, all, priors, is_metric}, {},
      &result.used, &result.model);
  return result;
}

TEST(PoseGraphDeformationTest, DriftOfRotationAndScaleIsRemoved) {
  const Simulation simulation = LongDrive(RigPreset::kMono);
  const PositionPriors priors = MeasuredPositions(simulation, 0.5, 0.1);
  const DeformedModel deformed =
      Deform(simulation, Drifted(simulation, 0.3, 1.002), priors, false);
  ASSERT_TRUE(deformed.deformation.has_value());
  const Errors after = Compare(simulation, deformed.model);
  EXPECT_GT(deformed.before.max_position, 5.0);
  EXPECT_GT(deformed.before.max_rotation_deg, 5.0);
  EXPECT_LT(after.max_position, 1.5);
  EXPECT_LT(after.max_rotation_deg, 0.4 * deformed.before.max_rotation_deg);
  EXPECT_LT(after.max_point, 0.4 * deformed.before.max_point);
  EXPECT_GT(deformed.deformation->max_shift, 3.0);
  EXPECT_GT(deformed.deformation->max_rotation_deg, 3.0);
  // Positions that were far from the initial model are used as well.
  for (size_t i = 0; i < priors.images.size(); ++i) {
    if (!priors.images[i]) continue;
    const double error =
        (priors.images[i]->position - simulation.cam_from_world[i].Center())
            .norm();
    EXPECT_TRUE(deformed.used.images[i].has_value() || error > 1.5);
  }
}

TEST(PoseGraphDeformationTest, RigsDoNotChangeTheirScale) {
  const Simulation simulation = LongDrive(RigPreset::kStereo);
  const DeformedModel deformed =
      Deform(simulation, Drifted(simulation, 0.3, 1.0),
             MeasuredPositions(simulation, 0.5, 0.1), true);
  ASSERT_TRUE(deformed.deformation.has_value());
  const Errors after = Compare(simulation, deformed.model);
  EXPECT_GT(deformed.before.max_position, 5.0);
  EXPECT_LT(after.max_position, 1.5);
  EXPECT_EQ(deformed.model.sensor_from_rig[1]->translation,
            simulation.ground_truth.sensor_from_rig[1]->translation);
}

TEST(PoseGraphDeformationTest, ConsistentModelIsBitwiseUnchanged) {
  const Simulation simulation = LongDrive(RigPreset::kMono);
  const PositionPriors priors = MeasuredPositions(simulation, 0.5, 0.1);
  Reconstruction model = simulation.ground_truth;
  PositionPriors used = priors;
  const Mask all(simulation.view_graph.pairs.size(), true);
  EXPECT_FALSE(
      DeformToPriors({simulation.scene, simulation.view_graph, all, priors}, {},
                     &used, &model)
          .has_value());
  for (size_t f = 0; f < model.rig_from_world.size(); ++f) {
    EXPECT_EQ(model.rig_from_world[f]->translation,
              simulation.ground_truth.rig_from_world[f]->translation);
  }
}

// No pair connects the frames before and after a gap.
TEST(PoseGraphDeformationTest, ComponentsShareOneWorld) {
  SimulationOptions options;
  options.rig = RigPreset::kStereo;
  options.path = PathPreset::kCurve;
  options.num_frames = 50;
  options.frame_spacing_m = 2.0;
  options.num_points_per_frame = 100;
  options.max_num_features_per_image = 200;
  options.pixel_noise_px = 0.3;
  Simulation simulation = Simulate(options);
  auto& pairs = simulation.view_graph.pairs;
  const auto component = [&](int image_idx) {
    const int frame_idx = simulation.scene.images[image_idx].frame_idx;
    return frame_idx < 22 ? 0 : frame_idx < 28 ? 1 : 2;
  };
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                             [&](const ImagePair& pair) {
                               const int component1 =
                                   component(pair.image_idx1);
                               return component1 == 1 ||
                                      component1 != component(pair.image_idx2);
                             }),
              pairs.end());
  const MapperResult result =
      RunMapper({simulation.scene, simulation.view_graph,
                 MeasuredPositions(simulation, 0.2, 0.1)},
                MapperOptions(), Context());
  ASSERT_EQ(result.models.size(), 2u);
  for (const MapperModel& model : result.models) {
    EXPECT_TRUE(model.position_priors->is_registered);
    double most = 0.0;
    for (size_t i = 0; i < simulation.scene.images.size(); ++i) {
      const auto pose = model.reconstruction.CamFromWorld(simulation.scene,
                                                          static_cast<int>(i));
      if (!pose) continue;
      most = std::max(
          most,
          (pose->Center() - simulation.cam_from_world[i].Center()).norm());
    }
    EXPECT_LT(most, 0.4);
  }
}

}  // namespace
}  // namespace mgsfm
