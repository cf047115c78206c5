// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "matching/pair_selection.h"
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
  return RunMatcher(
      options.input, context,
      [&](MatchingInput* input) {
        MatchSequentially(&input->database, input->scene, options.sequential,
                          options.vocabulary, options.input.matching, context);
      },
      [&](const MatchingInput& input) {
        return SelectSequentially(input.database, input.scene,
                                  options.sequential, options.vocabulary,
                                  options.input.matching, context);
      });
}

}  // namespace

Command SequentialMatcherCommand() {
  return MakeResumableCommand(
      "sequential_matcher",
      "Matches consecutive images of a moving rig and closes loops.",
      RunSequentialMatcher);
}

}  // namespace mgsfm
