// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "command.h"
#include "commands.h"
#include "matching/pair_selection.h"
#include "matching_input.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

// The options of the matchers, except those for descriptors, which are not
// read.
struct GeometricVerifierOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "Add two-view geometries to this COLMAP database with matches; pairs "
      "that have them are skipped."};
  Option<std::string> shard = MatchingInputOptions().shard;
  Option<std::string> shard_path = MatchingInputOptions().shard_path;
  Option<std::string> output_pairs_path =
      MatchingInputOptions().output_pairs_path;
  SceneLoadingOptions loading;
  TwoViewGeometryOptions two_view_geometry;
  RigVerificationOptions rig_verification;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, shard, shard_path, output_pairs_path, loading);
    visit.Group("TwoViewGeometry", two_view_geometry);
    visit.Group("FeatureMatching", rig_verification);
  }
};

int RunGeometricVerifier(const GeometricVerifierOptions& options,
                         const Context& context) {
  MatchingInputOptions matching;
  matching.database_path = options.database_path;
  matching.shard = options.shard;
  matching.shard_path = options.shard_path;
  matching.output_pairs_path = options.output_pairs_path;
  matching.loading = options.loading;
  matching.matching.two_view_geometry = options.two_view_geometry;
  matching.matching.rig_verification = options.rig_verification;
  return RunMatcher(
      matching, context,
      [&](MatchingInput* input) {
        VerifyMatches(&input->database, input->scene, matching.matching,
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
