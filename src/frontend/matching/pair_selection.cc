// SPDX-License-Identifier: BSD-3-Clause
#include "matching/pair_selection.h"

#include <algorithm>
#include <array>
#include <flann/flann.hpp>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/parallel.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "database/sqlite_database.h"
#include "files/file_operations.h"
#include "matching/image_retrieval.h"
#include "matching/key_frames.h"
#include "matching/match_list.h"
#include "matching/pair_matching.h"
#include "matching/scene_pairs.h"
#include "mgsfm/base/error.h"
#include "mgsfm/priors/pose_priors.h"

namespace mgsfm {
namespace {

// Frame distances at which images are matched, ascending.
std::vector<int> FrameDistances(const SequentialPairOptions& options) {
  std::vector<int> distances;
  for (int d = 1; d <= options.overlap; ++d) distances.push_back(d);
  constexpr int kMaxExponent = 30;  // 2^30 fits into an int
  if (options.quadratic_overlap) {
    for (int k = 0; k < std::min(*options.overlap, kMaxExponent); ++k) {
      if ((1 << k) > options.overlap) distances.push_back(1 << k);
    }
  }
  return distances;
}

// The frame distances at which different sensors are paired: the distances for
// one sensor, and 0.
std::vector<int> SensorPairDistances(const SequentialPairOptions& options) {
  std::vector<int> distances = FrameDistances(options);
  distances.insert(distances.begin(), 0);
  return distances;
}

// Indices of evenly spaced frames, including the first.
std::vector<int> ProbeFrames(const FrameSequence& sequence,
                             const SequentialPairOptions& options) {
  const int num_probes =
      std::min(*options.num_probe_frames, sequence.num_frames());
  return Transformed(Indices(num_probes), [&](int i) {
    return static_cast<int>(int64_t{i} * sequence.num_frames() / num_probes);
  });
}

// Calls visit(slot1, slot2, pair) for all images of different sensors in two
// frames. Within one frame, each pair of sensors is visited once.
template <class Visit>
void ForEachSensorPair(const FrameSequence& sequence, int frame1, int frame2,
                       const Visit& visit) {
  if (frame2 >= sequence.num_frames()) return;
  for (int slot1 = 0; slot1 < sequence.num_slots; ++slot1) {
    for (int slot2 = 0; slot2 < sequence.num_slots; ++slot2) {
      if (slot1 == slot2 || (frame1 == frame2 && slot1 > slot2)) continue;
      const auto pair = sequence.Pair(frame1, slot1, frame2, slot2);
      if (pair) visit(slot1, slot2, *pair);
    }
  }
}

// Number of probes and of verified probes per pair of sensors, for one frame
// distance.
class SensorOverlap {
 public:
  SensorOverlap(int num_slots, double min_ratio)
      : num_slots_(num_slots),
        min_ratio_(min_ratio),
        counts_(static_cast<size_t>(num_slots) * num_slots) {}

  void Add(int slot1, int slot2, bool is_verified) {
    Count& count = counts_[slot1 * num_slots_ + slot2];
    ++count.num_probes;
    count.num_verified += is_verified ? 1 : 0;
  }
  bool Overlaps(int slot1, int slot2) const {
    const Count& count = counts_[slot1 * num_slots_ + slot2];
    // Sensors without images in the probe frames may overlap.
    if (count.num_probes == 0) return true;
    return count.num_verified > 0 &&
           count.num_verified >= min_ratio_ * count.num_probes;
  }

