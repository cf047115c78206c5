// SPDX-License-Identifier: BSD-3-Clause
#include "matching/fisheye_detection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "frontend/matching/simulated_pair.h"
#include "geometry/so3.h"
#include "mgsfm/models/scene_loading.h"
#include "support/temp_dir.h"
#include "support/threads.h"

namespace mgsfm {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

// Images of a camera that moves and turns amid points. The database states that
// its lens is `stated`.
class FisheyeDetectionTest : public testing::Test {
 protected:
  static constexpr int kNumImages = 4;
  static constexpr int kSizePx = 400;

  FisheyeDetectionTest()
      : database_((dir_.path() / "a.db").string(),
                  FeatureDatabase::OpenMode::kOrCreate) {}

  static Camera Unknown() {
    return MakeCamera(CameraModelId::kSimpleRadial, kSizePx, kSizePx,
                      {1.2 * kSizePx, 200, 200, 0}, false);
  }

  void AddCamera(const std::string& folder, const Camera& lens,
                 const Camera& stated) {
    Random random(3);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 1500; ++i) {
      points.emplace_back(random.Uniform(-8.0, 8.0), random.Uniform(-8.0, 8.0),
                          random.Uniform(-2.0, 12.0));
    }
    const CameraId camera_id = database_.AddCamera(stated);
    std::vector<ImageId> images;
    std::vector<std::vector<int>> keypoint_of_point;
    for (int i = 0; i < kNumImages; ++i) {
      const Rigid3 cam_from_world{
          ExpSO3({0.02 * i, 0.06 * i, -0.03 * i}),
          Eigen::Vector3d(-0.3 * i, 0.05 * i, -0.2 * i)};
      images.push_back(database_.AddImage(
          folder + "/" + std::to_string(i) + ".png", camera_id));
      keypoint_of_point.push_back(
          Observe(points, cam_from_world, lens, images.back(), &random));
    }
    for (int i = 0; i < kNumImages; ++i) {
      for (int j = i + 1; j < std::min(i + 4, kNumImages); ++j) {
        WriteMatches(images[i], keypoint_of_point[i], images[j],
                     keypoint_of_point[j]);
      }
    }
  }

  DatabaseContents Structure() const {
    return database_.ReadStructure(Context());
  }

  std::vector<FisheyeFinding> Find(int num_threads = 1) const {
    const Scene scene = LoadScene(Structure(), {}, Context()).scene;
    return FindFisheyes(database_, scene, {}, Threads(num_threads));
  }

 private:
  std::vector<int> Observe(const std::vector<Eigen::Vector3d>& points,
                           const Rigid3& cam_from_world, const Camera& lens,
                           ImageId image, Random* random) {
    std::vector<FeatureKeypoint> keypoints;
    std::vector<int> keypoint_of_point;
    for (const Eigen::Vector3d& point : points) {
      keypoint_of_point.push_back(-1);
      const Eigen::Vector3d in_cam = cam_from_world * point;
      const auto pixel = ProjectToPixel(lens.model, lens.params.data(), in_cam);
      if (in_cam.norm() < 1.0 || !pixel || !IsInImage(lens, *pixel)) continue;
      keypoint_of_point.back() = static_cast<int>(keypoints.size());
      keypoints.push_back(FeatureKeypoint::FromScale(
          static_cast<float>(pixel->x() + 0.3 * random->Normal()),
          static_cast<float>(pixel->y() + 0.3 * random->Normal()), 1, 0));
    }
    database_.WriteKeypoints(image, keypoints);
    return keypoint_of_point;
  }

  void WriteMatches(ImageId image1, const std::vector<int>& keypoints1,
                    ImageId image2, const std::vector<int>& keypoints2) {
    std::vector<Match> matches;
    for (size_t i = 0; i < keypoints1.size(); ++i) {
      if (keypoints1[i] < 0 || keypoints2[i] < 0) continue;
      matches.push_back({static_cast<uint32_t>(keypoints1[i]),
                         static_cast<uint32_t>(keypoints2[i])});
    }
    database_.WriteMatches(image1, image2, matches);
  }

  const TempDir dir_;

 protected:
  FeatureDatabase database_;
};

Camera FisheyeOf(double focal_px) {
  return MakeCamera(CameraModelId::kOpenCVFisheye, 400, 400,
                    {focal_px, focal_px, 200, 200, 0.008, -0.002, 0, 0});
}

