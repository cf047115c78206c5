// SPDX-License-Identifier: BSD-3-Clause
#include "moving_objects/rig_motions.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "math/statistics.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

constexpr double kFocalLength_px = 600.0;
constexpr double kMaxError_px = 2.0;
constexpr double kNoise_px = 0.3;
constexpr double kRelativeDepthNoise = 0.01;

// The rig drives a bend; a vehicle ahead stays at a constant distance.
const Rigid3 kDrive = Rigid3::FromRotationAndCenter(
    ExpSO3({0.0, DegToRad(-2.0), 0.0}), {0.03, 0.0, 1.5});
const Rigid3 kFollow = Rigid3::FromRotationAndCenter(
    ExpSO3({0.0, DegToRad(0.2), 0.0}), {0.0, 0.0, 0.1});

// The boxes that contain the points of both.
const Vector3d kLowOfStreet(-10.0, -3.0, 6.0), kHighOfStreet(10.0, 3.0, 30.0);
const Vector3d kLowOfVehicle(-2.0, -2.0, 7.0), kHighOfVehicle(2.0, 2.0, 11.0);

Vector3d Noise(double sigma, Random* random) {
  return sigma * Vector3d(random->Normal(), random->Normal(), random->Normal());
}

// The images whose keypoints have depths, and those that come first.
struct Layout {
  bool has_earlier_depths = true;
  bool has_later_depths = false;
  bool is_later_first = false;
};

// Two frames of a rig with two cameras that look ahead.
class TwoFrames {
 public:
  explicit TwoFrames(const Layout& layout = {}) : layout_(layout), random_(5) {
    cameras_ = {Rigid3(), {ExpSO3({0.0, 0.2, 0.02}), {-0.8, 0.05, 0.1}}};
    scene_.cameras.push_back({CameraId(1),
                              CameraModelId::kPinhole,
                              1200,
                              800,
                              {kFocalLength_px, kFocalLength_px, 600.0, 400.0},
                              true});
    scene_.rigs.push_back({RigId(1), 0, {0, 1}});
    for (int sensor = 0; sensor < 2; ++sensor) {
      scene_.sensors.push_back({"", 0, 0, std::nullopt});
      depths_.cam_from_rig.emplace_back(cameras_[sensor]);
    }
    for (int i = 0; i < 4; ++i) {
      const auto id = static_cast<uint32_t>(i + 1);
      scene_.images.push_back({ImageId(id), "", 0, i % 2, i / 2, {}});
    }
    scene_.frames = {{FrameId(1), "", 0, {0, 1}}, {FrameId(2), "", 0, {2, 3}}};
    bearings_.images.resize(4);
    depths_.keypoints.resize(4);
    // The order of the pairs is the same in both layouts.
    for (const auto& [earlier, later] : {std::pair(0, 0), {0, 1}, {1, 1}}) {
      ImagePair pair;
      std::tie(pair.image_idx1, pair.image_idx2) =
          std::minmax({EarlierImage(earlier), LaterImage(later)});
      view_graph_.pairs.push_back(pair);
      pair_idxs_.push_back(pair_idxs_.size());
    }
  }

  // Matches of points that move relative to the rig.
  void AddPoints(int number, const Rigid3& later_from_earlier,
                 const Vector3d& low, const Vector3d& high) {
    for (int i = 0; i < number; ++i) {
      Vector3d point;
      for (int axis = 0; axis < 3; ++axis) {
        point[axis] = random_.Uniform(low[axis], high[axis]);
      }
      AddMatch(point, later_from_earlier * point);
    }
  }
  void AddStatic(int number) {
    AddPoints(number, kDrive, kLowOfStreet, kHighOfStreet);
  }
  void AddVehicle(int number) {
    AddPoints(number, kFollow, kLowOfVehicle, kHighOfVehicle);
  }
  void AddMismatches(int number) {
    for (int i = 0; i < number; ++i) {
      const auto any = [this] {
        return Vector3d(random_.Uniform(-10.0, 10.0),
                        random_.Uniform(-3.0, 3.0), random_.Uniform(6.0, 30.0));
      };
      const Vector3d earlier = any();
      AddMatch(earlier, any());
    }
  }

  // The matches added from now on are outliers of verification.
  void AddOutliersFromNowOn() { adds_outliers_ = true; }

