// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "matching/pair_selection.h"
#include "matching_input.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

struct SpatialMatcherOptions {
  MatchingInputOptions input;
  SpatialMatchingOptions spatial;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input);
    visit.Group("SpatialMatching", spatial);
  }
};

int RunSpatialMatcher(const SpatialMatcherOptions& options,
                      const Context& context) {
  return RunMatcher(
      options.input, context,
      [&](MatchingInput* input) {
        MatchSpatially(&input->database, input->scene, options.spatial,
                       options.input.matching, context);
      },
      [&](const MatchingInput& input) {
        return SelectSpatially(input.database, input.scene, options.spatial,
                               context);
      });
}

}  // namespace

Command SpatialMatcherCommand() {
  return MakeResumableCommand("spatial_matcher",
                              "Matches images with nearby position priors.",
                              RunSpatialMatcher);
}

}  // namespace mgsfm
