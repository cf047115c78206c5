// SPDX-License-Identifier: BSD-3-Clause
// A rig drives 1.2 laps along a closed street and takes rendered images, so
// that the images that show the same places are known exactly.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "files/image_writing.h"
#include "geometry/epipolar.h"
#include "geometry/so3.h"
#include "mgsfm/database/feature_database.h"
#include "mgsfm/features/feature_extraction.h"
#include "mgsfm/mapper/mapper.h"
#include "mgsfm/matching/matching.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/simulator/simulation.h"
#include "simulator/rendering.h"
#include "support/temp_dir.h"

namespace mgsfm {
namespace {

constexpr int kOverlapFrames = 5;
constexpr int kMinLoopFrames = 2 * kOverlapFrames + 1;
// Frames of the second lap are not at positions of the first.
constexpr double kFramesPerLap = 44.4;
constexpr int kNumFrames = 53;
constexpr double kRadius_m = 17.0;
constexpr double kSecondLapOffset_m = 0.4;

// Two images overlap if each shows at least this share of the other.
constexpr double kMinOverlap = 0.15;
// Images with less overlap do not show the same place.
constexpr double kNoOverlap = 0.02;

// Clockwise as seen from above; y points down.
std::vector<Rigid3> ClosedPath() {
  std::vector<Rigid3> rig_from_world;
  for (int i = 0; i < kNumFrames; ++i) {
    const double laps = i / kFramesPerLap;
    const double yaw = 2.0 * kPi * laps;
    const double radius =
        kRadius_m + kSecondLapOffset_m * std::clamp(laps, 0.0, 1.0);
    const Eigen::Vector3d center(-radius * std::cos(yaw), 0.0,
                                 radius * std::sin(yaw));
    rig_from_world.push_back(Rigid3::FromRotationAndCenter(
        ExpSO3(Eigen::Vector3d(0.0, -yaw, 0.0)), center));
  }
  return rig_from_world;
}

SimulatedCamera MakeCamera(const std::string& folder, double right_m) {
  return {folder,
          CameraModelId::kPinhole,
          320,
          200,
          {210, 210, 160, 100},
          Rigid3::FromRotationAndCenter(Eigen::Quaterniond::Identity(),
                                        {right_m, 0.0, 0.0})};
}

int FrameOf(const std::string& image_name) {
  return std::stoi(image_name.substr(image_name.find('/') + 1));
}

// Renders images and computes their overlap.
class ClosedStreet {
 public:
  ClosedStreet() {
    options_.random_seed = 5;
    input_.rig = {MakeCamera("left/", 0.0), MakeCamera("right/", 0.5)};
    input_.rig_from_world_path = ClosedPath();
    simulation_ = SimulateWithoutFeatures(options_, input_);
    renderer_ = std::make_unique<StreetRenderer>(options_, input_,
                                                 simulation_.scene.cameras,
                                                 RenderingOptions{}, Context());
    for (size_t i = 0; i < simulation_.scene.images.size(); ++i) {
      idxs_.emplace(simulation_.scene.images[i].name, i);
      points_.push_back(PointsSeen(i));
    }
  }

  const Simulation& simulation() const { return simulation_; }

  void WriteImages(const std::filesystem::path& folder,
                   const Context& context) const {
    for (size_t i = 0; i < simulation_.scene.images.size(); ++i) {
      const Image& image = simulation_.scene.images[i];
      const std::filesystem::path path = folder / image.name;
      std::filesystem::create_directories(path.parent_path());
      const ColorImage pixels = renderer_->Render(
          image.camera_idx, simulation_.cam_from_world[i], context);
      WriteColorImage(path, pixels.width_px, pixels.height_px, pixels.rgb);
    }
  }

  // The smaller of the shares of either image that the other also shows.
  double Overlap(const std::string& name1, const std::string& name2) const {
    const size_t i = idxs_.at(name1), j = idxs_.at(name2);
    return std::min(Share(i, j), Share(j, i));
  }

 private:
  static constexpr int kGrid_px = 16;

  std::vector<Eigen::Vector3d> PointsSeen(size_t image) const {
    const Camera& camera = simulation_.scene.cameras[0];
    const Rigid3 world_from_cam = simulation_.cam_from_world[image].Inverse();
    std::vector<Eigen::Vector3d> points;
    for (int y = kGrid_px / 2; y < camera.height_px; y += kGrid_px) {
      for (int x = kGrid_px / 2; x < camera.width_px; x += kGrid_px) {
        const auto ray = RayFromPixel(camera.model, camera.params.data(),
                                      Eigen::Vector2d(x, y));
        const Eigen::Vector3d direction = world_from_cam.rotation * *ray;
        const auto distance =
            renderer_->DistanceAlong(world_from_cam.translation, direction);
        if (!distance) continue;
        points.push_back(world_from_cam.translation + *distance * direction);
      }
    }
    return points;
  }

