// SPDX-License-Identifier: BSD-3-Clause
#include "matching/descriptor_matching.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "matching/nearest_two.h"

namespace mgsfm {
namespace {

using State = RoughDecision::State;

// Descriptors have a norm of 512 up to the rounding of their elements.
constexpr double kSquaredNorm = 512.0 * 512.0;

// Tests whether a descriptor accepts its nearest neighbor.
class Acceptance {
 public:
  explicit Acceptance(const DescriptorMatchingOptions& options)
      : max_ratio_(options.max_ratio), max_distance_(options.max_distance) {}

  bool operator()(double best_dot, double second_dot) const {
    const double distance = Angle(best_dot);
    return distance <= max_distance_ &&
           distance < max_ratio_ * Angle(second_dot);
  }

 private:
  static double Angle(double dot) {
    return std::acos(std::clamp(dot / kSquaredNorm, 0.0, 1.0));
  }
  const double max_ratio_;
  const double max_distance_;
};

// Replaces uncertain decisions by decisions with exact dot products with
// `others`, or by a rejection if `needs(i)` says that no match can depend on
// them.
void SettleUnsure(DescriptorView descriptors, DescriptorView others,
                  const Acceptance& accepts,
                  const std::function<bool(size_t)>& needs,
                  std::vector<RoughDecision>* decisions) {
  std::vector<size_t> unsure;
  std::vector<uint8_t> values;
  for (size_t i = 0; i < decisions->size(); ++i) {
    if ((*decisions)[i].state != State::kUnsure) continue;
    if (!needs(i)) {
      (*decisions)[i] = {State::kRejects, std::nullopt};
      continue;
    }
    unsure.push_back(i);
    values.insert(values.end(), descriptors.Row(i), descriptors.Row(i + 1));
  }
  if (unsure.empty()) return;
  std::vector<TwoNearest> nearest, nearest_of_others;
  FindTwoNearest({values.data(), unsure.size()}, others, &nearest,
                 &nearest_of_others);
  for (size_t k = 0; k < unsure.size(); ++k) {
    const TwoNearest& two = nearest[k];
    if (two.best_idx == TwoNearest::kNone) {
      (*decisions)[unsure[k]] = {State::kRejects, std::nullopt};
      continue;
    }
    const bool accepted = accepts(two.best_dot, two.second_dot);
    (*decisions)[unsure[k]] = {accepted ? State::kAccepts : State::kRejects,
                               two.best_idx};
  }
}

// The decisions of all descriptors; no decision that a match depends on is
// uncertain.
RoughDecisions DecideAll(DescriptorView descriptors1,
                         DescriptorView descriptors2,
                         const DescriptorMatchingOptions& options) {
  const Acceptance accepts(options);
  auto decisions = DecideRoughly(descriptors1, descriptors2, accepts);
  if (!decisions) {
    decisions.emplace();
    decisions->of_1.resize(descriptors1.size);
    decisions->of_2.resize(descriptors2.size);
  }
  auto& of_1 = decisions->of_1;
  auto& of_2 = decisions->of_2;
  // With cross_check, a match also depends on the decision of the partner.
  const auto may_pair = [&](const std::vector<RoughDecision>& others,
                            const RoughDecision& decision, size_t i) {
    if (!options.cross_check || !decision.best_idx) return true;
    const RoughDecision& other = others[*decision.best_idx];
    return other.state != State::kRejects &&
           (!other.best_idx || *other.best_idx == static_cast<int32_t>(i));
  };
  SettleUnsure(
      descriptors1, descriptors2, accepts,
      [&](size_t i) { return may_pair(of_2, of_1[i], i); }, &of_1);
  SettleUnsure(
      descriptors2, descriptors1, accepts,
      [&](size_t j) {
        return options.cross_check && may_pair(of_1, of_2[j], j);
      },
      &of_2);
  return std::move(*decisions);
}

}  // namespace

std::vector<Match> MatchDescriptors(DescriptorView descriptors1,
                                    DescriptorView descriptors2,
                                    const DescriptorMatchingOptions& options) {
  const auto max_size = static_cast<size_t>(options.max_num_matches);
  descriptors1.size = std::min(descriptors1.size, max_size);
  descriptors2.size = std::min(descriptors2.size, max_size);
  const RoughDecisions decisions =
      DecideAll(descriptors1, descriptors2, options);
  std::vector<Match> matches;
  for (size_t i = 0; i < decisions.of_1.size(); ++i) {
    const RoughDecision& decision = decisions.of_1[i];
    if (decision.state != State::kAccepts) continue;
    if (options.cross_check) {
      const RoughDecision& back = decisions.of_2[*decision.best_idx];
      if (back.state != State::kAccepts ||
          *back.best_idx != static_cast<int32_t>(i)) {
        continue;
      }
    }
    matches.push_back(
        {static_cast<uint32_t>(i), static_cast<uint32_t>(*decision.best_idx)});
  }
  return matches;
}

}  // namespace mgsfm
