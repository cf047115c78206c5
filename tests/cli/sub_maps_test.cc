// SPDX-License-Identifier: BSD-3-Clause
// Clusters of a drive, mapped one by one and joined.
#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "base/random.h"
#include "cli/shared_drive.h"
#include "geometry/geodetic.h"
#include "mgsfm/models/model_io.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;
using Json = nlohmann::json;

class SubMapCommands : public SharedDriveTest {
 protected:
  static void SetUpTestSuite() { SimulateLoop(); }
  CommandOutput Run(const std::string& arguments) const {
    const CommandOutput output = RunMgsfm(arguments);
    EXPECT_EQ(output.exit_code, 0) << arguments << output.err;
    return output;
  }
  Json Partition(int num_clusters) const {
    Run("mapper --partition " + std::to_string(num_clusters) +
        " --partition_overlap 4 --database_path " + Database() +
        " --output_path " + Path("clusters"));
    return Json::parse(ReadTextFile(Path("clusters/clusters.json")));
  }
  void Map(const Json& clusters, int cluster, const std::string& more) const {
    const std::string list = clusters["clusters"][cluster]["image_list"];
    Run("mapper --write_report 0 --database_path " + Database() +
        " --image_list_path " + Path("clusters/" + list) + " --output_path " +
        Path("maps/" + std::to_string(cluster)) + more);
  }
  // All clusters but `failing`, with the calibration of the first.
  void MapAll(const Json& clusters, int failing = -1,
              const std::string& more = "") const {
    fs::create_directory(Path("maps"));
    const int first = clusters["calibration_clusters"][0];
    Map(clusters, first, more);
    const auto num_clusters = static_cast<int>(clusters["clusters"].size());
    for (int i = 0; i < num_clusters; ++i) {
      if (i == first || i == failing) continue;
      Map(clusters, i,
          " --BundleAdjustment.refine_sensor_from_rig yes --rig_config_path " +
              Path("maps/" + std::to_string(first) + "/0") + more);
    }
  }
  std::string JoinTo(const std::string& name) const {
    return "model_merger --graph 1 --cluster_path " + Path("clusters") +
           " --input_path " + Path("maps") + " --database_path " + Database() +
           " --output_path " + Path(name);
  }
  CommandOutput Join() const { return Run(JoinTo("joined")); }
  double MeanError(const std::string& model) const {
    return Evaluate(Path(model))["position_m"]["mean"].get<double>();
  }
  // The command must end without output, and state the text.
  void ExpectRefused(const std::string& arguments,
                     const std::string& text) const {
    const CommandOutput refused = RunMgsfm(arguments);
    EXPECT_NE(refused.exit_code, 0) << arguments;
    EXPECT_THAT(LastWord(refused), HasSubstr(text)) << arguments;
    EXPECT_FALSE(fs::exists(Path("refused"))) << arguments;
  }
  Json Evaluate(const std::string& model) const {
    Run("model_evaluator --input_path " + model + " --gt_path " + In() +
        "/truth --json " + Path("errors.json"));
    return Json::parse(ReadTextFile(Path("errors.json")));
  }
  void ExpectAsGood(const std::string& model,
                    const std::string& reference) const {
    const Json errors = Evaluate(model);
    const Json reference_errors = Evaluate(reference);
    EXPECT_EQ(errors["num_registered"], reference_errors["num_registered"]);
    EXPECT_LT(errors["position_m"]["mean"].get<double>(),
              1.1 * reference_errors["position_m"]["mean"].get<double>());
  }
  // Joins two clusters in `finished`, and adds the third one in `joined`.
  // Returns the report.
  Json ExtendFinished(const std::string& more) const {
    MapAll(Partition(3), -1, more);
    fs::create_directory(Path("new"));
    fs::rename(Path("maps/2"), Path("new/0"));
    const std::string join =
        "model_merger --graph 1 --database_path " + Database() + more;
    Run(join + " --input_path " + Path("maps") + " --output_path " +
        Path("finished"));
    Run(join + " --input_path " + Path("new") + " --existing_path " +
        Path("finished") + "/ --output_path " + Path("joined"));
    return Json::parse(ReadTextFile(Path("joined/report.json")));
  }
  void ExpectThatFinishedFramesStay() const {
    std::map<std::string, Rigid3> joined;
    for (const ModelImage& image : ReadModelPoses(Path("joined/0")).images) {
      joined.emplace(image.name, image.cam_from_world);
    }
    EXPECT_EQ(joined.size(), 120u);
    for (const ModelImage& image : ReadModelPoses(Path("finished/0")).images) {
      // Files have poses of images, which are rounded once more.
      EXPECT_LT((joined.at(image.name).Center() - image.cam_from_world.Center())
                    .norm(),
                1e-9);
    }
    EXPECT_EQ(ReadTextFile(Path("joined/0/rig_config.json")),
              ReadTextFile(Path("finished/0/rig_config.json")));
  }
  // Maps all images at once for comparison.
  void ExpectAsGoodAsSingleModel(const std::string& model) const {
    Run("mapper --write_report 0 --database_path " + Database() +
        " --output_path " + Path("single"));
    ExpectAsGood(model, Path("single/0"));
  }
};

