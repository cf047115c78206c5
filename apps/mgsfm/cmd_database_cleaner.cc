// SPDX-License-Identifier: BSD-3-Clause
#include <string>

#include "command.h"
#include "commands.h"
#include "database/database_cleaning.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

struct DatabaseCleanerOptions {
  Option<std::string> database_path{"database_path", "", Required(),
                                    "Change this COLMAP database."};
  Option<std::string> type{
      "type", "", Required(),
      "Delete these rows: matches (and two-view geometries), features (and "
      "matches), images (and features, frames and priors) or all."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(database_path, type);
  }
};

CleanedRows ParseType(const std::string& name) {
  for (const auto& [type_name, rows] : EnumTable<CleanedRows>::kNames) {
    if (type_name == name) return rows;
  }
  throw Error("unknown --type '" + name +
              "'; choose all, images, features or matches");
}

int RunDatabaseCleaner(const DatabaseCleanerOptions& options,
                       const Context& context) {
  CleanDatabase(options.database_path, ParseType(options.type));
  context.Info("deleted from " + *options.database_path + ": " + *options.type);
  return kExitSuccess;
}

}  // namespace

Command DatabaseCleanerCommand() {
  return MakeCommand(
      "database_cleaner",
      "Deletes matches, features, images or everything from a database.",
      RunDatabaseCleaner);
}

}  // namespace mgsfm
