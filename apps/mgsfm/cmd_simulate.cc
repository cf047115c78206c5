// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <filesystem>

#include "base/format.h"
#include "base/text.h"
#include "command.h"
#include "commands.h"
#include "files/file_operations.h"
#include "files/image_writing.h"
#include "files/staged_output.h"
#include "mgsfm/base/error.h"
#include "mgsfm/database/database.h"
#include "mgsfm/models/model_io.h"
#include "mgsfm/models/trajectory_io.h"
#include "mgsfm/priors/pose_priors.h"
#include "mgsfm/rigs/rig_config.h"
#include "mgsfm/simulator/simulation.h"
#include "model_file.h"
#include "rigs/image_times.h"
#include "scene/intrinsics_check.h"
#include "simulator/position_measurement.h"
#include "simulator/rendering.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

enum class TrajectoryFormat { kKitti, kTum };
enum class ImageFormat { kPng, kJpeg };

}  // namespace

template <>
struct EnumTable<DatabaseSchema> {
  static constexpr std::pair<std::string_view, DatabaseSchema> kNames[] = {
      {"3.8", DatabaseSchema::k38}, {"3.12", DatabaseSchema::k312}};
};

template <>
struct EnumTable<ImageFormat> {
  static constexpr std::pair<std::string_view, ImageFormat> kNames[] = {
      {"png", ImageFormat::kPng}, {"jpg", ImageFormat::kJpeg}};
};

template <>
struct EnumTable<PairKind> {
  static constexpr std::pair<std::string_view, PairKind> kNames[] = {
      {"true", PairKind::kTrue},
      {"isolated", PairKind::kIsolatedWrong},
      {"duplicate", PairKind::kDuplicatedStructure},
      {"vehicle", PairKind::kMovingObject}};
};

template <>
struct EnumTable<TrajectoryFormat> {
  static constexpr std::pair<std::string_view, TrajectoryFormat> kNames[] = {
      {"kitti", TrajectoryFormat::kKitti}, {"tum", TrajectoryFormat::kTum}};
};

namespace {

constexpr char kName[] = "simulate";
constexpr char kSummary[] =
    "Simulates a drive: database or images, and ground truth.";

struct SimulateCommandOptions {
  Option<std::string> output_path{
      "output_path", "", Required(),
      "Write database.db or images, the ground-truth model in `truth`, the "
      "kinds of image pairs in pairs.csv and the times of frames in "
      "timestamps.txt into this folder; if cameras do not trigger "
      "simultaneously, also image poses in `truth_images`."};
  Option<SimulationPreset> preset{
      "preset", SimulationPreset::kSmall,
      "Set the defaults of all other options. small: a few frames without "
      "noise. street: a realistic street without noise. standard: street with "
      "noise, mismatches, vehicles and wrong pairs. aliased: standard with "
      "duplicated facades. moderate, hard: aliased with more degradations, "
      "vehicles in convoy, and cuts with few matches."};
  Option<NoiseLevel> level{
      "level", NoiseLevel::kMild,
      "Set the defaults of noise and mismatches of worlds with a path of their "
      "own. none: exact. mild: 10 % mismatches. medium: 25 %, 3 % along "
      "epipolar lines, 1 % wrong pairs."};
  Option<std::string> trajectory_path{"trajectory_path", "",
                                      "Read the poses of the reference camera "
                                      "from this file, instead of `path`."};
  Option<TrajectoryFormat> trajectory_format{
      "trajectory_format", TrajectoryFormat::kKitti,
      "State the format of the trajectory. kitti: a 3x4 matrix per line; tum: "
      "time, position, quaternion."};
  Option<std::string> rig_config_path{
      "rig_config_path", "",
      "Read one rig with the poses, models and parameters of its cameras from "
      "COLMAP's rig_config.json, instead of `rig`. Image sizes are twice the "
      "principal points."};
  Option<DatabaseSchema> database_schema{
      "database_schema", DatabaseSchema::k38,
      "Write the database schema of this COLMAP version; 3.8 has no rigs."};
  Option<bool> render{
      "render", false,
      "Render images of a textured street instead of writing a database; adds "
      "cameras.txt for --ImageReader.camera_params_path. Options of features, "
      "matches and vehicles have no effect."};
  Option<double> render_scale{
      "render_scale", 1.0, GreaterThan(0.0),
      "Scale the images relative to the cameras of the rig."};
  Option<ImageFormat> render_format{"render_format", ImageFormat::kPng,
                                    "Choose the file format of the images."};
  Option<int> render_jpeg_quality{
      "render_jpeg_quality", 95, Between(1, 100),
      "Set the quality of JPEG images; 100 is best."};
  RenderingOptions rendering;
  SimulationOptions simulation;
  PositionMeasurementOptions positions;
  GravityMeasurementOptions gravity;

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(output_path, preset, level, trajectory_path, trajectory_format,
          rig_config_path, database_schema, render, render_scale, render_format,
          render_jpeg_quality, rendering, simulation, positions, gravity);
  }
};