TEST_F(SubMapCommands, JoinedClustersAreAsGoodAsOneModel) {
  const Json clusters = Partition(3);
  ASSERT_EQ(clusters["clusters"].size(), 3u);
  MapAll(clusters);
  Join();
  ExpectAsGoodAsSingleModel(Path("joined/0"));
  const Json report = Json::parse(ReadTextFile(Path("joined/report.json")));
  EXPECT_EQ(report["sub_maps"].size(), 3u);
  EXPECT_TRUE(report["missing_clusters"].empty());
}

TEST_F(SubMapCommands, LimitOfMemorySelectsTracks) {
  MapAll(Partition(3));
  Join();
  const std::string join = JoinTo("small") + " --max_memory ";
  const CommandOutput refused = RunMgsfm(join + "80");
  EXPECT_EQ(refused.exit_code, 1);
  const std::string message = LastWord(refused);
  EXPECT_THAT(message, HasSubstr("--max_memory allows 80; allow more"));
  EXPECT_FALSE(fs::exists(Path("small")));
  const std::string about = "needs about ";
  const CommandOutput output =
      Run(join + message.substr(message.find(about) + about.size(), 2));
  EXPECT_THAT(output.err, HasSubstr("selects tracks"));
  // A third of the observations wait: errors grow by the root of 3/2.
  const Json errors = Evaluate(Path("small/0"));
  const Json reference = Evaluate(Path("joined/0"));
  EXPECT_EQ(errors["num_registered"], reference["num_registered"]);
  EXPECT_LT(errors["position_m"]["mean"].get<double>(),
            1.25 * reference["position_m"]["mean"].get<double>());
  const auto num_observations = [&](const std::string& name) {
    const Json report = Json::parse(ReadTextFile(Path(name + "/report.json")));
    return report["models"][0]["num_observations"].get<double>();
  };
  EXPECT_GT(num_observations("small"), 0.97 * num_observations("joined"));
}

// One cluster is added to the model of the others, which stays as it is.
TEST_F(SubMapCommands, FinishedMapIsExtended) {
  const Json report = ExtendFinished("");
  const Json& finished = report["models"][0]["finished_map"];
  EXPECT_TRUE(finished["frames_are_fixed"]) << finished;
  EXPECT_EQ(report["sub_maps"][0]["path"], Path("finished/0"));
  EXPECT_FALSE(report["sub_maps"][0].contains("cluster"));
  EXPECT_EQ(report["sub_maps"][1]["cluster"], 0);
  ExpectThatFinishedFramesStay();
  // Two thirds of the observations determine the map, so that its errors are
  // the root of 3/2 of those by all.
  const double error = MeanError("joined/0");
  fs::rename(Path("finished"), Path("new/1"));
  Run("model_merger --graph 1 --database_path " + Database() +
      " --input_path " + Path("new") + " --output_path " + Path("all"));
  EXPECT_LT(error, 1.25 * MeanError("all/0"));
}

