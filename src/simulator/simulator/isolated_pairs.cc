// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>

#include "base/ranges.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "math/random_vector.h"
#include "mgsfm/base/mask.h"
#include "simulator/pair_making.h"
#include "simulator/random_streams.h"

namespace mgsfm {
namespace {

// Range of the number of matches, as stated in the help of the option.
constexpr int kMinNumMatches = 15, kMaxNumMatches = 60;
// Features match if their distance to the epipolar line is at most this many
// standard deviations of the noise.
constexpr double kMaxError_sigma = 1.5;
constexpr int kNumTrials = 50;  // motions tried for a pair
// Images are unrelated if their number of common points is below this fraction
// of the minimum number of matches.
constexpr double kUnrelatedShare = 0.34;

class IsolatedPairMaker {
 public:
  IsolatedPairMaker(const Footage& footage, const PairMaker& maker,
                    const std::vector<PairPlan>& plans)
      : footage_(footage),
        maker_(maker),
        plans_(plans),
        num_features_(Transformed(footage.photographs.features,
                                  &SimulatedFeatures::size)) {}

  std::optional<MadePair> Make(Random* random) {
    for (int i = 0; i < kNumTrials; ++i) {
      const auto plan = FindUnrelated(random);
      if (!plan) continue;
      const Rigid3 cam2_from_cam1 = RandomPose(*plan, random);
      const size_t num_before =
          footage_.photographs.features[plan->image2].size();
      std::vector<Match> matches = MakeMatches(*plan, cam2_from_cam1, random);
      auto made =
          maker_.Verify(plan->image1, plan->image2, PairKind::kIsolatedWrong,
                        cam2_from_cam1, matches);
      if (made) {
        made_.insert({plan->image1, plan->image2});
        return made;
      }
      RemoveNew(plan->image2, num_before);
    }
    return std::nullopt;
  }

 private:
  std::optional<PairPlan> FindUnrelated(Random* random) const {
    const auto num_images = static_cast<uint32_t>(num_features_.size());
    const int i = static_cast<int>(random->Index(num_images));
    const int j = static_cast<int>(random->Index(num_images));
    const PairPlan plan{std::min(i, j), std::max(i, j)};
    if (i == j || made_.count({plan.image1, plan.image2}) > 0 ||
        std::binary_search(plans_.begin(), plans_.end(), plan) ||
        NumCommonPoints(footage_.photographs.features[i],
                        footage_.photographs.features[j], kClutter) >
            kUnrelatedShare * footage_.options.min_num_matches) {
      return std::nullopt;
    }
    return plan;
  }

  // A motion of a few meters, mostly forward or backward, with a slight turn.
  Rigid3 RandomPose(const PairPlan& plan, Random* random) const {
    const Eigen::Vector3d turn =
        DegToRad(1.0) *
        NormalVector(random).cwiseProduct(Eigen::Vector3d(2.0, 6.0, 2.0));
    const double sign = random->Uniform() < 0.5 ? -1.0 : 1.0;
    const double length_m = random->Uniform(1.5, 10.0);
    const Eigen::Vector3d direction =
        Eigen::Vector3d(0.0, 0.0, sign) +
        NormalVector(random).cwiseProduct(Eigen::Vector3d(0.15, 0.05, 0.0));
    const Rigid3 rig2_from_rig1 =
        Rigid3::FromRotationAndCenter(ExpSO3(turn), length_m * direction);
    const auto& sensor_from_rig = [this](int image) -> const Rigid3& {
      return footage_.rig[footage_.photographs.exposures[image].camera]
          .sensor_from_rig;
    };
    return sensor_from_rig(plan.image2) * rig2_from_rig1 *
           sensor_from_rig(plan.image1).Inverse();
  }