 private:
  struct Count {
    int num_probes = 0;
    int num_verified = 0;
  };
  int num_slots_;
  double min_ratio_;
  std::vector<Count> counts_;
};

}  // namespace

std::vector<FrameSequence> MakeFrameSequences(const Scene& scene) {
  // The key is the rig for rigs of several sensors, otherwise the folder.
  using Key = std::pair<std::optional<int>, std::string>;
  std::map<Key, std::vector<int>> frames_of_key;
  for (const int frame_idx : OrderOfFrames(scene)) {
    const Frame& frame = scene.frames[frame_idx];
    const bool is_single = scene.rigs[frame.rig_idx].sensor_idxs.size() == 1;
    const std::string& image_name = scene.images[frame.image_idxs.front()].name;
    frames_of_key[is_single ? Key(std::nullopt, FolderOfName(image_name))
                            : Key(frame.rig_idx, "")]
        .push_back(frame_idx);
  }
  std::vector<FrameSequence> sequences;
  for (auto& [key, frame_idxs] : frames_of_key) {
    FrameSequence sequence;
    if (key.first) {
      sequence.num_slots =
          static_cast<int>(scene.rigs[*key.first].sensor_idxs.size());
    }
    for (const int frame_idx : frame_idxs) {
      std::vector<std::optional<int>>& images =
          sequence.images.emplace_back(sequence.num_slots);
      for (const int image_idx : scene.frames[frame_idx].image_idxs) {
        const Image& image = scene.images[image_idx];
        const std::vector<int>& sensors =
            scene.rigs[scene.frames[frame_idx].rig_idx].sensor_idxs;
        const auto slot =
            std::find(sensors.begin(), sensors.end(), image.sensor_idx);
        images[slot - sensors.begin()] = image_idx;
      }
    }
    sequence.frame_idxs = std::move(frame_idxs);
    sequences.push_back(std::move(sequence));
  }
  return sequences;
}

ImagePairList SameSensorPairs(const std::vector<FrameSequence>& sequences,
                              const SequentialPairOptions& options) {
  const std::vector<int> distances = FrameDistances(options);
  ImagePairList pairs;
  for (const FrameSequence& sequence : sequences) {
    for (int frame = 0; frame < sequence.num_frames(); ++frame) {
      for (const int distance : distances) {
        if (frame + distance >= sequence.num_frames()) break;
        for (int slot = 0; slot < sequence.num_slots; ++slot) {
          const auto pair = sequence.Pair(frame, slot, frame + distance, slot);
          if (pair) pairs.push_back(*pair);
        }
      }
    }
  }
  SortUnique(&pairs);
  return pairs;
}

ImagePairList ProbePairs(const std::vector<FrameSequence>& sequences,
                         const SequentialPairOptions& options) {
  ImagePairList pairs;
  if (!options.expand_rig_images) return pairs;
  for (const FrameSequence& sequence : sequences) {
    for (const int frame : ProbeFrames(sequence, options)) {
      for (const int distance : SensorPairDistances(options)) {
        ForEachSensorPair(
            sequence, frame, frame + distance,
            [&](int, int, const ImageIdxPair& pair) { pairs.push_back(pair); });
      }
    }
  }
  SortUnique(&pairs);
  return pairs;
}

ImagePairList OverlappingSensorPairs(
    const std::vector<FrameSequence>& sequences,
    const std::vector<FrameSequence>& all_sequences,
    const SequentialPairOptions& options,
    const std::function<bool(const ImageIdxPair&)>& is_verified) {
  ImagePairList pairs;
  if (!options.expand_rig_images) return pairs;
  for (size_t i = 0; i < sequences.size(); ++i) {
    const FrameSequence& sequence = sequences[i];
    const std::vector<int> probes = ProbeFrames(sequence, options);
    for (const int distance : SensorPairDistances(options)) {
      SensorOverlap overlap(sequence.num_slots, options.min_probe_ratio);
      for (const int frame : probes) {
        ForEachSensorPair(sequence, frame, frame + distance,
                          [&](int slot1, int slot2, const ImageIdxPair& pair) {
                            overlap.Add(slot1, slot2, is_verified(pair));
                          });
      }
      const FrameSequence& selected =
          distance == 0 ? all_sequences[i] : sequence;
      for (int frame = 0; frame < selected.num_frames(); ++frame) {
        ForEachSensorPair(selected, frame, frame + distance,
                          [&](int slot1, int slot2, const ImageIdxPair& pair) {
                            if (overlap.Overlaps(slot1, slot2))
                              pairs.push_back(pair);
                          });
      }
    }
  }
  SortUnique(&pairs);
  return pairs;
}

namespace {

struct PlacedImage {
  int image_idx;
  Eigen::Vector3d position;
};

std::vector<PlacedImage> PlaceImages(
    const Scene& scene,
    const std::vector<std::optional<Eigen::Vector3d>>& position_of_image,
    bool ignore_z) {
  std::vector<std::optional<Eigen::Vector3d>> position_of_frame(
      scene.frames.size());
  for (size_t i = 0; i < scene.images.size(); ++i) {
    auto& position = position_of_frame[scene.images[i].frame_idx];
    if (!position) position = position_of_image[i];
  }
  std::vector<PlacedImage> placed;
  for (size_t i = 0; i < scene.images.size(); ++i) {
    auto position = position_of_image[i];
    if (!position) position = position_of_frame[scene.images[i].frame_idx];
    if (!position) continue;
    if (ignore_z) position->z() = 0.0;
    placed.push_back({static_cast<int>(i), *position});
  }
  return placed;
}

// Exact nearest neighbors in a kd-tree. FLANN breaks ties by the layout of its
// tree, and images of one frame often share a position. It therefore only
// bounds the distance of the last neighbor; all images within this distance are
// sorted.
class NearestImages {
 public:
  NearestImages(const std::vector<PlacedImage>& images,
                const SpatialMatchingOptions& options)
      : images_(images),
        max_num_(std::min(static_cast<size_t>(options.max_num_neighbors),
                          images.size() - 1)),
        max_squared_distance_(options.max_distance * options.max_distance) {
    for (const PlacedImage& image : images) {
      coordinates_.insert(coordinates_.end(), image.position.begin(),
                          image.position.end());
    }
    index_ = std::make_unique<Index>(
        Coordinates(coordinates_.data(), images.size(), 3),
        flann::KDTreeSingleIndexParams());
    index_->buildIndex();
  }

