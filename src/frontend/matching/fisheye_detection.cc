// SPDX-License-Identifier: BSD-3-Clause
#include "matching/fisheye_detection.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>

#include "base/format.h"
#include "base/parallel.h"
#include "base/ranges.h"
#include "geometry/so3.h"
#include "matching/descriptor_matching.h"
#include "matching/scene_pairs.h"
#include "matching/two_view_verification.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// The fields of view of fisheyes to try. The focal length of any lens between
// them is within 10 % of the nearest one.
constexpr std::array<double, 5> kFieldsOfViewDeg = {120, 145, 170, 195, 220};
// At least 240 matches: an unexplained fraction of 0.05 then has a standard
// error of 0.014; kMinDifference is 3.5 times that. The maxima bound the cost.
constexpr size_t kMaxNumSampledPairs = 20;
constexpr size_t kMinNumSampledPairs = 4;
constexpr size_t kMinNumMatches = 60;
constexpr size_t kMaxNumMatches = 250;
// An inlier ratio of 0.5 is found in 220 trials.
constexpr int kMaxNumLensTrials = 400;
// Keypoints are accurate to a fraction of a pixel, so that a smaller tolerance
// than for verification distinguishes lenses.
constexpr double kToleranceFactor = 0.25;
// Number of matches that a pinhole does not explain, relative to a fisheye.
// Rendered drives: 3.3, 5.4 and 4.4 times as many for fisheyes of 115, 121 and
// 191 degrees, 1.9 times for OPENCV of 79 degrees with k1 = -0.28, 0.1 and 0.5
// times for PINHOLE of 64 and 96 degrees. KITTI 06: 0.9 times.
constexpr double kMinRatio = 2.5;
constexpr double kMinDifference = 0.05;

bool IsPerspectiveModel(CameraModelId model) {
  return model == CameraModelId::kSimplePinhole ||
         model == CameraModelId::kPinhole ||
         model == CameraModelId::kSimpleRadial ||
         model == CameraModelId::kRadial || model == CameraModelId::kOpenCV;
}

// The keypoints of the matches of a pair.
struct SampledPair {
  std::array<std::vector<Eigen::Vector2f>, 2> keypoints_px;
  std::vector<Match> matches;
};

Camera PerspectiveOf(const Camera& camera) {
  const double focal_px = std::max(camera.width_px, camera.height_px);
  return {camera.id,
          CameraModelId::kSimplePinhole,
          camera.width_px,
          camera.height_px,
          {focal_px, 0.5 * camera.width_px, 0.5 * camera.height_px},
          false};
}

Camera FisheyeOf(const Camera& camera, double field_of_view_deg) {
  Camera fisheye = PerspectiveOf(camera);
  fisheye.model = CameraModelId::kSimpleFisheye;
  fisheye.params[0] /= DegToRad(field_of_view_deg);
  fisheye.has_prior_focal_length = true;
  return fisheye;
}

size_t NumExplained(const SampledPair& pair, const Camera& camera,
                    const TwoViewGeometryOptions& options, Random random) {
  std::array<std::vector<std::optional<Eigen::Vector3d>>, 2> rays;
  for (size_t k = 0; k < 2; ++k) {
    rays[k] =
        Transformed(pair.keypoints_px[k], [&](const Eigen::Vector2f& keypoint) {
          return RayFromPixel(camera, keypoint.cast<double>());
        });
  }
  const VerificationView view1{&camera, &pair.keypoints_px[0], &rays[0]};
  const VerificationView view2{&camera, &pair.keypoints_px[1], &rays[1]};
  return VerifyPair(view1, view2, pair.matches, options, random).matches.size();
}

