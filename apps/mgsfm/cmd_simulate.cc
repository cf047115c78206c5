// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <filesystem>

#include "command.h"
#include "commands.h"
#include "mgsfm/base/error.h"
#include "mgsfm/io/database.h"
#include "mgsfm/io/model_io.h"
#include "mgsfm/io/rig_config.h"
#include "mgsfm/io/staged_output.h"
#include "mgsfm/io/trajectory_io.h"
#include "mgsfm/synthetic/simulation.h"

namespace mgsfm {
namespace {

enum class SimulationPreset { kSmall, kStreet, kStandard, kAliased };
enum class TrajectoryFormat { kKitti, kTum };

}  // namespace

template <>
struct EnumTable<DatabaseSchema> {
  static constexpr std::pair<std::string_view, DatabaseSchema> kNames[] = {
      {"3.8", DatabaseSchema::k38}, {"3.12", DatabaseSchema::k312}};
};

template <>
struct EnumTable<SimulationPreset> {
  static constexpr std::pair<std::string_view, SimulationPreset> kNames[] = {
      {"small", SimulationPreset::kSmall},
      {"street", SimulationPreset::kStreet},
      {"standard", SimulationPreset::kStandard},
      {"aliased", SimulationPreset::kAliased}};
};

template <>
struct EnumTable<TrajectoryFormat> {
  static constexpr std::pair<std::string_view, TrajectoryFormat> kNames[] = {
      {"kitti", TrajectoryFormat::kKitti}, {"tum", TrajectoryFormat::kTum}};
};

namespace {

constexpr char kName[] = "simulate";
constexpr char kSummary[] =
    "Writes a database of a simulated drive, and its truth.";

struct SimulateCommandOptions {
  std::string output_path;
  SimulationPreset preset = SimulationPreset::kSmall;
  std::string trajectory_path;
  TrajectoryFormat trajectory_format = TrajectoryFormat::kKitti;
  std::string rig_config_path;
  DatabaseSchema database_schema = DatabaseSchema::k38;
  SimulationOptions simulation;

