// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "matching/pair_selection.h"
#include "matching_input.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

struct VocabTreeMatcherOptions {
  MatchingInputOptions input;
  VocabTreeMatchingOptions retrieval;
  VocabularyOptions vocabulary;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input);
    visit.Group("VocabTreeMatching", retrieval);
    visit.Group("VocabTree", vocabulary);
  }
};

int RunVocabTreeMatcher(const VocabTreeMatcherOptions& options,
                        const Context& context) {
  return RunMatcher(
      options.input, context,
      [&](MatchingInput* input) {
        MatchByVocabulary(&input->database, input->scene, options.retrieval,
                          options.vocabulary, options.input.matching, context);
      },
      [&](const MatchingInput& input) {
        return SelectByVocabulary(input.database, input.scene,
                                  options.retrieval, options.vocabulary,
                                  context);
      });
}

}  // namespace

Command VocabTreeMatcherCommand() {
  return MakeResumableCommand("vocab_tree_matcher",
                              "Matches each image with the most similar ones.",
                              RunVocabTreeMatcher);
}

}  // namespace mgsfm
