// SPDX-License-Identifier: BSD-3-Clause
#include "command.h"
#include "commands.h"
#include "matching/pair_selection.h"
#include "matching_input.h"
#include "mgsfm/base/error.h"
#include "mgsfm/matching/matching.h"

namespace mgsfm {
namespace {

struct MatchesImporterOptions {
  MatchingInputOptions input;
  Option<std::string> match_list_path{"match_list_path", "", Required(),
                                      "Read pairs or matches from this text "
                                      "file; see docs/reference/formats.md."};
  Option<MatchListType> match_type{
      "match_type", MatchListType::kPairs,
      "Choose the content of the file: pairs to match, raw matches to verify, "
      "or inlier matches that are imported as they are."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(input, match_list_path, match_type);
  }
};

int RunMatchesImporter(const MatchesImporterOptions& options,
                       const Context& context) {
  const bool has_part = !options.input.shard->empty() ||
                        !options.input.output_pairs_path->empty();
  if (has_part && options.match_type != MatchListType::kPairs) {
    throw Error(
        "--shard matches pairs; set --match_type pairs, or import the "
        "matches without --shard");
  }
  return RunMatcher(
      options.input, context,
      [&](MatchingInput* input) {
        ImportMatches(&input->database, input->scene, options.match_list_path,
                      options.match_type, options.input.matching, context);
      },
      [&](const MatchingInput& input) {
        return SelectListed(input.scene, options.match_list_path);
      });
}

}  // namespace

Command MatchesImporterCommand() {
  return MakeResumableCommand("matches_importer",
                              "Imports pairs or matches from a text file.",
                              RunMatchesImporter);
}

}  // namespace mgsfm