  void ForgetSensor(int sensor_idx) {
    depths_.cam_from_rig[sensor_idx] = std::nullopt;
  }
  StepHypotheses Find() const {
    return FindRigMotions(Matches(), kMaxError_px, Random(3));
  }
  std::optional<Rigid3> Refine(const Rigid3& start) const {
    const auto refined = RefineRigMotion(Matches(), kMaxError_px, start);
    if (!refined) return std::nullopt;
    return refined->later_from_earlier;
  }

 private:
  int EarlierImage(int sensor) const {
    return sensor + (layout_.is_later_first ? 2 : 0);
  }
  int LaterImage(int sensor) const {
    return sensor + (layout_.is_later_first ? 0 : 2);
  }
  FrameMatches Matches() const {
    return {scene_,
            bearings_,
            view_graph_,
            depths_,
            layout_.is_later_first ? 1 : 0,
            pair_idxs_};
  }

  // Points in the rig at both times, for one pair after the other.
  void AddMatch(const Vector3d& earlier, const Vector3d& later) {
    ImagePair& pair = view_graph_.pairs[num_matches_++ % 3];
    const bool is_first_earlier =
        (pair.image_idx1 >= 2) == layout_.is_later_first;
    int earlier_idx = pair.image_idx1, later_idx = pair.image_idx2;
    if (!is_first_earlier) std::swap(earlier_idx, later_idx);
    Match match{AddKeypoint(earlier_idx, earlier, layout_.has_earlier_depths),
                AddKeypoint(later_idx, later, layout_.has_later_depths)};
    if (!is_first_earlier) std::swap(match.keypoint_idx1, match.keypoint_idx2);
    (adds_outliers_ ? pair.outliers : pair.matches).push_back(match);
  }

  uint32_t AddKeypoint(int image_idx, const Vector3d& point_in_rig,
                       bool has_depth) {
    const Vector3d point = cameras_[image_idx % 2] * point_in_rig;
    const Vector3d noise = Noise(kNoise_px / kFocalLength_px, &random_);
    const double distance =
        point.norm() * (1.0 + kRelativeDepthNoise * random_.Normal());
    KeypointRays& rays = bearings_.images[image_idx];
    rays.Append((point.normalized() + noise).normalized());
    depths_.keypoints[image_idx].emplace_back();
    if (has_depth)
      depths_.keypoints[image_idx].back() = KeypointDepth{distance};
    return static_cast<uint32_t>(rays.size() - 1);
  }

  Layout layout_;
  Random random_;
  std::vector<Rigid3> cameras_;  // cam_from_rig
  Scene scene_;
  Bearings bearings_;
  ViewGraph view_graph_;
  FrameDepths depths_;
  std::vector<size_t> pair_idxs_;
  size_t num_matches_ = 0;
  bool adds_outliers_ = false;
};

TwoFrames Street(const Layout& layout = {}) {
  TwoFrames frames(layout);
  frames.AddStatic(150);
  frames.AddVehicle(90);
  frames.AddMismatches(60);
  return frames;
}

// The vehicle has more keypoints than the street.
TwoFrames BehindALorry(const Layout& layout = {}) {
  TwoFrames frames(layout);
  frames.AddStatic(120);
  frames.AddVehicle(160);
  frames.AddMismatches(30);
  return frames;
}

// The reach of many random points in a box.
double ReachOfBox(const Vector3d& low, const Vector3d& high) {
  Random random(7);
  const Vector3d center = 0.5 * (low + high);
  std::vector<double> distances, spreads;
  for (int i = 0; i < 20000; ++i) {
    Vector3d point;
    for (int axis = 0; axis < 3; ++axis) {
      point[axis] = random.Uniform(low[axis], high[axis]);
    }
    distances.push_back(point.norm());
    spreads.push_back((point - center).norm());
  }
  return std::sqrt(Median(distances) * Median(spreads));
}

// The bounds hold for more than 100 seeds. A vehicle is small, hence its motion
// is less certain than that of the scene.
void ExpectNear(const Rigid3& motion, const Rigid3& truth) {
  EXPECT_LT(RadToDeg(AngleBetween(motion.rotation, truth.rotation)), 0.2);
  EXPECT_LT((motion.Center() - truth.Center()).norm(), 0.03);
}

