// SPDX-License-Identifier: BSD-3-Clause
#include "bundle_adjustment/retriangulation.h"

#include <gtest/gtest.h>

#include <map>

#include "bundle_adjustment/point_filters.h"
#include "estimation/bundle_adjustment/bundle_fixtures.h"
#include "geometry/triangulation.h"
#include "scene/observations.h"

namespace mgsfm {
namespace {

PointFilterOptions Within(double max_error_px) {
  PointFilterOptions options;
  options.max_error_px = max_error_px;
  return options;
}

std::vector<Eigen::Vector3d> CentersOf(const std::vector<ImageView>& views,
                                       const Point3D& point) {
  std::vector<Eigen::Vector3d> centers;
  for (const Observation& o : point.track) {
    centers.push_back(views[o.image_idx].center);
  }
  return centers;
}

// The true points by their first observation.
std::map<Observation, const Point3D*> ByFirstObservation(
    const Reconstruction& truth) {
  std::map<Observation, const Point3D*> by_first;
  for (const Point3D& point : truth.points) {
    by_first[point.track.front()] = &point;
  }
  return by_first;
}

class RetriangulationTest : public testing::TestWithParam<RigPreset> {
 protected:
  RetriangulationTest()
      : simulation_(Simulate(SmallScene(GetParam(), PathPreset::kCurve))) {}

  const Scene& scene() const { return simulation_.scene; }
  const Reconstruction& truth() const { return simulation_.ground_truth; }

  // Checks that all points with a sufficient angle are correct.
  void ExpectTruth(const Reconstruction& result) const {
    const std::vector<ImageView> views = MakeImageViews(scene(), truth());
    const auto by_first = ByFirstObservation(result);
    size_t num_expected = 0;
    for (const Point3D& point : truth().points) {
      const std::vector<Eigen::Vector3d> centers = CentersOf(views, point);
      if (MaxTriangulationAngle(centers, point.point_in_world, 1.0) < 0.02) {
        continue;
      }
      ++num_expected;
      const auto it = by_first.find(point.track.front());
      ASSERT_TRUE(it != by_first.end());
      EXPECT_EQ(it->second->track, point.track);
      EXPECT_LT((it->second->point_in_world - point.point_in_world).norm(),
                1e-2);
    }
    EXPECT_GT(num_expected, truth().points.size() / 2);
  }

