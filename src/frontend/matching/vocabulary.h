// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "matching/descriptor_matching.h"
#include "mgsfm/base/context.h"
#include "mgsfm/matching/matching_options.h"

namespace mgsfm {

// Vocabulary tree, trained on descriptors of the data set itself by
// hierarchical k-means (Nister, Stewenius: Scalable recognition with a
// vocabulary tree, CVPR 2006). A node with n samples is split into
// min(branching, n / m) children if these are at least two, where m is the mean
// number of samples per word, at least 8. Centers are rounded to integers, so
// that all sums are exact and the tree is independent of the number of threads.
// docs/development/libraries.md explains why FLANN is not used.
//
// K-means of a level stops when no sample changes its center, or after
// num_iterations. O(samples * branching * levels * iterations).
class Vocabulary {
 public:
  // Needs at least one descriptor.
  static Vocabulary Train(DescriptorView samples,
                          const VocabularyTrainingOptions& options,
                          const Context& context);

  // A file format of this program, not COLMAP's. Read throws Error, naming the
  // file, for other files.
  static Vocabulary Read(const std::string& path);
  void Write(const std::string& path) const;

  int num_words() const { return num_words_; }

  // The word reached by descending to the nearest child; ties go to the first
  // child. O(branching * levels).
  int FindWord(const uint8_t* descriptor) const;

 private:
  friend class VocabularyTrainer;

  struct Node {
    int first_child = 0;
    int num_children = 0;
    int word = 0;  // meaningful if num_children is 0
  };

  // Index of the nearest of `num_centers` centers.
  static int FindNearest(const int16_t* descriptor, const int16_t* centers,
                         const int32_t* squared_norms, int num_centers);

  std::vector<Node> nodes_;
  std::vector<int16_t> centers_;        // a row per node
  std::vector<int32_t> squared_norms_;  // of the rows
  int num_words_ = 0;
};

}  // namespace mgsfm
