// SPDX-License-Identifier: BSD-3-Clause
#include <benchmark/benchmark.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "geometry/epipolar.h"
#include "math/union_find.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/database/database.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"
#include "mgsfm/tracks/track_establishment.h"
#include "mgsfm/view_graph/view_graph_estimation.h"
#include "micro/groups.h"

namespace mgsfm {
namespace {

constexpr double kMaxErrorRad = 3e-3;

Context Threads(int num_threads) {
  Context context;
  context.num_threads = num_threads;
  return context;
}

// A street observed by a stereo rig, created on first use.
const Simulation& Street() {
  static const Simulation street = [] {
    SimulationOptions options = StandardSimulation(RigPreset::kStereo);
    options.num_frames = 150;
    return Simulate(options);
  }();
  return street;
}

size_t NumMatches(const ViewGraph& view_graph) {
  size_t num_matches = 0;
  for (const ImagePair& pair : view_graph.pairs) {
    num_matches += pair.matches.size();
  }
  return num_matches;
}

// The rays of all matches and their relative pose.
struct PairRays {
  RayMatches matches;
  Rigid3 cam2_from_cam1;
};

std::vector<PairRays> GatherRays(const Simulation& street) {
  const Bearings bearings = ComputeBearings(street.scene, 1);
  std::vector<PairRays> pairs;
  for (const ImagePair& pair : street.view_graph.pairs) {
    const std::optional<RelativePose>& pose = pair.relative_pose;
    if (!pose || !pose->translation_direction) continue;
    PairRays rays;
    rays.cam2_from_cam1 = {pose->cam2_from_cam1, *pose->translation_direction};
    for (const Match& match : pair.matches) {
      rays.matches.Add(bearings.Ray(pair.image_idx1, match.keypoint_idx1),
                       bearings.Ray(pair.image_idx2, match.keypoint_idx2));
    }
    pairs.push_back(std::move(rays));
  }
  return pairs;
}

// Items: matches.
template <class Function>
void OverPairs(benchmark::State* state, const Function& function) {
  const std::vector<PairRays> pairs = GatherRays(Street());
  int64_t num_matches = 0;
  for (const PairRays& pair : pairs) {
    num_matches += static_cast<int64_t>(pair.matches.size());
  }
  for (auto _ : *state) {
    for (const PairRays& pair : pairs) function(pair);
  }
  state->SetItemsProcessed(state->iterations() * num_matches);
}

void TestInliers(benchmark::State& state) {
  OverPairs(&state, [](const PairRays& pair) {
    benchmark::DoNotOptimize(
        FindInliers(pair.matches, pair.cam2_from_cam1, kMaxErrorRad));
  });
}

void ScorePoses(benchmark::State& state) {
  OverPairs(&state, [](const PairRays& pair) {
    benchmark::DoNotOptimize(
        ScoreRelativePose(pair.matches, pair.cam2_from_cam1, kMaxErrorRad));
  });
}

void RefinePoses(benchmark::State& state) {
  OverPairs(&state, [](const PairRays& pair) {
    Rigid3 pose = pair.cam2_from_cam1;
    benchmark::DoNotOptimize(
        RefineRelativePose(pair.matches, PoseRefinementOptions(), &pose));
  });
}

void EstimateRelativePoses(benchmark::State& state) {
  const Simulation& street = Street();
  const Bearings bearings = ComputeBearings(street.scene, 1);
  const Context context = Threads(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(EstimateViewGraph(street.scene, bearings,
                                               street.view_graph, {}, context));
  }
  state.SetItemsProcessed(state.iterations() *
                          static_cast<int64_t>(street.view_graph.pairs.size()));
}

void MakeRaysOfKeypoints(benchmark::State& state) {
  const Simulation& street = Street();
  int64_t num_keypoints = 0;
  for (const Image& image : street.scene.images) {
    num_keypoints += static_cast<int64_t>(image.keypoints_px.size());
  }
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        ComputeBearings(street.scene, static_cast<int>(state.range(0))));
  }
  state.SetItemsProcessed(state.iterations() * num_keypoints);
}

// Items: matches, merged in the order of the pairs.
void JoinSets(benchmark::State& state) {
  const Simulation& street = Street();
  std::vector<size_t> first = {0};
  for (const Image& image : street.scene.images) {
    first.push_back(first.back() + image.keypoints_px.size());
  }
  for (auto _ : state) {
    UnionFind sets(first.back());
    for (const ImagePair& pair : street.view_graph.pairs) {
      for (const Match& match : pair.matches) {
        sets.Union(first[pair.image_idx1] + match.keypoint_idx1,
                   first[pair.image_idx2] + match.keypoint_idx2);
      }
    }
    benchmark::DoNotOptimize(sets.Find(0));
  }
  state.SetItemsProcessed(state.iterations() *
                          static_cast<int64_t>(NumMatches(street.view_graph)));
}

void JoinTracks(benchmark::State& state) {
  const Simulation& street = Street();
  const Mask all(street.view_graph.pairs.size(), true);
  const Context context = Threads(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(
        EstablishTracks(street.scene, street.view_graph, all, {}, context));
  }
  state.SetItemsProcessed(state.iterations() *
                          static_cast<int64_t>(NumMatches(street.view_graph)));
}

// A temporary folder, removed by the destructor.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name =
        (std::filesystem::temp_directory_path() / "mgsfm_micro_XXXXXX")
            .string();
    if (mkdtemp(name.data()) == nullptr) {
      throw Error("no folder can be made in '" + name + "'");
    }
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

// Items: matches.
void ReadDatabases(benchmark::State& state) {
  const Simulation& street = Street();
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "database.db").string();
  WriteDatabase(path, MakeDatabaseContents(street.scene, street.view_graph),
                DatabaseSchema::k38);
  const Context context = Threads(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    benchmark::DoNotOptimize(LoadScene(path, {}, context));
  }
  state.SetItemsProcessed(state.iterations() *
                          static_cast<int64_t>(NumMatches(street.view_graph)));
  state.SetBytesProcessed(
      state.iterations() *
      static_cast<int64_t>(std::filesystem::file_size(path)));
}

void Register(const char* name, void (*run)(benchmark::State&),
              bool has_threads) {
  auto* registered =
      benchmark::RegisterBenchmark(name, run)->Unit(benchmark::kMillisecond);
  if (!has_threads) return;
  registered->UseRealTime()->ArgName("threads")->Arg(1)->Arg(2);
}

}  // namespace

void RegisterMatchingBenchmarks() {
  Register("read_database", ReadDatabases, true);
  Register("rays_of_keypoints", MakeRaysOfKeypoints, true);
  Register("inlier_test", TestInliers, false);
  Register("score_relative_pose", ScorePoses, false);
  Register("refine_relative_pose", RefinePoses, false);
  Register("estimate_view_graph", EstimateRelativePoses, true);
  Register("union_find", JoinSets, false);
  Register("establish_tracks", JoinTracks, true);
}

}  // namespace mgsfm