  Simulation simulation_;
};

TEST_P(RetriangulationTest, PosesAloneGiveAllPoints) {
  Reconstruction result = truth();
  result.points.clear();
  Retriangulate(scene(), GroupTracks(truth()), Within(1.0), 2, &result);
  ExpectTruth(result);
}

// Groups are computed for each model, so they can lack an observation of a
// point and contain its others.
TEST_P(RetriangulationTest, NoKeypointIsInTwoPoints) {
  ObservationGroups groups;
  for (const Point3D& point : truth().points) {
    groups.observations.insert(groups.observations.end(),
                               point.track.begin() + 1, point.track.end());
    groups.FinishGroup();
  }
  Reconstruction result = truth();
  Retriangulate(scene(), groups, Within(1.0), 2, &result);
  std::map<Observation, int> num_points;
  for (const Point3D& point : result.points) {
    for (const Observation& o : point.track) ++num_points[o];
  }
  ASSERT_FALSE(num_points.empty());
  for (const auto& [observation, count] : num_points) EXPECT_EQ(count, 1);
}

TEST_P(RetriangulationTest, GroupsOfSeveralPointsAreSplit) {
  Reconstruction result = truth();
  result.points.clear();
  Retriangulate(scene(), GroupTracks(truth(), 3), Within(0.5), 2, &result);
  const auto by_first = ByFirstObservation(truth());
  size_t num_whole = 0;
  for (const Point3D& point : result.points) {
    std::vector<int> images;
    for (const Observation& o : point.track) images.push_back(o.image_idx);
    EXPECT_TRUE(std::adjacent_find(images.begin(), images.end()) ==
                images.end());
    const auto it = by_first.find(point.track.front());
    num_whole += it != by_first.end() && it->second->track == point.track;
  }
  // Near epipoles, two points can share a line of sight.
  EXPECT_GT(num_whole, truth().points.size() * 8 / 10);
}

TEST_P(RetriangulationTest, IncompletePointsAreCompletedAndMerged) {
  Reconstruction result = truth();
  result.points.clear();
  for (const Point3D& point : truth().points) {
    if (point.track.size() < 4) {
      result.points.push_back(point);
      continue;
    }
    // Two points with some of the observations each; one is in neither.
    Point3D first = point, second = point;
    first.track.resize(2);
    second.track.erase(second.track.begin(), second.track.begin() + 3);
    first.point_in_world += Eigen::Vector3d::Constant(1e-4);
    result.points.push_back(first);
    result.points.push_back(second);
  }
  Retriangulate(scene(), GroupTracks(truth()), Within(1.0), 2, &result);
  ExpectTruth(result);
}

TEST_P(RetriangulationTest, WrongKeypointsAreRejected) {
  Random random(7);
  Simulation changed = simulation_;
  std::vector<size_t> true_length;
  for (Point3D& point : changed.ground_truth.points) {
    true_length.push_back(point.track.size());
    if (point.track.size() < 4) continue;
    const Observation& wrong =
        point.track[random.Index(static_cast<uint32_t>(point.track.size()))];
    changed.scene.images[wrong.image_idx].keypoints_px[wrong.keypoint_idx] +=
        Eigen::Vector2f(30.0f, 30.0f);
  }
  Reconstruction result = truth();
  result.points.clear();
  Retriangulate(changed.scene, GroupTracks(truth()), Within(1.0), 2, &result);
  const std::vector<ImageView> views = MakeImageViews(scene(), truth());
  size_t num_observations = 0;
  for (const Point3D& point : result.points) {
    num_observations += point.track.size();
    for (const Observation& o : point.track) {
      const auto pixel = changed.scene.images[o.image_idx]
                             .keypoints_px[o.keypoint_idx]
                             .cast<double>();
      EXPECT_LE(
          views[o.image_idx].ReprojectionError(point.point_in_world, pixel),
          1.0);
    }
  }
  EXPECT_GT(num_observations, NumObservations(truth()) / 2);
  EXPECT_LT(num_observations, NumObservations(truth()));
}

TEST_P(RetriangulationTest, ThreadsDoNotChangeABit) {
  Reconstruction one = truth(), three = truth();
  one.points.clear();
  three.points.clear();
  const ObservationGroups groups = GroupTracks(truth(), 2);
  Retriangulate(scene(), groups, Within(1.0), 1, &one);
  Retriangulate(scene(), groups, Within(1.0), 3, &three);
  ASSERT_EQ(one.points.size(), three.points.size());
  for (size_t i = 0; i < one.points.size(); ++i) {
    EXPECT_EQ(one.points[i].track, three.points[i].track);
    EXPECT_EQ(one.points[i].point_in_world, three.points[i].point_in_world);
  }
}

TEST_P(RetriangulationTest, ImagesWithoutPoseAreIgnored) {
  Reconstruction result = truth();
  result.points.clear();
  result.rig_from_world[3].reset();
  Retriangulate(scene(), GroupTracks(truth()), Within(1.0), 2, &result);
  EXPECT_FALSE(result.points.empty());
  for (const Point3D& point : result.points) {
    for (const Observation& o : point.track) {
      EXPECT_NE(scene().images[o.image_idx].frame_idx, 3);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Rigs, RetriangulationTest,
                         testing::Values(RigPreset::kMono, RigPreset::kStereo,
                                         RigPreset::kKitti360,
                                         RigPreset::kCube6));

TEST(PointFilterTest, RemovesLargeErrorsAndSmallAngles) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  Reconstruction result = simulation.ground_truth;
  const Observation moved = result.points[0].track[0];
  Scene scene = simulation.scene;
  scene.images[moved.image_idx].keypoints_px[moved.keypoint_idx].x() += 5.0f;
  PointFilterOptions options = Within(4.0);
  options.min_angle_rad = DegToRad(2.0);
  options.min_two_view_angle_rad = DegToRad(4.0);
  FilterPoints(scene, options, 2, &result);
  const std::vector<ImageView> views = MakeImageViews(scene, result);
  EXPECT_LT(result.points.size(), simulation.ground_truth.points.size());
  EXPECT_GT(result.points.size(), 0u);
  for (const Point3D& point : result.points) {
    EXPECT_EQ(std::count(point.track.begin(), point.track.end(), moved), 0);
    EXPECT_GE(MaxTriangulationAngle(CentersOf(views, point),
                                    point.point_in_world, kPi),
              DegToRad(point.track.size() == 2 ? 4.0 : 2.0));
  }
}

// One large error among exact ones is part of a heavy tail; errors that are all
// large tell that the point is not precise.
TEST(PointFilterTest, RemovesPointsThatErrAsAWhole) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  const auto& points = simulation.ground_truth.points;
  const auto has_many = [](const Point3D& point) {
    return point.track.size() >= 8;
  };
  const auto one_error = std::find_if(points.begin(), points.end(), has_many);
  const auto all_errors = std::find_if(one_error + 1, points.end(), has_many);
  ASSERT_TRUE(all_errors != points.end());
  Scene scene = simulation.scene;
  const auto move = [&scene](const Observation& o, float error_px) {
    scene.images[o.image_idx].keypoints_px[o.keypoint_idx].x() += error_px;
  };
  move(one_error->track[0], 1.5f);
  float sign = 1.0f;
  for (const Observation& o : all_errors->track) move(o, sign = -sign);
  PointFilterOptions options = Within(2.0);
  options.max_rms_error_px = 0.6;
  const auto is_kept = [](const Reconstruction& model, const Point3D& point) {
    return std::any_of(
        model.points.begin(), model.points.end(),
        [&](const Point3D& kept) { return kept.track == point.track; });
  };
  Reconstruction filtered = simulation.ground_truth;
  FilterPoints(scene, options, 2, &filtered);
  EXPECT_EQ(filtered.points.size(), points.size() - 1);
  EXPECT_TRUE(is_kept(filtered, *one_error));
  EXPECT_FALSE(is_kept(filtered, *all_errors));
  Reconstruction anew = simulation.ground_truth;
  Retriangulate(scene, GroupTracks(simulation.ground_truth), options, 2, &anew);
  EXPECT_TRUE(is_kept(anew, *one_error));
  EXPECT_FALSE(is_kept(anew, *all_errors));
}

// Filtering and retriangulation agree on the largest distance.
TEST(PointFilterTest, RemovesPointsFarBeyondTheScene) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  const Scene& scene = simulation.scene;
  const double median = MedianDistance(scene, simulation.ground_truth, 2);
  ASSERT_GT(median, 0.0);
  PointFilterOptions options = Within(4.0);
  options.max_distance = median;
  Reconstruction filtered = simulation.ground_truth;
  FilterPoints(scene, options, 2, &filtered);
  Reconstruction anew = simulation.ground_truth;
  Retriangulate(scene, GroupTracks(simulation.ground_truth), options, 2, &anew);
  const double num_points = simulation.ground_truth.points.size();
  EXPECT_NEAR(filtered.points.size() / num_points, 0.5, 0.01);
  EXPECT_NEAR(anew.points.size() / num_points, 0.5, 0.02);
  for (const Reconstruction* result : {&filtered, &anew}) {
    const std::vector<ImageView> views = MakeImageViews(scene, *result);
    for (const Point3D& point : result->points) {
      EXPECT_LE(NearestDistance(CentersOf(views, point), point.point_in_world),
                median);
    }
  }
}

// A large distance needs two images of a frame if its cameras can measure it.
TEST(PointFilterTest, LargeDistancesNeedTwoImagesOfAFrame) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  const Scene& scene = simulation.scene;
  Reconstruction truth = simulation.ground_truth;
  // Every third point loses one of two images of its frames.
  for (size_t i = 0; i < truth.points.size(); i += 3) {
    std::vector<Observation>& track = truth.points[i].track;
    std::map<int, Observation> by_frame;
    for (const Observation& o : track) {
      by_frame.emplace(scene.images[o.image_idx].frame_idx, o);
    }
    track.clear();
    for (const auto& item : by_frame) track.push_back(item.second);
  }
  const double median = MedianDistance(scene, truth, 2);
  PointFilterOptions options = Within(4.0);
  options.max_distance_of_one_image = median;
  options.sensor_measures_distances = FindSensorsThatMeasure(
      scene, truth, PointDistances(scene, truth, 2), median);
  EXPECT_TRUE(options.sensor_measures_distances[0]);
  EXPECT_TRUE(options.sensor_measures_distances[1]);
  const std::vector<ImageView> views = MakeImageViews(scene, truth);
  size_t num_admissible = 0;
  for (const Point3D& point : truth.points) {
    num_admissible += IsSeenTwice(scene, point.track) ||
                      NearestDistance(CentersOf(views, point),
                                      point.point_in_world) <= median;
  }
  Reconstruction filtered = truth;
  FilterPoints(scene, options, 2, &filtered);
  EXPECT_LT(num_admissible, truth.points.size());
  EXPECT_LE(filtered.points.size(), num_admissible);
  // Single observations are no points.
  EXPECT_GT(filtered.points.size(), num_admissible * 9 / 10);
  Reconstruction anew = truth;
  Retriangulate(scene, GroupTracks(truth), options, 2, &anew);
  for (const Reconstruction* result : {&filtered, &anew}) {
    for (const Point3D& point : result->points) {
      EXPECT_TRUE(IsSeenTwice(scene, point.track) ||
                  NearestDistance(CentersOf(views, point),
                                  point.point_in_world) <= median);
    }
  }
}

