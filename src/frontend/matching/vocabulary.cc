// SPDX-License-Identifier: BSD-3-Clause
#include "matching/vocabulary.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <string>

#include "base/file_reading.h"
#include "base/parallel.h"
#include "base/random.h"
#include "base/ranges.h"
#include "files/file_operations.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

constexpr size_t kDim = DescriptorView::kDim;
// Lower bound, so that a word represents several features.
constexpr size_t kMinSamplesPerWord = 8;
// Samples per parallel task.
constexpr size_t kBlockSize = 256;

using WideDescriptor = std::array<int16_t, kDim>;

WideDescriptor Widen(const uint8_t* descriptor) {
  WideDescriptor wide;
  std::copy_n(descriptor, kDim, wide.begin());
  return wide;
}

int32_t Dot(const int16_t* a, const int16_t* b) {
  int32_t sum = 0;
  for (size_t k = 0; k < kDim; ++k) sum += int32_t{a[k]} * b[k];
  return sum;
}

}  // namespace

int Vocabulary::FindNearest(const int16_t* descriptor, const int16_t* centers,
                            const int32_t* squared_norms, int num_centers) {
  int nearest = 0;
  int32_t least = std::numeric_limits<int32_t>::max();
  for (int i = 0; i < num_centers; ++i) {
    // The squared distance up to the norm of the descriptor.
    const int32_t distance =
        squared_norms[i] -
        2 * Dot(descriptor, centers + static_cast<size_t>(i) * kDim);
    if (distance < least) {
      least = distance;
      nearest = i;
    }
  }
  return nearest;
}

int Vocabulary::FindWord(const uint8_t* descriptor) const {
  const WideDescriptor wide = Widen(descriptor);
  int node = 0;
  while (nodes_[node].num_children > 0) {
    const int first = nodes_[node].first_child;
    node = first +
           FindNearest(
               wide.data(), centers_.data() + static_cast<size_t>(first) * kDim,
               squared_norms_.data() + first, nodes_[node].num_children);
  }
  return nodes_[node].word;
}

// Trains the tree level by level. K-means runs on all nodes of a level at once,
// in parallel over their samples.
class VocabularyTrainer {
 public:
  VocabularyTrainer(DescriptorView samples,
                    const VocabularyTrainingOptions& options,
                    const Context& context)
      : samples_(samples),
        options_(options),
        context_(context),
        samples_per_word_(std::max(
            kMinSamplesPerWord,
            samples.size / static_cast<size_t>(options.num_visual_words))),
        order_(Indices<size_t>(samples.size)),
        child_of_(samples.size) {}

  Vocabulary Train() {
    AddNodes(1);
    std::vector<Cluster> level = {{0, 0, samples_.size}};
    while (!level.empty()) {
      context_.CheckInterrupted();
      std::vector<Cluster> split;
      for (const Cluster& cluster : level) {
        if (NumChildren(cluster) >= 2) {
          split.push_back(cluster);
        } else {
          tree_.nodes_[cluster.node].word = tree_.num_words_++;
        }
      }
      level = Split(split);
    }
    return std::move(tree_);
  }

 private:
  // A node and its samples order_[begin] to order_[end - 1].
  struct Cluster {
    int node;
    size_t begin;
    size_t end;
  };

  int NumChildren(const Cluster& cluster) const {
    return static_cast<int>(
        std::min(static_cast<size_t>(options_.branching),
                 (cluster.end - cluster.begin) / samples_per_word_));
  }

  void AddNodes(int num_nodes) {
    const size_t size = tree_.nodes_.size() + static_cast<size_t>(num_nodes);
    tree_.nodes_.resize(size);
    tree_.centers_.resize(size * kDim);
    tree_.squared_norms_.resize(size);
  }

  int16_t* Center(int node) {
    return tree_.centers_.data() + static_cast<size_t>(node) * kDim;
  }

  void UpdateNorm(int node) {
    tree_.squared_norms_[node] = Dot(Center(node), Center(node));
  }

  std::vector<Cluster> Split(const std::vector<Cluster>& clusters) {
    for (const Cluster& cluster : clusters) Initialize(cluster);
    for (int i = 0;; ++i) {
      const bool has_changed = Assign(clusters, i == 0);
      if (!has_changed || i == options_.num_iterations) break;
      ParallelFor(
          clusters.size(), context_.num_threads,
          [&](size_t k) { UpdateCenters(clusters[k]); }, 1);
      context_.CheckInterrupted();
    }
    std::vector<Cluster> children;
    for (const Cluster& cluster : clusters) AddChildren(cluster, &children);
    return children;
  }

