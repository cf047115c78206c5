// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "command.h"
#include "commands.h"
#include "io/database/database_merging.h"

namespace mgsfm {
namespace {

struct DatabaseMergerOptions {
  Option<std::string> database_path1{"database_path1", "", Required(),
                                     "First database. It is only read."};
  Option<std::string> database_path2{
      "database_path2", "", Required(),
      "Second database, without images of the same name. It is only read."};
  Option<std::string> merged_database_path{
      "merged_database_path", "", Required(),
      "Database to write; it must not exist."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path1, database_path2, merged_database_path);
  }
};

int RunDatabaseMerger(const DatabaseMergerOptions& options,
                      const Context& context) {
  const DatabaseMergeSummary summary =
      MergeDatabases(options.database_path1, options.database_path2,
                     options.merged_database_path, context);
  context.Info("merged: " + std::to_string(summary.num_images) + " images, " +
               std::to_string(summary.num_pairs) + " pairs, " +
               std::to_string(summary.num_rigs) + " rigs");
  return kExitSuccess;
}

}  // namespace

Command DatabaseMergerCommand() {
  return MakeCommand("database_merger",
                     "Merges two databases with different images.",
                     RunDatabaseMerger);
}

}  // namespace mgsfm
