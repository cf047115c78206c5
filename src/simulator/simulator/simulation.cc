// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/simulator/simulation.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <string>
#include <utility>

#include "base/format.h"
#include "base/parallel.h"
#include "base/ranges.h"
#include "mgsfm/base/error.h"
#include "simulator/detection.h"
#include "simulator/pair_making.h"
#include "simulator/pair_selection.h"
#include "simulator/random_streams.h"
#include "simulator/weak_cuts.h"
#include "simulator/world.h"

namespace mgsfm {
namespace {

// Approximate number of wrong pairs per duplicate structure, also with weak
// cuts, whose presets have fewer matches.
constexpr double kPairsPerDuplicate = 30.0, kPairsPerDuplicateAtCuts = 15.0;

// The cameras sorted by the names of their images, the canonical order of
// scenes.
std::vector<int> OrderByName(const std::vector<SimulatedCamera>& rig) {
  std::vector<int> order = Indices(rig.size());
  SortBy(
      &order, [&](int a) -> const auto& { return rig[a].image_prefix; });
  return order;
}

std::string SensorName(const std::string& image_prefix) {
  const bool is_folder = !image_prefix.empty() && image_prefix.back() == '/';
  return image_prefix.substr(0, image_prefix.size() - (is_folder ? 1 : 0));
}

std::optional<WorldPlan> PlanOf(const SimulationOptions& options) {
  if (!IsPlanned(options.world)) return std::nullopt;
  return PlanWorld(options.world, options.random_seed);
}

// The cameras of all rigs; every further rig is a copy of the first.
std::vector<SimulatedCamera> RigsOf(const SimulationOptions& options,
                                    const SimulationInput& input,
                                    const std::optional<WorldPlan>& plan) {
  std::vector<SimulatedCamera> cameras =
      input.rig.empty() ? MakeRig(options.rig) : input.rig;
  const size_t num_cameras = cameras.size();
  const size_t num_rigs = plan ? plan->world_from_rigs.size() : 1;
  for (size_t i = num_cameras; i < num_rigs * num_cameras; ++i) {
    SimulatedCamera camera = cameras[i % num_cameras];
    camera.rig = static_cast<int>(i / num_cameras);
    camera.image_prefix =
        "rig" + std::to_string(camera.rig) + "_" + camera.image_prefix;
    cameras.push_back(camera);
  }
  return cameras;
}

std::vector<SimulatedCamera> WithFocalError(std::vector<SimulatedCamera> rig,
                                            double relative_error) {
  for (SimulatedCamera& camera : rig) {
    const CameraModelInfo& info = InfoOf(camera.model);
    for (const int i : info.focal_length_idxs) {
      camera.params[i] *= 1.0 + relative_error;
    }
  }
  return rig;
}

class Simulator {
 public:
  Simulator(const SimulationOptions& options, const SimulationInput& input,
            const Context& context)
      : options_(options),
        context_(context),
        plan_(PlanOf(options)),
        rig_(RigsOf(options, input, plan_)),
        assumed_rig_(WithFocalError(rig_, options.focal_length_error)),
        drive_(plan_ ? SamplePlan(options, *plan_)
                     : MakeDrive(options, input)) {}

  Simulation Run() {
    AddRig();
    AddImages();
    world_ = plan_
                 ? MakeWorld(*plan_, options_.random_seed, drive_)
                 : MakeWorld(options_, rig_, drive_, NumDuplicates(), context_);
    std::optional<Vehicles> vehicles;
    if (options_.moving_feature_ratio > 0.0 || options_.convoy_ratio > 0.0) {
      vehicles.emplace(options_, world_->road, drive_,
                       plan_ ? &*plan_ : nullptr);
    }
    const Detector detector(options_, rig_, assumed_rig_, *world_,
                            vehicles ? &*vehicles : nullptr);
    DetectFeatures(detector);
    const Footage footage{
        options_, rig_,        drive_, *world_, vehicles ? &*vehicles : nullptr,
        detector, photographs_};
    if (options_.convoy_ratio > 0.0) HideConvoys(footage);
    const WeakCuts weak_cuts(footage);
    AddPairs(footage, PairMaker(footage, weak_cuts));
    AddFeatures();
    AddTruePoses();
    AddTruePoints();
    CheckConsistent(simulation_.scene);
    return std::move(simulation_);
  }