  // Initial centers are distinct random samples.
  void Initialize(const Cluster& cluster) {
    Vocabulary::Node& node = tree_.nodes_[cluster.node];
    node.num_children = NumChildren(cluster);
    node.first_child = static_cast<int>(tree_.nodes_.size());
    const int first = node.first_child, num_children = node.num_children;
    AddNodes(num_children);
    Random random(context_.random_seed, static_cast<uint64_t>(cluster.node));
    for (int k = 0; k < num_children; ++k) {
      const size_t at = cluster.begin + static_cast<size_t>(k);
      const size_t drawn =
          at + random.Index(static_cast<uint32_t>(cluster.end - at));
      std::swap(order_[at], order_[drawn]);
      std::copy_n(samples_.Row(order_[at]), kDim, Center(first + k));
      UpdateNorm(first + k);
    }
  }

  // Assigns samples to centers. Returns whether an assignment changed.
  bool Assign(const std::vector<Cluster>& clusters, bool is_first) {
    std::vector<Cluster> blocks;
    for (const Cluster& cluster : clusters) {
      for (size_t i = cluster.begin; i < cluster.end; i += kBlockSize) {
        blocks.push_back(
            {cluster.node, i, std::min(i + kBlockSize, cluster.end)});
      }
    }
    const auto assign_block = [&](size_t i) {
      const Vocabulary::Node& node = tree_.nodes_[blocks[i].node];
      const int16_t* centers = Center(node.first_child);
      const int32_t* norms = tree_.squared_norms_.data() + node.first_child;
      for (size_t k = blocks[i].begin; k < blocks[i].end; ++k) {
        new_child_[order_[k]] =
            Vocabulary::FindNearest(Widen(samples_.Row(order_[k])).data(),
                                    centers, norms, node.num_children);
      }
    };
    ParallelFor(blocks.size(), context_.num_threads, assign_block, 1);
    const bool has_changed = is_first || new_child_ != child_of_;
    child_of_ = new_child_;
    return has_changed;
  }

  // Rounded means of integers. A center without samples is unchanged.
  void UpdateCenters(const Cluster& cluster) {
    const Vocabulary::Node& node = tree_.nodes_[cluster.node];
    std::vector<int64_t> sums(static_cast<size_t>(node.num_children) * kDim, 0);
    std::vector<int64_t> counts(node.num_children, 0);
    for (size_t i = cluster.begin; i < cluster.end; ++i) {
      const int child = child_of_[order_[i]];
      int64_t* sum = sums.data() + static_cast<size_t>(child) * kDim;
      const uint8_t* sample = samples_.Row(order_[i]);
      for (size_t k = 0; k < kDim; ++k) sum[k] += sample[k];
      ++counts[child];
    }
    for (int child = 0; child < node.num_children; ++child) {
      if (counts[child] == 0) continue;
      int16_t* center = Center(node.first_child + child);
      const int64_t* sum = sums.data() + static_cast<size_t>(child) * kDim;
      for (size_t k = 0; k < kDim; ++k) {
        center[k] = static_cast<int16_t>((2 * sum[k] + counts[child]) /
                                         (2 * counts[child]));
      }
      UpdateNorm(node.first_child + child);
    }
  }

  // Sorts the samples by child. A node whose samples all have the same center
  // becomes a leaf.
  void AddChildren(const Cluster& cluster, std::vector<Cluster>* children) {
    const auto begin = order_.begin() + cluster.begin;
    const auto end = order_.begin() + cluster.end;
    std::stable_sort(begin, end, [&](size_t a, size_t b) {
      return child_of_[a] < child_of_[b];
    });
    Vocabulary::Node& node = tree_.nodes_[cluster.node];
    if (child_of_[*begin] == child_of_[*(end - 1)]) {
      node.num_children = 0;
      node.word = tree_.num_words_++;
      return;
    }
    size_t child_begin = cluster.begin;
    for (int child = 0; child < node.num_children; ++child) {
      size_t child_end = child_begin;
      while (child_end < cluster.end && child_of_[order_[child_end]] == child) {
        ++child_end;
      }
      // A child without samples becomes a leaf.
      children->push_back({node.first_child + child, child_begin, child_end});
      child_begin = child_end;
    }
  }

