// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "mgsfm/base/context.h"
#include "mgsfm/base/options.h"
#include "mgsfm/matching/descriptor_matching.h"

namespace mgsfm {

struct VocabularyOptions {
  int num_visual_words = 65536;
  int branching = 16;
  int num_iterations = 8;
  int max_num_descriptors = 400000;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("num_visual_words", self.num_visual_words, AtLeast(1), "words",
          "About so many leaves has the vocabulary tree, if there are enough "
          "descriptors.");
    visit("branching", self.branching, Between(2, 1024), "children",
          "Most children of a node of the tree.");
    visit("num_iterations", self.num_iterations, AtLeast(1), "iterations",
          "Most iterations of k-means at each level.");
    visit("max_num_descriptors", self.max_num_descriptors, AtLeast(1),
          "descriptors",
          "Size of the sample, drawn evenly from all images, from which the "
          "tree is made.");
  }
};

// A tree of visual words, made from descriptors of the data set itself by
// hierarchical k-means (Nister, Stewenius: Scalable recognition with a
// vocabulary tree, CVPR 2006). A node with n samples gets
// min(branching, n / m) children, unless that is fewer than two, where m is
// the mean number of samples that a word should have, at least 8. Centres are
// rounded to integers, so all sums are exact and the tree does not depend on
// the number of threads. O(samples * branching * levels * iterations).
class Vocabulary {
 public:
  // At least one descriptor is needed.
  static Vocabulary Train(DescriptorView samples,
                          const VocabularyOptions& options,
                          const Context& context);

  int num_words() const { return num_words_; }

  // The word at the end of the path to the nearest child; of equally near ones
  // the first. O(branching * levels).
  int FindWord(const uint8_t* descriptor) const;

 private:
  friend class VocabularyTrainer;

  struct Node {
    int first_child = 0;
    int num_children = 0;
    int word = -1;  // of a leaf
  };

  // Position among `num_centers` of the one nearest to the descriptor.
  static int FindNearest(const int16_t* descriptor, const int16_t* centers,
                         const int32_t* squared_norms, int num_centers);

  std::vector<Node> nodes_;
  std::vector<int16_t> centers_;        // a row for each node
  std::vector<int32_t> squared_norms_;  // of the rows
  int num_words_ = 0;
};

}  // namespace mgsfm