TEST(RigMotionsTest, SceneAndVehicleAreFound) {
  for (const Layout& layout :
       {Layout{true, false}, Layout{false, true}, Layout{true, true}}) {
    const StepHypotheses motions = Street(layout).Find();
    ASSERT_EQ(motions.size(), 2u);
    ExpectNear(motions[0].later_from_earlier, kDrive);
    ExpectNear(motions[1].later_from_earlier, kFollow);
    // Some matches agree by chance, or with both motions.
    EXPECT_NEAR(motions[0].share, 150.0 / 300.0, 0.03);
    EXPECT_EQ(motions[0].own_share, motions[0].share);
    EXPECT_NEAR(motions[1].own_share, 90.0 / 300.0, 0.03);
    EXPECT_GE(motions[1].share, motions[1].own_share);
  }
}

// Verification kept the matches of the vehicle only. Mismatches do not count.
TEST(RigMotionsTest, TheSceneCanBeAmongTheOutliers) {
  TwoFrames frames;
  frames.AddVehicle(160);
  frames.AddOutliersFromNowOn();
  frames.AddStatic(120);
  frames.AddMismatches(150);
  const StepHypotheses motions = frames.Find();
  ASSERT_EQ(motions.size(), 2u);
  ExpectNear(motions[0].later_from_earlier, kFollow);
  ExpectNear(motions[1].later_from_earlier, kDrive);
  EXPECT_NEAR(motions[0].own_share, 160.0 / 280.0, 0.03);
  EXPECT_NEAR(motions[1].own_share, 120.0 / 280.0, 0.03);
  const auto refined = frames.Refine(
      kDrive * Rigid3{ExpSO3({0.0, DegToRad(0.5), 0.0}), {0.05, 0.0, 0.1}});
  ASSERT_TRUE(refined.has_value());
  ExpectNear(*refined, kDrive);
}

// The motion with the most matches comes first, whether it is credible or not.
TEST(RigMotionsTest, AVehicleMayHaveMoreMatches) {
  const StepHypotheses motions = BehindALorry().Find();
  ASSERT_EQ(motions.size(), 2u);
  ExpectNear(motions[0].later_from_earlier, kFollow);
  ExpectNear(motions[1].later_from_earlier, kDrive);
}

// The standard deviation of the reach is 3 % for 150 points in the box.
TEST(RigMotionsTest, TheReachIsThatOfThePointsOfAMotion) {
  TwoFrames frames;
  frames.AddStatic(150);
  frames.AddVehicle(150);
  const StepHypotheses motions = frames.Find();
  ASSERT_EQ(motions.size(), 2u);
  const bool is_street_first =
      AngleBetween(motions[0].later_from_earlier.rotation, kDrive.rotation) <
      DegToRad(0.5);
  const MotionHypothesis& street = motions[is_street_first ? 0 : 1];
  const MotionHypothesis& vehicle = motions[is_street_first ? 1 : 0];
  ASSERT_TRUE(street.reach && vehicle.reach);
  const double of_street = ReachOfBox(kLowOfStreet, kHighOfStreet);
  const double of_vehicle = ReachOfBox(kLowOfVehicle, kHighOfVehicle);
  EXPECT_NEAR(*street.reach, of_street, 0.15 * of_street);
  EXPECT_NEAR(*vehicle.reach, of_vehicle, 0.15 * of_vehicle);
}

TEST(RigMotionsTest, ASingleMotionIsNotComparedWithOthers) {
  TwoFrames frames;
  frames.AddStatic(150);
  const StepHypotheses motions = frames.Find();
  ASSERT_EQ(motions.size(), 1u);
  EXPECT_FALSE(motions[0].reach.has_value());
}

TEST(RigMotionsTest, TheOrderOfImagesHasNoInfluence) {
  for (const bool is_later_known : {false, true}) {
    const Layout layout{!is_later_known, is_later_known};
    Layout reversed = layout;
    reversed.is_later_first = true;
    const StepHypotheses expected = Street(layout).Find();
    const StepHypotheses motions = Street(reversed).Find();
    ASSERT_EQ(motions.size(), expected.size());
    for (size_t k = 0; k < motions.size(); ++k) {
      const Rigid3& a = motions[k].later_from_earlier;
      const Rigid3& b = expected[k].later_from_earlier;
      EXPECT_LT(AngleBetween(a.rotation, b.rotation), 1e-9);
      EXPECT_LT((a.translation - b.translation).norm(), 1e-9);
      EXPECT_EQ(motions[k].share, expected[k].share);
      EXPECT_EQ(motions[k].own_share, expected[k].own_share);
      EXPECT_EQ(motions[k].reach, expected[k].reach);
    }
  }
}

