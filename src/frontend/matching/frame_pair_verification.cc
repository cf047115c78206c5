// SPDX-License-Identifier: BSD-3-Clause
#include "matching/frame_pair_verification.h"

#include <Eigen/LU>
#include <algorithm>
#include <map>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "geometry/epipolar.h"
#include "geometry/generalized_pose.h"
#include "matching/scene_pairs.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// Fraction of the inliers of a PANORAMIC pair that must agree with the rig
// motion to keep the pair. Most matches of a correct pair agree, few of a wrong
// one.
constexpr double kMinRotationInlierRatio = 0.5;
// RANSAC also tries the relative pose of each pair, so few samples suffice.
constexpr int kMaxNumTrials = 1000;

bool IsEligible(const UnitImagePair& pair) {
  return pair.view1.camera->has_prior_focal_length &&
         pair.view2.camera->has_prior_focal_length &&
         pair.single.config != TwoViewConfig::kWatermark;
}

// The matches of an eligible pair whose keypoints have rays; otherwise none.
struct PairRays {
  UnitMatches matches;
  std::vector<size_t> match_idxs;  // of each of these in UnitImagePair::matches
};

PairRays CollectRays(const UnitImagePair& pair, double max_error_px) {
  PairRays result{{pair.cam1_from_unit1, pair.cam2_from_unit2, {}, 0.0}, {}};
  result.matches.max_error_rad =
      max_error_px * RadiansPerPixel(*pair.view1.camera, *pair.view2.camera);
  if (!IsEligible(pair)) return result;
  for (size_t i = 0; i < pair.matches->size(); ++i) {
    const auto [idx1, idx2] = (*pair.matches)[i];
    const auto& ray1 = (*pair.view1.rays)[idx1];
    const auto& ray2 = (*pair.view2.rays)[idx2];
    if (!ray1 || !ray2) continue;
    result.matches.rays.Add(*ray1, *ray2);
    result.match_idxs.push_back(i);
  }
  return result;
}

std::optional<Rigid3> EstimateMotion(const std::vector<UnitImagePair>& pairs,
                                     const std::vector<PairRays>& rays,
                                     const TwoViewGeometryOptions& options,
                                     Random* random) {
  std::vector<PairPose> guesses;
  for (size_t p = 0; p < pairs.size(); ++p) {
    const auto& pose = pairs[p].single.relative_pose;
    if (!IsEligible(pairs[p]) || !pose || !pose->translation_direction) {
      continue;
    }
    guesses.push_back(
        {p, {pose->cam2_from_cam1, *pose->translation_direction}});
  }
  RansacOptions ransac;
  ransac.confidence = options.confidence;
  ransac.max_num_trials = std::min(*options.max_num_trials, kMaxNumTrials);
  return EstimateUnitPose(Transformed(rays, &PairRays::matches), guesses,
                          ransac, random);
}

// Indices into UnitImagePair::matches.
std::vector<size_t> FindMatchInliers(const PairRays& rays,
                                     const Rigid3& motion) {
  const Mask is_inlier = FindUnitInliers(rays.matches, motion);
  std::vector<size_t> inliers;
  for (size_t i = 0; i < is_inlier.size(); ++i) {
    if (is_inlier[i]) inliers.push_back(rays.match_idxs[i]);
  }
  return inliers;
}

bool Supports(const UnitImagePair& pair, size_t num_inliers,
              const TwoViewGeometryOptions& two_view,
              const RigVerificationOptions& rig) {
  return num_inliers >= static_cast<size_t>(rig.min_num_unit_inliers) &&
         static_cast<double>(num_inliers) >=
             two_view.min_inlier_ratio * pair.matches->size();
}