TEST_F(FisheyeDetectionTest, FisheyesAreNamedTogether) {
  AddCamera("left", FisheyeOf(120.0), Unknown());
  AddCamera("right", FisheyeOf(120.0), Unknown());
  const std::vector<FisheyeFinding> findings = Find();
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_THAT(findings[0].cameras, ElementsAre("left", "right"));
  // 400 px of an equidistant lens are 191 degrees.
  EXPECT_NEAR(findings[0].field_of_view_deg, 191.0, 25.0);
  const std::string text = Describe(findings[0]);
  EXPECT_THAT(text, HasSubstr("cameras 'left', 'right' seem to be fisheyes"));
  EXPECT_THAT(text, HasSubstr("ImageReader.camera_model OPENCV_FISHEYE"));
}

TEST_F(FisheyeDetectionTest, ThreadsDoNotMatter) {
  AddCamera("left", FisheyeOf(120.0), Unknown());
  const std::vector<FisheyeFinding> one = Find(), three = Find(3);
  ASSERT_EQ(one.size(), 1u);
  ASSERT_EQ(three.size(), 1u);
  EXPECT_EQ(DescribeEvidence(three[0]), DescribeEvidence(one[0]));
  EXPECT_EQ(three[0].unexplained_by_fisheye, one[0].unexplained_by_fisheye);
  EXPECT_EQ(three[0].unexplained_by_pinhole, one[0].unexplained_by_pinhole);
}

// The pairs of all cameras are verified again.
TEST_F(FisheyeDetectionTest, AdoptedFisheyesReplaceOnlyTheirModels) {
  AddCamera("left", FisheyeOf(120.0), Unknown());
  AddCamera("front",
            MakeCamera(CameraModelId::kPinhole, 400, 400, {300, 300, 200, 200}),
            Unknown());
  const DatabaseContents before = Structure();
  database_.WriteTwoViewGeometry({before.images[0].id,
                                  before.images[1].id,
                                  TwoViewConfig::kCalibrated,
                                  std::nullopt,
                                  std::nullopt,
                                  std::nullopt,
                                  std::nullopt,
                                  {{0, 0}}});
  ASSERT_EQ(database_.CountInlierMatches().size(), 1u);
  const size_t num_matches = database_.CountMatches().size();
  AdoptFisheyes(Find(), LoadScene(before, {}, Context()).scene, &database_);
  const DatabaseContents after = Structure();
  ASSERT_EQ(after.cameras.size(), 2u);
  const Camera& adopted = after.cameras[0];
  EXPECT_EQ(adopted.model, CameraModelId::kOpenCVFisheye);
  // 400 px of an equidistant lens are 191 degrees; the steps are 25 degrees.
  EXPECT_NEAR(adopted.params[0], 120.0, 0.1 * 120.0);
  EXPECT_EQ(adopted.params[2], 200.0);
  EXPECT_FALSE(adopted.has_prior_focal_length);
  EXPECT_EQ(after.cameras[1].params, before.cameras[1].params);
  EXPECT_EQ(database_.CountMatches().size(), num_matches);
  EXPECT_THAT(database_.CountInlierMatches(), IsEmpty());
  EXPECT_THAT(Find(), IsEmpty());
}

TEST_F(FisheyeDetectionTest, NarrowFisheyes) {
  AddCamera("a", FisheyeOf(190.0), Unknown());
  const std::vector<FisheyeFinding> findings = Find();
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].field_of_view_deg, 120.0);
}

TEST_F(FisheyeDetectionTest, PerspectiveCamerasAreNot) {
  AddCamera("wide",
            MakeCamera(CameraModelId::kPinhole, 400, 400, {200, 200, 200, 200}),
            Unknown());
  AddCamera("narrow",
            MakeCamera(CameraModelId::kPinhole, 400, 400, {480, 480, 200, 200}),
            Unknown());
  AddCamera("distorted",
            MakeCamera(CameraModelId::kOpenCV, 400, 400,
                       {300, 300, 200, 200, -0.2, 0.05, 0.0, 0.0}),
            Unknown());
  EXPECT_THAT(Find(), IsEmpty());
}

TEST_F(FisheyeDetectionTest, KnownLensesAreNotQuestioned) {
  Camera known = Unknown();
  known.has_prior_focal_length = true;
  AddCamera("known", FisheyeOf(120.0), known);
  AddCamera("fisheye", FisheyeOf(120.0), FisheyeOf(120.0));
  EXPECT_THAT(Find(), IsEmpty());
}

}  // namespace
}  // namespace mgsfm
