// SPDX-License-Identifier: BSD-3-Clause
#include "matching/key_frames.h"

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "base/ranges.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// docs/results/constants.md has the measurement.
constexpr double kMinShareOfInliers = 0.85;

// The intervals of one sequence. An interval of a length starts at a multiple
// of it; two halves form the next longer one.
class Intervals {
 public:
  explicit Intervals(const FrameSequence& sequence)
      : sequence_(sequence), is_key_(sequence.num_frames(), true) {}

  // Lists the intervals of this length whose halves are whole.
  void StartLength(int length) {
    length_ = length;
    candidates_.clear();
    for (int begin = 0; begin + length < sequence_.num_frames();
         begin += length) {
      if (length == 1 || (IsWhole(begin) && IsWhole(begin + length / 2))) {
        candidates_.push_back(begin);
      }
    }
  }

  // The pairs of the ends of intervals.
  void AppendPairs(ImagePairList* pairs) const {
    for (const int begin : candidates_) {
      AppendPairsOfFrames(begin, begin + length_, pairs);
    }
  }

  // Joins halves, once these pairs are matched.
  void Join(const PairTrial& trial) {
    whole_.clear();
    for (const int begin : candidates_) {
      if (length_ == 1 ? !IsVerified(begin, trial)
                       : !EndsSeeTheSame(begin, trial)) {
        continue;
      }
      whole_.push_back(begin);
      if (length_ > 1) is_key_[begin + length_ / 2] = false;
    }
  }

  // The pairs of each other frame with the key frames before and after it.
  void AppendTies(ImagePairList* pairs) const {
    int last_key = 0;
    for (int key = 1; key < sequence_.num_frames(); ++key) {
      if (!is_key_[key]) continue;
      for (int i = last_key + 1; i < key; ++i) {
        AppendPairsOfFrames(last_key, i, pairs);
        AppendPairsOfFrames(i, key, pairs);
      }
      last_key = key;
    }
  }

  FrameSequence Keys() const {
    FrameSequence keys;
    keys.num_slots = sequence_.num_slots;
    for (int i = 0; i < sequence_.num_frames(); ++i) {
      if (!is_key_[i]) continue;
      keys.frame_idxs.push_back(sequence_.frame_idxs[i]);
      keys.images.push_back(sequence_.images[i]);
    }
    return keys;
  }

 private:
  void AppendPairsOfFrames(int frame1, int frame2, ImagePairList* pairs) const {
    for (int slot = 0; slot < sequence_.num_slots; ++slot) {
      const auto pair = sequence_.Pair(frame1, slot, frame2, slot);
      if (pair) pairs->push_back(*pair);
    }
  }

  bool IsWhole(int begin) const {
    return std::binary_search(whole_.begin(), whole_.end(), begin);
  }

  size_t NumInliers(int frame1, int frame2, int slot,
                    const PairTrial& trial) const {
    const auto pair = sequence_.Pair(frame1, slot, frame2, slot);
    return pair ? trial.num_inliers(*pair) : 0;
  }

  bool IsVerified(int begin, const PairTrial& trial) const {
    for (int slot = 0; slot < sequence_.num_slots; ++slot) {
      if (NumInliers(begin, begin + 1, slot, trial) > 0) return true;
    }
    return false;
  }

  bool EndsSeeTheSame(int begin, const PairTrial& trial) const {
    for (int slot = 0; slot < sequence_.num_slots; ++slot) {
      size_t of_steps = 0;
      for (int i = begin; i < begin + length_; ++i) {
        of_steps += NumInliers(i, i + 1, slot, trial);
      }
      const size_t of_ends = NumInliers(begin, begin + length_, slot, trial);
      if (static_cast<double>(of_ends) * length_ <
          kMinShareOfInliers * static_cast<double>(of_steps)) {
        return false;
      }
    }
    return true;
  }

  const FrameSequence& sequence_;
  int length_ = 1;
  std::vector<int> candidates_;  // the first frames of intervals, ascending
  std::vector<int> whole_;       // of the last length, ascending
  Mask is_key_;                  // per frame
};

}  // namespace

KeyFrames FindKeyFrames(const std::vector<FrameSequence>& sequences,
                        const PairTrial& trial) {
  std::vector<Intervals> intervals(sequences.begin(), sequences.end());
  KeyFrames result;
  for (int length = 1;; length *= 2) {
    ImagePairList pairs;
    for (Intervals& of_sequence : intervals) {
      of_sequence.StartLength(length);
      of_sequence.AppendPairs(&pairs);
    }
    if (pairs.empty()) break;
    SortUnique(&pairs);
    trial.match(pairs, "matching of consecutive frames");
    for (Intervals& of_sequence : intervals) of_sequence.Join(trial);
    result.ties.insert(result.ties.end(), pairs.begin(), pairs.end());
  }
  for (const Intervals& of_sequence : intervals) {
    of_sequence.AppendTies(&result.ties);
    result.sequences.push_back(of_sequence.Keys());
  }
  SortUnique(&result.ties);
  return result;
}

NeighborPairs SelectNeighbors(const Scene& scene,
                              const SequentialPairOptions& options,
                              const PairTrial& trial) {
  const std::vector<FrameSequence> sequences = MakeFrameSequences(scene);
  KeyFrames keys = options.use_key_frames ? FindKeyFrames(sequences, trial)
                                          : KeyFrames{sequences, {}};
  const ImagePairList probes = ProbePairs(keys.sequences, options);
  trial.match(probes, "matching of probe frames");
  NeighborPairs neighbors{{}, std::move(keys.ties)};
  neighbors.pairs = Concatenated(std::array{
      neighbors.pairs, probes, SameSensorPairs(keys.sequences, options),
      OverlappingSensorPairs(keys.sequences, sequences, options,
                             [&](const ImageIdxPair& pair) {
                               return trial.num_inliers(pair) > 0;
                             })});
  SortUnique(&neighbors.pairs);
  neighbors.key_frames = std::move(keys.sequences);
  return neighbors;
}

}  // namespace mgsfm