SampledPair ReadPair(const FeatureDatabase& database, const Scene& scene,
                     const ImageIdxPair& pair,
                     const DescriptorMatchingOptions& options) {
  SampledPair sampled;
  const std::array<int, 2> idxs = {pair.image_idx1, pair.image_idx2};
  std::array<std::vector<FeatureKeypoint>, 2> keypoints;
  std::array<DescriptorMatrix, 2> descriptors;
  std::array<DescriptorView, 2> views;
  bool has_sift = options.guided_matching;
  for (size_t k = 0; k < 2; ++k) {
    const ImageId image_id = scene.images[idxs[k]].id;
    keypoints[k] = database.ReadKeypoints(image_id);
    descriptors[k] = database.ReadDescriptors(image_id);
    views[k] = {descriptors[k].data(), keypoints[k].size()};
    has_sift &=
        static_cast<size_t>(descriptors[k].rows()) == keypoints[k].size() &&
        static_cast<size_t>(descriptors[k].cols()) == DescriptorView::kDim;
  }
  const std::vector<Match> matches =
      has_sift ? MatchDescriptors(views[0], views[1], options)
               : ReadMatchesOfPair(database, scene, pair);
  CheckMatches(scene, pair, matches, keypoints[0].size(), keypoints[1].size());
  const size_t step = matches.size() / kMaxNumMatches + 1;
  for (size_t i = 0; i < matches.size(); i += step) {
    const FeatureKeypoint& a = keypoints[0][matches[i].keypoint_idx1];
    const FeatureKeypoint& b = keypoints[1][matches[i].keypoint_idx2];
    const auto idx = static_cast<uint32_t>(sampled.matches.size());
    sampled.keypoints_px[0].emplace_back(a.x_px, a.y_px);
    sampled.keypoints_px[1].emplace_back(b.x_px, b.y_px);
    sampled.matches.push_back({idx, idx});
  }
  return sampled;
}

// The pairs of images of each camera with enough matches, evenly spread over
// the recording.
std::map<int, std::vector<ImageIdxPair>> SelectPairs(
    const FeatureDatabase& database, const Scene& scene) {
  const ImageIdxs image_idxs(scene);
  std::map<int, std::vector<ImageIdxPair>> pairs_of_camera;
  for (const PairCount& row : database.CountMatches()) {
    const auto pair = image_idxs.Find(row);
    if (!pair || row.num_matches < kMinNumMatches) continue;
    const int camera_idx = scene.images[pair->image_idx1].camera_idx;
    const Camera& camera = scene.cameras[camera_idx];
    if (camera_idx != scene.images[pair->image_idx2].camera_idx ||
        camera.has_prior_focal_length || !IsPerspectiveModel(camera.model)) {
      continue;
    }
    pairs_of_camera[camera_idx].push_back(*pair);
  }
  for (auto& [camera_idx, pairs] : pairs_of_camera) {
    std::sort(pairs.begin(), pairs.end());
    pairs = EvenlySpaced(pairs, kMaxNumSampledPairs);
  }
  return pairs_of_camera;
}

// Fractions of the matches that a pinhole, the first, and the fisheyes explain.
constexpr size_t kNumLenses = kFieldsOfViewDeg.size() + 1;
using Shares = std::array<double, kNumLenses>;

Shares MeasureShares(const std::vector<SampledPair>& pairs,
                     const Camera& camera,
                     const TwoViewGeometryOptions& options,
                     const Context& context) {
  std::vector<Camera> lenses = {PerspectiveOf(camera)};
  for (const double field_of_view_deg : kFieldsOfViewDeg) {
    lenses.push_back(FisheyeOf(camera, field_of_view_deg));
  }
  std::vector<std::array<size_t, kNumLenses>> counts(pairs.size());
  ParallelFor(
      pairs.size(), context.num_threads,
      [&](size_t i) {
        context.CheckInterrupted();
        const Random random(context.random_seed, i);
        for (size_t k = 0; k < kNumLenses; ++k) {
          counts[i][k] = NumExplained(pairs[i], lenses[k], options, random);
        }
      },
      1);
  double num_matches = 0.0;
  Shares shares = {};
  for (size_t i = 0; i < pairs.size(); ++i) {
    num_matches += static_cast<double>(pairs[i].matches.size());
    for (size_t k = 0; k < kNumLenses; ++k) {
      shares[k] += static_cast<double>(counts[i][k]);
    }
  }
  for (double& share : shares) share /= num_matches;
  return shares;
}

struct LensEvidence {
  int camera_idx = 0;
  int num_pairs = 0;
  Shares shares;

  const double* BestFisheye() const {
    return std::max_element(shares.data() + 1, shares.data() + kNumLenses);
  }
  double FieldOfViewDeg() const {
    return kFieldsOfViewDeg[BestFisheye() - (shares.data() + 1)];
  }
  double UnexplainedByFisheye() const { return 1.0 - *BestFisheye(); }
  double UnexplainedByPinhole() const { return 1.0 - shares[0]; }
};

bool PrefersFisheye(const LensEvidence& e) {
  return e.UnexplainedByPinhole() > e.UnexplainedByFisheye() + kMinDifference;
}

bool IsFisheye(const LensEvidence& e) {
  return PrefersFisheye(e) &&
         e.UnexplainedByPinhole() > kMinRatio * e.UnexplainedByFisheye();
}

bool HaveOneSize(const Camera& a, const Camera& b) {
  return a.width_px == b.width_px && a.height_px == b.height_px;
}