  // Indices of images, nearest first; ties go to the smaller index.
  std::vector<int> Find(size_t query) const {
    std::vector<std::pair<double, int>> neighbors;  // squared distance, image
    for (const size_t i : FindCandidates(query)) {
      const double squared_distance =
          (images_[i].position - images_[query].position).squaredNorm();
      if (i == query || squared_distance > max_squared_distance_) continue;
      neighbors.emplace_back(squared_distance, images_[i].image_idx);
    }
    std::sort(neighbors.begin(), neighbors.end());
    if (neighbors.size() > max_num_) neighbors.resize(max_num_);
    return Transformed(neighbors, &std::pair<double, int>::second);
  }

 private:
  using Index = flann::KDTreeSingleIndex<flann::L2_Simple<double>>;
  using Coordinates = flann::Matrix<double>;

  // All images as near as the last neighbor, including the query itself.
  std::vector<size_t> FindCandidates(size_t query) const {
    const flann::SearchParams exact(flann::FLANN_CHECKS_UNLIMITED);
    Eigen::Vector3d position = images_[query].position;
    const Coordinates queries(position.data(), 1, 3);
    std::vector<std::vector<size_t>> idxs;
    std::vector<std::vector<double>> squared_distances;
    index_->knnSearch(queries, idxs, squared_distances, max_num_ + 1, exact);
    const double squared_radius =
        std::min(squared_distances[0].back(), max_squared_distance_);
    // FLANN excludes the radius itself and takes it as a float.
    constexpr double kMargin = 8.0 * std::numeric_limits<float>::epsilon();
    index_->radiusSearch(queries, idxs, squared_distances,
                         static_cast<float>(squared_radius * (1.0 + kMargin)) +
                             std::numeric_limits<float>::min(),
                         exact);
    return idxs[0];
  }

