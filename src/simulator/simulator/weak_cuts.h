// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "simulator/pair_selection.h"
#include "simulator/road.h"

namespace mgsfm {

// The frames of the drive before the weak cuts, ascending: places where the
// appearance of the street changes between two frames, as at the exit of a
// tunnel or around a corner. About half of the cuts are at the sharpest turn
// nearby. Depends on the drive only.
std::vector<int> PlanWeakCuts(const SimulationOptions& options,
                              const Drive& drive);

// Tells which points are recognized on both sides of weak cuts.
class WeakCuts {
 public:
  // Chooses the fraction of points that are recognized across each cut of the
  // world such that about as many correct matches remain as the options demand.
  // Omits cuts where fewer would remain.
  explicit WeakCuts(const Footage& footage);

  // Whether two frames recognize the same point. True for other passes of the
  // same place.
  bool AreSeenAlike(int frame1, int frame2, int identity) const;

 private:
  struct Cut {
    int frame;
    double share;  // of the points that are recognized on both sides
  };

  const uint64_t seed_;
  const int max_gap_;
  std::vector<Cut> cuts_;
};

// Detects features without convoys in as many images as necessary for some
// correct pairs between all consecutive frames: one camera after the other,
// beginning with the same one for each vehicle.
void HideConvoys(const Footage& footage);

}  // namespace mgsfm