  bool IsSeen(const Eigen::Vector3d& point, size_t image) const {
    const Camera& camera = simulation_.scene.cameras[0];
    const Rigid3& cam_from_world = simulation_.cam_from_world[image];
    const auto pixel = ProjectToPixel(camera.model, camera.params.data(),
                                      cam_from_world * point);
    if (!pixel || pixel->x() < 0.0 || pixel->x() > camera.width_px ||
        pixel->y() < 0.0 || pixel->y() > camera.height_px) {
      return false;
    }
    const Eigen::Vector3d ray = point - cam_from_world.Center();
    const auto distance =
        renderer_->DistanceAlong(cam_from_world.Center(), ray.normalized());
    return distance && *distance > 0.98 * ray.norm();
  }

  double Share(size_t image, size_t other) const {
    const std::vector<Eigen::Vector3d>& points = points_[image];
    const auto num_common = std::count_if(
        points.begin(), points.end(),
        [&](const Eigen::Vector3d& point) { return IsSeen(point, other); });
    return static_cast<double>(num_common) / points.size();
  }

  SimulationOptions options_;
  SimulationInput input_;
  Simulation simulation_;
  std::unique_ptr<StreetRenderer> renderer_;
  std::map<std::string, size_t> idxs_;
  std::vector<std::vector<Eigen::Vector3d>> points_;  // seen, of each image
};

using NamePair = std::pair<std::string, std::string>;  // sorted

// Pairs of frames far apart in the sequence.
struct LoopPairs {
  std::vector<NamePair> proposed;
  std::vector<NamePair> verified;
};

LoopPairs ReadLoopPairs(const FeatureDatabase& database) {
  std::map<ImageId, std::string> names;
  for (const ImageRow& image : database.ReadStructure({}).images) {
    names.emplace(image.id, image.name);
  }
  LoopPairs pairs;
  for (const PairCount& row : database.CountInlierMatches()) {
    const NamePair pair = std::minmax(names.at(row.image_id1),  //
                                      names.at(row.image_id2));
    if (std::abs(FrameOf(pair.first) - FrameOf(pair.second)) < kMinLoopFrames) {
      continue;
    }
    pairs.proposed.push_back(pair);
    if (row.num_matches > 0) pairs.verified.push_back(pair);
  }
  std::sort(pairs.verified.begin(), pairs.verified.end());
  return pairs;
}

// All overlapping pairs of images that a loop could connect.
std::vector<NamePair> TrueLoopPairs(const ClosedStreet& street) {
  std::vector<NamePair> pairs;
  const std::vector<Image>& images = street.simulation().scene.images;
  for (size_t i = 0; i < images.size(); ++i) {
    for (size_t j = i + 1; j < images.size(); ++j) {
      const NamePair pair(images[i].name, images[j].name);
      if (std::abs(FrameOf(pair.first) - FrameOf(pair.second)) >=
              kMinLoopFrames &&
          street.Overlap(pair.first, pair.second) >= kMinOverlap) {
        pairs.push_back(pair);
      }
    }
  }
  return pairs;
}

// Writes pairs of opposite places as if they were neighbors on a straight
// road, with consistent matches: keypoints in the same direction from the image
// center.
void PlantWrongPairs(const ClosedStreet& street, const Scene& scene,
                     FeatureDatabase* database) {
  constexpr int kNumPairs = 12;
  constexpr size_t kNumMatches = 40;
  const auto direction = [](const FeatureKeypoint& keypoint) {
    return std::atan2(keypoint.y_px - 100.0, keypoint.x_px - 160.0);
  };
  for (int i = 0; i < kNumPairs; ++i) {
    const Image& image1 = scene.images[2 * i];
    const Image& image2 = scene.images[2 * i + 20 + i % 3];
    ASSERT_EQ(street.Overlap(image1.name, image2.name), 0.0);
    const auto keypoints1 = database->ReadKeypoints(image1.id);
    const auto keypoints2 = database->ReadKeypoints(image2.id);
    const Rigid3 motion{Eigen::Quaterniond::Identity(), {0.0, 0.0, -1.0}};
    TwoViewGeometryRow row{image1.id,
                           image2.id,
                           TwoViewConfig::kCalibrated,
                           std::nullopt,
                           EssentialFromPose(motion),
                           std::nullopt,
                           motion,
                           {}};
    std::vector<bool> is_taken(keypoints2.size());
    for (size_t k1 = 0; k1 < keypoints1.size(); k1 += 3) {
      for (size_t k2 = 0; k2 < keypoints2.size(); ++k2) {
        const double turn =
            direction(keypoints2[k2]) - direction(keypoints1[k1]);
        if (is_taken[k2] || std::abs(turn) > 0.005) continue;
        is_taken[k2] = true;
        row.matches.push_back(
            {static_cast<uint32_t>(k1), static_cast<uint32_t>(k2)});
        break;
      }
      if (row.matches.size() == kNumMatches) break;
    }
    EXPECT_EQ(row.matches.size(), kNumMatches);
    database->WriteTwoViewGeometry(row);
  }
}

// Pairs without overlap that observe a common point of the model.
size_t CountWrongPairs(const ClosedStreet& street, const Scene& scene,
                       const Reconstruction& model) {
  std::map<std::pair<int, int>, int> num_points;
  for (const Point3D& point : model.points) {
    for (const Observation& a : point.track) {
      for (const Observation& b : point.track) {
        if (a.image_idx < b.image_idx) {
          ++num_points[{a.image_idx, b.image_idx}];
        }
      }
    }
  }
  size_t num_wrong = 0;
  for (const auto& [pair, count] : num_points) {
    const std::string& name1 = scene.images[pair.first].name;
    const std::string& name2 = scene.images[pair.second].name;
    if (std::abs(FrameOf(name1) - FrameOf(name2)) >= kMinLoopFrames &&
        street.Overlap(name1, name2) == 0.0) {
      ++num_wrong;
    }
  }
  return num_wrong;
}

// The largest position error of the frames after a similarity alignment.
double LargestPositionError(const std::vector<Rigid3>& truth,
                            const Scene& scene, const Reconstruction& model) {
  const auto num_frames = static_cast<Eigen::Index>(scene.frames.size());
  Eigen::Matrix3Xd estimated(3, num_frames), expected(3, num_frames);
  for (Eigen::Index i = 0; i < num_frames; ++i) {
    estimated.col(i) = model.rig_from_world[i]->Center();
    expected.col(i) = truth[FrameOf("/" + scene.frames[i].name)].Center();
  }
  const Eigen::Matrix4d transform = Eigen::umeyama(estimated, expected);
  return (transform * estimated.colwise().homogeneous())
      .colwise()
      .hnormalized()
      .
      operator-(expected)
      .colwise()
      .norm()
      .maxCoeff();
}

class LoopDetectionTest : public testing::Test {
 protected:
  LoopDetectionTest()
      : database_((dir_.path() / "database.db").string(),
                  FeatureDatabase::OpenMode::kOrCreate) {
    context_.num_threads = 2;
    street_.WriteImages(dir_.path() / "images", context_);
    FeatureExtractionOptions options;
    options.reader.camera_model = "PINHOLE";
    options.reader.camera_params = "210,210,160,100";
    ExtractFeatures((dir_.path() / "images").string(), options, &database_,
                    context_);
    SequentialMatchingOptions matching;
    matching.pairs.overlap = kOverlapFrames;
    MatchSequentially(&database_,
                      LoadScene(database_.ReadStructure({}), {}, {}).scene,
                      matching, {}, {}, context_);
  }