  Simulation RunWithoutFeatures() {
    AddRig();
    AddImages();
    AddTruePoses();
    CheckConsistent(simulation_.scene);
    return std::move(simulation_);
  }

 private:
  void AddRig() {
    Scene& scene = simulation_.scene;
    // Rigs in the order of their first images.
    std::vector<int> rig_idxs(drive_.num_rigs, -1);
    sensor_idxs_.resize(rig_.size());
    for (const int i : OrderByName(rig_)) {
      const SimulatedCamera& camera = assumed_rig_[i];
      int& rig_idx = rig_idxs[camera.rig];
      if (rig_idx < 0) {
        rig_idx = static_cast<int>(scene.rigs.size());
        scene.rigs.push_back(
            {RigId(static_cast<uint32_t>(rig_idx + 5)), 0, {}});
      }
      const int idx = static_cast<int>(scene.sensors.size());
      scene.cameras.push_back({CameraId(static_cast<uint32_t>(3 * idx + 4)),
                               camera.model, camera.width_px, camera.height_px,
                               camera.params, true});
      Sensor sensor{SensorName(camera.image_prefix), rig_idx, idx,
                    std::nullopt};
      const bool is_reference = i == 0 || camera.rig != rig_[i - 1].rig;
      if (is_reference || options_.extrinsics_are_known) {
        sensor.sensor_from_rig = camera.sensor_from_rig;
      }
      scene.sensors.push_back(sensor);
      scene.rigs[rig_idx].sensor_idxs.push_back(idx);
      if (is_reference) scene.rigs[rig_idx].ref_sensor_idx = idx;
      sensor_idxs_[i] = idx;
    }
  }

  void AddImages() {
    Scene& scene = simulation_.scene;
    std::vector<int> frame_idx_of_drive(drive_.num_frames(), -1);
    for (const int camera : OrderByName(rig_)) {
      for (int frame = 0; frame < drive_.num_frames(); ++frame) {
        if (frame % drive_.num_rigs != rig_[camera].rig) continue;
        const Exposure exposure = Expose(camera, frame);
        Random random = RandomOf(options_.random_seed, Effect::kMissingImages,
                                 exposure.Key());
        if (random.Uniform() < options_.missing_image_ratio) continue;
        const std::string frame_name = FrameName(frame);
        int& frame_idx = frame_idx_of_drive[frame];
        if (frame_idx < 0) {
          frame_idx = static_cast<int>(scene.frames.size());
          scene.frames.push_back(
              {FrameId(static_cast<uint32_t>(2 * frame + 9)),
               frame_name,
               simulation_.scene.sensors[sensor_idxs_[camera]].rig_idx,
               {}});
          drive_frames_.push_back(frame);
        }
        const int image_idx = static_cast<int>(scene.images.size());
        scene.frames[frame_idx].image_idxs.push_back(image_idx);
        scene.images.push_back(
            {ImageId(static_cast<uint32_t>(frame * rig_.size() + camera + 1)),
             rig_[camera].image_prefix + frame_name + ".png",
             sensor_idxs_[camera],
             sensor_idxs_[camera],
             frame_idx,
             {},
             drive_.TimeOfFrame(frame)});
        photographs_.exposures.push_back(exposure);
        simulation_.cam_from_world.push_back(exposure.cam_from_world);
      }
    }
    drive_frames_ = Transformed(SortFrames(&scene), [&](int frame_idx) {
      return drive_frames_[frame_idx];
    });
  }