TEST(RigMotionsTest, FewOrRandomMatchesSupportNone) {
  EXPECT_TRUE(TwoFrames().Find().empty());
  TwoFrames few;
  few.AddStatic(7);
  EXPECT_TRUE(few.Find().empty());
  TwoFrames random;
  random.AddMismatches(100);
  EXPECT_TRUE(random.Find().empty());
}

TEST(RigMotionsTest, NoneAreFoundWithoutDepths) {
  const TwoFrames frames = Street({false, false});
  EXPECT_TRUE(frames.Find().empty());
  EXPECT_FALSE(frames.Refine(kDrive));
}

// Two of three pairs show an image of the other camera.
TEST(RigMotionsTest, CamerasWithUnknownPosesAreLeftOut) {
  TwoFrames frames;
  frames.AddStatic(400);
  frames.AddVehicle(300);
  frames.ForgetSensor(1);
  const StepHypotheses motions = frames.Find();
  ASSERT_EQ(motions.size(), 2u);
  ExpectNear(motions[0].later_from_earlier, kDrive);
  ExpectNear(motions[1].later_from_earlier, kFollow);
  frames.ForgetSensor(0);
  EXPECT_TRUE(frames.Find().empty());
}

TEST(RigMotionsTest, RefinementReturnsToTheNearestMotion) {
  Random random(9);
  for (const bool is_later_first : {false, true}) {
    const TwoFrames frames = BehindALorry({true, false, is_later_first});
    for (const Rigid3& truth : {kDrive, kFollow}) {
      for (int trial = 0; trial < 10; ++trial) {
        const Vector3d axis = Noise(1.0, &random).normalized();
        const Vector3d error =
            0.05 * truth.Center().norm() * Noise(1.0, &random).normalized();
        const auto motion = frames.Refine(Rigid3::FromRotationAndCenter(
            ExpSO3(DegToRad(1.0) * axis) * truth.rotation,
            truth.Center() + error));
        ASSERT_TRUE(motion);
        ExpectNear(*motion, truth);
      }
    }
  }
}

TEST(RigMotionsTest, RefinementNeedsSupport) {
  EXPECT_FALSE(TwoFrames().Refine(kDrive));
  TwoFrames few;
  few.AddStatic(7);
  EXPECT_FALSE(few.Refine(kDrive));
  const Rigid3 turn{ExpSO3({0.0, DegToRad(30.0), 0.0}), Vector3d::Zero()};
  TwoFrames wrong;
  wrong.AddStatic(100);
  EXPECT_FALSE(wrong.Refine(turn));
}

// One match of two images with the relative pose kDrive.
class OneMatch {
 public:
  OneMatch(const Vector3d& point1, const Vector3d& point2) {
    bearings.images.resize(2);
    bearings.images[0].Append(point1.normalized());
    bearings.images[1].Append(point2.normalized());
    depths.keypoints = {{KeypointDepth{point1.norm()}},
                        {KeypointDepth{point2.norm()}}};
    pair.image_idx2 = 1;
  }
  MatchVerdict Compare(const Rigid3& cam2_from_cam1 = kDrive) const {
    return CompareWithMotion(bearings, depths, pair, {0, 0}, cam2_from_cam1,
                             kMaxError_px / kFocalLength_px);
  }
  // With the depth in one image only, or in none.
  MatchVerdict CompareWith(bool has_depth1, bool has_depth2) const {
    OneMatch match = *this;
    if (!has_depth1) match.depths.keypoints[0] = {std::nullopt};
    if (!has_depth2) match.depths.keypoints[1].clear();
    return match.Compare();
  }

  Bearings bearings;
  FrameDepths depths;
  ImagePair pair;
};

std::vector<Vector3d> PointsAround() {
  std::vector<Vector3d> points;
  for (const double x : {-4.0, -2.0, 2.0, 4.0}) {
    for (const double y : {-1.0, 0.5}) {
      for (const double z : {5.0, 8.0}) points.emplace_back(x, y, z);
    }
  }
  return points;
}