// Two clusters beside one do not fit the limit, but one beside two does.
TEST_F(SubMapCommands, FinishedMapStaysWithinALimitOfMemory) {
  MapAll(Partition(3));
  fs::rename(Path("maps/0"), Path("finished"));
  const std::string join = "model_merger --graph 1 --database_path " +
                           Database() + " --input_path " + Path("maps") +
                           " --existing_path " + Path("finished");
  const std::string to_output = " --output_path " + Path("joined");
  Run(join + to_output);
  const double error = MeanError("joined/0");
  fs::rename(Path("joined"), Path("unlimited"));
  const std::string message =
      LastWord(RunMgsfm(join + " --max_memory 80" + to_output));
  EXPECT_THAT(message, HasSubstr("allow more"));
  const std::string about = "needs about ";
  const std::string limit =
      " --max_memory " + message.substr(message.find(about) + about.size(), 2);
  const CommandOutput output = Run(join + limit + to_output);
  EXPECT_THAT(output.err, HasSubstr("selects tracks"));
  const Json report = Json::parse(ReadTextFile(Path("joined/report.json")));
  EXPECT_TRUE(report["models"][0]["finished_map"]["frames_are_fixed"]);
  ExpectThatFinishedFramesStay();
  // A third of the observations wait: errors grow by the root of 3/2.
  EXPECT_LT(MeanError("joined/0"), 1.25 * error);
  fs::create_directory(Path("two"));
  fs::rename(Path("finished"), Path("two/0"));
  fs::rename(Path("maps/1"), Path("two/1"));
  fs::rename(Path("joined"), Path("selected"));
  Run("model_merger --graph 1 --database_path " + Database() +
      " --input_path " + Path("two") + " --output_path " + Path("finished"));
  EXPECT_THAT(Run(join + limit + to_output).err,
              Not(HasSubstr("selects tracks")));
  ExpectThatFinishedFramesStay();
}

TEST_F(SubMapCommands, FinishedMapIsRefusedWithBadOptions) {
  Run("model_splitter --input_path " + In() + "/truth --output_path " +
      Path("maps") + " --num_clusters 2 --num_overlap_frames 4");
  fs::create_directory(Path("finished"));
  fs::rename(Path("maps/0"), Path("finished/0"));
  fs::create_directory(Path("empty"));
  const std::string existing = " --existing_path " + Path("finished");
  const std::string to_output = " --output_path " + Path("refused");
  const std::string join = "model_merger --graph 1 --input_path ";
  for (const std::string input : {"empty", "missing"}) {
    const CommandOutput output =
        RunMgsfm(join + Path(input) + existing + to_output);
    EXPECT_EQ(output.exit_code, 2);
    EXPECT_THAT(output.err, HasSubstr("'" + Path(input) +
                                      "' has no model of any cluster; check "
                                      "--input_path"));
    EXPECT_FALSE(fs::exists(Path("refused")));
  }
  ExpectRefused(
      join + Path("maps") + " --existing_path " + Path("empty") + to_output,
      "has no model; set --existing_path");
  ExpectRefused(join + Path("finished") + existing + to_output,
                "move it out of the folder --input_path");
  ExpectRefused(
      "model_merger --input_path " + Path("maps") + existing + to_output,
      "set --graph 1");
  for (const std::string map : {"", "/", "/0/"}) {
    ExpectRefused(join + Path("maps") + existing + map + " --output_path " +
                      Path("finished"),
                  "holds the finished map; choose another --output_path");
  }
  EXPECT_FALSE(fs::exists(Path("finished/report.json")));
}

