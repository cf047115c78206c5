// SPDX-License-Identifier: BSD-3-Clause
#include "matching/pair_matching.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "base/fingerprint.h"
#include "base/parallel.h"
#include "base/ranges.h"
#include "database/database_shard.h"
#include "matching/descriptor_matching.h"
#include "matching/frame_pair_verification.h"
#include "matching/guided_matching.h"
#include "matching/scene_pairs.h"
#include "mgsfm/base/options_io.h"

namespace mgsfm {
namespace {

// Limits the loss of an interrupted run to seconds of work.
constexpr size_t kMaxBatchSize = 256;
// Other streams verify pairs and units (frame_pair_verification.cc).
constexpr uint64_t kLandmarkStream = 2;

}  // namespace

struct PairMatcher::Result {
  bool has_new_matches = false;
  std::vector<Match> matches;
  ImagePair verified;
};

PairMatcher::PairMatcher(const MatchDatabases& databases, const Scene& scene,
                         const PairMatchingOptions& options,
                         const Context& context)
    : databases_(databases),
      scene_(scene),
      options_(options),
      context_(context),
      cache_(databases.features, scene,
             static_cast<size_t>(options.cache_size_mib) << 20) {
  for (const auto& [pair, number] :
       CountRows(databases, scene, &FeatureDatabase::CountMatches)) {
    matched_.insert(pair);
  }
  for (const auto& row :
       CountRows(databases, scene, &FeatureDatabase::CountInlierMatches)) {
    num_inliers_.insert(row);
  }
}

size_t PairMatcher::NumInliers(const ImageIdxPair& pair) const {
  const auto found = num_inliers_.find(pair);
  const bool is_verified =
      found != num_inliers_.end() &&
      found->second >=
          static_cast<size_t>(options_.two_view_geometry.min_num_inliers);
  return is_verified ? found->second : 0;
}

PairMatchingSummary PairMatcher::Run(const ImagePairList& pairs,
                                     std::string_view stage,
                                     std::optional<ProgressSpan> span) {
  ImagePairList todo = pairs;
  EraseIf(&todo, [&](const ImageIdxPair& pair) {
    return num_inliers_.count(pair) > 0;
  });
  const size_t num_done = pairs.size() - todo.size();
  const ProgressSpan progress = span.value_or(ProgressSpan{0, pairs.size()});
  const auto report = [&](size_t num_new) {
    context_.ReportProgress(stage, progress.num_before + num_done + num_new,
                            progress.total);
  };
  report(0);
  for (size_t next = 0; next < todo.size();) {
    const size_t begin = next;
    const std::vector<ImageIdxPair> batch = NextBatch(todo, &next);
    std::vector<Result> results(batch.size());
    // The database is not thread-safe.
    for (size_t i = 0; i < batch.size(); ++i) {
      results[i].has_new_matches = matched_.count(batch[i]) == 0;
      if (results[i].has_new_matches) continue;
      results[i].matches = ReadMatchesOfPair(databases_, scene_, batch[i]);
    }
    ParallelFor(
        batch.size(), context_.num_threads,
        [&](size_t i) {
          const bool has_matches = !results[i].has_new_matches;
          results[i] =
              MatchPair(batch[i], std::move(results[i].matches), has_matches);
        },
        1, [&](size_t num_matched) { report(begin + num_matched); });
    Write(batch, results);
    report(next);
    context_.Debug(std::string(stage) + ": " +
                   std::to_string(progress.num_before + num_done + next) +
                   " of " + std::to_string(progress.total) +
                   " pairs in the database");
  }
  PairMatchingSummary summary{pairs.size(), num_done, 0};
  summary.num_verified = CountIf(
      pairs, [&](const ImageIdxPair& pair) { return NumInliers(pair) > 0; });
  return summary;
}

// Takes as many pairs as fit into the cache.
std::vector<ImageIdxPair> PairMatcher::NextBatch(const ImagePairList& pairs,
                                                 size_t* next) {
  std::vector<ImageIdxPair> batch;
  cache_.StartBatch();
  while (*next < pairs.size() && batch.size() < kMaxBatchSize) {
    const ImageIdxPair& pair = pairs[*next];
    if (!batch.empty() && (!cache_.HasRoomFor(pair.image_idx1) ||
                           !cache_.HasRoomFor(pair.image_idx2))) {
      break;
    }
    const bool needs_descriptors = matched_.count(pair) == 0;
    cache_.AddToBatch(pair.image_idx1, needs_descriptors);
    cache_.AddToBatch(pair.image_idx2, needs_descriptors);
    batch.push_back(pair);
    ++*next;
  }
  cache_.ComputeRays(context_);
  return batch;
}

PairMatcher::Result PairMatcher::MatchPair(const ImageIdxPair& pair,
                                           std::vector<Match> matches,
                                           bool has_matches) const {
  const Image& image1 = scene_.images[pair.image_idx1];
  const Image& image2 = scene_.images[pair.image_idx2];
  const auto& features1 = cache_.Get(pair.image_idx1);
  const auto& features2 = cache_.Get(pair.image_idx2);
  if (has_matches) {
    cache_.Check(pair, matches);
  } else {
    matches = MatchGuided(
        {features1.View(scene_.cameras[image1.camera_idx]),
         features1.Descriptors(), &features1.landmarks},
        {features2.View(scene_.cameras[image2.camera_idx]),
         features2.Descriptors(), &features2.landmarks},
        options_.matching, options_.two_view_geometry,
        Random(PairSeed(image1.name, image2.name, context_.random_seed),
               kLandmarkStream));
  }
  ImagePair verified = VerifyImages(scene_, pair, features1, features2, matches,
                                    options_.two_view_geometry, context_);
  return {!has_matches, std::move(matches), std::move(verified)};
}

void PairMatcher::Write(const std::vector<ImageIdxPair>& batch,
                        const std::vector<Result>& results) {
  DatabaseTransaction transaction(&databases_.output);
  for (size_t i = 0; i < batch.size(); ++i) {
    const Result& result = results[i];
    const auto [id1, id2] = IdsOf(scene_, batch[i]);
    if (result.has_new_matches) {
      databases_.output.WriteMatches(id1, id2, result.matches);
    }
    databases_.output.WriteTwoViewGeometry(
        MakePairRow(id1, id2, result.verified));
  }
  transaction.Commit();
  for (size_t i = 0; i < batch.size(); ++i) {
    matched_.insert(batch[i]);
    num_inliers_[batch[i]] = results[i].verified.matches.size();
  }
}

namespace {

// The default of ExhaustiveMatching.block_size.
constexpr size_t kImagesPerBlock = 50;

// A hash of everything except the database that the matches depend on.
std::string FingerprintOf(const Scene& scene, const ImagePairList& pairs,
                          PairMatchingOptions options, uint64_t random_seed) {
  Fingerprint fingerprint;
  for (const Image& image : scene.images) {
    fingerprint.Add(image.frame_idx).Add(image.sensor_idx);
  }
  for (const Sensor& sensor : scene.sensors) {
    fingerprint.Add(sensor.sensor_from_rig.has_value());
    if (!sensor.sensor_from_rig) continue;
    const Rigid3& pose = *sensor.sensor_from_rig;
    for (const double value : pose.rotation.coeffs()) fingerprint.Add(value);
    for (const double value : pose.translation) fingerprint.Add(value);
  }
  for (const ImageIdxPair& pair : pairs) {
    fingerprint.Add(pair.image_idx1).Add(pair.image_idx2);
  }
  options.cache_size_mib = PairMatchingOptions().cache_size_mib;
  return fingerprint.Add(OptionsToJsonOf(options)).Add(random_seed).ToString();
}

}  // namespace

ImagePairList PairsOfShare(const ImagePairList& pairs, const Scene& scene,
                           const Share& share) {
  const size_t num_images = std::max<size_t>(1, scene.images.size());
  const int frames_per_block = static_cast<int>(
      std::max<size_t>(1, kImagesPerBlock * scene.frames.size() / num_images));
  using FramePair = std::array<int, 4>;  // blocks and frames
  const auto frames_of = [&](const ImageIdxPair& pair) {
    const auto [first, second] =
        std::minmax(scene.images[pair.image_idx1].frame_idx,
                    scene.images[pair.image_idx2].frame_idx);
    return FramePair{first / frames_per_block, second / frames_per_block,
                     int{first}, int{second}};
  };
  auto order = Transformed(pairs, [&](const ImageIdxPair& pair) {
    return std::pair(frames_of(pair), pair);
  });
  std::sort(order.begin(), order.end());
  // A pair of frames belongs to the share of its first image pair.
  const auto first_of_group = [&](size_t i) {
    while (i > 0 && i < order.size() && order[i].first == order[i - 1].first) {
      ++i;
    }
    return i;
  };
  ImagePairList selected;
  const size_t end = first_of_group(share.End(order.size()));
  for (size_t i = first_of_group(share.Begin(order.size())); i < end; ++i) {
    selected.push_back(order[i].second);
  }
  return selected;
}

PairMatchingSummary MatchShare(const FeatureDatabase& features,
                               const Scene& scene, const ImagePairList& pairs,
                               const Share& share,
                               const PairMatchingOptions& options,
                               FeatureDatabase* shard, const Context& context) {
  ShardManifest manifest{
      ShardKind::kMatches, share,
      FingerprintOfStructure(features, context) +
          FingerprintOf(scene, pairs, options, context.random_seed),
      false};
  const bool is_complete = BeginShard(manifest, shard);
  const MatchDatabases databases{features, *shard};
  const ImagePairList selected = PairsOfShare(pairs, scene, share);
  PairMatcher matcher(databases, scene, options, context);
  const PairMatchingSummary summary =
      matcher.Run(selected, "matching of share " + share.ToString());
  if (!is_complete && options.rig_verification.rig_verification) {
    VerifyUnitsOfPairs(selected, scene, options, databases, context);
  }
  features.CheckUnchanged();
  manifest.is_complete = true;
  if (!is_complete) shard->WriteShard(manifest);
  return summary;
}

}  // namespace mgsfm