// The image size whose center is the principal point.
std::pair<int, int> ImageSize(CameraModelId model,
                              const std::vector<double>& params) {
  const CameraModelInfo& info = InfoOf(model);
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
    if (!camera.cam_from_rig || !camera.camera_model ||
        !camera.image_pattern.empty()) {
      throw Error(problem + "camera '" + camera.NameRule() +
                  "' needs a prefix, a pose and a camera model");
    }
    const auto [width, height] =
        ImageSize(*camera.camera_model, camera.camera_params);
    const Camera intrinsics{CameraId(1), *camera.camera_model, width, height,
                            camera.camera_params};
    const auto found = FindIntrinsicsProblem(intrinsics);
    if (found && found->is_certain) {
      throw Error(problem + "camera '" + camera.NameRule() + "' " +
                  found->text + "; correct it");
    }
    const auto place = camera.is_reference ? rig.begin() : rig.end();
    rig.insert(place, {camera.image_prefix, *camera.camera_model, width, height,
                       camera.camera_params, *camera.cam_from_rig});
  }
  return rig;
}

SimulationInput ReadInput(const SimulateCommandOptions& options) {
  SimulationInput input;
  if (!options.rig_config_path->empty()) {
    input.rig = ReadRig(options.rig_config_path);
  }
  if (options.trajectory_path->empty()) return input;
  if (options.trajectory_format == TrajectoryFormat::kKitti) {
    input.rig_from_world_path = ReadKittiPoses(*options.trajectory_path);
  } else {
    for (const TimedPose& pose : ReadTumPoses(*options.trajectory_path)) {
      input.rig_from_world_path.push_back(pose.cam_from_world);
      input.timestamps_s.push_back(pose.timestamp_s);
    }
  }
  if (input.rig_from_world_path.empty()) {
    throw Error("'" + *options.trajectory_path + "' contains no pose");
  }
  return input;
}

bool IsSynchronized(const SimulationOptions& options) {
  return options.trigger_jitter_ms == 0.0 && options.trigger_offset_ms == 0.0;
}

// Image poses, which differ from those of the frames by the trigger offsets.
void WriteTrueImages(const Simulation& simulation, const fs::path& folder,
                     const Context& context) {
  fs::create_directory(folder);
  WriteModel(folder, SeparateImages(simulation.scene),
             SeparateImages(simulation.ground_truth,
                            {simulation.cam_from_world.begin(),
                             simulation.cam_from_world.end()}),
             ModelFormat::kBinary, context);
}

void WriteTruth(const Simulation& simulation, const SimulationOptions& options,
                const fs::path& staging_dir, const Context& context) {
  const fs::path truth_path = staging_dir / "truth";
  fs::create_directory(truth_path);
  WriteModelAndRig(truth_path, simulation.scene, simulation.ground_truth,
                   ModelFormat::kBinary, context);
  WriteImageTimestamps(staging_dir / "timestamps.txt", simulation.scene);
  if (!IsSynchronized(options)) {
    WriteTrueImages(simulation, staging_dir / "truth_images", context);
  }
}

// One line per image folder, in the format of feature_extractor.
std::string CameraLines(const Scene& scene) {
  std::string lines;
  for (const Sensor& sensor : scene.sensors) {
    const Camera& camera = scene.cameras[sensor.camera_idx];
    const std::string model(InfoOf(camera.model).name);
    lines += Formatted("%s %s %d %d", sensor.name.c_str(), model.c_str(),
                       camera.width_px, camera.height_px);
    for (const double param : camera.params) {
      lines += ' ' + FormatDouble(param, std::chars_format::general, 17);
    }
    lines += "\n";
  }
  return lines;
}

void RenderImages(const SimulateCommandOptions& options,
                  const StreetRenderer& renderer, const Simulation& simulation,
                  const fs::path& image_path, const Context& context) {
  const std::vector<Image>& images = simulation.scene.images;
  for (size_t i = 0; i < images.size(); ++i) {
    const fs::path path = image_path / images[i].name;
    fs::create_directories(path.parent_path());
    const ColorImage image = renderer.Render(
        images[i].camera_idx, simulation.cam_from_world[i], context);
    WriteColorImage(path, image.width_px, image.height_px, image.rgb,
                    options.render_jpeg_quality);
    context.ReportProgress("simulation: images", i + 1, images.size());
  }
}

void CheckIsNew(const fs::path& path) {
  if (!fs::exists(path)) return;
  throw Error("'" + path.string() + "' exists; choose a new folder");
}

