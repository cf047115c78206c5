// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "command.h"
#include "commands.h"
#include "matching_input.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

// Those of the matchers without the ones for descriptors, which are not read.
struct GeometricVerifierOptions {
  Option<std::string> database_path{
      "database_path", "", Required(),
      "COLMAP database with matches. Adds two-view geometries; pairs that have "
      "them are skipped."};
  SceneLoadingOptions loading;
  TwoViewGeometryOptions two_view_geometry;
  RigVerificationOptions rig_verification;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, loading);
    visit.Group("TwoViewGeometry", two_view_geometry);
    visit.Group("FeatureMatching", rig_verification);
  }
};

int RunGeometricVerifier(const GeometricVerifierOptions& options,
                         const Context& context) {
  MatchingInputOptions matching;
  matching.database_path = options.database_path;
  matching.loading = options.loading;
  matching.matching.two_view_geometry = options.two_view_geometry;
  matching.matching.rig_verification = options.rig_verification;
  MatchingInput input = OpenMatchingInput(matching, context);
  VerifyMatches(&input.database, input.scene, matching.matching, context);
  WarnOfFisheyes(input, matching.matching, context);
  return kExitSuccess;
}

}  // namespace

Command GeometricVerifierCommand() {
  return MakeResumableCommand(
      "geometric_verifier",
      "Verifies the matches of a database, for any kind of features.",
      RunGeometricVerifier);
}

}  // namespace mgsfm
