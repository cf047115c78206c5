// SPDX-License-Identifier: BSD-3-Clause
// Prints the table of docs/reference/simulation.md: the real database
// kitti06_stereo, the simulation of the same frames, and simulated drives. The
// argument is the data folder, see support/shared_data.h.
#include <filesystem>
#include <iostream>

#include "mgsfm/base/timer.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/models/trajectory_io.h"
#include "mgsfm/simulator/simulation.h"
#include "simulator/match_statistics.h"

namespace mgsfm {
namespace {

MatchStatistics OfRealData(const std::filesystem::path& folder) {
  const LoadedScene loaded =
      LoadScene((folder / "database.db").string(), {}, {});
  const std::vector<Rigid3> cam0_from_world =
      ReadKittiPoses(folder / "gt_poses.txt");
  const std::vector<Rigid3> cam_from_cam0 =
      ReadKittiCalibration(folder / "calib.txt");
  std::vector<Rigid3> cam_from_world;
  for (const Image& image : loaded.scene.images) {
    const int number = std::stoi(loaded.scene.frames[image.frame_idx].name);
    cam_from_world.push_back(cam_from_cam0[image.sensor_idx] *
                             cam0_from_world[number]);
  }
  return ComputeMatchStatistics(loaded.scene, loaded.view_graph,
                                cam_from_world);
}

// Errors among the verified matches of correct pairs.
struct WrongShares {
  double to_another_point = 0.0;
  double on_vehicles = 0.0;
  double raw_to_another_point = 0.0;
};

WrongShares FindWrongShares(const Simulation& simulation) {
  WrongShares shares;
  double num_matches = 0.0, num_raw = 0.0;
  for (size_t i = 0; i < simulation.pair_kinds.size(); ++i) {
    if (simulation.pair_kinds[i] != PairKind::kTrue) continue;
    const ImagePair& pair = simulation.view_graph.pairs[i];
    const std::vector<int>& points1 =
        simulation.keypoint_points[pair.image_idx1];
    const std::vector<int>& points2 =
        simulation.keypoint_points[pair.image_idx2];
    for (const Match& match : pair.matches) {
      const int point1 = points1[match.keypoint_idx1];
      const bool is_wrong = point1 != points2[match.keypoint_idx2];
      shares.on_vehicles += point1 < 0 ? 1.0 : 0.0;
      shares.to_another_point += point1 >= 0 && is_wrong ? 1.0 : 0.0;
      num_matches += 1.0;
    }
    for (const Match& match : AllMatches(pair)) {
      const bool is_wrong =
          points1[match.keypoint_idx1] != points2[match.keypoint_idx2];
      shares.raw_to_another_point += is_wrong ? 1.0 : 0.0;
      num_raw += 1.0;
    }
  }
  shares.to_another_point /= num_matches;
  shares.on_vehicles /= num_matches;
  shares.raw_to_another_point /= num_raw;
  return shares;
}

void Add(const std::string& title, const Simulation& simulation,
         std::vector<std::string>* titles,
         std::vector<MatchStatistics>* statistics) {
  titles->push_back(title);
  statistics->push_back(ComputeMatchStatistics(
      simulation.scene, simulation.view_graph, simulation.cam_from_world));
  size_t num_wrong = 0, num_duplicated = 0, num_moving = 0;
  for (const PairKind kind : simulation.pair_kinds) {
    num_wrong += kind == PairKind::kIsolatedWrong ? 1 : 0;
    num_duplicated += kind == PairKind::kDuplicatedStructure ? 1 : 0;
    num_moving += kind == PairKind::kMovingObject ? 1 : 0;
  }
  const WrongShares wrong = FindWrongShares(simulation);
  std::cerr << title << ": of the matches of true pairs, wrong "
            << wrong.to_another_point << " (raw " << wrong.raw_to_another_point
            << "), on vehicles " << wrong.on_vehicles << "; pairs isolated "
            << num_wrong << ", duplicated " << num_duplicated
            << ", of a vehicle " << num_moving << ", points "
            << simulation.world_points.size() << "\n";
}

int Run(const std::filesystem::path& data) {
  Context context;
  context.num_threads = 2;
  std::vector<std::string> titles = {"real 06, 51 frames"};
  std::vector<MatchStatistics> statistics = {
      OfRealData(data / "kitti06_stereo")};
  const std::vector<Rigid3> path =
      ReadKittiPoses(data / "kitti06_stereo/gt_poses.txt");
  SimulationOptions options = StreetSimulation(RigPreset::kStereo);
  options.pixel_noise_px = 0.7;
  Add("the same frames, noise only", Simulate(options, path, context), &titles,
      &statistics);
  options = AliasedSimulation(RigPreset::kStereo);
  Add("the same frames, aliased", Simulate(options, path, context), &titles,
      &statistics);
  options.frame_step = 2;
  for (const RigPreset rig : {RigPreset::kStereo, RigPreset::kKitti360}) {
    options.rig = rig;
    for (const char* name : {"04", "07"}) {
      const Timer timer;
      const Simulation simulation =
          Simulate(options,
                   ReadKittiPoses(data / "kitti_trajectories" /
                                  (name + std::string(".txt"))),
                   context);
      std::cerr << timer.Seconds() << " s\n";
      Add(std::string(name) + ", every 2nd, " + std::string(EnumName(rig)),
          simulation, &titles, &statistics);
    }
  }
  std::cout << ToMarkdown(titles, statistics);
  return 0;
}

}  // namespace
}  // namespace mgsfm

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: print_match_statistics FOLDER_OF_DATA\n";
    return 1;
  }
  return mgsfm::Run(argv[1]);
}