TEST(PointFilterTest, OneCameraMayObserveDistantPoints) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kMono, PathPreset::kCurve));
  const Scene& scene = simulation.scene;
  const double median = MedianDistance(scene, simulation.ground_truth, 2);
  PointFilterOptions options = Within(4.0);
  Reconstruction all = simulation.ground_truth;
  FilterPoints(scene, options, 2, &all);
  options.max_distance_of_one_image = median;
  options.sensor_measures_distances = FindSensorsThatMeasure(
      scene, simulation.ground_truth,
      PointDistances(scene, simulation.ground_truth, 2), median);
  Reconstruction filtered = simulation.ground_truth;
  FilterPoints(scene, options, 2, &filtered);
  EXPECT_EQ(filtered.points.size(), all.points.size());
}

TEST(PointFilterTest, RemovesPointsOfTwoViewsNextToACamera) {
  const Simulation simulation =
      Simulate(SmallScene(RigPreset::kStereo, PathPreset::kCurve));
  const Scene& scene = simulation.scene;
  const Reconstruction& truth = simulation.ground_truth;
  PointFilterOptions options = Within(4.0);
  options.min_two_view_distance = MedianDistance(scene, truth, 2);
  const std::vector<ImageView> views = MakeImageViews(scene, truth);
  size_t num_near = 0;
  size_t num_kept = 0;
  for (const Point3D& point : truth.points) {
    const bool is_near =
        NearestDistance(CentersOf(views, point), point.point_in_world) <
        options.min_two_view_distance;
    const bool is_dropped = is_near && point.track.size() == 2;
    num_near += is_near;
    num_kept += !is_dropped;
  }
  ASSERT_LT(num_kept, truth.points.size());
  ASSERT_GT(num_kept, truth.points.size() - num_near);

  Reconstruction filtered = truth;
  FilterPoints(scene, options, 2, &filtered);
  EXPECT_EQ(filtered.points.size(), num_kept);
  // From poses alone.
  Reconstruction anew = truth;
  anew.points.clear();
  Retriangulate(scene, GroupTracks(truth), options, 2, &anew);
  for (const Point3D& point : anew.points) {
    if (point.track.size() > 2) continue;
    EXPECT_GE(NearestDistance(CentersOf(views, point), point.point_in_world),
              options.min_two_view_distance);
  }
  EXPECT_NEAR(anew.points.size() / static_cast<double>(num_kept), 1.0, 0.02);
}

