// SPDX-License-Identifier: BSD-3-Clause
// A model that drifts around a circle is closed.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "geometry/so3.h"
#include "incremental/growth_steps.h"
#include "mgsfm/simulator/simulation.h"
#include "scene/observations.h"
#include "support/model_comparison.h"

namespace mgsfm {
namespace {

TEST(LoopClosure, ADriftedCircleIsClosed) {
  SimulationOptions simulated;
  simulated.path = PathPreset::kLoop;
  simulated.num_frames = 60;
  simulated.max_num_features_per_image = 400;
  simulated.pixel_noise_px = 0.3;
  const Simulation simulation = Simulate(simulated);
  const Scene& scene = simulation.scene;
  const Reconstruction& truth = simulation.ground_truth;
  const Bearings bearings = ComputeBearings(scene, 1);
  const ObservationGroups tracks = GroupTracks(truth.points);
  const ResectionOptions resection;
  const BundleAdjustmentOptions bundle_adjustment;
  const TrackOptions track_options;
  const MatchSelectionOptions selection;
  const IncrementalOptions options{resection, bundle_adjustment, track_options,
                                   selection};
  const Context context;
  const Mask all_pairs(simulation.view_graph.pairs.size(), true);
  const Mask no_neighbors(simulation.view_graph.pairs.size());
  GrowthInput input{
      {scene, bearings, simulation.view_graph, all_pairs, no_neighbors},
      options,
      context,
      tracks,
      {},
      std::vector<std::vector<int>>(scene.frames.size())};
  input.keypoints.resize(scene.images.size());
  for (size_t t = 0; t < tracks.size(); ++t) {
    for (const Observation* o = tracks.begin(t); o != tracks.end(t); ++o) {
      input.keypoints[o->image_idx].push_back(
          {o->keypoint_idx, static_cast<int>(t)});
    }
  }
  GrowingModel model(input, truth.sensor_from_rig);
  for (int f = 0; f < 60; ++f) {
    if (f >= 40) {
      const FrameRegistration found = RegisterFrame(input, model, f);
      if (found.loop) {
        const double error_before =
            CompareModels(scene, model.poses(), truth).max_position;
        ASSERT_TRUE(CloseLoop(input, f, found, &model)) << f;
        EXPECT_LT(CompareModels(scene, model.poses(), truth).max_position,
                  0.2 * error_before);
        return;
      }
    }
    // Each step turns a little too far.
    const Rigid3 drift{ExpSO3({0.0, DegToRad(0.1) * f, 0.0}),
                       Eigen::Vector3d::Zero()};
    model.SetFrame(f, *truth.rig_from_world[f] * drift);
    if (f > 0) model.Triangulate({f});
  }
  FAIL() << "no loop was found";
}

}  // namespace
}  // namespace mgsfm
