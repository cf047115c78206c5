// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstdlib>
#include <optional>

#include "base/parallel.h"
#include "matching/pair_lists.h"
#include "matching/pair_selection.h"

namespace mgsfm {
namespace {

// Minimum similarity of an image pair relative to the most similar pair of its
// two frames; less similar pairs are skipped to save time. This value skips 1
// of 1178 pairs that would be verified, twice the value 291
// (docs/results/constants.md).
constexpr float kMinRelativeSimilarity = 0.25f;
// Image pairs with fewer consistent words are rejected. Unrelated images in
// tests/frontend/matching/vocabulary_test.cc have at most this many by chance.
constexpr int kMinConsistentWords = 6;

// A frame by its index in a sequence.
struct Place {
  size_t sequence = 0;
  int frame = 0;
  std::vector<int> images;
};

struct Candidate {
  size_t place = 0;
  float similarity = 0.0f;
  int num_consistent = 0;
  ImagePairList pairs;
};

class FrameRetrieval {
 public:
  FrameRetrieval(const std::vector<FrameSequence>& sequences,
                 const std::vector<WordImage>& images, const WordIndex& index,
                 const FrameRetrievalOptions& options)
      : images_(images), index_(index), options_(options) {
    for (size_t s = 0; s < sequences.size(); ++s) {
      for (int i = 0; i < sequences[s].num_frames(); ++i) {
        Place place{s, i, {}};
        for (const std::optional<int>& image : sequences[s].images[i]) {
          if (image) place.images.push_back(*image);
        }
        if (i % options.period == 0) queries_.push_back(places_.size());
        places_.push_back(std::move(place));
      }
    }
  }

  size_t num_queries() const { return queries_.size(); }

  ImagePairList Query(size_t query_idx) const {
    const Place& query = places_[queries_[query_idx]];
    std::vector<std::vector<float>> similarities;
    for (const int image : query.images) {
      similarities.push_back(index_.Similarities(image));
    }
    std::vector<Candidate> candidates = MostSimilar(query, similarities);
    for (Candidate& candidate : candidates) {
      Compare(query, similarities, &candidate);
    }
    if (options_.num_images_after_verification > 0) Rerank(&candidates);
    ImagePairList pairs;
    for (const Candidate& candidate : candidates) {
      pairs.insert(pairs.end(), candidate.pairs.begin(), candidate.pairs.end());
    }
    return pairs;
  }

 private:
  bool IsCandidate(const Place& query, const Place& place) const {
    return query.sequence != place.sequence ||
           std::abs(query.frame - place.frame) >= options_.min_frame_distance;
  }

  std::vector<Candidate> MostSimilar(
      const Place& query,
      const std::vector<std::vector<float>>& similarities) const {
    std::vector<Candidate> candidates;
    for (size_t p = 0; p < places_.size(); ++p) {
      if (!IsCandidate(query, places_[p])) continue;
      Candidate candidate{p, 0.0f, 0, {}};
      for (size_t i = 0; i < query.images.size(); ++i) {
        for (const int other : places_[p].images) {
          if (other != query.images[i]) {
            candidate.similarity += similarities[i][other];
          }
        }
      }
      if (candidate.similarity > 0.0f) {
        candidates.push_back(std::move(candidate));
      }
    }
    KeepFirst(
        options_.num_images,
        [](const Candidate& candidate) { return candidate.similarity; },
        &candidates);
    return candidates;
  }

  // Selects image pairs of the two frames.
  void Compare(const Place& query,
               const std::vector<std::vector<float>>& similarities,
               Candidate* candidate) const {
    const std::vector<int>& others = places_[candidate->place].images;
    float most_similar = 0.0f;
    for (size_t i = 0; i < query.images.size(); ++i) {
      for (const int other : others) {
        if (other == query.images[i]) continue;
        most_similar = std::max(most_similar, similarities[i][other]);
      }
    }
    for (size_t i = 0; i < query.images.size(); ++i) {
      const int image = query.images[i];
      for (const int other : others) {
        if (other == image ||
            similarities[i][other] < kMinRelativeSimilarity * most_similar) {
          continue;
        }
        if (options_.num_images_after_verification > 0) {
          const int num_consistent =
              CountConsistentWords(images_[image], images_[other]);
          if (num_consistent < kMinConsistentWords) continue;
          candidate->num_consistent += num_consistent;
        }
        candidate->pairs.push_back(internal::MakePair(image, other));
      }
    }
  }

  void Rerank(std::vector<Candidate>* candidates) const {
    KeepFirst(
        options_.num_images_after_verification,
        [](const Candidate& candidate) { return candidate.num_consistent; },
        candidates);
  }

  // Keeps the candidates with the largest values, the first of equal ones.
  template <class Value>
  static void KeepFirst(int num_kept, const Value& value,
                        std::vector<Candidate>* candidates) {
    std::stable_sort(candidates->begin(), candidates->end(),
                     [&](const Candidate& a, const Candidate& b) {
                       return value(a) > value(b);
                     });
    if (candidates->size() > static_cast<size_t>(num_kept)) {
      candidates->resize(num_kept);
    }
  }

  const std::vector<WordImage>& images_;
  const WordIndex& index_;
  const FrameRetrievalOptions& options_;
  std::vector<Place> places_;
  std::vector<size_t> queries_;
};

}  // namespace

ImagePairList RetrievePairs(const std::vector<FrameSequence>& sequences,
                            const std::vector<WordImage>& images,
                            const WordIndex& index,
                            const FrameRetrievalOptions& options,
                            const Context& context) {
  const FrameRetrieval retrieval(sequences, images, index, options);
  std::vector<ImagePairList> pairs_of_query(retrieval.num_queries());
  ParallelFor(
      pairs_of_query.size(), context.num_threads,
      [&](size_t i) { pairs_of_query[i] = retrieval.Query(i); }, 1,
      [&](size_t num_done) {
        context.ReportProgress("image retrieval", num_done,
                               pairs_of_query.size());
      });
  ImagePairList pairs;
  for (const ImagePairList& list : pairs_of_query) {
    pairs.insert(pairs.end(), list.begin(), list.end());
  }
  internal::SortUnique(&pairs);
  return pairs;
}

}  // namespace mgsfm
