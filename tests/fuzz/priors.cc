// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "fuzz/fuzz_target.h"
#include "mgsfm/priors/pose_priors.h"
#include "mgsfm/scene/scene.h"
#include "rigs/image_times.h"

namespace mgsfm {
namespace {

Scene MakeScene() {
  Scene scene;
  const CameraId camera_id(1);
  scene.cameras.push_back({camera_id,
                           CameraModelId::kSimplePinhole,
                           640,
                           480,
                           {500.0, 320.0, 240.0}});
  scene.sensors.push_back({"", 0, 0, Rigid3()});
  scene.rigs.push_back({RigId(1), 0, {0}});
  for (const char* name : {"1.jpg", "2.jpg", "a b.jpg"}) {
    const int idx = static_cast<int>(scene.images.size());
    const auto id = static_cast<uint32_t>(idx + 1);
    scene.frames.push_back({FrameId(id), name, 0, {idx}});
    scene.images.push_back({ImageId(id), name, 0, 0, idx, {}});
  }
  return scene;
}

void FuzzPositions(const Scene& scene, const std::string& path, bool is_gps) {
  PosePriorOptions options;
  options.ref_images_path = path;
  options.ref_is_gps = is_gps ? PositionKind::kGps : PositionKind::kCartesian;
  PositionPriors priors;
  if (!Accepts([&] { priors = ReadPositionPriors(scene, "", options); })) {
    return;
  }
  for (const auto& prior : priors.images) {
    FUZZ_CHECK(!prior || prior->position.allFinite());
  }
}

// Trajectories of KITTI and TUM are recognized by their content; the latter
// need times of images.
void FuzzTrajectory(Scene scene, const std::string& path) {
  for (size_t i = 0; i < scene.images.size(); ++i) {
    scene.images[i].timestamp_s = 0.5 + static_cast<double>(i);
  }
  FuzzPositions(scene, path, false);
}

void FuzzGravity(const Scene& scene, const std::string& path) {
  PosePriorOptions options;
  options.gravity_path = path;
  GravityPriors gravity;
  if (!Accepts([&] { gravity = ReadGravity(scene, "", options); })) return;
  WriteGravity(path, scene, gravity);
  const GravityPriors again = ReadGravity(scene, "", options);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const auto& a = gravity.images[i];
    const auto& b = again.images[i];
    FUZZ_CHECK(a.has_value() == b.has_value());
    if (a) FUZZ_CHECK((*a - *b).norm() < 1e-9);
  }
}

void FuzzTimestamps(Scene scene, const std::string& path) {
  if (!Accepts([&] { ReadImageTimestamps(path, &scene); })) return;
  WriteImageTimestamps(path, scene);
  Scene again = scene;
  ReadImageTimestamps(path, &again);
  for (size_t i = 0; i < scene.images.size(); ++i) {
    const double time_s = *scene.images[i].timestamp_s;
    FUZZ_CHECK(std::abs(*again.images[i].timestamp_s - time_s) <=
               1e-9 + 1e-15 * std::abs(time_s));
  }
}

}  // namespace

// The first byte selects the kind of file.
void FuzzPriors(const std::string& input) {
  if (input.empty()) return;
  static const Scene* const scene = new Scene(MakeScene());
  const std::string path = (FuzzFolder() / "priors.txt").string();
  WriteTextFile(path, input.substr(1));
  if (input[0] == 't') return FuzzTrajectory(*scene, path);
  switch (input[0] % 4) {
    case 0:
      return FuzzPositions(*scene, path, false);
    case 1:
      return FuzzPositions(*scene, path, true);
    case 2:
      return FuzzGravity(*scene, path);
    default:
      return FuzzTimestamps(*scene, path);
  }
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(priors, mgsfm::FuzzPriors)
