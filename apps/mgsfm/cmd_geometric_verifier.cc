// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "matching/selected_pairs.h"
#include "matching_input.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

int RunGeometricVerifier(const MatchingInputOptions& options,
                         const Context& context) {
  return RunMatcher(
      options, context,
      [&](MatchingInput* input) {
        VerifyMatches(&input->database, input->scene, options.matching,
                      context);
      },
      [&](const MatchingInput& input) {
        return SelectMatched(input.database, input.scene);
      });
}

}  // namespace

Command GeometricVerifierCommand() {
  return MakeResumableCommand(
      "geometric_verifier",
      "Verifies the matches of a database, for any kind of features.",
      RunGeometricVerifier);
}

}  // namespace mgsfm
