// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "bundle_adjustment/point_filters.h"
#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

constexpr double kMaxError_px = 2.0;

// Matches between all observations of each point, in pairs of images.
ViewGraph MatchesOf(const std::vector<Point3D>& points) {
  std::map<std::pair<int, int>, ImagePair> pairs;
  for (const Point3D& point : points) {
    for (const Observation& a : point.track) {
      for (const Observation& b : point.track) {
        if (a.image_idx >= b.image_idx) continue;
        ImagePair& pair = pairs[{a.image_idx, b.image_idx}];
        pair.image_idx1 = a.image_idx;
        pair.image_idx2 = b.image_idx;
        pair.matches.push_back({static_cast<uint32_t>(a.keypoint_idx),
                                static_cast<uint32_t>(b.keypoint_idx)});
      }
    }
  }
  ViewGraph view_graph;
  for (auto& [images, pair] : pairs) view_graph.pairs.push_back(pair);
  return view_graph;
}

using Tracks = std::vector<std::vector<Observation>>;

Tracks TracksOf(const Reconstruction& model) {
  Tracks tracks;
  for (const Point3D& point : model.points) tracks.push_back(point.track);
  return tracks;
}

class ContradictedPointsTest : public testing::TestWithParam<RigPreset> {
 protected:
  ContradictedPointsTest()
      : simulation_(Simulate(SmallScene(GetParam(), PathPreset::kCurve))),
        matches_(MatchesOf(truth().points)) {}

  const Scene& scene() const { return simulation_.scene; }
  const Reconstruction& truth() const { return simulation_.ground_truth; }

  // Every third point has two observations of its track, and is half as far
  // from the first of them.
  Reconstruction WithWrongPoints() const {
    Reconstruction model = truth();
    for (size_t i = 0; i < model.points.size(); i += 3) {
      Point3D& point = model.points[i];
      point.track.resize(2);
      const Eigen::Vector3d center =
          model.CamFromWorld(scene(), point.track[0].image_idx)->Center();
      point.point_in_world = 0.5 * (point.point_in_world + center);
    }
    return model;
  }

  bool Contradicts(const Reconstruction& model, const Point3D& point,
                   const Observation& o) const {
    const auto cam_from_world = model.CamFromWorld(scene(), o.image_idx);
    if (!cam_from_world) return false;
    const Image& image = scene().images[o.image_idx];
    const Camera& camera = model.cameras[image.camera_idx];
    const auto pixel = ProjectToPixel(camera.model, camera.params.data(),
                                      *cam_from_world * point.point_in_world);
    return !pixel ||
           (*pixel - image.keypoints_px[o.keypoint_idx].cast<double>()).norm() >
               kMaxError_px;
  }

  // All keypoints that are matched with those of a point, once per match.
  std::vector<Observation> MatchedWith(const Point3D& point) const {
    std::vector<Observation> matched;
    for (const ImagePair& pair : matches_.pairs) {
      for (const Match& m : pair.matches) {
        const Observation a{pair.image_idx1, static_cast<int>(m.keypoint_idx1)};
        const Observation b{pair.image_idx2, static_cast<int>(m.keypoint_idx2)};
        const auto has = [&](const Observation& o) {
          return std::find(point.track.begin(), point.track.end(), o) !=
                 point.track.end();
        };
        if (has(a) && !has(b)) matched.push_back(b);
        if (has(b) && !has(a)) matched.push_back(a);
      }
    }
    return matched;
  }

  // The tracks of the points that have the share, one point after the other.
  Tracks Expected(const Reconstruction& model, double min_match_share) const {
    Tracks kept;
    for (const Point3D& point : model.points) {
      double num_agreeing = 0.0, num_contradicting = 0.0;
      for (size_t i = 0; i < point.track.size(); ++i) {
        num_agreeing += static_cast<double>(point.track.size()) - 1.0;
      }
      for (const Observation& o : MatchedWith(point)) {
        num_contradicting += Contradicts(model, point, o);
      }
      const double share = num_agreeing / (num_agreeing + num_contradicting);
      if (share >= min_match_share) kept.push_back(point.track);
    }
    return kept;
  }