  const DescriptorView samples_;
  const VocabularyTrainingOptions& options_;
  const Context& context_;
  const size_t samples_per_word_;
  std::vector<size_t> order_;
  std::vector<int> child_of_;  // per sample, relative to first_child
  std::vector<int> new_child_ = std::vector<int>(child_of_.size());
  Vocabulary tree_;
};

Vocabulary Vocabulary::Train(DescriptorView samples,
                             const VocabularyTrainingOptions& options,
                             const Context& context) {
  MGSFM_CHECK_GT(samples.size, size_t{0});
  return VocabularyTrainer(samples, options, context).Train();
}

// ------------------------------------------------------------------- files
//
// The line kMagic, the number of nodes (int32), and per node, in the order of
// `nodes_`: first child, number of children, word (int32 each) and center (128
// times int16). Little-endian.

namespace {

constexpr char kMagic[] = "mgsfm vocabulary tree 1\n";

template <class T>
void AppendBytes(const T* values, size_t size, std::string* bytes) {
  bytes->append(reinterpret_cast<const char*>(values), size * sizeof(T));
}

}  // namespace

void Vocabulary::Write(const std::string& path) const {
  std::string bytes = kMagic;
  const auto num_nodes = static_cast<int32_t>(nodes_.size());
  AppendBytes(&num_nodes, 1, &bytes);
  for (size_t i = 0; i < nodes_.size(); ++i) {
    const int32_t node[] = {nodes_[i].first_child, nodes_[i].num_children,
                            nodes_[i].word};
    AppendBytes(node, 3, &bytes);
    AppendBytes(centers_.data() + i * kDim, kDim, &bytes);
  }
  ReplaceFile(path, bytes);
}

Vocabulary Vocabulary::Read(const std::string& path) {
  const std::string bytes = ReadFile(path, "vocabulary tree '" + path + "'");
  const auto check = [&](bool is_sound) {
    if (is_sound) return;
    throw Error(
        "'" + path +
        "' is not a vocabulary tree of this program, or is damaged; make "
        "it with vocab_tree_builder");
  };
  constexpr size_t kHeaderSize = sizeof(kMagic) - 1 + sizeof(int32_t);
  constexpr size_t kNodeSize = 3 * sizeof(int32_t) + kDim * sizeof(int16_t);
  check(bytes.size() >= kHeaderSize + kNodeSize &&
        bytes.compare(0, sizeof(kMagic) - 1, kMagic) == 0);
  int32_t num_nodes = 0;
  std::memcpy(&num_nodes, bytes.data() + sizeof(kMagic) - 1, sizeof(int32_t));
  check(num_nodes > 0 &&
        bytes.size() ==
            kHeaderSize + kNodeSize * static_cast<size_t>(num_nodes));
  Vocabulary tree;
  tree.nodes_.resize(static_cast<size_t>(num_nodes));
  tree.centers_.resize(tree.nodes_.size() * kDim);
  for (int32_t i = 0; i < num_nodes; ++i) {
    const char* at = bytes.data() + kHeaderSize + kNodeSize * i;
    int32_t node[3];
    std::memcpy(node, at, sizeof(node));
    int16_t* center = tree.centers_.data() + static_cast<size_t>(i) * kDim;
    std::memcpy(center, at + sizeof(node), kDim * sizeof(int16_t));
    // Children come after their parent, so every path ends.
    const bool is_leaf = node[1] == 0;
    check(is_leaf ? node[2] >= 0 && node[2] < num_nodes
                  : node[1] > 0 && node[0] > i && node[0] < num_nodes &&
                        node[1] <= num_nodes - node[0]);
    // Descriptors are bytes; larger values would overflow sums.
    check(std::all_of(center, center + kDim,
                      [](int16_t v) { return v >= 0 && v <= 255; }));
    tree.nodes_[i] = {node[0], node[1], node[2]};
    tree.squared_norms_.push_back(Dot(center, center));
    if (is_leaf) tree.num_words_ = std::max(tree.num_words_, node[2] + 1);
  }
  return tree;
}

}  // namespace mgsfm
