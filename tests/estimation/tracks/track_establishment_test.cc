// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/tracks/track_establishment.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <tuple>
#include <vector>

#include "base/random.h"
#include "mgsfm/base/mask.h"
#include "mgsfm/simulator/simulation.h"

namespace mgsfm {
namespace {

using Group = std::vector<Observation>;

std::vector<Group> ToVectors(const ObservationGroups& groups) {
  std::vector<Group> result;
  for (size_t i = 0; i < groups.size(); ++i) {
    result.emplace_back(groups.begin(i), groups.end(i));
  }
  return result;
}

// Images that have nothing but keypoints far apart from each other.
Scene MakeScene(int num_images, int num_keypoints) {
  Scene scene;
  scene.images.resize(num_images, Image{ImageId(1), "", 0, 0, 0, {}});
  for (Image& image : scene.images) {
    for (int i = 0; i < num_keypoints; ++i) {
      image.keypoints_px.emplace_back(100.0f * i, 0.0f);
    }
  }
  return scene;
}

struct TestMatch {
  Observation observation1, observation2;
};

ViewGraph MakeViewGraph(const std::vector<TestMatch>& matches) {
  std::map<std::pair<int, int>, std::set<std::pair<int, int>>> by_pair;
  for (const TestMatch& match : matches) {
    const auto [a, b] = std::minmax(match.observation1, match.observation2);
    by_pair[{a.image_idx, b.image_idx}].insert(
        {a.keypoint_idx, b.keypoint_idx});
  }
  ViewGraph view_graph;
  for (const auto& [images, keypoints] : by_pair) {
    ImagePair pair;
    pair.image_idx1 = images.first;
    pair.image_idx2 = images.second;
    for (const auto& [keypoint1, keypoint2] : keypoints) {
      pair.matches.push_back(
          {static_cast<uint32_t>(keypoint1), static_cast<uint32_t>(keypoint2)});
    }
    view_graph.pairs.push_back(pair);
  }
  return view_graph;
}

// A chain of matches through observations.
void AddChain(const Group& observations, std::vector<TestMatch>* matches) {
  for (size_t i = 1; i < observations.size(); ++i) {
    matches->push_back({observations[i - 1], observations[i]});
  }
}

void AddClique(const Group& observations, std::vector<TestMatch>* matches) {
  for (size_t i = 0; i < observations.size(); ++i) {
    for (size_t j = 0; j < i; ++j) {
      matches->push_back({observations[j], observations[i]});
    }
  }
}

TrackOptions KeepAll() {
  TrackOptions options;
  options.min_track_length = 2;
  return options;
}

ObservationGroups Candidates(const Scene& scene, const ViewGraph& view_graph,
                             const Context& context = {}) {
  return EstablishCandidates(scene, view_graph,
                             {Mask(view_graph.pairs.size(), true), {}},
                             KeepAll(), context);
}

TrackResult Establish(const Scene& scene, const ViewGraph& view_graph,
                      const TrackOptions& options = KeepAll(),
                      const Context& context = {}) {
  return EstablishTracks(scene, view_graph, Mask(view_graph.pairs.size(), true),
                         options, context);
}

void ExpectConsistent(const ObservationGroups& candidates,
                      const TrackResult& result) {
  const ObservationGroups& tracks = result.estimate;
  std::map<Observation, size_t> candidate_of;
  for (size_t i = 0; i < candidates.size(); ++i) {
    for (const Observation* o = candidates.begin(i); o != candidates.end(i);
         ++o) {
      EXPECT_TRUE(candidate_of.emplace(*o, i).second);
    }
  }
  std::set<Observation> seen;
  for (size_t i = 0; i < tracks.size(); ++i) {
    EXPECT_GE(tracks.length(i), 2u);
    for (const Observation* o = tracks.begin(i); o != tracks.end(i); ++o) {
      EXPECT_TRUE(seen.insert(*o).second);
      EXPECT_EQ(candidate_of.at(*o), candidate_of.at(*tracks.begin(i)));
      if (o == tracks.begin(i)) continue;
      EXPECT_LT((o - 1)->image_idx, o->image_idx);
    }
    EXPECT_TRUE(i == 0 || *tracks.begin(i - 1) < *tracks.begin(i));
  }
  EXPECT_LE(tracks.size(), candidates.size());
  EXPECT_EQ(result.summary.num_tracks, tracks.size());
  EXPECT_EQ(result.summary.num_observations, tracks.observations.size());
}

// Reference implementation on maps and sets, without duplicate keypoints.
class BruteForce {
 public:
  explicit BruteForce(const ViewGraph& view_graph) {
    for (const ImagePair& pair : view_graph.pairs) {
      for (const Match& match : pair.matches) {
        const Observation a{pair.image_idx1,
                            static_cast<int>(match.keypoint_idx1)};
        const Observation b{pair.image_idx2,
                            static_cast<int>(match.keypoint_idx2)};
        neighbors_[a].insert(b);
        neighbors_[b].insert(a);
        matches_.push_back({a, b, pair.matches.size()});
      }
    }
  }