TEST_F(SubMapCommands, FinishedMapThatNothingConnectsIsReported) {
  Run("model_splitter --input_path " + In() + "/truth --output_path " +
      Path("parts") + " --num_clusters 5 --num_overlap_frames 3");
  const auto names = [&](const std::string& part) {
    std::set<std::string> found;
    for (const ModelImage& image : ReadModelPoses(Path(part)).images) {
      found.insert(image.name);
    }
    return found;
  };
  const std::set<std::string> finished = names("parts/0");
  fs::create_directory(Path("maps"));
  for (int i = 1; i < 5; ++i) {
    const std::string part = "parts/" + std::to_string(i);
    const std::set<std::string> others = names(part);
    const bool is_apart = std::none_of(
        others.begin(), others.end(),
        [&](const std::string& name) { return finished.count(name) > 0; });
    if (!is_apart) continue;
    fs::rename(Path(part), Path("maps/0"));
    break;
  }
  fs::rename(Path("parts/0"), Path("finished"));
  const CommandOutput output =
      Run("model_merger --graph 1 --input_path " + Path("maps") +
          " --existing_path " + Path("finished") + " --output_path " +
          Path("joined"));
  EXPECT_THAT(output.err, HasSubstr("nothing connects the finished map '" +
                                    Path("finished") + "' of --existing_path"));
  EXPECT_THAT(output.err, HasSubstr("set --database_path"));
  const Json report = Json::parse(ReadTextFile(Path("joined/report.json")));
  ASSERT_EQ(report["models"].size(), 2u);
  for (const Json& model : report["models"]) {
    const bool is_map = model["sub_maps"][0] == 0;
    ASSERT_EQ(model.contains("finished_map"), is_map);
    if (!is_map) continue;
    EXPECT_TRUE(model["finished_map"]["frames_are_fixed"]);
    EXPECT_TRUE(model["finished_map"]["bend"].is_null());
  }
}

TEST_F(SubMapCommands, FailedClusterIsReportedAndTheRestDelivered) {
  const Json clusters = Partition(4);
  const int failing = clusters["calibration_clusters"][0] == 0 ? 1 : 0;
  MapAll(clusters, failing);
  const CommandOutput output = Join();
  EXPECT_THAT(output.err, HasSubstr("there is no model in '" +
                                    Path("maps/" + std::to_string(failing))));
  const Json report = Json::parse(ReadTextFile(Path("joined/report.json")));
  EXPECT_EQ(report["missing_clusters"].size(), 1u);
  EXPECT_GT(Evaluate(Path("joined/0"))["num_registered"], 60);
}

// Two circles of 15 m radius, joined by a street of 40 m, in steps of 2 m. The
// camera looks along the path.
std::string DrawDistricts() {
  constexpr double kRadius = 15.0, kStreet = 40.0, kStep = 2.0;
  const double circle = 2.0 * std::acos(-1.0) * kRadius;
  std::ostringstream poses;
  poses.precision(12);
  for (double s = 0.0; s < 2.0 * circle + kStreet; s += kStep) {
    // Left of the start, back to it, along x, and right of its end.
    const double first = std::min(s, circle) / kRadius;
    const double second = std::max(0.0, s - circle - kStreet) / kRadius;
    const double along = std::clamp(s - circle, 0.0, kStreet);
    const double x = kRadius * (std::sin(first) + std::sin(second)) + along;
    const double y =
        kRadius * ((1.0 - std::cos(first)) - (1.0 - std::cos(second)));
    const double heading = first - second;
    const double c = std::cos(heading), n = std::sin(heading);
    // Columns: right, down, forward.
    poses << n << " 0 " << c << ' ' << x << ' ' << -c << " 0 " << n << ' ' << y
          << " 0 -1 0 0\n";
  }
  return poses.str();
}

