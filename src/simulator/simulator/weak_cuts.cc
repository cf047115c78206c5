// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/weak_cuts.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <map>
#include <optional>

#include "base/ranges.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "simulator/random_streams.h"

namespace mgsfm {
namespace {

// Correct pairs that remain across every cut. They are safe against chance: the
// expected number of their inliers exceeds the minimum number of matches, and
// the number of matches on a vehicle, by this factor.
constexpr int kMinNumPairs = 2;
constexpr double kSafetyFactor = 1.5;
// Steps of the fraction of points that are recognized on both sides.
constexpr double kShareStep = 0.02;
// Fraction of the weak cuts that are at a turn.
constexpr double kShareAtTurns = 0.5;

// The change of appearance is complete after two frames: the fraction of points
// that frames recognize, relative to consecutive frames.
double ShareOfGap(int gap) { return gap == 1 ? 1.0 : (gap == 2 ? 0.5 : 0.0); }

// A number in [0, 1) for a point at a cut.
double LotOf(uint64_t seed, int cut, int identity) {
  const uint64_t of_cut =
      RandomOf(seed, Effect::kWeakCuts, 2 * static_cast<uint64_t>(cut) + 1)
          .NextBits();
  return Random(of_cut, static_cast<uint64_t>(identity)).Uniform();
}

// The features that the images of a pair have in common.
struct Common {
  int gap = 0;  // in frames
  std::vector<int> points;
  int num_on_vehicle = 0;  // of the vehicle with the most
  // Features on vehicles that satisfy the epipolar constraint of the world, as
  // all do on a straight road.
  int num_like_world = 0;
};

// The expected correct matches across a cut, and the pairs that are safe.
struct Support {
  int num_safe_pairs = 0;
  double num_matches = 0.0;

  bool IsEnough(double min_num_matches) const {
    return num_safe_pairs >= kMinNumPairs && num_matches >= min_num_matches;
  }
};

// Counts what connects both sides of the cut between two consecutive frames.
class CutInspector {
 public:
  explicit CutInspector(const Footage& footage)
      : footage_(footage), plans_of_cut_(footage.drive.num_frames()) {
    const std::vector<Exposure>& exposures = footage_.photographs.exposures;
    for (const PairPlan& plan :
         PlanNeighbors(footage_.options, footage_.drive, exposures)) {
      const auto [begin, end] = std::minmax(
          {exposures[plan.image1].frame, exposures[plan.image2].frame});
      // Pairs between the ends of a closed drive cross no cut.
      if (end - begin > footage_.options.num_matched_frames) continue;
      for (int cut = begin; cut < end; ++cut) {
        plans_of_cut_[cut].push_back(plan);
      }
    }
  }

  std::vector<Common> FindCommon(int cut) const {
    return Transformed(plans_of_cut_[cut],
                       [&](const PairPlan& plan) { return FindCommon(plan); });
  }

  Support SupportOf(const std::vector<Common>& pairs) const {
    const double correct_share =
        (1.0 - footage_.options.mismatch_ratio) *
        (1.0 - footage_.options.epipolar_outlier_ratio);
    Support support;
    for (const Common& common : pairs) {
      const auto num_points = static_cast<double>(common.points.size());
      const auto exceeds = [&](double factor) {
        return correct_share * num_points >=
                   factor * footage_.options.min_num_matches &&
               num_points + common.num_like_world >=
                   factor * common.num_on_vehicle;
      };
      if (!exceeds(1.0)) continue;
      support.num_matches += correct_share * num_points;
      if (exceeds(kSafetyFactor)) ++support.num_safe_pairs;
    }
    return support;
  }

 private:
  Common FindCommon(const PairPlan& plan) const {
    const std::vector<int>& ids1 =
        footage_.photographs.features[plan.image1].identities;
    const std::vector<int>& ids2 =
        footage_.photographs.features[plan.image2].identities;
    Common common;
    common.gap = std::abs(footage_.photographs.exposures[plan.image1].frame -
                          footage_.photographs.exposures[plan.image2].frame);
    std::set_intersection(ids1.begin(), ids1.end(), ids2.begin(), ids2.end(),
                          std::back_inserter(common.points));
    const auto first_moving =
        std::lower_bound(common.points.begin(), common.points.end(),
                         static_cast<int>(footage_.world.points.size()));
    const auto first_clutter =
        std::lower_bound(first_moving, common.points.end(), kClutter);
    std::map<int, int> num_on_vehicles;
    for (auto identity = first_moving; identity != first_clutter; ++identity) {
      int& number = num_on_vehicles[footage_.detector.VehicleOf(*identity)];
      common.num_on_vehicle = std::max(common.num_on_vehicle, ++number);
    }
    common.num_like_world = NumLikeWorld(plan, {first_moving, first_clutter});
    common.points.erase(first_moving, common.points.end());
    return common;
  }

  int NumLikeWorld(const PairPlan& plan,
                   const std::vector<int>& identities) const {
    Rigid3 cam2_from_cam1 =
        footage_.photographs.exposures[plan.image2].cam_from_world *
        footage_.photographs.exposures[plan.image1].cam_from_world.Inverse();
    if (cam2_from_cam1.translation.norm() < 1e-9) return 0;
    cam2_from_cam1.translation.normalize();
    const double max_error_rad =
        footage_.options.max_verification_error_px / kReferenceFocal_px;
    const auto ray_of = [this](int image,
                               int identity) -> const Eigen::Vector3d& {
      const SimulatedFeatures& features = footage_.photographs.features[image];
      const auto place = std::lower_bound(features.identities.begin(),
                                          features.identities.end(), identity);
      return features.rays[place - features.identities.begin()];
    };
    return static_cast<int>(CountIf(identities, [&](int identity) {
      return std::abs(
                 SampsonAngle(cam2_from_cam1, ray_of(plan.image1, identity),
                              ray_of(plan.image2, identity))) < max_error_rad;
    }));
  }