  size_t NumComponents() const {
    size_t num_components = 0;
    std::set<Observation> seen;
    for (const auto& [start, unused] : neighbors_) {
      if (seen.count(start) > 0) continue;
      std::set<Observation> component;
      std::vector<Observation> stack = {start};
      while (!stack.empty()) {
        const Observation observation = stack.back();
        stack.pop_back();
        if (!component.insert(observation).second) continue;
        for (const Observation& next : neighbors_.at(observation)) {
          stack.push_back(next);
        }
      }
      seen.insert(component.begin(), component.end());
      ++num_components;
    }
    return num_components;
  }

  std::vector<Group> Tracks() const {
    std::vector<std::tuple<long, long, Observation, Observation>> order;
    std::map<Observation, std::set<Observation>> set_of;
    for (const auto& [a, b, num_pair_matches] : matches_) {
      long support = 0;
      for (const Observation& c : neighbors_.at(a)) {
        support += neighbors_.at(b).count(c);
      }
      order.emplace_back(-support, -static_cast<long>(num_pair_matches), a, b);
      set_of[a] = {a};
      set_of[b] = {b};
    }
    std::sort(order.begin(), order.end());
    for (const auto& [support, num, a, b] : order) {
      std::set<Observation> joined = set_of[a];
      joined.insert(set_of[b].begin(), set_of[b].end());
      std::set<int> images;
      for (const Observation& o : joined) images.insert(o.image_idx);
      if (images.size() < joined.size()) continue;
      for (const Observation& o : joined) set_of[o] = joined;
    }
    std::set<std::set<Observation>> sets;
    for (const auto& [unused, set] : set_of) {
      if (set.size() > 1) sets.insert(set);
    }
    std::vector<Group> tracks;
    for (const auto& set : sets) tracks.emplace_back(set.begin(), set.end());
    return tracks;
  }

