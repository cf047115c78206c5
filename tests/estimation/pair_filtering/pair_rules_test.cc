// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <iterator>
#include <set>
#include <string_view>

#include "mgsfm/base/error.h"
#include "mgsfm/pair_filtering/pair_filtering.h"

namespace mgsfm {
namespace {

TEST(PairRules, HaveANameAReasonAndAnOptionOfTheirOwn) {
  std::set<std::string_view> names, options;
  std::set<RejectionReason> reasons;
  const PairFilteringOptions defaults;
  for (const PairRule& rule : kPairRules) {
    names.insert(rule.name);
    reasons.insert(rule.reason);
    options.insert((defaults.*rule.option).Info().name);
    EXPECT_FALSE(rule.rejects.empty()) << rule.name;
    EXPECT_FALSE(rule.stage.empty()) << rule.name;
  }
  EXPECT_EQ(names.size(), std::size(kPairRules));
  EXPECT_EQ(reasons.size(), std::size(kPairRules));
  EXPECT_EQ(options.size(), std::size(kPairRules));
  EXPECT_LE(std::size(kPairRules), 10u);
}

TEST(PairRules, AnOptionSwitchesOffNoOtherRule) {
  for (const PairRule& rule : kPairRules) {
    PairFilteringOptions options;
    for (const PairRule& other : kPairRules) options.*other.option = true;
    options.*rule.option = false;
    for (const PairRule& other : kPairRules) {
      EXPECT_EQ(IsRuleOn(other.reason, options), other.reason != rule.reason)
          << rule.name << ", " << other.name;
    }
  }
}

TEST(PairRules, OtherReasonsAreNoRules) {
  EXPECT_THROW(
      (void)IsRuleOn(RejectionReason::kNoRelativePose, PairFilteringOptions()),
      ContractError);
}

TEST(PairRules, PairsOfFixedRegionsAreCountedWithThoseOfTheViewGraph) {
  const PairVerdicts verdicts = {RejectionReason::kAmbiguousMotion,
                                 std::nullopt};
  for (const RejectionCount& count : CountRejections(verdicts, 5)) {
    const size_t expected = count.reason == RejectionReason::kFixedRegion ? 5u
                            : count.reason == RejectionReason::kAmbiguousMotion
                                ? 1u
                                : 0u;
    EXPECT_EQ(count.num_pairs, expected) << EnumName(count.reason);
  }
}

}  // namespace
}  // namespace mgsfm