class TwoDistricts : public SubMapCommands {
 protected:
  static void SetUpTestSuite() {
    const TempDir dir;
    const std::string path = (dir.path() / "districts.txt").string();
    std::ofstream(path) << DrawDistricts();
    Simulate("--rig stereo --trajectory_path " + path +
             " --max_num_features 150 --num_points_per_frame 60 "
             "--pixel_noise 0.3");
  }
  // The clusters of each frame of 2 m.
  std::map<int, std::set<int>> ClustersOfFrames(const Json& clusters) const {
    std::map<int, std::set<int>> found;
    for (size_t i = 0; i < clusters["clusters"].size(); ++i) {
      std::istringstream names(ReadTextFile(
          Path("clusters/" +
               clusters["clusters"][i]["image_list"].get<std::string>())));
      for (std::string name; std::getline(names, name);) {
        found[std::stoi(name.substr(name.find('/') + 1))].insert(
            static_cast<int>(i));
      }
    }
    return found;
  }
};

// The street is the place to cut: each district is in one cluster, but for
// frames at its junction.
TEST_F(TwoDistricts, AreCutAtTheStreetAndJoined) {
  const Json clusters = Partition(2);
  ASSERT_EQ(clusters["clusters"].size(), 2u);
  const auto clusters_of_frame = ClustersOfFrames(clusters);
  const int num_frames = static_cast<int>(clusters_of_frame.size());
  EXPECT_EQ(num_frames, 115);
  const int district1 = *clusters_of_frame.at(20).begin();
  for (int i = 0; i < num_frames; ++i) {
    const bool is_street = i >= 44 && i < 71;
    if (is_street) continue;
    const std::set<int> expected = {i < 44 ? district1 : 1 - district1};
    EXPECT_EQ(clusters_of_frame.at(i), expected) << "frame " << i;
  }
  MapAll(clusters);
  Join();
  ExpectAsGoodAsSingleModel(Path("joined/0"));
}

// A loop with GPS and gravity.
class MeasuredSubMaps : public SubMapCommands {
 protected:
  static constexpr double kSigma = 0.3;  // of the positions, m
  static void SetUpTestSuite() {
    SimulateLoop("--gravity_sigma 0.5");
    Random random(5);
    std::ofstream file(Gps());
    file.precision(15);
    for (const ModelImage& image : ReadModelPoses(In() + "/truth").images) {
      const Eigen::Vector3d noise(random.Normal(), random.Normal(),
                                  random.Normal());
      // The y axis of simulated worlds points down.
      const Eigen::Vector3d center = image.cam_from_world.Center();
      const Eigen::Vector3d east_north_up(center.x(), center.z(), -center.y());
      file << image.name << ' '
           << LatitudeLongitudeAltitude(east_north_up + kSigma * noise,
                                        {48.0, 9.0, 300.0})
                  .transpose()
           << '\n';
    }
  }
  static std::string Gps() { return In() + "/gps.txt"; }
  static std::string Priors() {
    const std::string sigma = std::to_string(kSigma);
    return " --ref_images_path " + Gps() +
           " --ref_is_gps 1 --prior_position_std_x " + sigma +
           " --prior_position_std_y " + sigma + " --prior_position_std_z " +
           sigma + " --gravity_path " + In() + "/gravity.txt";
  }
  // The mean distance of the images of two models in their own worlds.
  double Distance(const std::string& model,
                  const std::string& reference) const {
    Run("model_evaluator --alignment none --gt_unit m --input_path " +
        Path(model) + " --gt_path " + Path(reference) + " --json " +
        Path("errors.json"));
    const Json errors = Json::parse(ReadTextFile(Path("errors.json")));
    return errors["position_m"]["mean"].get<double>();
  }
};