bool IsAccepted(const std::vector<UnitImagePair>& pairs,
                const std::vector<std::vector<size_t>>& inliers,
                const TwoViewGeometryOptions& two_view,
                const RigVerificationOptions& rig) {
  size_t num_pairs = 0, num_inliers = 0;
  for (size_t p = 0; p < pairs.size(); ++p) {
    if (!Supports(pairs[p], inliers[p].size(), two_view, rig)) continue;
    ++num_pairs;
    num_inliers += inliers[p].size();
  }
  return num_pairs >= 2 &&
         num_inliers >= static_cast<size_t>(two_view.min_num_inliers);
}

// The new geometry of a pair under an accepted motion; nullopt: unchanged.
std::optional<ImagePair> ApplyMotion(const UnitImagePair& pair,
                                     const Rigid3& motion,
                                     const std::vector<size_t>& inliers,
                                     bool supports) {
  const ImagePair& single = pair.single;
  if (single.config == TwoViewConfig::kPanoramic &&
      inliers.size() >= kMinRotationInlierRatio * single.matches.size()) {
    return std::nullopt;
  }
  ImagePair result;
  result.config = TwoViewConfig::kDegenerate;
  if (!supports) {
    if (single.matches.empty()) return std::nullopt;
    return result;
  }
  Rigid3 pose = pair.cam2_from_unit2 * motion * pair.cam1_from_unit1.Inverse();
  const double length = pose.translation.norm();
  if (!(length > 0.0)) return std::nullopt;
  pose.translation /= length;
  result.config = TwoViewConfig::kCalibrated;
  result.relative_pose = RelativePose{pose.rotation, pose.translation};
  result.E = EssentialFromPose(pose);
  for (const size_t i : inliers) result.matches.push_back((*pair.matches)[i]);
  return result;
}

}  // namespace

std::vector<std::optional<ImagePair>> VerifyUnits(
    const std::vector<UnitImagePair>& pairs,
    const std::optional<Rigid3>& unit2_from_unit1,
    const TwoViewGeometryOptions& two_view, const RigVerificationOptions& rig,
    Random random) {
  std::vector<std::optional<ImagePair>> results(pairs.size());
  const auto rays = Transformed(pairs, [&](const UnitImagePair& pair) {
    return CollectRays(pair, two_view.max_error);
  });
  const std::optional<Rigid3> motion =
      unit2_from_unit1 ? unit2_from_unit1
                       : EstimateMotion(pairs, rays, two_view, &random);
  if (!motion) return results;
  const auto inliers = Transformed(rays, [&](const PairRays& of_pair) {
    return FindMatchInliers(of_pair, *motion);
  });
  if (!IsAccepted(pairs, inliers, two_view, rig)) return results;
  for (size_t p = 0; p < pairs.size(); ++p) {
    if (!IsEligible(pairs[p])) continue;
    results[p] =
        ApplyMotion(pairs[p], *motion, inliers[p],
                    Supports(pairs[p], inliers[p].size(), two_view, rig));
  }
  return results;
}

namespace {

// Maximum number of frame pairs in memory. The feature cache bounds the memory;
// this bounds the time between two checks for interruption.
constexpr size_t kMaxNumFramePairs = 64;
// VerifyImages uses the default stream of the same seed.
constexpr uint64_t kRandomStream = 1;

struct FramePair {
  bool is_one_frame = false;
  ImagePairList pairs;
};

bool HasKnownPose(const Scene& scene, int image_idx) {
  return scene.sensors[scene.images[image_idx].sensor_idx]
      .sensor_from_rig.has_value();
}

std::vector<FramePair> GroupByFrames(const ImagePairList& pairs,
                                     const Scene& scene) {
  std::map<std::pair<int, int>, ImagePairList> pairs_of_frames;
  for (const ImageIdxPair& pair : pairs) {
    if (!HasKnownPose(scene, pair.image_idx1) ||
        !HasKnownPose(scene, pair.image_idx2)) {
      continue;
    }
    const int frame1 = scene.images[pair.image_idx1].frame_idx;
    const int frame2 = scene.images[pair.image_idx2].frame_idx;
    pairs_of_frames[std::minmax(frame1, frame2)].push_back(pair);
  }
  std::vector<FramePair> groups;
  for (auto& [frames, list] : pairs_of_frames) {
    if (list.size() < 2) continue;
    groups.push_back({frames.first == frames.second, std::move(list)});
  }
  return groups;
}

// The two-view geometry with images 1 and 2 exchanged.
ImagePair Swapped(ImagePair pair) {
  if (pair.F) pair.F->transposeInPlace();
  if (pair.E) pair.E->transposeInPlace();
  if (pair.H) pair.H = pair.H->inverse().normalized();
  if (pair.relative_pose) {
    RelativePose& pose = *pair.relative_pose;
    pose.cam2_from_cam1 = pose.cam2_from_cam1.conjugate();
    if (pose.translation_direction) {
      pose.translation_direction =
          -(pose.cam2_from_cam1 * *pose.translation_direction);
    }
  }
  SwapImages(&pair.matches);
  return pair;
}

class UnitPass {
 public:
  UnitPass(const Scene& scene, const PairMatchingOptions& options,
           const MatchDatabases& databases, const Context& context)
      : scene_(scene),
        options_(options),
        databases_(databases),
        context_(context),
        cache_(databases.features, scene,
               static_cast<size_t>(options.cache_size_mib) << 20) {}

