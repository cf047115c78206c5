// SPDX-License-Identifier: BSD-3-Clause
#include "matching/shard_matching.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "base/fingerprint.h"
#include "database/database_shard.h"
#include "matching/pair_matching.h"
#include "matching/scene_pairs.h"
#include "matching/unit_verification.h"
#include "mgsfm/base/options_io.h"

namespace mgsfm {
namespace {

// The default of ExhaustiveMatching.block_size.
constexpr size_t kImagesPerBlock = 50;

// Everything that the matches of the pairs depend on, beside the database.
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
  std::vector<std::pair<FramePair, ImageIdxPair>> order;
  order.reserve(pairs.size());
  for (const ImageIdxPair& pair : pairs) {
    order.emplace_back(frames_of(pair), pair);
  }
  std::sort(order.begin(), order.end());
  // A pair of frames belongs to the share in which its first pair lies.
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
  const internal::MatchDatabases databases{features, *shard};
  const ImagePairList selected = PairsOfShare(pairs, scene, share);
  PairMatcher matcher(databases, scene, options, context);
  const PairMatchingSummary summary =
      matcher.Run(selected, "matching of share " + share.ToString());
  if (!is_complete && options.rig_verification.rig_verification) {
    internal::VerifyUnitsOfPairs(selected, scene, options, databases, context);
  }
  features.CheckUnchanged();
  manifest.is_complete = true;
  if (!is_complete) shard->WriteShard(manifest);
  return summary;
}

}  // namespace mgsfm
