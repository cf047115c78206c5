// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "matching_input.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

struct MatchesImporterOptions {
  MatchingInputOptions input;
  std::string match_list_path;
  MatchListType match_type = MatchListType::kPairs;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    MatchingInputOptions::Describe(self.input, visit);
    visit("match_list_path", self.match_list_path, Required(), "",
          "Text file of pairs or matches, see docs/reference/formats.md.");
    visit("match_type", self.match_type, AnyValue(), "",
          "Content of the file: pairs to match, raw matches to verify, or "
          "inlier matches that are imported as they are.");
  }
};

int RunMatchesImporter(const MatchesImporterOptions& options,
                       const Context& context) {
  MatchingInput input = OpenMatchingInput(options.input, context);
  ImportMatches(&input.database, input.scene, options.match_list_path,
                options.match_type, options.input.matching, context);
  return kExitSuccess;
}

}  // namespace

Command MatchesImporterCommand() {
  return MakeResumableCommand("matches_importer",
                              "Imports pairs or matches from a text file.",
                              RunMatchesImporter);
}

}  // namespace mgsfm