 private:
  std::map<Observation, std::set<Observation>> neighbors_;
  std::vector<std::tuple<Observation, Observation, size_t>> matches_;
};

TEST(TrackEstablishmentTest, AgreesWithBruteForceOnRandomGraphs) {
  for (uint64_t seed = 0; seed < 100; ++seed) {
    Random random(1, seed);
    const int num_images = 3 + static_cast<int>(random.Index(8));
    const int num_keypoints = 5 + static_cast<int>(random.Index(20));
    const uint32_t num_matches = random.Index(150) + 5;
    std::vector<TestMatch> matches;
    while (matches.size() < num_matches) {
      const Observation a{static_cast<int>(random.Index(num_images)),
                          static_cast<int>(random.Index(num_keypoints))};
      Observation b{static_cast<int>(random.Index(num_images)),
                    static_cast<int>(random.Index(num_keypoints))};
      if (random.Uniform() < 0.7) b.keypoint_idx = a.keypoint_idx;
      if (a.image_idx != b.image_idx) matches.push_back({a, b});
    }
    const ViewGraph view_graph = MakeViewGraph(matches);
    const Scene scene = MakeScene(num_images, num_keypoints);
    const TrackResult result = Establish(scene, view_graph);
    const ObservationGroups candidates = Candidates(scene, view_graph);
    ExpectConsistent(candidates, result);
    const BruteForce brute_force(view_graph);
    EXPECT_EQ(result.summary.num_components, brute_force.NumComponents());
    EXPECT_EQ(ToVectors(candidates), brute_force.Tracks());
    EXPECT_EQ(ToVectors(result.estimate), brute_force.Tracks());
  }
}

TEST(TrackEstablishmentTest, FindsTheTracksOfASimulation) {
  SimulationOptions options;
  options.num_frames = 8;
  const Simulation simulation = Simulate(options);
  const TrackResult result = Establish(simulation.scene, simulation.view_graph);
  ExpectConsistent(Candidates(simulation.scene, simulation.view_graph), result);
  EXPECT_EQ(result.summary.num_components_with_conflicts, 0u);
  std::map<Observation, size_t> point_of;
  for (size_t i = 0; i < simulation.ground_truth.points.size(); ++i) {
    for (const Observation& o : simulation.ground_truth.points[i].track) {
      point_of[o] = i;
    }
  }
  for (const Group& track : ToVectors(result.estimate)) {
    for (const Observation& o : track) {
      EXPECT_EQ(point_of.at(o), point_of.at(track[0]));
    }
  }
  EXPECT_GT(result.summary.num_tracks, 100u);
}

TEST(TrackEstablishmentTest, WrongMatchDoesNotDestroyTracks) {
  const Group track1 = {{0, 0}, {1, 0}, {2, 0}, {3, 0}};
  const Group track2 = {{0, 1}, {1, 1}, {2, 1}, {4, 1}};
  std::vector<TestMatch> matches;
  AddClique(track1, &matches);
  AddClique(track2, &matches);
  matches.push_back({{3, 0}, {4, 1}});
  const TrackResult result = Establish(MakeScene(5, 2), MakeViewGraph(matches));
  EXPECT_EQ(result.summary.num_components, 1u);
  EXPECT_EQ(result.summary.num_components_with_conflicts, 1u);
  EXPECT_EQ(ToVectors(result.estimate), (std::vector<Group>{track1, track2}));
}

TEST(TrackEstablishmentTest, DuplicateKeypointsAreOne) {
  Scene scene = MakeScene(4, 2);
  // Keypoint 1 of image 1 is keypoint 0 with another orientation.
  scene.images[1].keypoints_px[1] =
      scene.images[1].keypoints_px[0] + Eigen::Vector2f(0.5f, 1.0f);
  std::vector<TestMatch> matches;
  AddClique({{0, 0}, {1, 1}, {2, 0}, {3, 0}}, &matches);
  matches.push_back({{0, 0}, {1, 0}});
  const ViewGraph view_graph = MakeViewGraph(matches);
  const TrackResult joined = Establish(scene, view_graph);
  ExpectConsistent(Candidates(scene, view_graph), joined);
  EXPECT_EQ(ToVectors(joined.estimate),
            (std::vector<Group>{{{0, 0}, {1, 1}, {2, 0}, {3, 0}}}));
}

TEST(TrackEstablishmentTest, UnusedPairsAreNotUsed) {
  std::vector<TestMatch> matches;
  AddChain({{0, 0}, {1, 0}, {2, 0}}, &matches);
  const ViewGraph view_graph = MakeViewGraph(matches);
  const TrackResult result =
      EstablishTracks(MakeScene(3, 1), view_graph, {1, 0}, KeepAll(), {});
  EXPECT_EQ(ToVectors(result.estimate), (std::vector<Group>{{{0, 0}, {1, 0}}}));
}

std::vector<int> CountPerImage(const ObservationGroups& tracks,
                               size_t num_images) {
  std::vector<int> counts(num_images, 0);
  for (const Observation& o : tracks.observations) ++counts[o.image_idx];
  return counts;
}

TEST(TrackEstablishmentTest, SelectionKeepsEveryImageConstrained) {
  SimulationOptions simulation_options;
  simulation_options.num_frames = 10;
  const Simulation simulation = Simulate(simulation_options);
  const size_t num_images = simulation.scene.images.size();
  const std::vector<int> all = CountPerImage(
      Establish(simulation.scene, simulation.view_graph).estimate, num_images);

  TrackOptions options;
  options.min_track_length = 8;
  options.min_tracks_per_image = 40;
  const TrackResult few_short =
      Establish(simulation.scene, simulation.view_graph, options);
  ExpectConsistent(Candidates(simulation.scene, simulation.view_graph),
                   few_short);
  const auto with_minimum = CountPerImage(few_short.estimate, num_images);
  for (size_t i = 0; i < num_images; ++i) {
    EXPECT_GE(with_minimum[i], std::min(40, all[i]));
  }

  options.min_track_length = 3;
  options.max_tracks_per_image = 60;
  const TrackResult capped =
      Establish(simulation.scene, simulation.view_graph, options);
  ExpectConsistent(Candidates(simulation.scene, simulation.view_graph), capped);
  const auto with_maximum = CountPerImage(capped.estimate, num_images);
  for (size_t i = 0; i < num_images; ++i) {
    EXPECT_GE(with_maximum[i], std::min(40, all[i]));
  }
  EXPECT_LT(capped.summary.num_tracks,
            num_images * options.max_tracks_per_image / 2);
  EXPECT_GT(capped.summary.mean_track_length, 3.0);
}

TEST(TrackEstablishmentTest, OrderOfMatchesAndThreadsDoNotMatter) {
  SimulationOptions options;
  options.num_frames = 8;
  options.mismatch_ratio = 0.1;
  Simulation simulation = Simulate(options);
  const TrackResult result = Establish(simulation.scene, simulation.view_graph);
  const ObservationGroups candidates =
      Candidates(simulation.scene, simulation.view_graph);
  EXPECT_GT(result.summary.num_components_with_conflicts, 0u);
  Random random(5);
  for (ImagePair& pair : simulation.view_graph.pairs) {
    for (size_t i = pair.matches.size(); i > 1; --i) {
      std::swap(pair.matches[i - 1],
                pair.matches[random.Index(static_cast<uint32_t>(i))]);
    }
  }
  std::reverse(simulation.view_graph.pairs.begin(),
               simulation.view_graph.pairs.end());
  Context context;
  context.num_threads = 3;
  const TrackResult shuffled =
      Establish(simulation.scene, simulation.view_graph, KeepAll(), context);
  EXPECT_EQ(
      ToVectors(candidates),
      ToVectors(Candidates(simulation.scene, simulation.view_graph, context)));
  EXPECT_EQ(ToVectors(result.estimate), ToVectors(shuffled.estimate));
}

// Images of `num_points` points in each of two places, connected by one wrong
// image pair only, whose matches each join two points.
struct TwoPlaces {
  static constexpr int kImagesOfPlace = 5;
  static constexpr int kNumPoints = 60;

