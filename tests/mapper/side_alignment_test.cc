// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "mapper/weak_seams.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

constexpr int kNumFrames = 20;
constexpr int kFirstBeyond = 12;

// A drive whose model is wrong from kFirstBeyond on: its points are those of
// either side.
struct BrokenDrive {
  Simulation simulation;
  MapperModel model;
  MapperOptions options;

  explicit BrokenDrive(const Rigid3& beyond_from_core) {
    SimulationOptions settings;
    settings.num_frames = kNumFrames;
    settings.pixel_noise_px = 0.3;
    simulation = Simulate(settings);
    model.reconstruction = simulation.ground_truth;
    for (int i = kFirstBeyond; i < kNumFrames; ++i) {
      auto& pose = model.reconstruction.rig_from_world[i];
      pose = *pose * beyond_from_core;
    }
    model.reconstruction.points = PointsOfSide(Rigid3(), false);
    const std::vector<Point3D> beyond =
        PointsOfSide(beyond_from_core.Inverse(), true);
    model.reconstruction.points.insert(model.reconstruction.points.end(),
                                       beyond.begin(), beyond.end());
  }

  bool IsBeyond(const Observation& o) const {
    return simulation.scene.images[o.image_idx].frame_idx >= kFirstBeyond;
  }

  std::vector<Point3D> PointsOfSide(const Rigid3& world_from_world,
                                    bool is_beyond) const {
    std::vector<Point3D> points;
    for (Point3D point : simulation.ground_truth.points) {
      point.track.erase(std::remove_if(point.track.begin(), point.track.end(),
                                       [&](const Observation& o) {
                                         return IsBeyond(o) != is_beyond;
                                       }),
                        point.track.end());
      if (point.track.size() < 2) continue;
      point.point_in_world = world_from_world * point.point_in_world;
      points.push_back(point);
    }
    return points;
  }

  // Returns the pairs that are used afterwards.
  Mask Realign() {
    const Scene& scene = simulation.scene;
    const ViewGraph& pairs = simulation.view_graph;
    const FramePairIndex index(scene, pairs, SequenceMode::kYes);
    const auto confidence_of = [&](const Mask& used, const MapperModel& m) {
      return EstimateModelConfidence(
          {scene, index, pairs, used, {}, m.reconstruction}, options, {});
    };
    Mask used(pairs.pairs.size(), true);
    for (size_t i = 0; i < used.size(); ++i) {
      const auto& frames = index.Of(i);
      used[i] = (frames.frame_idx1 < kFirstBeyond) ==
                (frames.frame_idx2 < kFirstBeyond);
    }
    const PositionPriors positions;
    const GravityPriors gravity;
    AdjustmentInput input{scene, pairs, pairs, positions, gravity};
    input.pair_is_used = used;
    model.confidence = confidence_of(used, model);
    RealignSides(index, options, {}, confidence_of, &input, &model);
    return input.pair_is_used;
  }

  // The largest error of the step across the break, relative to the true one.
  double StepError() const {
    const auto step = [](const Reconstruction& r) {
      return *r.rig_from_world[kFirstBeyond] *
             r.rig_from_world[kFirstBeyond - 1]->Inverse();
    };
    const Rigid3 truth = step(simulation.ground_truth);
    const Rigid3 found = step(model.reconstruction);
    return std::max(
        truth.rotation.angularDistance(found.rotation),
        (truth.translation.normalized() - found.translation.normalized())
            .norm());
  }
};

TEST(SideAlignment, MovesASideToWhereMoreMatchesAgree) {
  BrokenDrive drive({ExpSO3(Eigen::Vector3d(0.0, 0.1, 0.02)),
                     Eigen::Vector3d(1.0, -0.5, 2.0)});
  ASSERT_GT(drive.StepError(), 0.1);
  const Mask used = drive.Realign();
  EXPECT_LT(drive.StepError(), 0.01);
  EXPECT_TRUE(drive.model.confidence.seams.empty());
  EXPECT_GT(used.Count(), 0u);
}

TEST(SideAlignment, LeavesAModelWithoutOtherMatches) {
  BrokenDrive drive({ExpSO3(Eigen::Vector3d(0.0, 0.1, 0.02)),
                     Eigen::Vector3d(1.0, -0.5, 2.0)});
  auto& pairs = drive.simulation.view_graph.pairs;
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(),
                             [&](const ImagePair& pair) {
                               return drive.IsBeyond({pair.image_idx1, 0}) !=
                                      drive.IsBeyond({pair.image_idx2, 0});
                             }),
              pairs.end());
  const auto before = drive.model.reconstruction.rig_from_world;
  drive.Realign();
  EXPECT_FALSE(drive.model.confidence.seams.empty());
  for (int i = 0; i < kNumFrames; ++i) {
    EXPECT_TRUE(drive.model.reconstruction.rig_from_world[i]->translation ==
                before[i]->translation);
  }
}

TEST(SideAlignment, LeavesASoundModel) {
  BrokenDrive drive{Rigid3()};
  drive.Realign();
  EXPECT_LT(drive.StepError(), 0.01);
}

}  // namespace
}  // namespace mgsfm