  Simulation simulation_;
  ViewGraph matches_;
};

TEST_P(ContradictedPointsTest, RightPointsAgreeWithTheirMatches) {
  Reconstruction model = truth();
  RemoveContradictedPoints(scene(), matches_, kMaxError_px, 1.0, 2, &model);
  EXPECT_EQ(TracksOf(model), TracksOf(truth()));
}

TEST_P(ContradictedPointsTest, PointsWithTheShareStayInTheirOrder) {
  const Reconstruction wrong = WithWrongPoints();
  for (const double min_match_share : {0.2, 0.7, 1.0}) {
    Reconstruction model = wrong;
    RemoveContradictedPoints(scene(), matches_, kMaxError_px, min_match_share,
                             2, &model);
    EXPECT_EQ(TracksOf(model), Expected(wrong, min_match_share));
    EXPECT_LT(model.points.size(), wrong.points.size());
  }
}

TEST_P(ContradictedPointsTest, AShareOfZeroKeepsAll) {
  Reconstruction model = WithWrongPoints();
  RemoveContradictedPoints(scene(), matches_, kMaxError_px, 0.0, 2, &model);
  EXPECT_EQ(TracksOf(model), TracksOf(WithWrongPoints()));
}

TEST_P(ContradictedPointsTest, ImagesWithoutPoseAreNoEvidence) {
  Reconstruction model = WithWrongPoints();
  ViewGraph others = matches_;  // only with images that have no pose
  for (size_t f = 0; f < scene().frames.size(); ++f) {
    if (f % 2 == 1) model.rig_from_world[f].reset();
  }
  const auto is_registered = [&](int image_idx) {
    return model.rig_from_world[scene().images[image_idx].frame_idx]
        .has_value();
  };
  others.pairs.erase(std::remove_if(others.pairs.begin(), others.pairs.end(),
                                    [&](const ImagePair& pair) {
                                      return is_registered(pair.image_idx1) &&
                                             is_registered(pair.image_idx2);
                                    }),
                     others.pairs.end());
  const auto tracks = TracksOf(model);
  RemoveContradictedPoints(scene(), others, kMaxError_px, 1.0, 2, &model);
  EXPECT_EQ(TracksOf(model), tracks);
}

// The matches join each point with the next one, so that they contradict both.
TEST_P(ContradictedPointsTest, RefinementTakesMatchesAsEvidence) {
  std::vector<Point3D> joined;
  for (size_t i = 0; i + 1 < truth().points.size(); i += 2) {
    joined.push_back(truth().points[i]);
    const auto& track = truth().points[i + 1].track;
    joined.back().track.insert(joined.back().track.end(), track.begin(),
                               track.end());
  }
  const ViewGraph wrong = MatchesOf(joined);
  const auto num_points = [&](const ViewGraph* matches, double share) {
    CandidateSource source = FixedCandidates(GroupTracks(truth()));
    source.matches = matches;
    BundleAdjustmentOptions options;
    options.min_match_share = share;
    return RefineReconstruction(scene(), source, truth(), options, Context())
        .estimate.points.size();
  };
  const size_t num_without = num_points(nullptr, 0.7);
  EXPECT_GT(num_without, 0u);
  EXPECT_LT(num_points(&wrong, 0.7), num_without / 2);
  EXPECT_EQ(num_points(&wrong, 0.0), num_without);
  EXPECT_EQ(num_points(&matches_, 0.7), num_without);
}

INSTANTIATE_TEST_SUITE_P(Rigs, ContradictedPointsTest,
                         testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                         RigPreset::kKitti360));

}  // namespace
}  // namespace mgsfm
