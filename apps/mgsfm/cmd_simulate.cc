// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>

#include "command.h"
#include "commands.h"
#include "mgsfm/io/database.h"
#include "mgsfm/io/model_io.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {

template <>
struct EnumTable<DatabaseSchema> {
  static constexpr std::pair<std::string_view, DatabaseSchema> kNames[] = {
      {"3.8", DatabaseSchema::k38}, {"3.12", DatabaseSchema::k312}};
};

namespace {

struct SimulateCommandOptions {
  std::string output_path;
  DatabaseSchema database_schema = DatabaseSchema::k38;
  SimulationOptions simulation;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("output_path", self.output_path, Required(), "",
          "Folder for database.db and the ground truth, a model in `truth`.");
    visit("database_schema", self.database_schema, AnyValue(), "",
          "COLMAP version whose tables are written; 3.8 has no rigs.");
    SimulationOptions::Describe(self.simulation, visit);
  }
};

int RunSimulate(const SimulateCommandOptions& options, const Context& context) {
  SimulationOptions simulation_options = options.simulation;
  simulation_options.random_seed = context.random_seed;
  const Simulation simulation = Simulate(simulation_options);

  const std::filesystem::path output_path = options.output_path;
  const std::filesystem::path truth_path = output_path / "truth";
  std::error_code error;
  std::filesystem::create_directories(truth_path, error);
  if (error) {
    throw Error("cannot create the folder '" + truth_path.string() +
                "': " + error.message());
  }
  const std::filesystem::path database_path = output_path / "database.db";
  WriteDatabase(database_path.string(),
                MakeDatabaseContents(simulation.scene, simulation.view_graph),
                options.database_schema);
  WriteModel(truth_path, simulation.scene, simulation.ground_truth,
             ModelFormat::kBinary);
  context.Info("wrote " + database_path.string() + " (" +
               std::to_string(simulation.scene.images.size()) + " images, " +
               std::to_string(simulation.view_graph.pairs.size()) +
               " pairs) and " + truth_path.string());
  return kExitSuccess;
}

}  // namespace

Command SimulateCommand() {
  return MakeCommand("simulate",
                     "Writes a database of a simulated drive, and its truth.",
                     RunSimulate);
}

}  // namespace mgsfm
