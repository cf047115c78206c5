// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "matching/pair_selection.h"
#include "matching_input.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

struct ExhaustiveMatcherOptions {
  MatchingInputOptions input;
  ExhaustiveMatchingOptions exhaustive;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input);
    visit.Group("ExhaustiveMatching", exhaustive);
  }
};

int RunExhaustiveMatcher(const ExhaustiveMatcherOptions& options,
                         const Context& context) {
  return RunMatcher(
      options.input, context,
      [&](MatchingInput* input) {
        MatchExhaustively(&input->database, input->scene, options.exhaustive,
                          options.input.matching, context);
      },
      [&](const MatchingInput& input) {
        return SelectExhaustively(input.scene);
      });
}

}  // namespace

Command ExhaustiveMatcherCommand() {
  return MakeResumableCommand("exhaustive_matcher",
                              "Matches all pairs of images.",
                              RunExhaustiveMatcher);
}

}  // namespace mgsfm