std::string NameOfCamera(const Scene& scene, int camera_idx) {
  for (const Sensor& sensor : scene.sensors) {
    if (sensor.camera_idx == camera_idx) return sensor.name;
  }
  return "";
}

}  // namespace

std::vector<FisheyeFinding> FindFisheyes(const FeatureDatabase& database,
                                         const Scene& scene,
                                         const PairMatchingOptions& options,
                                         const Context& context) {
  TwoViewGeometryOptions strict = options.two_view_geometry;
  strict.max_num_trials =
      std::min<int>(strict.max_num_trials, kMaxNumLensTrials);
  strict.max_error = kToleranceFactor * strict.max_error;
  std::vector<LensEvidence> evidence;
  for (const auto& [camera_idx, pair_idxs] : SelectPairs(database, scene)) {
    if (pair_idxs.size() < kMinNumSampledPairs) continue;
    const std::vector<SampledPair> pairs =
        Transformed(pair_idxs, [&](const ImageIdxPair& pair) {
          return ReadPair(database, scene, pair, options.matching);
        });
    evidence.push_back(
        {camera_idx, static_cast<int>(pairs.size()),
         MeasureShares(pairs, scene.cameras[camera_idx], strict, context)});
  }
  std::map<double, FisheyeFinding> finding_of_lens;
  for (const LensEvidence& e : evidence) {
    const bool is_fisheye =
        IsFisheye(e) ||
        (PrefersFisheye(e) && AnyOf(evidence, [&](const LensEvidence& other) {
           return IsFisheye(other) &&
                  HaveOneSize(scene.cameras[e.camera_idx],
                              scene.cameras[other.camera_idx]);
         }));
    if (!is_fisheye) continue;
    FisheyeFinding& finding = finding_of_lens[e.FieldOfViewDeg()];
    finding.unexplained_by_fisheye =
        std::max(finding.unexplained_by_fisheye, e.UnexplainedByFisheye());
    finding.unexplained_by_pinhole =
        std::max(finding.unexplained_by_pinhole, e.UnexplainedByPinhole());
    finding.field_of_view_deg = e.FieldOfViewDeg();
    finding.num_pairs += e.num_pairs;
    finding.cameras.push_back(NameOfCamera(scene, e.camera_idx));
    finding.camera_idxs.push_back(e.camera_idx);
  }
  std::vector<FisheyeFinding> findings;
  for (auto& [lens, finding] : finding_of_lens) {
    findings.push_back(std::move(finding));
  }
  return findings;
}

std::string DescribeEvidence(const FisheyeFinding& finding) {
  std::string names;
  for (const std::string& name : finding.cameras) {
    names += (names.empty() ? "'" : ", '") + name + "'";
  }
  const bool is_one = finding.cameras.size() == 1;
  // Names may be long, so only the numbers are formatted.
  const std::string numbers = Formatted(
      "a fisheye of about %.0f degrees leaves %.0f %% of the matches of %d "
      "image pairs unexplained, a perspective camera %.0f %%",
      finding.field_of_view_deg, 100.0 * finding.unexplained_by_fisheye,
      finding.num_pairs, 100.0 * finding.unexplained_by_pinhole);
  return (is_one ? "camera " : "cameras ") + names +
         (is_one ? " seems to be a fisheye: " : " seem to be fisheyes: ") +
         numbers;
}

std::string Describe(const FisheyeFinding& finding) {
  const std::string factor =
      Formatted("%.2f", 1.0 / DegToRad(finding.field_of_view_deg));
  return DescribeEvidence(finding) + "; calibrate " +
         (finding.cameras.size() == 1 ? "it" : "them") +
         ", or set ImageReader.camera_model OPENCV_FISHEYE and "
         "ImageReader.default_focal_length_factor " +
         factor + " and start with a new database";
}

void AdoptFisheyes(const std::vector<FisheyeFinding>& findings,
                   const Scene& scene, FeatureDatabase* database) {
  DatabaseTransaction transaction(database);
  for (const FisheyeFinding& finding : findings) {
    for (const int camera_idx : finding.camera_idxs) {
      Camera camera =
          FisheyeOf(scene.cameras[camera_idx], finding.field_of_view_deg);
      camera.model = CameraModelId::kOpenCVFisheye;
      const std::vector<double> simple = camera.params;
      camera.params = {simple[0], simple[0], simple[1], simple[2], 0, 0, 0, 0};
      camera.has_prior_focal_length = false;
      database->UpdateCamera(camera);
    }
  }
  database->DeleteTwoViewGeometries();
  transaction.Commit();
}

}  // namespace mgsfm
