// SPDX-License-Identifier: BSD-3-Clause
#include "registration/side_motion.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "base/random.h"
#include "base/ranges.h"
#include "geometry/absolute_pose.h"
#include "mgsfm/geometry/camera_models.h"
#include "registration/unit_resection.h"

namespace mgsfm {
namespace {

// A side with the points that at least two of its frames observe.
Reconstruction SideOf(const SidesInput& input, bool is_beyond) {
  const Scene& scene = input.scene;
  Reconstruction side = input.model;
  for (size_t i = 0; i < side.rig_from_world.size(); ++i) {
    if (input.frame_is_beyond[i] != is_beyond) side.rig_from_world[i].reset();
  }
  std::vector<Point3D> points;
  for (Point3D& point : side.points) {
    auto& track = point.track;
    EraseIf(&track, [&](const Observation& o) {
      return input.IsBeyond(o.image_idx) != is_beyond;
    });
    const bool has_frames = AnyOf(track, [&](const Observation& o) {
      return scene.images[o.image_idx].frame_idx !=
             scene.images[track.front().image_idx].frame_idx;
    });
    if (has_frames) points.push_back(std::move(point));
  }
  side.points = std::move(points);
  return side;
}

// The points of the other side that the images of one side observe according to
// their matches, with the side as the unit: its frame is the world of the
// model.
std::vector<CameraPoints> MatchesOfSide(const SidesInput& input, bool is_beyond,
                                        int num_threads) {
  const Scene& scene = input.scene;
  const Reconstruction other = SideOf(input, !is_beyond);
  Mask is_wanted(scene.images.size());
  for (size_t i = 0; i < is_wanted.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    is_wanted[i] = input.IsBeyond(image_idx) == is_beyond &&
                   input.model.IsRegistered(scene, image_idx);
  }
  const auto found =
      FindPointMatches(scene, input.matches, other, is_wanted, num_threads);
  std::vector<CameraPoints> cameras;
  for (size_t i = 0; i < found.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const Camera& camera = other.cameras[scene.images[i].camera_idx];
    CameraPoints of_image =
        CollectPoints(input.bearings, other, image_idx, found[i]);
    if (of_image.size() == 0) continue;
    of_image.cam_from_unit = *input.model.CamFromWorld(scene, image_idx);
    of_image.max_error_rad = input.max_error_px / PixelsPerRadian(camera);
    cameras.push_back(std::move(of_image));
  }
  return cameras;
}

// The matches of both sides, each with the pose of its side relative to the
// other.
using BothSides = std::array<std::vector<CameraPoints>, 2>;

std::vector<double> ErrorsOf(const BothSides& sides,
                             const Rigid3& beyond_from_core) {
  std::vector<double> errors = AbsolutePoseErrors(sides[0], beyond_from_core);
  const std::vector<double> of_core =
      AbsolutePoseErrors(sides[1], beyond_from_core.Inverse());
  errors.insert(errors.end(), of_core.begin(), of_core.end());
  return errors;
}

// Whether `pose` explains significantly more matches than the model.
bool ExplainsMore(const BothSides& sides, const Rigid3& pose,
                  int min_num_matches) {
  const std::vector<double> by_model = ErrorsOf(sides, Rigid3());
  const std::vector<double> by_pose = ErrorsOf(sides, pose);
  int num_of_pose = 0, num_of_model = 0;
  for (size_t i = 0; i < by_pose.size(); ++i) {
    if (by_pose[i] <= 1.0 && by_model[i] > 1.0) ++num_of_pose;
    if (by_pose[i] > 1.0 && by_model[i] <= 1.0) ++num_of_model;
  }
  return num_of_pose >= min_num_matches &&
         IsSignificantlyMore(num_of_pose, num_of_model);
}

}  // namespace

std::optional<Rigid3> FindMotionOfSide(const SidesInput& input,
                                       const Context& context) {
  const BothSides sides = {MatchesOfSide(input, true, context.num_threads),
                           MatchesOfSide(input, false, context.num_threads)};
  for (size_t i = 0; i < sides.size(); ++i) {
    Random random(context.random_seed, i);
    auto pose = EstimateAbsolutePose(sides[i], RansacOptions(), &random);
    if (pose && i == 1) pose = pose->Inverse();
    if (pose && ExplainsMore(sides, *pose, input.min_num_inliers)) return pose;
  }
  return std::nullopt;
}

bool IsSignificantlyMore(int count, int other) {
  // Differences of counts are significant beyond three standard deviations.
  return count - other > 3.0 * std::sqrt(count + other);
}

}  // namespace mgsfm
