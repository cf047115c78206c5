// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "matching_input.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

struct SequentialMatcherOptions {
  MatchingInputOptions input;
  SequentialMatchingOptions sequential;
  VocabularyOptions vocabulary;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input);
    visit.Group("SequentialMatching", sequential);
    visit.Group("VocabTree", vocabulary);
  }
};

int RunSequentialMatcher(const SequentialMatcherOptions& options,
                         const Context& context) {
  MatchingInput input = OpenMatchingInput(options.input, context);
  MatchSequentially(&input.database, input.scene, options.sequential,
                    options.vocabulary, options.input.matching, context);
  WarnOfFisheyes(input, options.input.matching, context);
  return kExitSuccess;
}

}  // namespace

Command SequentialMatcherCommand() {
  return MakeResumableCommand(
      "sequential_matcher",
      "Matches consecutive images of a moving rig and closes loops.",
      RunSequentialMatcher);
}

}  // namespace mgsfm