TEST_F(MeasuredSubMaps, FinishedMapIsExtendedInItsWorld) {
  const Json report = ExtendFinished(Priors());
  const Json& model = report["models"][0];
  EXPECT_TRUE(model["finished_map"]["frames_are_fixed"]) << model;
  ExpectThatFinishedFramesStay();
  EXPECT_EQ(ReadTextFile(Path("joined/0/geo_origin.json")),
            ReadTextFile(Path("finished/0/geo_origin.json")));
  const Json& positions = model["position_priors"];
  EXPECT_TRUE(positions["is_registered"]);
  EXPECT_GT(positions["num_used"], 0.9 * 120);
  EXPECT_LT(positions["rms"], 2.0 * kSigma);
  EXPECT_TRUE(model.contains("gravity"));
  // A map elsewhere follows the positions.
  fs::remove(Path("finished/0/geo_origin.json"));
  fs::remove(Path("finished/report.json"));
  const CommandOutput output =
      Run("model_merger --graph 1 --database_path " + Database() +
          " --input_path " + Path("new") + " --existing_path " +
          Path("finished") + " --output_path " + Path("moved") + Priors());
  EXPECT_THAT(output.err, HasSubstr("the finished map is not in the world of "
                                    "the positions; everything is adjusted"));
  // Two thirds of the positions determine the world of the map.
  EXPECT_LT(Distance("moved/0", "joined/0"), kSigma / 3.0);
}

// All clusters and the join have the world and the origin of a single run, the
// first position by name, although most clusters lack that image.
TEST_F(MeasuredSubMaps, JoinUsesPositionsAndGravityLikeOneRun) {
  MapAll(Partition(3), -1, Priors());
  Run("mapper --write_report 0 --database_path " + Database() +
      " --output_path " + Path("single") + Priors());
  Run(JoinTo("joined") + Priors() + " --compute_covariances 1");
  const std::string origin = ReadTextFile(Path("single/0/geo_origin.json"));
  for (const std::string model : {"maps/0/0", "maps/2/0", "joined/0"}) {
    EXPECT_EQ(ReadTextFile(Path(model + "/geo_origin.json")), origin) << model;
  }
  ExpectAsGood(Path("joined/0"), Path("single/0"));
  // Both use the same positions, and differ by less than the noise of one.
  EXPECT_LT(Distance("joined/0", "single/0"), kSigma / 3.0);
  const Json report = Json::parse(ReadTextFile(Path("joined/report.json")));
  const Json& model = report["models"][0];
  EXPECT_TRUE(model["position_priors"]["is_registered"]);
  EXPECT_EQ(model["gravity"]["num_priors"], 60);
  EXPECT_EQ(report["summary"]["models"][0]["num_images"], 120);
  EXPECT_TRUE(fs::exists(Path("joined/0/report.html")));
  EXPECT_TRUE(fs::exists(Path("joined/0/covariances.csv")));
  // The frames are in their order, not in that of the clusters.
  const std::string table = ReadTextFile(Path("joined/0/frames.csv"));
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 61);
  EXPECT_LT(table.find("000009"), table.find("000010"));
  EXPECT_LT(table.find("000029"), table.find("000030"));
}

TEST_F(MeasuredSubMaps, JoinWithoutPositionsKeepsTheirWorld) {
  MapAll(Partition(3), -1, Priors());
  const CommandOutput output = Run(JoinTo("joined"));
  EXPECT_THAT(output.err, HasSubstr("the join only keeps their world; set "
                                    "--use_prior_position"));
  EXPECT_THAT(output.err, HasSubstr("the sub-maps used measured gravity"));
  EXPECT_EQ(ReadTextFile(Path("joined/0/geo_origin.json")),
            ReadTextFile(Path("maps/1/0/geo_origin.json")));
  // Each sub-map is placed by fewer positions than the whole.
  Run(JoinTo("measured") + Priors());
  EXPECT_LT(Distance("joined/0", "measured/0"), 3.0 * kSigma);
}

