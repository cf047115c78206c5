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

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    MatchingInputOptions::Describe(self.input, visit);
    visit.Group("SpatialMatching", self.spatial);
  }
};

int RunSpatialMatcher(const SpatialMatcherOptions& options,
                      const Context& context) {
  MatchingInput input = OpenMatchingInput(options.input, context);
  MatchSpatially(&input.database, input.scene, options.spatial,
                 options.input.matching, context);
  return kExitSuccess;
}

}  // namespace

Command SpatialMatcherCommand() {
  return MakeResumableCommand("spatial_matcher",
                              "Matches images with nearby position priors.",
                              RunSpatialMatcher);
}

}  // namespace mgsfm
