// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "base/random.h"
#include "foundation/geometry/test_cameras.h"
#include "geometry/so3.h"
#include "rig_solver/rig_problem.h"
#include "support/threads.h"

namespace mgsfm {

inline Eigen::Vector3d RandomVector(double size, Random* random) {
  return size *
         Eigen::Vector3d(random->Normal(), random->Normal(), random->Normal());
}

// A rig that drives past a cloud of points.
struct RigSceneOptions {
  std::vector<TestCamera> cameras;  // one per sensor
  int num_frames = 6;
  int num_points = 60;
  int num_frames_of_point = 4;  // consecutive; with all sensors
  bool rotations_are_free = true;
  bool sensors_are_free = true;  // except the first
  bool params_are_free = false;
  bool points_are_free = true;
  bool images_move = false;  // since the times of their frames
  double noise_px = 0.0;
  uint64_t seed = 1;
};

// Points with so many frames that a preconditioner cuts them.
inline RigSceneOptions SceneOfLongTracks() {
  RigSceneOptions options;
  options.cameras = {FisheyeTestCameras()[0], FisheyeTestCameras()[0]};
  options.num_frames = 75;
  options.num_points = 120;
  options.num_frames_of_point = 70;
  options.params_are_free = true;
  options.noise_px = 0.5;
  return options;
}

template <class Observation>
struct RigScene {
  RigProblem<Observation> problem;
  RigState truth;
};

inline PoseMask MakeMask(bool turns, bool shifts) {
  PoseMask mask;
  mask << (turns ? 1 : 0), (turns ? 1 : 0), (turns ? 1 : 0), (shifts ? 1 : 0),
      (shifts ? 1 : 0), (shifts ? 1 : 0);
  return mask;
}

inline Eigen::Vector3d PointInCamera(const RigProblemBase& problem,
                                     const RigState& state, int image_idx,
                                     const Eigen::Vector3d& point) {
  const RigProblemBase::Image& image = problem.images[image_idx];
  const FramePose frame =
      Move(state.frames[image.frame], problem.MotionOf(image_idx));
  return state.sensors[image.sensor] *
         (frame.rig_from_world * (point - frame.center));
}

inline void AddPosesAndImages(const RigSceneOptions& options, Random* random,
                              RigProblemBase* problem, RigState* state) {
  const bool turns = options.rotations_are_free;
  for (int f = 0; f < options.num_frames; ++f) {
    FramePose frame;
    frame.rig_from_world = ExpSO3(RandomVector(0.05, random));
    frame.center =
        Eigen::Vector3d(0.5 * f, 0.0, 0.0) + RandomVector(0.1, random);
    state->frames.push_back(frame);
    problem->frame_masks.push_back(MakeMask(turns && f > 0, f > 0));
  }
  // One coordinate of one frame fixes the scale.
  problem->frame_masks.back()[3] = 0.0;
  for (size_t s = 0; s < options.cameras.size(); ++s) {
    const bool is_free = options.sensors_are_free && s > 0;
    state->sensors.push_back(
        {Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()});
    if (s > 0) {
      state->sensors[s] = {ExpSO3(RandomVector(0.05, random)),
                           RandomVector(0.3, random)};
    }
    problem->sensor_masks.push_back(MakeMask(turns && is_free, is_free));
    for (int f = 0; f < options.num_frames; ++f) {
      problem->images.push_back({f, static_cast<int>(s), static_cast<int>(s)});
      if (!options.images_move) continue;
      problem->motions.push_back(
          {ExpSO3(RandomVector(0.05, random)), RandomVector(0.1, random)});
    }
    const TestCamera& camera = options.cameras[s];
    CameraParams params{};
    std::copy(camera.params.begin(), camera.params.end(), params.begin());
    state->cameras.push_back(params);
    RigProblemBase::Camera free{camera.model, {}};
    for (size_t i = 0; options.params_are_free && i < camera.params.size();
         ++i) {
      free.free_params.push_back(static_cast<int>(i));
      // Some are not observable here.
      problem->priors.push_back({static_cast<int>(s), static_cast<int>(i),
                                 camera.params[i] * (1.0 + 1e-3),
                                 0.01 * (std::abs(camera.params[i]) + 0.01)});
    }
    problem->cameras.push_back(free);
  }
  problem->points_are_free = options.points_are_free;
}

// Calls function(image, x) for all sensors of consecutive frames, then finishes
// the point, which is ahead of the middle frame.
template <class Function>
void AddPoints(const RigSceneOptions& options, Random* random,
               RigProblemBase* problem, RigState* state,
               const Function& function) {
  size_t num_observations = 0;
  for (int p = 0; p < options.num_points; ++p) {
    const int first = static_cast<int>(
        p % (options.num_frames - options.num_frames_of_point + 1));
    const int middle = first + options.num_frames_of_point / 2;
    state->points.push_back(state->frames[middle].center +
                            Eigen::Vector3d(random->Uniform() * 4.0 - 2.0,
                                            random->Uniform() * 4.0 - 2.0,
                                            4.0 + 4.0 * random->Uniform()));
    // Not in the order of frames.
    for (size_t s = 0; s < options.cameras.size(); ++s) {
      for (int f = first; f < first + options.num_frames_of_point; ++f) {
        const int image = static_cast<int>(s) * options.num_frames + f;
        num_observations += function(
            image, PointInCamera(*problem, *state, image, state->points[p]));
      }
    }
    problem->point_begin.push_back(num_observations);
  }
}

inline RigScene<PixelObservation> MakePixelScene(
    const RigSceneOptions& options) {
  RigScene<PixelObservation> scene;
  Random random(options.seed);
  AddPosesAndImages(options, &random, &scene.problem, &scene.truth);
  AddPoints(
      options, &random, &scene.problem, &scene.truth,
      [&](int image, const Eigen::Vector3d& x) {
        const int camera = scene.problem.images[image].camera;
        auto pixel = ProjectToPixel(scene.problem.cameras[camera].model,
                                    scene.truth.cameras[camera].data(), x);
        if (!pixel) return false;
        *pixel += options.noise_px *
                  Eigen::Vector2d(random.Normal(), random.Normal());
        scene.problem.observations.push_back({image, pixel->cast<float>()});
        return true;
      });
  return scene;
}

// A scene with rays, constant rotations, and all kinds of terms between images.
inline RigScene<RayObservation> MakeRayScene(RigSceneOptions options,
                                             double noise) {
  RigScene<RayObservation> scene;
  RigProblem<RayObservation>& problem = scene.problem;
  options.rotations_are_free = false;
  options.params_are_free = false;
  Random random(options.seed);
  AddPosesAndImages(options, &random, &problem, &scene.truth);
  problem.loss = {RobustLossType::kCauchy, 0.02};
  AddPoints(
      options, &random, &problem, &scene.truth,
      [&](int image, const Eigen::Vector3d& x) {
        problem.observations.push_back(
            {image,
             (x.normalized() + RandomVector(noise, &random)).normalized()});
        return true;
      });
  const auto center = [&](int image) -> Eigen::Vector3d {
    const Rigid3& sensor = scene.truth.sensors[problem.images[image].sensor];
    const FramePose& frame = scene.truth.frames[problem.images[image].frame];
    return frame.center + frame.rig_from_world.conjugate() * sensor.Center();
  };
  const int num_images = static_cast<int>(problem.images.size());
  for (int i = 0; i < 4 * num_images; ++i) {
    BaselineTerm term;
    term.kind = static_cast<BaselineTerm::Kind>(i % 3);
    term.image1 = i % num_images;
    term.image2 = (5 * i + 3) % num_images;
    if (term.image1 == term.image2) continue;
    const Eigen::Vector3d baseline = center(term.image2) - center(term.image1);
    term.direction =
        (baseline.normalized() + RandomVector(noise, &random)).normalized();
    term.length = baseline.norm() * (1.0 + noise * random.Normal());
    term.min_length = 1e-4 * term.length;
    term.weight = term.kind == BaselineTerm::Kind::kZero ? 1e-4 : 0.3;
    problem.baselines.push_back(term);
  }
  LinearTerm term;
  for (int s = 0; s < static_cast<int>(options.cameras.size()); ++s) {
    term.parts.push_back({false, s, RandomVector(1.0, &random)});
  }
  term.parts.push_back({true, 1, RandomVector(1.0, &random)});
  term.weight = 0.1;
  problem.linear_terms.push_back(term);
  problem.cameras.clear();
  scene.truth.cameras.clear();
  for (RigProblemBase::Image& image : problem.images) image.camera = -1;
  return scene;
}

// Perturbs all free parameters by normal noise of relative size `size`.
inline void Perturb(const RigProblemBase& problem, double size, Random* random,
                    RigState* state) {
  const auto masked = [&](const PoseMask& mask) {
    PoseVector v;
    v << RandomVector(0.1 * size, random), RandomVector(size, random);
    return PoseVector(v.cwiseProduct(mask));
  };
  for (size_t i = 0; i < state->frames.size(); ++i) {
    const PoseVector d = masked(problem.frame_masks[i]);
    FramePose& pose = state->frames[i];
    pose.rig_from_world = ExpSO3(d.head<3>()) * pose.rig_from_world;
    pose.center += d.tail<3>();
  }
  for (size_t i = 0; i < state->sensors.size(); ++i) {
    const PoseVector d = masked(problem.sensor_masks[i]);
    state->sensors[i].rotation =
        ExpSO3(d.head<3>()) * state->sensors[i].rotation;
    state->sensors[i].translation += d.tail<3>();
  }
  for (size_t i = 0; i < state->cameras.size(); ++i) {
    for (const int param : problem.cameras[i].free_params) {
      state->cameras[i][param] *= 1.0 + 0.1 * size * random->Normal();
    }
  }
  if (!problem.points_are_free) return;
  for (Eigen::Vector3d& point : state->points) {
    point += RandomVector(size, random);
  }
}

// Moves a point to `factor` times its distance from the first image with it.
template <class Observation>
void MovePointAway(const RigProblem<Observation>& problem, size_t point,
                   double factor, RigState* state) {
  const auto& first = problem.observations[problem.point_begin[point]];
  const FramePose& frame = state->frames[problem.images[first.image].frame];
  state->points[point] =
      frame.center + factor * (state->points[point] - frame.center);
}

// Adds position and gravity priors for all images and priors for all sensors,
// about `error` from the truth, so that the loss affects some of them.
template <class Observation>
void AddPosePriorsNearby(double error, RigScene<Observation>* scene) {
  RigProblem<Observation>& problem = scene->problem;
  Random random(17);
  problem.position_loss = {RobustLossType::kCauchy, 1.5};
  problem.gravity_loss = {RobustLossType::kCauchy, 2.0};
  for (size_t i = 0; i < problem.images.size(); ++i) {
    const RigProblemBase::Image& image = problem.images[i];
    const FramePose& frame = scene->truth.frames[image.frame];
    const Rigid3 cam_from_world =
        scene->truth.sensors[image.sensor] *
        Rigid3::FromRotationAndCenter(frame.rig_from_world, frame.center);
    PositionPrior prior;
    prior.image = static_cast<int>(i);
    prior.point_in_cam = RandomVector(0.4, &random);
    prior.position = cam_from_world.Inverse() * prior.point_in_cam +
                     RandomVector(error, &random);
    for (int k = 0; k < 3; ++k) {
      prior.sqrt_information.col(k) += RandomVector(0.2, &random);
    }
    prior.sqrt_information /= error;
    problem.position_priors.push_back(prior);
    GravityPrior gravity;
    gravity.image = prior.image;
    gravity.down = Eigen::Vector3d(0.3, 1.0, -0.2).normalized();
    gravity.direction = ExpSO3(RandomVector(error, &random)) *
                        (cam_from_world.rotation * gravity.down);
    gravity.sigma_rad = error;
    problem.gravity_priors.push_back(gravity);
  }
  for (size_t s = 0; s < scene->truth.sensors.size(); ++s) {
    Rigid3 given = scene->truth.sensors[s];
    given.rotation = ExpSO3(RandomVector(error, &random)) * given.rotation;
    given.translation += RandomVector(error, &random);
    problem.sensor_priors.push_back(
        {static_cast<int>(s), given, error, 0.5 * error});
    problem.sensor_priors.back().factor.template diagonal<-3>().setConstant(
        0.3);
  }
}

}  // namespace mgsfm
