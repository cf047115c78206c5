// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
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
  MatchingInput input = OpenMatchingInput(options.input, context);
  MatchExhaustively(&input.database, input.scene, options.exhaustive,
                    options.input.matching, context);
  WarnOfFisheyes(input, options.input.matching, context);
  return kExitSuccess;
}

}  // namespace

Command ExhaustiveMatcherCommand() {
  return MakeResumableCommand("exhaustive_matcher",
                              "Matches all pairs of images.",
                              RunExhaustiveMatcher);
}

}  // namespace mgsfm
