// SPDX-License-Identifier: BSD-3-Clause
#include "matching/guided_matching.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include "frontend/matching/simulated_pair.h"
#include "frontend/matching/test_descriptors.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"

namespace mgsfm {

inline bool operator==(const Match& a, const Match& b) {
  return a.keypoint_idx1 == b.keypoint_idx1 &&
         a.keypoint_idx2 == b.keypoint_idx2;
}

namespace {

using testing::IsSupersetOf;

const Rigid3 kSideways{ExpSO3({0.03, -0.08, 0.02}), {1.0, 0.2, -0.4}};
// The epipole lies in the image.
const Rigid3 kForward{ExpSO3({0.01, 0.02, -0.01}), {0.05, -0.02, -1.0}};

Camera Pinhole(bool has_prior = true) {
  return MakeCamera(CameraModelId::kPinhole, 800, 600, {600, 605, 405, 298},
                    has_prior);
}

// The field of view is 200 degrees.
Camera Fisheye() {
  return MakeCamera(CameraModelId::kOpenCVFisheye, 700, 700,
                    {200, 200, 350, 350, 0.01, -0.002, 0.0, 0.0});
}

// Two images with descriptors. Keypoint i of both images shows the same point
// if i < num_true. Every tenth keypoint is a landmark.
struct DescribedPair {
  SimulatedPair pair;
  TestDescriptors descriptors1, descriptors2;
  std::vector<uint32_t> landmarks;

  DescribedPair(const Camera& camera, const Rigid3& cam2_from_cam1,
                const std::function<Eigen::Vector3d(Random*)>& draw_point) {
    Random random(1);
    pair = SimulatePair(camera, cam2_from_cam1, {700, 300, 0.5}, &random,
                        draw_point);
    Describe(&random);
  }
  explicit DescribedPair(SimulatedPair simulated) : pair(std::move(simulated)) {
    Random random(1);
    Describe(&random);
  }

  void Describe(Random* random) {
    descriptors1 = RandomDescriptors(1000, random);
    for (uint32_t i = 0; i < 1000; ++i) {
      if (i < pair.num_true) {
        descriptors2.AddNoisyCopy(descriptors1.View().Row(i), 8.0, random);
      } else {
        descriptors2.AddRandom(random);
      }
      if (i % 10 == 0) landmarks.push_back(i);
    }
  }

