// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "mgsfm/base/context.h"
#include "simulator/detection.h"

namespace mgsfm {

// A pair of images to match, image1 < image2.
struct PairPlan {
  int image1;
  int image2;
  // The duplicate structure of a pair that matches it to its original, and
  // whether image 1 observes the duplicate.
  int duplicate = -1;
  bool first_sees_copy = false;

  friend bool operator<(const PairPlan& a, const PairPlan& b) {
    return a.image1 != b.image1 ? a.image1 < b.image1 : a.image2 < b.image2;
  }
};

// The images and features simulated so far, by image index of the scene.
struct Photographs {
  std::vector<Exposure> exposures;
  std::vector<SimulatedFeatures> features;
};

// A drive whose images have features. Refers to data that must outlive it.
struct Footage {
  const SimulationOptions& options;
  const std::vector<SimulatedCamera>& rig;
  const Drive& drive;
  const World& world;
  const Vehicles* vehicles;  // null: none
  const Detector& detector;
  // HideConvoys() and MakeIsolatedPairs() add and remove features.
  Photographs& photographs;
};

// The number of points observed in both images.
int NumCommonPoints(const SimulatedFeatures& features1,
                    const SimulatedFeatures& features2, int num_points);

// The pairs of temporal neighbors. Depends only on which images exist.
std::vector<PairPlan> PlanNeighbors(const SimulationOptions& options,
                                    const Drive& drive,
                                    const std::vector<Exposure>& exposures);

// Temporal neighbors and pairs of revisited places, sorted.
std::vector<PairPlan> PlanPairs(const Footage& footage, const Context& context);

// Pairs of an image of an original structure and one of its duplicate, at most
// `num_pairs`, about equally many per structure, those with the most points in
// common. Excludes `plans`. Sorted.
std::vector<PairPlan> PlanDuplicatedPairs(const Footage& footage,
                                          const std::vector<PairPlan>& plans,
                                          int num_pairs);

}  // namespace mgsfm