  TwoPlaces() {
    for (const int first : {0, kImagesOfPlace}) {
      for (int point = 0; point < kNumPoints; ++point) {
        Group track;
        for (int i = 0; i < kImagesOfPlace; ++i) {
          track.push_back({first + i, point});
        }
        AddClique(track, &matches);
        tracks.push_back(track);
      }
    }
    for (int point = 0; point < kNumPoints; ++point) {
      matches.push_back({{1, point}, {kImagesOfPlace + 1, point}});
    }
    std::sort(tracks.begin(), tracks.end());
  }

  Scene MakeScene() const {
    return mgsfm::MakeScene(2 * kImagesOfPlace, kNumPoints + 1);
  }

  std::vector<TestMatch> matches;
  std::vector<Group> tracks;  // the true ones
};

TEST(TrackEstablishmentTest, WrongPairDoesNotJoinTwoPlaces) {
  const TwoPlaces places;
  const ViewGraph view_graph = MakeViewGraph(places.matches);
  const TrackResult result = Establish(places.MakeScene(), view_graph, {});
  EXPECT_EQ(ToVectors(result.estimate), places.tracks);
  EXPECT_EQ(Candidates(places.MakeScene(), view_graph).size(),
            places.tracks.size() / 2);
}

TEST(TrackEstablishmentTest, ImageWithFewTracksKeepsAllMatches) {
  TwoPlaces places;
  // Another image of the first place, matched with one image only.
  const int last = 2 * TwoPlaces::kImagesOfPlace;
  for (int point = 0; point < 20; ++point) {
    places.matches.push_back({{0, point}, {last, point}});
    auto track = std::find_if(places.tracks.begin(), places.tracks.end(),
                              [&](const Group& group) {
                                return group[0] == Observation{0, point};
                              });
    track->push_back({last, point});
  }
  const Scene scene = MakeScene(last + 1, TwoPlaces::kNumPoints);
  const TrackResult result =
      Establish(scene, MakeViewGraph(places.matches), {});
  EXPECT_EQ(ToVectors(result.estimate), places.tracks);
}

// Without any triplet, all matches are used.
TEST(TrackEstablishmentTest, ChainsAreTracks) {
  std::vector<TestMatch> matches;
  std::vector<Group> tracks;
  for (int point = 0; point < 30; ++point) {
    tracks.push_back({{0, point}, {1, point}, {2, point}, {3, point}});
    AddChain(tracks.back(), &matches);
  }
  const TrackResult result =
      Establish(MakeScene(4, 30), MakeViewGraph(matches), {});
  EXPECT_EQ(ToVectors(result.estimate), tracks);
}

TEST(TrackEstablishmentTest, NoMatchesGiveNoTracks) {
  const TrackResult result = Establish(MakeScene(3, 4), ViewGraph());
  EXPECT_EQ(result.summary.num_components, 0u);
  EXPECT_EQ(result.summary.num_tracks, 0u);
  EXPECT_EQ(Establish(Scene(), ViewGraph()).summary.num_tracks, 0u);
}

// The points of a model stand for its matches: the joined groups are the
// components of the graph of new matches and of the tracks of points.
TEST(JoinPointsTest, JoinsWhatSharesKeypoints) {
  const Scene scene = MakeScene(5, 4);
  const auto point = [](const Group& track) {
    Point3D point;
    point.track = track;
    return point;
  };
  const std::vector<Point3D> points = {point({{0, 0}, {1, 0}}),
                                       point({{1, 1}, {2, 1}}),
                                       point({{0, 3}, {2, 3}})};
  ObservationGroups candidates;
  for (const Group& group : {Group{{1, 0}, {3, 0}}, Group{{2, 1}, {3, 1}},
                             Group{{0, 0}, {4, 2}}, Group{{3, 2}, {4, 3}}}) {
    candidates.AddGroup(group.data(), group.data() + group.size());
  }
  const std::vector<Group> joined = {{{0, 0}, {1, 0}, {3, 0}, {4, 2}},
                                     {{1, 1}, {2, 1}, {3, 1}},
                                     {{3, 2}, {4, 3}}};
  EXPECT_EQ(ToVectors(JoinPoints(scene, candidates, points, false)), joined);
  std::vector<Group> with_others = joined;
  with_others.push_back({{0, 3}, {2, 3}});
  EXPECT_EQ(ToVectors(JoinPoints(scene, candidates, points, true)),
            with_others);
}

}  // namespace
}  // namespace mgsfm