  TempDir dir_;
  Context context_;
  ClosedStreet street_;
  FeatureDatabase database_;
};

TEST_F(LoopDetectionTest, FindsImagesOfTheSamePlaceAndNoOthers) {
  const LoopPairs loops = ReadLoopPairs(database_);
  const std::vector<NamePair> expected = TrueLoopPairs(street_);
  size_t num_found = 0;
  for (const NamePair& pair : expected) {
    num_found +=
        std::binary_search(loops.verified.begin(), loops.verified.end(), pair);
  }
  size_t num_right = 0, num_wrong = 0;
  for (const NamePair& pair : loops.verified) {
    const double overlap = street_.Overlap(pair.first, pair.second);
    num_right += overlap >= kMinOverlap;
    num_wrong += overlap <= kNoOverlap;
  }
  RecordProperty("proposed", static_cast<int>(loops.proposed.size()));
  RecordProperty("verified", static_cast<int>(loops.verified.size()));
  RecordProperty("verified_and_right", static_cast<int>(num_right));
  RecordProperty("verified_and_wrong", static_cast<int>(num_wrong));
  RecordProperty("true", static_cast<int>(expected.size()));
  RecordProperty("true_and_found", static_cast<int>(num_found));
  EXPECT_GT(expected.size(), 20u);
  EXPECT_GE(num_right, 0.9 * loops.verified.size());
  EXPECT_GE(num_found, 0.8 * expected.size());
  EXPECT_EQ(num_wrong, 0u);

  PlantWrongPairs(street_, LoadScene(database_.ReadStructure({}), {}, {}).scene,
                  &database_);
  const LoadedScene input = LoadScene(database_.path(), {}, context_);
  const MapperResult result =
      RunMapper({input.scene, input.view_graph}, {}, context_);
  ASSERT_EQ(result.models.size(), 1u);
  ASSERT_TRUE(result.unregistered_frames.empty());
  const Reconstruction& model = result.models[0].reconstruction;
  EXPECT_EQ(CountWrongPairs(street_, input.scene, model), 0u);
  EXPECT_LT(LargestPositionError(street_.simulation().cam_from_world,
                                 input.scene, model),
            0.05);
}

}  // namespace
}  // namespace mgsfm