  FramePairSummary Run(const std::vector<FramePair>& groups) {
    summary_.num_frame_pairs = groups.size();
    for (size_t next = 0; next < groups.size();) {
      const size_t begin = next;
      ReadBatch(groups, &next);
      std::vector<std::vector<Result>> results(next - begin);
      ParallelFor(
          results.size(), context_.num_threads,
          [&](size_t i) { results[i] = Verify(groups[begin + i], inputs_[i]); },
          1,
          [&](size_t num_done) {
            context_.ReportProgress("rig verification", begin + num_done,
                                    groups.size());
          });
      Keep(std::move(results));
    }
    Write();
    return summary_;
  }

 private:
  struct Result {
    ImageIdxPair pair;
    bool was_verified = false;
    std::optional<ImagePair> changed;
  };
  using MatchLists = std::vector<std::vector<Match>>;  // per image pair

  // Takes as many frame pairs as fit into the cache.
  void ReadBatch(const std::vector<FramePair>& groups, size_t* next) {
    inputs_.clear();
    cache_.StartBatch();
    while (*next < groups.size() && inputs_.size() < kMaxNumFramePairs) {
      const ImagePairList& pairs = groups[*next].pairs;
      if (!inputs_.empty() && !cache_.HasRoomFor(pairs.front().image_idx1)) {
        break;
      }
      MatchLists lists;
      for (const ImageIdxPair& pair : pairs) {
        cache_.AddToBatch(pair.image_idx1, false);
        cache_.AddToBatch(pair.image_idx2, false);
        lists.push_back(ReadMatchesOfPair(databases_, scene_, pair));
        cache_.Check(pair, lists.back());
      }
      inputs_.push_back(std::move(lists));
      ++*next;
    }
    cache_.ComputeRays(context_);
  }

  // Whether the first image of the pair belongs to the second frame.
  bool IsSwapped(const ImageIdxPair& pair) const {
    return scene_.images[pair.image_idx1].frame_idx >
           scene_.images[pair.image_idx2].frame_idx;
  }

  UnitImagePair MakeUnitPair(const ImageIdxPair& pair,
                             const std::vector<Match>& matches,
                             ImagePair single) const {
    const auto view = [&](int image_idx) {
      const Image& image = scene_.images[image_idx];
      return cache_.Get(image_idx).View(scene_.cameras[image.camera_idx]);
    };
    const auto pose = [&](int image_idx) {
      return *scene_.sensors[scene_.images[image_idx].sensor_idx]
                  .sensor_from_rig;
    };
    int idx1 = pair.image_idx1, idx2 = pair.image_idx2;
    if (IsSwapped(pair)) std::swap(idx1, idx2);
    return {view(idx1), view(idx2), pose(idx1),
            pose(idx2), &matches,   std::move(single)};
  }