// The calibration of one part of a database lacks the rig of another.
TEST_F(SubMapCommands, ClusterOfAnotherRigKeepsItsRig) {
  Run("database_merger --database_path " + Database() + "," + Database() +
      " --image_prefix a/,b/ --vehicle a,b --merged_database_path " +
      Path("both.db"));
  std::map<std::string, std::string> lists;
  for (const ModelImage& image : ReadModelPoses(In() + "/truth").images) {
    for (const std::string prefix : {"a/", "b/"}) {
      lists[prefix] += prefix + image.name + "\n";
    }
  }
  std::ofstream(Path("a.txt")) << lists["a/"];
  std::ofstream(Path("b.txt")) << lists["b/"];
  std::ofstream(Path("all.txt")) << lists["a/"] << lists["b/"];
  const auto map = [&](const std::string& name, const std::string& more) {
    Run("mapper --write_report 0 --database_path " + Path("both.db") +
        " --image_list_path " + Path(name + ".txt") + " --output_path " +
        Path(name) + more);
    return Json::parse(ReadTextFile(Path(name + "/report.json")));
  };
  map("a", "");
  const std::string of_a =
      " --BundleAdjustment.refine_sensor_from_rig yes --calibration_path " +
      Path("a/0/rig_config.json");
  const Json b = map("b", of_a);
  EXPECT_EQ(b["input"]["num_rigs"], 1);
  EXPECT_EQ(b["input"]["num_frames"], 60);
  EXPECT_FALSE(b["models"][0]["rigs"][0]["sensors"][1]["was_known"]);
  const Json all = map("all", of_a);
  EXPECT_EQ(all["input"]["num_rigs"], 2);
  EXPECT_EQ(all["input"]["num_frames"], 120);
}

// Replacing them as results of an earlier run would lose them.
TEST_F(SubMapCommands, ModelsAndSubMapsAreNotOverwritten) {
  fs::create_directories(Path("maps/0/0"));
  std::ofstream(Path("maps/report.json")) << "{}";
  const CommandOutput cut =
      RunMgsfm("mapper --partition 2 --database_path " + Database() +
               " --output_path " + Path("maps"));
  EXPECT_EQ(cut.exit_code, 1);
  EXPECT_THAT(LastWord(cut), HasSubstr("holds models"));
  const CommandOutput joined =
      RunMgsfm("model_merger --graph 1 --input_path " + Path("maps") +
               " --output_path " + Path("maps"));
  EXPECT_EQ(joined.exit_code, 1);
  EXPECT_THAT(LastWord(joined), HasSubstr("holds the sub-maps"));
  EXPECT_TRUE(fs::exists(Path("maps/0/0")));
}

TEST_F(SubMapCommands, TooLargeInputIsRefusedBeforeTheReconstruction) {
  const std::string mapper = "mapper --write_report 0 --database_path " +
                             Database() + " --output_path " + Path("out") +
                             " --max_memory ";
  const CommandOutput refused = RunMgsfm(mapper + "82");
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(LastWord(refused), HasSubstr("--max_memory allows 82; cut the "
                                           "view graph with --partition"));
  EXPECT_THAT(refused.err, Not(HasSubstr("rotation averaging")));
  EXPECT_FALSE(fs::exists(Path("out")));
  Run(mapper + "1000");
}

TEST_F(SubMapCommands, SplitModelsJoinToTheWhole) {
  Run("model_splitter --input_path " + In() + "/truth --output_path " +
      Path("maps") + " --num_clusters 3 --num_overlap_frames 4");
  EXPECT_TRUE(fs::exists(Path("maps/2/images.bin")));
  Run("model_merger --graph 1 --refine 0 --input_path " + Path("maps") +
      " --output_path " + Path("joined"));
  const Json errors = Evaluate(Path("joined/0"));
  EXPECT_EQ(errors["num_registered"], 120);
  EXPECT_LT(errors["position_m"]["max"].get<double>(), 1e-6);
  const CommandOutput refused =
      RunMgsfm("model_splitter --input_path " + Path("maps/0") +
               " --output_path " + Path("maps"));
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_TRUE(fs::exists(Path("maps/2/images.bin")));
}

}  // namespace
}  // namespace mgsfm