  const Footage& footage_;
  std::vector<std::vector<PairPlan>> plans_of_cut_;
};

// Removes the points that are not recognized across a cut.
void RemoveChanged(uint64_t seed, int cut, double share,
                   std::vector<Common>* pairs) {
  for (Common& common : *pairs) {
    const double share_of_pair = share * ShareOfGap(common.gap);
    const auto is_changed = [&](int identity) {
      return LotOf(seed, cut, identity) >= share_of_pair;
    };
    EraseIf(&common.points, is_changed);
  }
}

// The smallest fraction of points on both sides that leaves as many matches as
// wanted, or all that there are; nullopt if even all points are too few.
std::optional<double> FindShare(const CutInspector& inspector,
                                const SimulationOptions& options, int cut,
                                double num_wanted) {
  std::vector<Common> pairs = inspector.FindCommon(cut);
  RemoveChanged(options.random_seed, cut, 1.0, &pairs);
  const Support all = inspector.SupportOf(pairs);
  if (!all.IsEnough(options.min_num_weak_cut_matches)) return std::nullopt;
  double share = 1.0;
  for (double smaller = 1.0 - kShareStep; smaller > 0.0;
       smaller -= kShareStep) {
    RemoveChanged(options.random_seed, cut, smaller, &pairs);
    if (!inspector.SupportOf(pairs).IsEnough(
            std::min(num_wanted, all.num_matches))) {
      break;
    }
    share = smaller;
  }
  return share;
}

double TurnAt(const Drive& drive, int cut) {
  return LogSO3(drive.PoseOfFrame(cut + 1).rotation *
                drive.PoseOfFrame(cut).rotation.conjugate())
      .norm();
}

// Detects the features of the images of a camera at two frames again.
void HideInCamera(const Detector& detector, int camera, int first_frame,
                  Photographs* photographs) {
  for (size_t i = 0; i < photographs->exposures.size(); ++i) {
    const Exposure& exposure = photographs->exposures[i];
    if (exposure.camera != camera || exposure.frame < first_frame ||
        exposure.frame > first_frame + 1) {
      continue;
    }
    photographs->features[i] = detector.Detect(exposure, false);
  }
}

}  // namespace

std::vector<int> PlanWeakCuts(const SimulationOptions& options,
                              const Drive& drive) {
  std::vector<int> cuts;
  if (options.weak_cut_spacing == 0) return cuts;
  const int reach = std::max(1, *options.num_matched_frames);
  const int end = drive.num_frames() - reach;
  Random random = RandomOf(options.random_seed, Effect::kWeakCuts);
  int earliest = reach;
  while (true) {
    const int pause =
        static_cast<int>(random.Uniform(0.5, 1.5) * options.weak_cut_spacing);
    const bool is_at_turn = random.Uniform() < kShareAtTurns;
    int cut = cuts.empty() ? reach + pause / 2 : cuts.back() + pause;
    cut = std::max(cut, earliest);
    if (cut >= end) break;
    if (is_at_turn) {
      const int last = std::min(end - 1, cut + options.weak_cut_spacing / 2);
      for (int other = cut; other <= last; ++other) {
        if (TurnAt(drive, other) > TurnAt(drive, cut)) cut = other;
      }
    }
    cuts.push_back(cut);
    // No pair crosses two cuts.
    earliest = cut + reach;
  }
  return cuts;
}

WeakCuts::WeakCuts(const Footage& footage)
    : seed_(footage.options.random_seed),
      max_gap_(footage.options.num_matched_frames) {
  if (footage.world.weak_cuts.empty()) return;
  const SimulationOptions& options = footage.options;
  const CutInspector inspector(footage);
  for (const int cut : footage.world.weak_cuts) {
    Random random =
        RandomOf(seed_, Effect::kWeakCuts, 2 * static_cast<uint64_t>(cut) + 2);
    const double num_matches = random.Uniform(options.min_num_weak_cut_matches,
                                              options.max_num_weak_cut_matches);
    const auto share = FindShare(inspector, options, cut, num_matches);
    if (share) cuts_.push_back({cut, *share});
  }
}

bool WeakCuts::AreSeenAlike(int frame1, int frame2, int identity) const {
  const auto [begin, end] = std::minmax({frame1, frame2});
  if (end - begin > max_gap_) return true;
  auto cut =
      std::lower_bound(cuts_.begin(), cuts_.end(), begin,
                       [](const Cut& c, int frame) { return c.frame < frame; });
  return cut == cuts_.end() || cut->frame >= end ||
         LotOf(seed_, cut->frame, identity) <
             cut->share * ShareOfGap(end - begin);
}

void HideConvoys(const Footage& footage) {
  const CutInspector inspector(footage);
  const int num_cameras = static_cast<int>(footage.rig.size());
  for (int cut = 0; cut + 1 < footage.drive.num_frames(); ++cut) {
    const auto convoy =
        footage.vehicles->ConvoyAt(footage.drive.TimeOfFrame(cut));
    if (!convoy) continue;
    for (int i = 0; i < num_cameras; ++i) {
      if (inspector.SupportOf(inspector.FindCommon(cut))
              .IsEnough(footage.options.min_num_weak_cut_matches)) {
        break;
      }
      HideInCamera(footage.detector, (*convoy + i) % num_cameras, cut,
                   &footage.photographs);
    }
  }
}

}  // namespace mgsfm