int RunRender(const SimulateCommandOptions& options, const Context& context) {
  const fs::path output_path = *options.output_path;
  StagedOutput output(output_path);  // finishes the output of a killed run
  CheckIsNew(output_path / "images");
  SimulationOptions simulation_options = options.simulation;
  simulation_options.random_seed = context.random_seed;
  SimulationInput input = ReadInput(options);
  input.rig =
      ScaledRig(input.rig.empty() ? MakeRig(simulation_options.rig) : input.rig,
                options.render_scale);
  Simulation simulation =
      SimulateWithoutFeatures(simulation_options, input, context);
  if (options.render_format == ImageFormat::kJpeg) {
    for (Image& image : simulation.scene.images) {
      image.name = fs::path(image.name).replace_extension(".jpg").string();
    }
  }
  const StreetRenderer renderer(simulation_options, input,
                                simulation.scene.cameras, options.rendering,
                                context);
  RenderImages(options, renderer, simulation, output.StagingDir() / "images",
               context);
  WriteFile(output.StagingDir() / "cameras.txt", CameraLines(simulation.scene));
  WriteTruth(simulation, simulation_options, output.StagingDir(), context);
  output.Commit();
  context.Info(Formatted("wrote %zu images, cameras.txt and truth",
                         simulation.scene.images.size()));
  return kExitSuccess;
}

void WritePositions(const Simulation& simulation,
                    const PositionMeasurementOptions& options,
                    const Context& context, const std::string& database_path) {
  const std::vector<PosePriorRow> rows = MakePosePriorRows(
      simulation.scene,
      MeasurePositions(simulation, options, context.random_seed));
  if (rows.empty()) return;
  FeatureDatabase database(database_path, FeatureDatabase::OpenMode::kExisting);
  DatabaseTransaction transaction(&database);
  for (const PosePriorRow& row : rows) database.WritePosePrior(row);
  transaction.Commit();
}

std::string PairKindLines(const Simulation& simulation) {
  std::string lines = "name1,name2,kind,num_matches\n";
  const std::vector<Image>& images = simulation.scene.images;
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    const ImagePair& pair = simulation.view_graph.pairs[i];
    lines +=
        images[pair.image_idx1].name + "," + images[pair.image_idx2].name + ",";
    lines += EnumName(simulation.pair_kinds[i]);
    lines += "," + std::to_string(pair.matches.size()) + "\n";
  }
  return lines;
}

int RunSimulate(const SimulateCommandOptions& options, const Context& context) {
  if (options.render) return RunRender(options, context);
  const fs::path output_path = *options.output_path;
  StagedOutput output(output_path);  // finishes the output of a killed run
  CheckIsNew(output_path / "database.db");
  SimulationOptions simulation_options = options.simulation;
  simulation_options.random_seed = context.random_seed;
  const Simulation simulation =
      Simulate(simulation_options, ReadInput(options), context);

  context.Info("writing " + output_path.string());
  const std::string database_path =
      (output.StagingDir() / "database.db").string();
  WriteDatabase(database_path,
                MakeDatabaseContents(simulation.scene, simulation.view_graph),
                options.database_schema);
  WritePositions(simulation, options.positions, context, database_path);
  const GravityPriors gravity =
      MeasureGravity(simulation, options.gravity, context.random_seed);
  if (!gravity.IsEmpty()) {
    WriteGravity((output.StagingDir() / "gravity.txt").string(),
                 simulation.scene, gravity);
  }
  WriteTruth(simulation, simulation_options, output.StagingDir(), context);
  WriteFile(output.StagingDir() / "pairs.csv", PairKindLines(simulation));
  output.Commit();
  context.Info(Formatted("wrote database.db (%zu images, %zu pairs) and truth",
                         simulation.scene.images.size(),
                         simulation.view_graph.pairs.size()));
  return kExitSuccess;
}

// The options are set twice: first for the preset, then on top of its values.
AllOptions<SimulateCommandOptions> PresetOptions(const OptionSetter& set) {
  AllOptions<SimulateCommandOptions> given, options;
  set(ListOptions(&given));
  const SimulateCommandOptions& preset = given.command;
  const WorldPreset world = preset.simulation.world;
  options.command.simulation =
      world == WorldPreset::kScatter || world == WorldPreset::kStreet
          ? PresetSimulation(preset.preset, SimulationOptions().rig)
          : WorldSimulation(world, preset.level);
  return options;
}

int ParseAndRun(const std::vector<std::string>& arguments) {
  auto options = PresetOptions(
      [&](const OptionList& list) { SetOptions(arguments, list); });
  if (!ParseArguments(kName, kSummary, arguments, ListOptions(&options))) {
    return kExitSuccess;
  }
  return RunSimulate(options.command, MakeTerminalContext(options.common));
}

CommandResult SetAndRun(const OptionSetter& set, const Context& environment) {
  return CallWith(kName, PresetOptions(set), set, environment, RunSimulate);
}

}  // namespace

Command SimulateCommand() {
  Command command = MakeCommand(kName, kSummary, RunSimulate);
  command.run = ParseAndRun;
  command.call = SetAndRun;
  return command;
}

}  // namespace mgsfm