// Optimal points have errors smaller than the noise, the more so the shorter
// their tracks are.
TEST(PointFilterTest, SigmaDoesNotDependOnTheTrackLength) {
  SimulationOptions options =
      SmallScene(RigPreset::kStereo, PathPreset::kCurve);
  options.pixel_noise_px = 0.7;
  const Simulation simulation = Simulate(options);
  Scene with_outliers = simulation.scene;
  for (Image& image : with_outliers.images) {
    for (size_t k = 0; k < image.keypoints_px.size(); k += 10) {
      image.keypoints_px[k] += 20.0f * Eigen::Vector2f::Ones();
    }
  }
  for (const size_t max_length : {2, 3, 4, 100}) {
    Reconstruction model = simulation.ground_truth;
    for (Point3D& point : model.points) {
      if (point.track.size() > max_length) point.track.resize(max_length);
    }
    const ObservationGroups groups = GroupTracks(model);
    Retriangulate(simulation.scene, groups, Within(5.0), 2, &model);
    // The errors of two observations have one degree of freedom, for which the
    // median underestimates sigma.
    const double tolerance = max_length == 2 ? 0.2 : 0.1;
    EXPECT_NEAR(NoiseSigmaPx(simulation.scene, model, 2), 0.7, tolerance)
        << max_length;
    EXPECT_NEAR(NoiseSigmaPx(with_outliers, model, 2), 0.7, tolerance)
        << max_length;
  }
  Reconstruction empty = simulation.ground_truth;
  empty.points.clear();
  EXPECT_EQ(NoiseSigmaPx(simulation.scene, empty, 2), 0.0);
}

}  // namespace
}  // namespace mgsfm
