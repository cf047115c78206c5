// SPDX-License-Identifier: BSD-3-Clause
#include "mapper/side_alignment.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/random.h"
#include "geometry/absolute_pose.h"
#include "mapper/candidates.h"
#include "mgsfm/geometry/camera_models.h"
#include "registration/point_matches.h"

namespace mgsfm {
namespace {

// The test of one seam.
struct SeamTest {
  const AdjustmentInput& input;
  const Bearings& bearings;
  const MapperOptions& options;
  const Context& context;
  const Reconstruction& model;
  Mask frame_is_beyond;
  std::vector<size_t> crossing;  // pairs of neighbors in time

  bool IsBeyond(int image_idx) const {
    return frame_is_beyond[input.scene.images[image_idx].frame_idx];
  }
};

std::vector<size_t> FindCrossing(const FramePairIndex& index,
                                 const Mask& frame_is_beyond,
                                 const Reconstruction& model) {
  std::vector<size_t> crossing;
  for (size_t i = 0; i < index.num_pairs(); ++i) {
    const FramePairIndex::FramePair& frames = index.Of(i);
    if (index.AreNeighbors(frames) &&
        frame_is_beyond[frames.frame_idx1] !=
            frame_is_beyond[frames.frame_idx2] &&
        model.rig_from_world[frames.frame_idx1] &&
        model.rig_from_world[frames.frame_idx2]) {
      crossing.push_back(i);
    }
  }
  return crossing;
}

// A side with the points that at least two of its frames observe.
Reconstruction SideOf(const SeamTest& test, bool is_beyond) {
  const Scene& scene = test.input.scene;
  Reconstruction side = test.model;
  for (size_t i = 0; i < side.rig_from_world.size(); ++i) {
    if (test.frame_is_beyond[i] != is_beyond) side.rig_from_world[i].reset();
  }
  std::vector<Point3D> points;
  for (Point3D& point : side.points) {
    auto& track = point.track;
    track.erase(std::remove_if(track.begin(), track.end(),
                               [&](const Observation& o) {
                                 return test.IsBeyond(o.image_idx) != is_beyond;
                               }),
                track.end());
    const bool has_frames =
        std::any_of(track.begin(), track.end(), [&](const Observation& o) {
          return scene.images[o.image_idx].frame_idx !=
                 scene.images[track.front().image_idx].frame_idx;
        });
    if (has_frames) points.push_back(std::move(point));
  }
  side.points = std::move(points);
  return side;
}

// The points of the other side that the images of one observe by their matches,
// with the side as the unit: its frame is the world of the model.
std::vector<CameraPoints> MatchesOfSide(const SeamTest& test, bool is_beyond) {
  const Scene& scene = test.input.scene;
  const Reconstruction other = SideOf(test, !is_beyond);
  ViewGraph matches;
  for (const size_t i : test.crossing) {
    const ImagePair& pair = test.input.view_graph.pairs[i];
    const ImagePair* source =
        FindPair(test.input.matches, pair.image_idx1, pair.image_idx2);
    if (source != nullptr) matches.pairs.push_back(*source);
  }
  Mask is_wanted(scene.images.size());
  for (size_t i = 0; i < is_wanted.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    is_wanted[i] = test.IsBeyond(image_idx) == is_beyond &&
                   test.model.IsRegistered(scene, image_idx);
  }
  const auto found = FindPointMatches(scene, matches, other, is_wanted,
                                      test.context.num_threads);
  std::vector<CameraPoints> cameras;
  for (size_t i = 0; i < found.size(); ++i) {
    const int image_idx = static_cast<int>(i);
    const Camera& camera = other.cameras[scene.images[i].camera_idx];
    CameraPoints of_image{Rigid3(), {}, {}, 0.0, {}};
    for (const PointMatch& match : found[i]) {
      if (!test.bearings.HasRay(image_idx, match.keypoint_idx)) continue;
      of_image.rays.push_back(test.bearings.Ray(image_idx, match.keypoint_idx));
      of_image.points.push_back(other.points[match.point_idx].point_in_world);
    }
    if (of_image.size() == 0) continue;
    of_image.cam_from_unit = *test.model.CamFromWorld(scene, image_idx);
    of_image.max_error_rad =
        test.options.bundle_adjustment.max_max_error_px /
        PixelsPerRadian(camera.model, camera.params.data());
    cameras.push_back(std::move(of_image));
  }
  return cameras;
}

// The matches of both sides, each with the pose of its side in the other one.
using BothSides = std::array<std::vector<CameraPoints>, 2>;

std::vector<double> ErrorsOf(const BothSides& sides,
                             const Rigid3& beyond_from_core) {
  std::vector<double> errors = AbsolutePoseErrors(sides[0], beyond_from_core);
  const std::vector<double> of_core =
      AbsolutePoseErrors(sides[1], beyond_from_core.Inverse());
  errors.insert(errors.end(), of_core.begin(), of_core.end());
  return errors;
}

// Whether a count is larger than another one beyond the noise of both.
bool IsSignificant(int count, int other) {
  // Differences of counts are significant beyond three standard deviations.
  return count - other > 3.0 * std::sqrt(count + other);
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
         IsSignificant(num_of_pose, num_of_model);
}

// beyond_from_core, the motion of the side beyond the seam that explains more
// matches than the model, if there is one.
std::optional<Rigid3> FindMotionOfSide(const SeamTest& test) {
  const BothSides sides = {MatchesOfSide(test, true),
                           MatchesOfSide(test, false)};
  for (size_t i = 0; i < sides.size(); ++i) {
    Random random(test.context.random_seed, i);
    auto pose = EstimateAbsolutePose(sides[i], RansacOptions(), &random);
    if (pose && i == 1) pose = pose->Inverse();
    if (pose &&
        ExplainsMore(sides, *pose, test.options.view_graph.min_num_inliers)) {
      return pose;
    }
  }
  return std::nullopt;
}

// The model with the side beyond the seam moved, and triangulated again.
MapperModel Realign(const SeamTest& test, const MapperModel& model,
                    const Rigid3& beyond_from_core, Mask* pair_is_used) {
  for (const size_t i : test.crossing) (*pair_is_used)[i] = true;
  AdjustmentInput input = test.input;
  input.pair_is_used = *pair_is_used;
  MapperModel realigned = model;
  Reconstruction initial = model.reconstruction;
  for (size_t i = 0; i < initial.rig_from_world.size(); ++i) {
    auto& pose = initial.rig_from_world[i];
    if (pose && test.frame_is_beyond[i]) pose = *pose * beyond_from_core;
  }
  initial = TriangulateCandidates(
      input.scene,
      MakeCandidateSource(input.scene, input.view_graph, input.matches,
                          *pair_is_used, test.options, test.context),
      initial, test.options.bundle_adjustment, test.context);
  AdjustModel(input, test.options, test.context, std::move(initial),
              &realigned);
  return realigned;
}

}  // namespace

void RealignSides(const FramePairIndex& index, const MapperOptions& options,
                  const Context& context,
                  const ConfidenceFunction& confidence_of,
                  AdjustmentInput* input, MapperModel* model) {
  if (model->confidence.seams.empty()) return;
  const Bearings bearings = ComputeBearings(
      input->scene, model->reconstruction.cameras, context.num_threads);
  std::set<std::vector<int>> tested;  // sides, so that the test ends
  for (size_t k = 0; k < model->confidence.seams.size();) {
    const Seam& seam = model->confidence.seams[k];
    if (!tested.insert(seam.frame_idxs_beyond).second) {
      ++k;
      continue;
    }
    Mask frame_is_beyond(input->scene.frames.size(), false);
    for (const int i : seam.frame_idxs_beyond) frame_is_beyond[i] = true;
    std::vector<int> core;
    for (size_t i = 0; i < frame_is_beyond.size(); ++i) {
      if (!frame_is_beyond[i]) core.push_back(static_cast<int>(i));
    }
    const auto count_ties = [&](const MapperModel& m) {
      return CountTies(input->scene, m.reconstruction, core,
                       seam.frame_idxs_beyond);
    };
    const SeamTest test{
        *input,
        bearings,
        options,
        context,
        model->reconstruction,
        frame_is_beyond,
        FindCrossing(index, frame_is_beyond, model->reconstruction)};
    const auto motion = FindMotionOfSide(test);
    ++k;
    if (!motion) continue;
    Mask pair_is_used = input->pair_is_used;
    MapperModel realigned = Realign(test, *model, *motion, &pair_is_used);
    if (!IsSignificant(count_ties(realigned), count_ties(*model))) continue;
    realigned.confidence = confidence_of(pair_is_used, realigned);
    context.Info("the side of " +
                 std::to_string(seam.frame_idxs_beyond.size()) +
                 " frames beyond a weak seam is moved to where more matches "
                 "agree");
    *model = std::move(realigned);
    input->pair_is_used = std::move(pair_is_used);
    k = 0;  // of the new seams
  }
}

}  // namespace mgsfm
