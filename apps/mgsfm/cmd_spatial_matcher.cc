// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
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
  MatchingInput input = OpenMatchingInput(options.input, context);
  MatchSpatially(&input.database, input.scene, options.spatial,
                 options.input.matching, context);
  WarnOfFisheyes(input, options.input.matching, context);
  return kExitSuccess;
}

}  // namespace

Command SpatialMatcherCommand() {
  return MakeResumableCommand("spatial_matcher",
                              "Matches images with nearby position priors.",
                              RunSpatialMatcher);
}

}  // namespace mgsfm