  const std::vector<PlacedImage>& images_;
  const size_t max_num_;
  const double max_squared_distance_;
  std::vector<double> coordinates_;  // 3 per image
  std::unique_ptr<Index> index_;
};

}  // namespace

ImagePairList SpatialPairs(
    const Scene& scene,
    const std::vector<std::optional<Eigen::Vector3d>>& position_of_image,
    const SpatialMatchingOptions& options, const Context& context) {
  const std::vector<PlacedImage> images =
      PlaceImages(scene, position_of_image, options.ignore_z);
  if (images.size() < 2) return {};
  const NearestImages nearest(images, options);
  std::vector<ImagePairList> pairs_of_image(images.size());
  ParallelFor(images.size(), context.num_threads, [&](size_t i) {
    for (const int image_idx : nearest.Find(i)) {
      pairs_of_image[i].push_back(MakePair(images[i].image_idx, image_idx));
    }
  });
  ImagePairList pairs = Concatenated(pairs_of_image);
  SortUnique(&pairs);
  return pairs;
}

namespace {

ImagePairList RetrievedPairs(const FeatureDatabase& database,
                             const Scene& scene,
                             const std::vector<FrameSequence>& sequences,
                             const VocabularyOptions& vocabulary,
                             int max_num_features,
                             const FrameRetrievalOptions& options,
                             const Context& context) {
  const ImageWords words =
      FindImageWords(database, scene, vocabulary, max_num_features, context);
  const WordIndex index(words.num_words, words.images);
  return RetrievePairs(sequences, words.images, index, options, context);
}

// Positions in meters if they are GPS, otherwise in the unit of the database.
std::vector<std::optional<Eigen::Vector3d>> ReadPositions(
    const FeatureDatabase& database, const Scene& scene, PositionKind kind,
    const Context& context) {
  const std::string source = "database '" + database.path() + "'";
  const std::vector<PosePriorRow> rows = database.ReadPosePriors();
  if (rows.empty()) {
    throw Error(source +
                " has no position priors (table pose_priors), which come from "
                "the GPS tags of the images; use another matcher");
  }
  PosePriorOptions options;
  options.use_prior_position = true;
  options.ref_is_gps = kind;
  options.overwrite_priors_covariance = true;  // it has no effect on pairs
  const PositionPriors priors =
      MakePositionPriors(scene, rows, source, options);
  context.Info(source + " has " +
               (priors.origin_wgs84 ? "latitudes and longitudes of images"
                                    : "Cartesian positions of images"));
  return Transformed(priors.images, [](const auto& prior) {
    return prior ? std::optional(prior->position) : std::nullopt;
  });
}

}  // namespace

ImagePairList BlockPairs(int begin1, int end1, int begin2, int end2) {
  ImagePairList pairs;
  for (int i = begin1; i < end1; ++i) {
    for (int j = std::max(begin2, i + 1); j < end2; ++j) {
      pairs.push_back({i, j});
    }
  }
  return pairs;
}

ImagePairList SelectExhaustively(const Scene& scene) {
  const int num_images = static_cast<int>(scene.images.size());
  return BlockPairs(0, num_images, 0, num_images);
}

ImagePairList SelectSequentially(const FeatureDatabase& database,
                                 const Scene& scene,
                                 const SequentialMatchingOptions& options,
                                 const VocabularyOptions& vocabulary,
                                 const PairMatchingOptions& matching,
                                 const Context& context) {
  const TemporaryFolder folder;
  FeatureDatabase trials(folder.path() + "/trials.db",
                         FeatureDatabase::OpenMode::kOrCreate);
  PairMatcher matcher({database, trials}, scene, matching, context);
  auto [key_frames, pairs] = SelectNeighbors(
      scene, options.pairs,
      {[&](const ImagePairList& some, std::string_view stage) {
         matcher.Run(some, stage);
       },
       [&](const ImageIdxPair& pair) { return matcher.NumInliers(pair); }});
  if (options.loop_detection) {
    pairs = Concatenated(
        std::array{pairs, SelectLoops(database, scene, key_frames, options,
                                      vocabulary, context)});
  }
  SortUnique(&pairs);
  return pairs;
}

ImagePairList SelectLoops(const FeatureDatabase& database, const Scene& scene,
                          const std::vector<FrameSequence>& sequences,
                          const SequentialMatchingOptions& options,
                          const VocabularyOptions& vocabulary,
                          const Context& context) {
  // Nearer frames, up to the overlap, are already matched.
  const FrameRetrievalOptions retrieval{
      options.loop_detection_period, options.loop_detection_num_images,
      options.loop_detection_num_images_after_verification,
      2 * options.pairs.overlap + 1};
  return RetrievedPairs(database, scene, sequences, vocabulary,
                        options.loop_detection_max_num_features, retrieval,
                        context);
}

ImagePairList SelectByVocabulary(const FeatureDatabase& database,
                                 const Scene& scene,
                                 const VocabTreeMatchingOptions& options,
                                 const VocabularyOptions& vocabulary,
                                 const Context& context) {
  FrameRetrievalOptions retrieval;
  retrieval.num_images = options.num_images;
  retrieval.num_images_after_verification =
      options.num_images_after_verification;
  return RetrievedPairs(database, scene, MakeFrameSequences(scene), vocabulary,
                        options.max_num_features, retrieval, context);
}

ImagePairList SelectSpatially(const FeatureDatabase& database,
                              const Scene& scene,
                              const SpatialMatchingOptions& options,
                              const Context& context) {
  const auto positions =
      ReadPositions(database, scene, options.is_gps, context);
  return SpatialPairs(scene, positions, options, context);
}

ImagePairList SelectListed(const Scene& scene, const std::string& list_path) {
  return ReadPairList(TextLines(list_path),
                      Transformed(scene.images, &Image::name));
}

void WritePairList(const ImagePairList& pairs, const Scene& scene,
                   const std::string& list_path) {
  std::string text;
  for (const ImageIdxPair& pair : pairs) {
    text += scene.images[pair.image_idx1].name + ' ' +
            scene.images[pair.image_idx2].name + '\n';
  }
  ReplaceFile(list_path, text);
}

ImagePairList SelectMatched(const FeatureDatabase& database,
                            const Scene& scene) {
  const ImageIdxs image_idxs(scene);
  ImagePairList pairs;
  for (const PairCount& row : database.CountMatches()) {
    if (const auto pair = image_idxs.Find(row)) pairs.push_back(*pair);
  }
  SortUnique(&pairs);
  return pairs;
}

}  // namespace mgsfm