  std::string FrameName(int frame) const {
    return options_.time_names
               ? Formatted("%019lld",
                           std::llround(1e9 * drive_.TimeOfFrame(frame)))
               : Formatted("%06d", drive_.pose_of_frame[frame]);
  }

  Exposure Expose(int camera, int frame) const {
    Exposure exposure{camera, frame, drive_.TimeOfFrame(frame), {}};
    Rigid3 rig_from_world = drive_.PoseOfFrame(frame);
    double delay_ms = camera == 0 ? 0.0 : options_.trigger_offset_ms;
    if (options_.trigger_jitter_ms > 0.0) {
      Random random = RandomOf(options_.random_seed, Effect::kTriggerJitter,
                               exposure.Key());
      delay_ms += options_.trigger_jitter_ms * random.Uniform(-1.0, 1.0);
    }
    if (delay_ms != 0.0) {
      exposure.time_s += 1e-3 * delay_ms;
      rig_from_world = drive_.PoseAt(exposure.time_s);
    }
    exposure.cam_from_world = rig_[camera].sensor_from_rig * rig_from_world;
    if (options_.readout_ms > 0.0) {
      const double half_s = 0.5e-3 * options_.readout_ms;
      const auto pose_at = [&](double time_s) {
        return rig_[camera].sensor_from_rig * drive_.PoseAt(time_s);
      };
      exposure.of_rows.emplace();
      exposure.of_rows->rig_from_world = {pose_at(exposure.time_s - half_s),
                                          pose_at(exposure.time_s + half_s)};
      exposure.of_rows->times_s = {0.0, 1.0};
    }
    return exposure;
  }

  int NumDuplicates() const {
    if (options_.duplicated_pair_ratio == 0.0) return 0;
    const size_t num_pairs =
        PlanNeighbors(options_, drive_, photographs_.exposures).size();
    const double pairs_per_duplicate = options_.weak_cut_spacing > 0
                                           ? kPairsPerDuplicateAtCuts
                                           : kPairsPerDuplicate;
    return static_cast<int>(std::ceil(options_.duplicated_pair_ratio *
                                      static_cast<double>(num_pairs) /
                                      pairs_per_duplicate));
  }

  void DetectFeatures(const Detector& detector) {
    const std::vector<Exposure>& exposures = photographs_.exposures;
    photographs_.features.resize(exposures.size());
    ParallelFor(
        exposures.size(), context_, "simulation: features",
        [&](size_t i) {
          photographs_.features[i] = detector.Detect(exposures[i]);
        },
        16);
  }

  // The numbers of wrong pairs are fractions of all pairs.
  void AddPairs(const Footage& footage, const PairMaker& maker) {
    std::vector<PairPlan> plans = PlanPairs(footage, context_);
    std::vector<MadePair> pairs = MakePairs(maker, plans);
    const double wrong_ratio =
        options_.isolated_wrong_pair_ratio + options_.duplicated_pair_ratio;
    if (wrong_ratio >= 1.0) {
      throw Error(
          "isolated_wrong_pair_ratio and duplicated_pair_ratio leave no "
          "correct "
          "pairs; decrease one of them");
    }
    const double num_all =
        static_cast<double>(pairs.size()) / (1.0 - wrong_ratio);
    const auto num_of = [num_all](double ratio) {
      return static_cast<int>(std::lround(ratio * num_all));
    };
    const std::vector<PairPlan> duplicated = PlanDuplicatedPairs(
        footage, plans, num_of(options_.duplicated_pair_ratio));
    const auto append = [&pairs](std::vector<MadePair> more) {
      std::move(more.begin(), more.end(), std::back_inserter(pairs));
    };
    append(MakePairs(maker, duplicated));
    plans.insert(plans.end(), duplicated.begin(), duplicated.end());
    std::sort(plans.begin(), plans.end());
    append(MakeIsolatedPairs(footage, maker, plans,
                             num_of(options_.isolated_wrong_pair_ratio),
                             context_));
    SortBy(&pairs, [](const MadePair& made) {
      return std::pair(made.pair.image_idx1, made.pair.image_idx2);
    });
    for (MadePair& pair : pairs) {
      simulation_.view_graph.pairs.push_back(std::move(pair.pair));
      simulation_.pair_kinds.push_back(pair.kind);
    }
  }