  template <class Self, class Visitor>
  static void Describe(Self& self, Visitor& visit) {
    visit("output_path", self.output_path, Required(), "",
          "Folder for database.db and the ground truth, a model in `truth`.");
    visit("preset", self.preset, AnyValue(), "",
          "Defaults of what follows. small: a few exact frames, as shown. "
          "street: a realistic street without noise. standard: the same with "
          "noise, mismatches, vehicles and wrong pairs. aliased: the same with "
          "duplicated facades.");
    visit("trajectory_path", self.trajectory_path, AnyValue(), "",
          "File with the poses of the reference camera, instead of `path`.");
    visit("trajectory_format", self.trajectory_format, AnyValue(), "",
          "kitti: a 3x4 matrix a line; tum: time, position, quaternion.");
    visit("rig_config_path", self.rig_config_path, AnyValue(), "",
          "COLMAP's rig_config.json instead of `rig`: one rig with the poses, "
          "models and parameters of its cameras. Principal points are taken "
          "for the centres of the images.");
    visit("database_schema", self.database_schema, AnyValue(), "",
          "COLMAP version whose tables are written; 3.8 has no rigs.");
    SimulationOptions::Describe(self.simulation, visit);
  }
};

SimulationOptions OptionsOf(SimulationPreset preset) {
  const RigPreset rig = SimulationOptions().rig;
  switch (preset) {
    case SimulationPreset::kSmall:
      return {};
    case SimulationPreset::kStreet:
      return StreetSimulation(rig);
    case SimulationPreset::kStandard:
      return StandardSimulation(rig);
    case SimulationPreset::kAliased:
      return AliasedSimulation(rig);
  }
  return {};
}

// The image size that the parameters tell.
std::pair<int, int> ImageSize(CameraModelId model,
                              const std::vector<double>& params) {
  const CameraModelInfo& info = *FindCameraModel(static_cast<int32_t>(model));
  const std::vector<int>& center = info.principal_point_idxs;
  const auto round = [](double x) { return static_cast<int>(std::lround(x)); };
  if (center.size() != 2) return {round(params[0]), round(params[1])};
  return {round(2.0 * params[center[0]]), round(2.0 * params[center[1]])};
}

std::vector<SimulatedCamera> ReadRig(const std::string& path) {
  const std::vector<RigConfig> rigs = ReadRigConfig(path);
  const std::string problem = "rig configuration '" + path + "': ";
  if (rigs.size() != 1) {
    throw Error(problem + "has " + std::to_string(rigs.size()) +
                " rigs; one rig can be simulated");
  }
  std::vector<SimulatedCamera> rig;
  for (const RigConfigCamera& camera : rigs.front().cameras) {
    if (!camera.cam_from_rig || !camera.camera_model) {
      throw Error(problem + "camera '" + camera.image_prefix +
                  "' has no pose or no camera model; a simulation needs both");
    }
    const auto [width, height] =
        ImageSize(*camera.camera_model, camera.camera_params);
    const auto place = camera.is_reference ? rig.begin() : rig.end();
    rig.insert(place, {camera.image_prefix, *camera.camera_model, width, height,
                       camera.camera_params, *camera.cam_from_rig});
  }
  return rig;
}

SimulationInput ReadInput(const SimulateCommandOptions& options) {
  SimulationInput input;
  if (!options.rig_config_path.empty()) {
    input.rig = ReadRig(options.rig_config_path);
  }
  if (options.trajectory_path.empty()) return input;
  if (options.trajectory_format == TrajectoryFormat::kKitti) {
    input.rig_from_world_path = ReadKittiPoses(options.trajectory_path);
  } else {
    for (const TimedPose& pose : ReadTumPoses(options.trajectory_path)) {
      input.rig_from_world_path.push_back(pose.cam_from_world);
      input.timestamps_s.push_back(pose.timestamp_s);
    }
  }
  if (input.rig_from_world_path.empty()) {
    throw Error("'" + options.trajectory_path + "' holds no pose");
  }
  return input;
}

int RunSimulate(const SimulateCommandOptions& options, const Context& context) {
  const std::filesystem::path output_path = options.output_path;
  if (std::filesystem::exists(output_path / "database.db")) {
    throw Error("'" + (output_path / "database.db").string() +
                "' exists already; name a new folder");
  }
  StagedOutput output(output_path);
  SimulationOptions simulation_options = options.simulation;
  simulation_options.random_seed = context.random_seed;
  const Simulation simulation =
      Simulate(simulation_options, ReadInput(options), context);

  context.Info("writing " + output_path.string());
  WriteDatabase((output.StagingDir() / "database.db").string(),
                MakeDatabaseContents(simulation.scene, simulation.view_graph),
                options.database_schema);
  const std::filesystem::path truth_path = output.StagingDir() / "truth";
  std::filesystem::create_directory(truth_path);
  WriteModel(truth_path, simulation.scene, simulation.ground_truth,
             ModelFormat::kBinary, context);
  WriteRigConfig((truth_path / "rig_config.json").string(), simulation.scene,
                 simulation.ground_truth);
  output.Commit();
  context.Info("wrote database.db (" +
               std::to_string(simulation.scene.images.size()) + " images, " +
               std::to_string(simulation.view_graph.pairs.size()) +
               " pairs) and truth");
  return kExitSuccess;
}

// The arguments are parsed twice: for the preset, and on top of it. The first
// time nothing is asked for but that they can be read.
int ParseAndRun(const std::vector<std::string>& arguments) {
  AllOptions<SimulateCommandOptions> preset;
  SetOptions(arguments, ListOptions(&preset));
  AllOptions<SimulateCommandOptions> options;
  options.command.simulation = OptionsOf(preset.command.preset);
  if (!ParseArguments(kName, kSummary, arguments, ListOptions(&options))) {
    return kExitSuccess;
  }
  return RunSimulate(options.command, MakeTerminalContext(options.common));
}

}  // namespace

Command SimulateCommand() {
  Command command = MakeCommand(kName, kSummary, RunSimulate);
  command.run = ParseAndRun;
  return command;
}

}  // namespace mgsfm