  std::vector<Result> Verify(const FramePair& group,
                             const MatchLists& lists) const {
    std::vector<Result> results;
    std::vector<UnitImagePair> unit;
    MatchLists ordered = lists;
    for (size_t p = 0; p < group.pairs.size(); ++p) {
      const ImageIdxPair& pair = group.pairs[p];
      ImagePair single = VerifyImages(scene_, pair, cache_.Get(pair.image_idx1),
                                      cache_.Get(pair.image_idx2), lists[p],
                                      options_.two_view_geometry, context_);
      results.push_back({pair, !single.matches.empty(), std::nullopt});
      if (IsSwapped(pair)) {
        SwapImages(&ordered[p]);
        single = Swapped(std::move(single));
      }
      unit.push_back(MakeUnitPair(pair, ordered[p], std::move(single)));
    }
    const Image& first = scene_.images[group.pairs.front().image_idx1];
    const Image& second = scene_.images[group.pairs.front().image_idx2];
    std::vector<std::optional<ImagePair>> changed = VerifyUnits(
        unit,
        group.is_one_frame ? std::optional<Rigid3>(Rigid3()) : std::nullopt,
        options_.two_view_geometry, options_.rig_verification,
        Random(PairSeed(first.name, second.name, context_.random_seed),
               kRandomStream));
    for (size_t p = 0; p < results.size(); ++p) {
      if (changed[p] && IsSwapped(results[p].pair)) {
        changed[p] = Swapped(std::move(*changed[p]));
      }
      results[p].changed = std::move(changed[p]);
    }
    return results;
  }

  void Keep(std::vector<std::vector<Result>> results) {
    for (std::vector<Result>& group : results) {
      for (Result& result : group) {
        if (!result.changed) continue;
        const bool is_verified = !result.changed->matches.empty();
        summary_.num_changed += is_verified ? 1 : 0;
        summary_.num_gained += is_verified && !result.was_verified ? 1 : 0;
        summary_.num_rejected += result.was_verified && !is_verified ? 1 : 0;
        results_.push_back(std::move(result));
      }
    }
  }

  // One transaction: sequential matching learns from verified pairs, which must
  // not depend on where an earlier run was interrupted.
  void Write() {
    DatabaseTransaction transaction(&databases_.output);
    for (const Result& result : results_) {
      const auto [id1, id2] = IdsOf(scene_, result.pair);
      databases_.output.WriteTwoViewGeometry(
          MakePairRow(id1, id2, *result.changed));
    }
    transaction.Commit();
  }

  const Scene& scene_;
  const PairMatchingOptions& options_;
  const MatchDatabases databases_;
  const Context& context_;
  FeatureCache cache_;
  std::vector<MatchLists> inputs_;  // of the batch
  std::vector<Result> results_;     // changed pairs only
  FramePairSummary summary_;
};

}  // namespace

ImagePair VerifyImages(const Scene& scene, const ImageIdxPair& pair,
                       const ImageFeatures& features1,
                       const ImageFeatures& features2,
                       const std::vector<Match>& matches,
                       const TwoViewGeometryOptions& options,
                       const Context& context) {
  const Image& image1 = scene.images[pair.image_idx1];
  const Image& image2 = scene.images[pair.image_idx2];
  return VerifyPair(
      features1.View(scene.cameras[image1.camera_idx]),
      features2.View(scene.cameras[image2.camera_idx]), matches, options,
      Random(PairSeed(image1.name, image2.name, context.random_seed)));
}

FramePairSummary VerifyUnitsOfPairs(const ImagePairList& pairs,
                                    const Scene& scene,
                                    const PairMatchingOptions& options,
                                    const MatchDatabases& databases,
                                    const Context& context) {
  const std::vector<FramePair> groups = GroupByFrames(pairs, scene);
  if (groups.empty()) return {};
  return UnitPass(scene, options, databases, context).Run(groups);
}

}  // namespace mgsfm
