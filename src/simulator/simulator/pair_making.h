// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "simulator/pair_selection.h"
#include "simulator/random_streams.h"
#include "simulator/weak_cuts.h"

namespace mgsfm {

struct MadePair {
  ImagePair pair;
  PairKind kind;
};

// Simulates matching and two-view verification: matches of common points,
// mismatches and outliers, verified matches and the estimated relative pose.
class PairMaker {
 public:
  // Both arguments must outlive this object.
  PairMaker(const Footage& footage, const WeakCuts& weak_cuts)
      : footage_(footage), weak_cuts_(weak_cuts) {}

  // nullopt if there are too few common points or verified matches.
  std::optional<MadePair> Make(const PairPlan& plan) const;

  // The same for matches that follow a relative pose of any kind.
  std::optional<MadePair> Verify(int image1, int image2, PairKind kind,
                                 const Rigid3& cam2_from_cam1,
                                 const std::vector<Match>& raw_matches) const;

  // Converts pixels to an angle, averaged over both images.
  double ErrorInRadians(int image1, int image2, double error_px) const;

 private:
  struct Hypothesis {
    PairKind kind;
    Rigid3 cam2_from_cam1;
    std::vector<Match> inliers;
  };

  void MoveAlongEpipolarLines(const PairPlan& plan,
                              const Rigid3& cam2_from_cam1,
                              std::vector<Match>* matches) const;
  std::optional<MadePair> MakeRandomPair(const PairPlan& plan,
                                         std::vector<Match> matches) const;
  bool Passes(const Rigid3& cam2_from_cam1, int image1, int image2,
              const Match& match, double max_error_rad) const;
  std::vector<Match> Inliers(const Rigid3& cam2_from_cam1, int image1,
                             int image2,
                             const std::vector<Match>& matches) const;
  std::optional<Hypothesis> MotionOfVehicle(
      int image1, int image2, const std::vector<Match>& matches) const;
  MadePair Finish(int image1, int image2, Hypothesis hypothesis) const;
  Rigid3 Estimate(int image1, int image2, const Hypothesis& hypothesis) const;
  bool IsPanoramic(int image1, int image2, const Hypothesis& hypothesis) const;
  Random RandomOfPair(Effect effect, int image1, int image2) const;

  const Footage& footage_;
  const WeakCuts& weak_cuts_;
};

// Verified pairs of images of unrelated places that are not in `plans`, at most
// `num_pairs`. Their matches are consistent with a plausible motion. They
// connect features that fit by chance, and new features appended to the images.
// `maker` must refer to the same footage.
std::vector<MadePair> MakeIsolatedPairs(const Footage& footage,
                                        const PairMaker& maker,
                                        const std::vector<PairPlan>& plans,
                                        int num_pairs, const Context& context);

}  // namespace mgsfm