  std::vector<MadePair> MakePairs(const PairMaker& maker,
                                  const std::vector<PairPlan>& plans) const {
    std::vector<std::optional<MadePair>> made(plans.size());
    ParallelFor(
        plans.size(), context_, "simulation: pairs",
        [&](size_t i) { made[i] = maker.Make(plans[i]); }, 64);
    std::vector<MadePair> pairs;
    for (std::optional<MadePair>& pair : made) {
      if (pair) pairs.push_back(std::move(*pair));
    }
    return pairs;
  }

  void AddFeatures() {
    const int num_points = static_cast<int>(world_->points.size());
    for (size_t i = 0; i < photographs_.features.size(); ++i) {
      SimulatedFeatures& features = photographs_.features[i];
      for (int& identity : features.identities) {
        if (identity >= num_points) identity = -1;
      }
      simulation_.keypoint_points.push_back(std::move(features.identities));
      simulation_.scene.images[i].keypoints_px =
          std::move(features.keypoints_px);
    }
    for (const WorldPoint& point : world_->points) {
      simulation_.world_points.push_back(point.position);
    }
  }

  void AddTruePoses() {
    Reconstruction& truth = simulation_.ground_truth;
    truth.cameras = simulation_.scene.cameras;
    truth.sensor_from_rig.resize(rig_.size());
    for (size_t i = 0; i < rig_.size(); ++i) {
      truth.cameras[sensor_idxs_[i]].params = rig_[i].params;
      truth.sensor_from_rig[sensor_idxs_[i]] = rig_[i].sensor_from_rig;
    }
    for (const int frame : drive_frames_) {
      truth.rig_from_world.emplace_back(drive_.PoseOfFrame(frame));
    }
  }

  void AddTruePoints() {
    const Scene& scene = simulation_.scene;
    Reconstruction& truth = simulation_.ground_truth;
    std::vector<std::vector<Observation>> tracks(
        simulation_.world_points.size());
    for (size_t i = 0; i < scene.images.size(); ++i) {
      const std::vector<int>& points = simulation_.keypoint_points[i];
      for (size_t j = 0; j < points.size(); ++j) {
        if (points[j] < 0) continue;
        tracks[points[j]].push_back({static_cast<int>(i), static_cast<int>(j)});
      }
    }
    for (size_t i = 0; i < tracks.size(); ++i) {
      if (tracks[i].size() < 2) continue;
      Point3D point;
      point.point_in_world = simulation_.world_points[i];
      point.track = std::move(tracks[i]);
      truth.points.push_back(std::move(point));
    }
  }

  const SimulationOptions& options_;
  const Context& context_;
  const std::optional<WorldPlan> plan_;
  const std::vector<SimulatedCamera> rig_;
  const std::vector<SimulatedCamera> assumed_rig_;
  const Drive drive_;
  std::optional<World> world_;
  Photographs photographs_;
  std::vector<int> drive_frames_;  // index in the drive, per frame of the scene
  std::vector<int> sensor_idxs_;   // per camera of the rig
  Simulation simulation_;
};

}  // namespace

Simulation Simulate(const SimulationOptions& options,
                    const SimulationInput& input, const Context& context) {
  return Simulator(options, input, context).Run();
}

Simulation SimulateWithoutFeatures(const SimulationOptions& options,
                                   const SimulationInput& input,
                                   const Context& context) {
  return Simulator(options, input, context).RunWithoutFeatures();
}

Simulation Simulate(const SimulationOptions& options,
                    const std::vector<Rigid3>& rig_from_world_path,
                    const Context& context) {
  SimulationInput input;
  input.rig_from_world_path = rig_from_world_path;
  return Simulate(options, input, context);
}

}  // namespace mgsfm