  std::vector<Match> MakeMatches(const PairPlan& plan,
                                 const Rigid3& cam2_from_cam1, Random* random) {
    const size_t num_wanted =
        std::max(*footage_.options.min_num_matches,
                 kMinNumMatches + static_cast<int>(random->Index(
                                      kMaxNumMatches - kMinNumMatches + 1)));
    const Rigid3 pose{cam2_from_cam1.rotation,
                      cam2_from_cam1.translation.normalized()};
    const auto num_features1 =
        static_cast<uint32_t>(num_features_[plan.image1]);
    Mask is_taken1(num_features1, false);
    Mask is_taken2(num_features_[plan.image2], false);
    std::vector<Match> matches;
    for (size_t i = 0; i < 5 * num_wanted && num_features1 > 0; ++i) {
      if (matches.size() == num_wanted) break;
      const uint32_t feature1 = random->Index(num_features1);
      const double depth_m = 4.0 * std::exp(random->Uniform(0.0, 2.7));
      const bool is_new = random->Uniform() < 0.5;
      if (is_taken1[feature1] != 0) continue;
      const Eigen::Vector3d ray1 =
          footage_.photographs.features[plan.image1].rays[feature1];
      int feature2 =
          is_new ? -1 : FindFitting(plan, pose, ray1, is_taken2, random);
      if (feature2 >= 0) {
        is_taken2[feature2] = 1;
      } else {
        feature2 = AddFitting(plan, cam2_from_cam1 * (depth_m * ray1), random);
      }
      if (feature2 < 0) continue;
      is_taken1[feature1] = 1;
      matches.push_back({feature1, static_cast<uint32_t>(feature2)});
    }
    return matches;
  }

  // A feature of image 2 that fits up to noise; -1 if there is none.
  int FindFitting(const PairPlan& plan, const Rigid3& pose,
                  const Eigen::Vector3d& ray1, const Mask& is_taken,
                  Random* random) const {
    const double max_error_rad = maker_.ErrorInRadians(
        plan.image1, plan.image2,
        kMaxError_sigma * footage_.options.pixel_noise_px);
    const SimulatedFeatures& features2 =
        footage_.photographs.features[plan.image2];
    std::vector<int> fitting;
    for (size_t i = 0; i < is_taken.size(); ++i) {
      const Eigen::Vector3d& ray2 = features2.rays[i];
      if (is_taken[i] == 0 &&
          std::abs(SampsonAngle(pose, ray1, ray2)) < max_error_rad &&
          IsInFront(pose, ray1, ray2, 0.0)) {
        fitting.push_back(static_cast<int>(i));
      }
    }
    if (fitting.empty()) return -1;
    return fitting[random->Index(static_cast<uint32_t>(fitting.size()))];
  }

  // Returns -1 if the point is outside the image.
  int AddFitting(const PairPlan& plan, const Eigen::Vector3d& point_in_cam2,
                 Random* random) {
    const int camera_number =
        footage_.photographs.exposures[plan.image2].camera;
    const SimulatedCamera& camera = footage_.rig[camera_number];
    const auto pixel = ProjectToPixel(camera, point_in_cam2);
    const double noise_x = footage_.options.pixel_noise_px * random->Normal();
    const double noise_y = footage_.options.pixel_noise_px * random->Normal();
    if (!pixel || pixel->x() < 0 || pixel->y() < 0 ||
        pixel->x() >= camera.width_px || pixel->y() >= camera.height_px) {
      return -1;
    }
    SimulatedFeatures& features2 = footage_.photographs.features[plan.image2];
    const bool is_seen = footage_.detector.Append(
        camera_number, kClutter, *pixel + Eigen::Vector2d(noise_x, noise_y),
        &features2);
    return is_seen ? static_cast<int>(features2.size()) - 1 : -1;
  }

  void RemoveNew(int image, size_t num_before) {
    SimulatedFeatures& features = footage_.photographs.features[image];
    features.identities.resize(num_before);
    features.keypoints_px.resize(num_before);
    features.rays.resize(num_before);
  }

  const Footage& footage_;
  const PairMaker& maker_;
  const std::vector<PairPlan>& plans_;
  std::vector<size_t> num_features_;  // per image, without those added here
  std::set<std::pair<int, int>> made_;
};

}  // namespace

std::vector<MadePair> MakeIsolatedPairs(const Footage& footage,
                                        const PairMaker& maker,
                                        const std::vector<PairPlan>& plans,
                                        int num_pairs, const Context& context) {
  IsolatedPairMaker isolated(footage, maker, plans);
  std::vector<MadePair> pairs;
  for (int i = 0; i < num_pairs; ++i) {
    Random random =
        RandomOf(footage.options.random_seed, Effect::kIsolatedPairs, i);
    auto pair = isolated.Make(&random);
    if (pair) pairs.push_back(std::move(*pair));
    if (i % 64 == 0) {
      context.ReportProgress("simulation: wrong pairs", i, num_pairs);
    }
  }
  return pairs;
}

}  // namespace mgsfm