TEST(CompareWithMotionTest, StaticPointsAgree) {
  for (const Vector3d& point : PointsAround()) {
    const OneMatch match(point, kDrive * point);
    for (const bool has_depth1 : {false, true}) {
      for (const bool has_depth2 : {false, true}) {
        EXPECT_EQ(match.CompareWith(has_depth1, has_depth2),
                  has_depth1 || has_depth2 ? MatchVerdict::kAgrees
                                           : MatchVerdict::kIsOnEpipolarLine);
      }
    }
  }
}

TEST(CompareWithMotionTest, UncertainDepthsAgree) {
  for (const Vector3d& point : PointsAround()) {
    for (const double factor : {0.75, 1.4}) {
      OneMatch match(point, kDrive * point);
      for (auto& depths : match.depths.keypoints) depths[0]->distance *= factor;
      EXPECT_EQ(match.Compare(), MatchVerdict::kAgrees);
    }
  }
}

// The inverse of a distance may be wrong by more than two standard deviations.
TEST(CompareWithMotionTest, DepthsAgreeWithinTheirStandardDeviations) {
  for (const Vector3d& near : PointsAround()) {
    const Vector3d point = 3.0 * near;  // depths are uncertain far away
    OneMatch match(point, kDrive * point);
    KeypointDepth& depth = *match.depths.keypoints[0][0];
    depth.distance *= 1.6;
    match.depths.keypoints[1].clear();
    EXPECT_EQ(match.Compare(), MatchVerdict::kContradicts);
    depth.relative_sigma = 0.3;
    EXPECT_EQ(match.Compare(), MatchVerdict::kAgrees);
    depth.relative_sigma = 0.03;
    EXPECT_EQ(match.Compare(), MatchVerdict::kContradicts);
  }
}

// A point that moves along its first ray stays on its epipolar line.
TEST(CompareWithMotionTest, PointsThatMoveAlongEpipolarLinesContradict) {
  for (const Vector3d& point : PointsAround()) {
    for (const double factor : {0.5, 3.0}) {
      const OneMatch match(point, kDrive * (factor * point));
      EXPECT_EQ(match.CompareWith(true, false), MatchVerdict::kContradicts);
      // The other depth is that of the intersection.
      EXPECT_EQ(match.CompareWith(false, true), MatchVerdict::kAgrees);
      EXPECT_EQ(match.CompareWith(false, false),
                MatchVerdict::kIsOnEpipolarLine);
    }
  }
}

// The same for the second ray.
TEST(CompareWithMotionTest, DepthsOfTheSecondImageCount) {
  for (const Vector3d& point : PointsAround()) {
    for (const double factor : {0.5, 3.0}) {
      const Vector3d point2 = kDrive * point;
      const OneMatch match(kDrive.Inverse() * (factor * point2), point2);
      EXPECT_EQ(match.CompareWith(false, true), MatchVerdict::kContradicts);
      EXPECT_EQ(match.CompareWith(true, true), MatchVerdict::kContradicts);
      EXPECT_EQ(match.CompareWith(true, false), MatchVerdict::kAgrees);
    }
  }
}

TEST(CompareWithMotionTest, PointsOffTheirEpipolarLinesContradict) {
  for (const Vector3d& point : PointsAround()) {
    const Vector3d aside(-0.05 * point.y(), 0.05 * point.x(), 0.0);
    const OneMatch match(point, kDrive * point + aside);
    EXPECT_EQ(match.CompareWith(false, false), MatchVerdict::kContradicts);
    EXPECT_EQ(match.CompareWith(true, true), MatchVerdict::kContradicts);
  }
}

TEST(CompareWithMotionTest, KeypointsWithoutRaysContradict) {
  const Vector3d point(2.0, 1.0, 6.0);
  for (const int image_idx : {0, 1}) {
    OneMatch match(point, kDrive * point);
    match.bearings.images[image_idx].is_valid[0] = false;
    EXPECT_EQ(match.Compare(), MatchVerdict::kContradicts);
  }
}

// While the rig stands still, nothing but moving objects changes its place.
TEST(CompareWithMotionTest, AStandstillExplainsNoMovedPoint) {
  const Rigid3 standstill;
  for (const Vector3d& point : PointsAround()) {
    EXPECT_EQ(OneMatch(point, point).Compare(standstill),
              MatchVerdict::kAgrees);
    const OneMatch moved(point, point + Vector3d(0.5, 0.0, 0.0));
    EXPECT_EQ(moved.Compare(standstill), MatchVerdict::kContradicts);
  }
}

}  // namespace
}  // namespace mgsfm
