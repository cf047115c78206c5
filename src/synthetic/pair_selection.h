// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "synthetic/detection.h"

namespace mgsfm {

// Two images to be matched; image1 < image2.
struct PairPlan {
  int image1;
  int image2;
  // If one of them is taken for the other's place: which structure, and
  // whether it is image 1 that sees the copy.
  int duplicate = -1;
  bool first_sees_copy = false;

  friend bool operator<(const PairPlan& a, const PairPlan& b) {
    return a.image1 != b.image1 ? a.image1 < b.image1 : a.image2 < b.image2;
  }
};

// What has been photographed so far: images by position in the scene.
struct Photographs {
  std::vector<Exposure> exposures;
  std::vector<Features> features;
};

// The number of points that both images show.
int NumCommonPoints(const Features& features1, const Features& features2,
                    int num_points);

// The plans for neighbours in time; depends only on which images there are.
std::vector<PairPlan> PlanNeighbors(const SimulationOptions& options,
                                    const Drive& drive,
                                    const std::vector<Exposure>& exposures);

// The same, and places that the drive visits again. Sorted.
std::vector<PairPlan> PlanPairs(const SimulationOptions& options,
                                const Drive& drive, const World& world,
                                const Photographs& photographs,
                                const Context& context);

// Pairs of images of originals with images of copies, at most `num_pairs` of
// them, about equally many for each structure: those with the most in common.
// None of `plans` is among them. Sorted.
std::vector<PairPlan> PlanDuplicatedPairs(const SimulationOptions& options,
                                          const World& world,
                                          const Photographs& photographs,
                                          const std::vector<PairPlan>& plans,
                                          int num_pairs);

}  // namespace mgsfm