  std::vector<Match> MatchBand(const DescriptorMatchingOptions& options = {}) {
    return MatchGuided({pair.view1.View(), descriptors1.View(), &landmarks},
                       {pair.view2.View(), descriptors2.View(), &landmarks},
                       options, TwoViewGeometryOptions(), Random(2));
  }
  std::vector<Match> MatchAll() {
    DescriptorMatchingOptions options;
    options.guided_matching = false;
    return MatchBand(options);
  }
  // Gives keypoint i of image 2 the descriptor of keypoint j.
  void Repeat(size_t i, size_t j) {
    constexpr size_t kDim = DescriptorView::kDim;
    std::copy_n(descriptors2.values.begin() + j * kDim, kDim,
                descriptors2.values.begin() + i * kDim);
  }
};

struct Motion {
  const char* name;
  Camera camera;
  Rigid3 cam2_from_cam1;
  std::function<Eigen::Vector3d(Random*)> draw_point;
};

std::vector<Motion> Motions() {
  return {{"sideways", Pinhole(), kSideways, DrawInBox},
          {"forward", Pinhole(), kForward, DrawInBox},
          {"uncalibrated", Pinhole(false), kSideways, DrawInBox},
          {"uncalibrated forward", Pinhole(false), kForward, DrawInBox},
          {"fisheye", Fisheye(), kSideways, DrawAround},
          {"fisheye forward", Fisheye(), kForward, DrawAround},
          {"oblique",
           Pinhole(),
           {kSideways.rotation, Eigen::Vector3d(0.3, 1.0, -0.6)},
           DrawInBox}};
}

std::vector<Match> TrueMatches(const DescribedPair& pair,
                               const std::vector<Match>& matches) {
  std::vector<Match> right;
  for (const Match& match : matches) {
    if (match.keypoint_idx1 == match.keypoint_idx2 &&
        match.keypoint_idx1 < pair.pair.num_true) {
      right.push_back(match);
    }
  }
  return right;
}

// Within the band, matches have no new rivals.
TEST(GuidedMatching, KeepsAllMatchesThatAgreeWithTheMotion) {
  for (const Motion& motion : Motions()) {
    DescribedPair pair(motion.camera, motion.cam2_from_cam1, motion.draw_point);
    const auto expected = TrueMatches(pair, pair.MatchAll());
    EXPECT_GT(expected.size(), 650u) << motion.name;
    EXPECT_THAT(pair.MatchBand(), IsSupersetOf(expected)) << motion.name;
  }
}

// The fundamental matrix stretches azimuths if guesses of the focal lengths are
// wrong by different factors.
TEST(GuidedMatching, KeepsMatchesOfDifferentUnknownLenses) {
  Random random(3);
  const Camera wide =
      MakeCamera(CameraModelId::kPinhole, 800, 600, {350, 350, 400, 300});
  const Camera narrow =
      MakeCamera(CameraModelId::kPinhole, 800, 600, {1100, 1100, 400, 300});
  const auto draw_far = [](Random* r) -> Eigen::Vector3d {
    return {r->Uniform(-3.0, 5.0), r->Uniform(-2.5, 2.5),
            r->Uniform(9.0, 20.0)};
  };
  const std::pair<Camera, Camera> lenses[] = {{wide, narrow}, {narrow, wide}};
  for (const auto& [first, second] : lenses) {
    SimulatedPair simulated;
    simulated.view1.camera = simulated.view2.camera =
        MakeCamera(CameraModelId::kPinhole, 800, 600, {960, 960, 400, 300},
                   /*has_prior=*/false);
    while (simulated.view1.keypoints.size() < 700) {
      const Eigen::Vector3d point = draw_far(&random);
      const auto pixel1 =
          ProjectToPixel(first.model, first.params.data(), point);
      const auto pixel2 =
          ProjectToPixel(second.model, second.params.data(), kSideways * point);
      if (!pixel1 || !pixel2 || !IsInImage(first, *pixel1) ||
          !IsInImage(second, *pixel2)) {
        continue;
      }
      const auto noisy = [&](const Eigen::Vector2d& pixel) {
        return Eigen::Vector2f(
            (pixel + Eigen::Vector2d(random.Normal(), random.Normal()))
                .cast<float>());
      };
      simulated.view1.keypoints.push_back(noisy(*pixel1));
      simulated.view2.keypoints.push_back(noisy(*pixel2));
    }
    simulated.num_true = 700;
    for (SimulatedView* view : {&simulated.view1, &simulated.view2}) {
      for (int i = 0; i < 300; ++i) {
        view->keypoints.emplace_back(
            static_cast<float>(random.Uniform(0.0, 800.0)),
            static_cast<float>(random.Uniform(0.0, 600.0)));
      }
      view->rays = RaysOf(view->camera, view->keypoints);
    }
    DescribedPair pair(simulated);
    const auto expected = TrueMatches(pair, pair.MatchAll());
    EXPECT_GT(expected.size(), 650u);
    EXPECT_THAT(pair.MatchBand(), IsSupersetOf(expected));
  }
}

// A copy far from the epipolar line makes a descriptor ambiguous in the whole
// image only.
TEST(GuidedMatching, IgnoresRivalsFarFromTheEpipolarLine) {
  for (const Motion& motion : Motions()) {
    DescribedPair pair(motion.camera, motion.cam2_from_cam1, motion.draw_point);
    size_t num_repeated = 0, num_found = 0, num_found_by_all = 0;
    for (size_t i = 0; i < 300; ++i) {
      if (i % 10 == 0) continue;  // a landmark
      pair.Repeat(pair.pair.num_true + i, i);
      ++num_repeated;
    }
    const auto count = [&](const std::vector<Match>& matches) {
      return std::count_if(matches.begin(), matches.end(), [](const Match& m) {
        return m.keypoint_idx1 < 300 && m.keypoint_idx1 % 10 != 0 &&
               m.keypoint_idx1 == m.keypoint_idx2;
      });
    };
    num_found = static_cast<size_t>(count(pair.MatchBand()));
    num_found_by_all = static_cast<size_t>(count(pair.MatchAll()));
    EXPECT_EQ(num_found_by_all, 0u) << motion.name;
    EXPECT_GT(num_found, num_repeated / 2) << motion.name;
  }
}

// A copy of a landmark makes a descriptor ambiguous everywhere.
TEST(GuidedMatching, LandmarksAreRivalsOfAllMatches) {
  DescribedPair pair(Pinhole(), kSideways, DrawInBox);
  const size_t landmark = pair.pair.num_true;
  ASSERT_EQ(landmark % 10, 0u);
  pair.Repeat(landmark, 1);
  for (const Match& match : pair.MatchBand()) {
    EXPECT_NE(match.keypoint_idx1, 1u);
  }
}

TEST(GuidedMatching, ComparesAllDescriptorsWithoutACommonMotion) {
  const DescribedPair sideways(Pinhole(), kSideways, DrawInBox);
  // A third of the matches has each motion.
  DescribedPair three_motions = sideways;
  const DescribedPair others[] = {
      {Pinhole(), {ExpSO3({-0.1, 0.1, 0.3}), {-0.5, 1.0, 0.3}}, DrawInBox},
      {Pinhole(), {ExpSO3({0.2, 0.0, -0.2}), {0.2, -1.0, 0.5}}, DrawInBox}};
  for (size_t i = 0; i < 1000; ++i) {
    const size_t motion = i / 10 % 3;
    if (motion == 2) continue;
    SimulatedPair& pair = three_motions.pair;
    const SimulatedPair& other = others[motion].pair;
    pair.view1.keypoints[i] = other.view1.keypoints[i];
    pair.view2.keypoints[i] = other.view2.keypoints[i];
    pair.view1.rays[i] = other.view1.rays[i];
    pair.view2.rays[i] = other.view2.rays[i];
  }
  DescribedPair no_landmarks = sideways;
  no_landmarks.landmarks.clear();
  // Landmarks on a plane, or without parallax, leave the motion open.
  const DescribedPair plane(Pinhole(), kSideways, DrawOnPlane);
  const DescribedPair uncalibrated_plane(Pinhole(false), kSideways,
                                         DrawOnPlane);
  const DescribedPair rotation(
      Pinhole(), {kSideways.rotation, Eigen::Vector3d::Zero()}, DrawInBox);
  for (DescribedPair pair :
       {three_motions, no_landmarks, plane, uncalibrated_plane, rotation}) {
    EXPECT_EQ(pair.MatchBand(), pair.MatchAll());
  }
}

TEST(GuidedMatching, UsesTheFirstDescriptorsOnly) {
  DescribedPair pair(Pinhole(), kSideways, DrawInBox);
  DescriptorMatchingOptions options;
  options.max_num_matches = 500;
  const auto matches = pair.MatchBand(options);
  EXPECT_GT(matches.size(), 400u);
  for (const Match& match : matches) {
    EXPECT_LT(match.keypoint_idx1, 500u);
    EXPECT_LT(match.keypoint_idx2, 500u);
  }
}

TEST(GuidedMatching, LandmarksAreTheLargestKeypointsOfEachCell) {
  const Camera camera = Pinhole();
  std::vector<FeatureKeypoint> keypoints;
  for (int i = 0; i < 400; ++i) {
    // Large keypoints in the left half, small ones in the right half.
    const float x = static_cast<float>(i % 20) * 40.0f + 20.0f;
    const float y = static_cast<float>(i / 20) * 30.0f + 15.0f;
    const float scale = (x < 400.0f ? 50.0f : 1.0f) + static_cast<float>(i % 7);
    keypoints.push_back(FeatureKeypoint::FromScale(x, y, scale, 0.0f));
  }
  const auto landmarks = SelectLandmarks(camera, keypoints);
  const auto num_left =
      std::count_if(landmarks.begin(), landmarks.end(),
                    [&](uint32_t i) { return keypoints[i].x_px < 400.0f; });
  EXPECT_GT(num_left, static_cast<int>(landmarks.size()) / 3);
  EXPECT_LT(num_left, 2 * static_cast<int>(landmarks.size()) / 3);
  // A tenth of the keypoints of each of 36 cells, rounded up.
  EXPECT_GE(landmarks.size(), keypoints.size() / 10);
  EXPECT_LE(landmarks.size(), keypoints.size() / 10 + 36);
  for (const uint32_t i : landmarks) {
    EXPECT_GE(i % 7, 4u);  // smaller ones of the cell are none
  }
}

}  // namespace
}  // namespace mgsfm
