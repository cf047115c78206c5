// SPDX-License-Identifier: BSD-3-Clause
#include "simulator/worlds/world_plan.h"

#include <algorithm>
#include <cmath>

#include "geometry/so3.h"
#include "simulator/random_streams.h"
#include "simulator/worlds/motion.h"

namespace mgsfm {
namespace {

constexpr double kEyeHeight_m = 1.6;
constexpr double kWall_m = 0.05;  // half the thickness

Rigid3 Placed(double x, double y, double z, double yaw_deg = 0.0) {
  return {ExpSO3(Eigen::Vector3d(0.0, 0.0, DegToRad(yaw_deg))), {x, y, z}};
}

class Planner {
 public:
  explicit Planner(uint64_t seed)
      : seed_(EffectSeed(seed, Effect::kWorlds)), random_(seed_) {}

  WorldPlan Plan(WorldPreset world) {
    using Make = void (Planner::*)();
    static const std::pair<WorldPreset, Make> kMakers[] = {
        {WorldPreset::kHandheld, &Planner::Handheld},
        {WorldPreset::kStairs, &Planner::Stairs},
        {WorldPreset::kElevator, &Planner::Elevator},
        {WorldPreset::kRobot, &Planner::Robot},
        {WorldPreset::kDrone, &Planner::Drone},
        {WorldPreset::kDome, &Planner::Dome},
        {WorldPreset::kTurntable, &Planner::Turntable},
        {WorldPreset::kSquare, &Planner::Square},
        {WorldPreset::kHead360, &Planner::Head360},
        {WorldPreset::kCorridor, &Planner::Corridor},
        {WorldPreset::kSessions, &Planner::Sessions},
        {WorldPreset::kBoat, &Planner::Boat},
        {WorldPreset::kTrain, &Planner::Train},
        {WorldPreset::kCrane, &Planner::Crane},
        {WorldPreset::kTwoRigs, &Planner::TwoRigs},
        {WorldPreset::kPedestrians, &Planner::Pedestrians},
        {WorldPreset::kPole360, &Planner::Pole360},
        {WorldPreset::kBridge, &Planner::Bridge}};
    for (const auto& [name, make] : kMakers) {
      if (name == world) (this->*make)();
    }
    return std::move(plan_);
  }

 private:
  // Walks an ellipse in a hall; every second the gaze jumps.
  void Handheld() {
    Room(0, 0, 0, 14, 10, 3.2);
    Furniture(30, 0, 0, 14, 10);
    std::vector<Key> gaze;
    for (double t = 0.0; t < 31.0; t += U(0.7, 2.0)) {
      const double yaw = U(-45.0, 45.0), pitch = U(-12.0, 15.0);
      const double last = gaze.empty() ? 0.0 : t - 0.3;
      if (!gaze.empty()) gaze.push_back({last, gaze.back().attitude});
      gaze.push_back({t, At(0, 0, 0, yaw, pitch)});
    }
    GoShaken(
        30.0,
        [around = Around(28.0, 4.5, 2.8, kEyeHeight_m, 60.0),
         gaze = Follow(gaze)](double t) -> Attitude {
          return around(t) + gaze(t);
        },
        0.012, 1.2, 9.0);
  }

  // Four equal storeys around a core; a turn of the stairs per storey.
  void Stairs() {
    density_ = 45.0;
    constexpr double kStorey_m = 3.0;
    for (const double y : {-2.5, 2.5}) Block(0, y, 1.5, 7, 0.1, kStorey_m);
    for (const double x : {-3.5, 3.5}) Block(x, 0, 1.5, 0.1, 5, kStorey_m);
    Block(0, 0, 1.5, 2.6, 0.3, kStorey_m);
    Block(2.8, 0, 0.0, 1.3, 5, 0.1);
    Block(3.2, 1.8, 0.6, 0.4, 0.8, 1.0, 10.0);
    for (int i = 0; i < 8; ++i) {
      Block(-2.0 + 0.5 * i, 1.3, 0.1 + 0.17 * i, 0.4, 1.6, 0.1);
    }
    Repeat(0, {0.0, 0.0, kStorey_m}, 3);
    std::vector<Key> keys;
    const double x[] = {2.5, -2.5, -2.5, 2.5}, y[] = {1.3, 1.3, -1.3, -1.3};
    for (int i = 0; i <= 16; ++i) {
      keys.push_back({1.9 * i, At(x[i % 4], y[i % 4], kEyeHeight_m + 0.75 * i,
                                  180.0 + 90.0 * i)});
    }
    GoShaken(30.0, Follow(keys), 0.01, 0.6, 5.0);
  }

  // Into a glass cabin, up three storeys, and out again.
  void Elevator() {
    reach_m_ = 30.0;
    Room(0, 0, 0, 16, 12, 14);
    for (int i = 0; i < 4; ++i) {
      Block(6.5, 0, 3.0 * i + 2.9, 3.0, 10, 0.15);
      Furniture(5, 0, 0, 14, 12);
      Block(5.5 + U(0, 1), U(-4, 4), 3.0 * i + 3.6, 0.5, 0.5, 1.2);
      Block(-7.5, U(-4, 4), 3.0 * i + 1.5, 0.5, 2.0, 2.0, 5.0);
    }
    const std::function<Attitude(double)> path =
        Follow({{0, At(-6, -3, 1.6, 20)},
                {5, At(0, 0, 1.6, 0)},
                {7, At(2, 0, 1.6, 0)},
                {9, At(3, 0, 1.6, 100)},
                {11, At(3, 0, 1.6, 180)},
                {12, At(3, 0, 1.6, 180)},
                {19, At(3, 0, 10.6, 170)},
                {20, At(3, 0, 10.6, 170)},
                {22, At(3, 0, 10.6, 20)},
                {26, At(5.5, 1, 10.6, 60)},
                {29, At(5.5, 3.5, 10.6, 170)}});
    const std::function<Attitude(double)> lift =
        Follow({{12, At(3, 0, 0, 0)}, {19, At(3, 0, 9, 0)}});
    GoShaken(28.0, path, 0.006, 0.4, 4.0);
    plan_.body_feature_ratio = 0.2;
    for (const double y : {-1.0, 1.0}) {
      plan_.bodies.push_back({{Placed(-1.0, y, 1.4),
                               {0.08, 0.25, 1.3},
                               250.0,
                               5,
                               static_cast<int>(1000 + y)},
                              [lift](double t) {
                                const Attitude a = lift(t);
                                return Placed(a[0], a[1], a[2]);
                              }});
    }
  }

  // Drives, stops, turns in place.
  void Robot() {
    Room(0, 0, 0, 16, 8, 2.8);
    Block(0, 2.6, 1.4, 0.2, 2.8, 2.8);
    Block(0, -2.9, 1.4, 0.2, 2.2, 2.8);
    Furniture(36, 0, 0, 15, 8);
    Go(30.0, Follow({{0, At(-6, -2, 0.6, 0)},
                     {1, At(-6, -2, 0.6, 0)},
                     {5, At(-2, -1, 0.6, 0)},
                     {7, At(-2, -1, 0.6, 90)},
                     {8, At(-2, -1, 0.6, 90)},
                     {10, At(-2, -1, 0.6, 0)},
                     {15, At(5, 0, 0.6, 0)},
                     {16, At(5, 0, 0.6, 0)},
                     {20, At(5, 0, 0.6, 180)},
                     {21, At(5, 0, 0.6, 180)},
                     {26, At(-3, 0.5, 0.6, 180)},
                     {27, At(-3, 0.5, 0.6, 180)},
                     {30, At(-3, 0.5, 0.6, 360)}}));
  }

  // Flies lanes above houses; the reference camera looks straight down.
  void Drone() {
    density_ = 0.35;
    reach_m_ = 140.0;
    Block(0, 0, -0.5, 260, 260, 1.0);
    for (int i = 0; i < 60; ++i) {
      const double height = U(4.0, 22.0);
      Block(U(-100, 100), U(-100, 100), 0.5 * height, U(8, 20), U(8, 20),
            height, U(0.0, 90.0));
    }
    GoShaken(12.0,
             Follow({{0, At(-50, -25, 60, 0, 90)},
                     {3.5, At(40, -25, 60, 0, 90)},
                     {4.5, At(50, -10, 61, 90, 90)},
                     {5.5, At(40, 5, 62, 180, 90)},
                     {9, At(-40, 5, 60, 180, 90)},
                     {10, At(-50, 15, 59, 90, 90)},
                     {12, At(-20, 30, 60, 0, 90)}}),
             0.1, 1.5, 2.0);
  }

  // Cameras around an object, which look inwards, turn about it.
  void Dome() {
    Object();
    Go(6.0, [](double t) {
      const double angle = 0.5 * t;
      const Eigen::Vector3d eye(2.0 * std::cos(angle), 2.0 * std::sin(angle),
                                1.0 + 0.4 * std::sin(0.9 * t));
      return LookAt(eye, {0.0, 0.0, 0.4});
    });
  }

  // An object on a turntable before a dark background: two turns.
  void Turntable() {
    Object();
    Go(24.0, [](double t) {
      const double angle = 2.0 * kPi * t / 12.0, height = t < 12.0 ? 0.6 : 1.4;
      const double blend = std::clamp(t - 11.5, 0.0, 1.0);
      const double z = blend < 1.0 ? 0.6 + 0.8 * blend : height;
      return LookAt({1.8 * std::cos(angle), 1.8 * std::sin(angle), z},
                    {0.0, 0.0, 0.4});
    });
  }

  // Pictures of a square in no order.
  void Square() {
    density_ = 3.0;
    reach_m_ = 60.0;
    Buildings(12, 26, 32, 14);
    density_ = 20.0;
    Block(0, 0, 1.5, 3, 3, 3, 30);
    Go(10.0, [seed = seed_](double t) {
      Random random(seed, static_cast<uint64_t>(std::llround(1e4 * t)) + 1);
      const double x = random.Uniform(-15.0, 15.0);
      const double y = random.Uniform(-15.0, 15.0);
      const double yaw = random.Uniform(0.0, 360.0);
      return At(x, y, random.Uniform(1.4, 1.9), yaw,
                random.Uniform(-15.0, 5.0));
    });
  }

  // Equal rooms in a row with wide doors; the head looks around.
  void Head360() {
    density_ = 25.0;
    constexpr double kRoom_m = 5.0;
    for (const double y : {-2.5, 2.5}) Block(0, y, 1.4, kRoom_m, 0.1, 2.8);
    for (const double y : {-1.75, 1.75}) Block(2.5, y, 1.4, 0.1, 1.5, 2.8);
    Block(0, 0, -kWall_m, kRoom_m, kRoom_m, 0.1);
    Furniture(10, 0, 0, 4.6, kRoom_m);
    Repeat(0, {kRoom_m, 0.0, 0.0}, 3);
    Block(-2.5, 0, 1.4, 0.1, 5, 2.8);
    Block(18, 0, 1.4, 0.1, 5, 2.8);
    GoShaken(
        26.0,
        [](double t) {
          return At(-1.5 + 0.65 * t, 0.7 * std::sin(0.8 * t), 1.7,
                    40.0 * std::sin(0.5 * t));
        },
        0.015, 2.0, 3.0);
  }

  void Corridor() {
    Room(10, 0, 0, 26, 2.6, 2.8);
    Furniture(26, 10, 0, 24, 2.4);
    GoShaken(30.0,
             Follow({{0, At(-1.5, 0.1, 1.5, 0)},
                     {13.5, At(19, 0.1, 1.5, 0)},
                     {16.5, At(19, -0.1, 1.5, 180)},
                     {30, At(-1.5, -0.2, 1.5, 180)}}),
             0.01, 0.5, 4.0);
  }

  // The same street at three times, the second time in the opposite direction.
  void Sessions() {
    density_ = 6.0;
    reach_m_ = 45.0;
    Facades(-30, 120, 7);
    Go(10.0, [](double t) -> Attitude {
      const bool is_back = t > 50.0 && t < 150.0;
      const double way = 8.0 * std::fmod(t, 100.0);
      const double bend = 2.0 * std::sin(way / 15.0);
      return is_back ? At(80.0 - way, 1.8 + bend, 1.6, 180.0)
                     : At(way, -1.5 + bend, 1.6, 4.0 * std::cos(way / 15.0));
    });
    plan_.sessions_s = {{0.0, 10.0}, {100.0, 110.0}, {200.0, 210.0}};
  }

  // Up a river that winds; the bow is in view.
  void Boat() {
    density_ = 0.8;
    reach_m_ = 120.0;
    Facades(-30, 200, 22);
    GoShaken(
        28.0,
        [](double t) {
          return At(4.0 * t, 6.0 * std::sin(t / 6.0), 2.5,
                    14.0 * std::cos(t / 6.0));
        },
        0.15, 2.5, 0.5);
    Hull({{{0.3, 1.1, 3.5}, {1.6, 0.4, 3.0}},
          {{0.3, 0.6, 5.2}, {0.1, 1.0, 0.1}}},
         0.3);
  }

  // A driver's cabin: window posts and desk are in the view of all cameras.
  void Train() {
    density_ = 0.8;
    reach_m_ = 90.0;
    Facades(-30, 520, 9);
    Go(28.0, [](double t) {
      const double way = 8.0 * t + 0.12 * t * t;
      return At(way, -6.0 * std::cos(way / 90.0), 2.8,
                RadToDeg(std::atan(6.0 / 90.0 * std::sin(way / 90.0))));
    });
    Hull({{{0.3, 0.75, 1.6}, {2.6, 0.4, 0.5}},
          {{-0.75, 0.0, 1.5}, {0.12, 1.4, 0.1}},
          {{1.3, 0.0, 1.5}, {0.12, 1.4, 0.1}}},
         0.35);
  }

  // Scenery some hundred meters away, seen from a jib that slews to and fro.
  void Crane() {
    density_ = 0.03;
    reach_m_ = 900.0;
    Buildings(70, 250, 600, 60);
    GoShaken(
        40.0,
        [](double t) -> Attitude {
          const double angle = 2.2 * std::sin(2.0 * kPi * t / 40.0);
          return At(18.0 * std::cos(angle), 18.0 * std::sin(angle),
                    45.0 + 4.0 * std::sin(0.2 * t), RadToDeg(angle), 6.0);
        },
        0.03, 0.3, 1.0);
  }

  // Two vehicles on the same street, in opposite directions.
  void TwoRigs() {
    density_ = 6.0;
    reach_m_ = 45.0;
    Facades(-40, 130, 7);
    Go(14.0, [](double t) {
      return At(6.0 * t, -1.5, 1.6, 6.0 * std::sin(0.7 * t));
    });
    Go(14.0, [](double t) {
      return At(6.5 * t, 1.5, 1.9, 180.0 + 6.0 * std::sin(0.5 * t));
    });
  }

  void Pedestrians() {
    density_ = 3.0;
    reach_m_ = 60.0;
    Buildings(12, 24, 30, 12);
    GoShaken(28.0, Around(25.0, 7.0, 7.0, kEyeHeight_m, 100.0), 0.015, 0.8,
             4.0);
    People(40, 14.0);
  }

  // A camera high on a pole; its carrier walks below and sways against it.
  void Pole360() {
    density_ = 3.0;
    reach_m_ = 40.0;
    Buildings(12, 16, 22, 9);
    GoShaken(28.0, Around(26.0, 7.0, 5.0, 2.6, 90.0), 0.02, 1.5, 2.0);
    Hull({{{0.0, 1.75, 0.15}, {0.5, 1.7, 0.35}}}, 0.25, 0.04, 3.0);
  }

  // Most of the view is the inside of the wheelhouse.
  void Bridge() {
    density_ = 0.12;
    reach_m_ = 500.0;
    Buildings(60, 90, 260, 30);
    GoShaken(
        28.0,
        [](double t) {
          const double angle = t / 20.0;
          return At(80.0 * std::sin(angle) - 40.0,
                    80.0 * (1.0 - std::cos(angle)) - 30.0, 9.0,
                    RadToDeg(angle));
        },
        0.2, 2.0, 0.3);
    Hull({{{0.0, 0.8, 1.6}, {4.0, 0.6, 0.6}},
          {{0.0, -0.7, 1.8}, {4.0, 0.5, 0.4}},
          {{-0.6, 0.0, 2.0}, {0.2, 1.2, 0.1}},
          {{0.7, 0.0, 2.0}, {0.2, 1.2, 0.1}}},
         0.6);
  }

  // What is there. Sizes are full lengths.
  TexturedBox& Block(double x, double y, double z, double length, double width,
                     double height, double yaw_deg = 0.0) {
    plan_.boxes.push_back(
        {Placed(x, y, z, yaw_deg), 0.5 * Eigen::Vector3d(length, width, height),
         density_, reach_m_, static_cast<int>(plan_.boxes.size())});
    return plan_.boxes.back();
  }

  // Walls around a center on the floor; the floor is included.
  void Room(double x, double y, double z, double length, double width,
            double height) {
    const double t = 2.0 * kWall_m, middle = z + 0.5 * height;
    Block(x, y + 0.5 * width, middle, length, t, height);
    Block(x, y - 0.5 * width, middle, length, t, height);
    Block(x + 0.5 * length, y, middle, t, width, height);
    Block(x - 0.5 * length, y, middle, t, width, height);
    Block(x, y, z - kWall_m, length, width, t);
  }

  void Furniture(int number, double x, double y, double length, double width) {
    for (int i = 0; i < number; ++i) {
      const double height = U(0.4, 2.0),
                   side = random_.Uniform() < 0.5 ? 1 : -1;
      Block(x + U(-0.45, 0.45) * length, y + side * U(0.4, 0.48) * width,
            0.5 * height, U(0.3, 1.2), U(0.3, 0.8), height, U(-20.0, 20.0));
    }
  }

  // Houses around an open place, on the ground.
  void Buildings(int number, double inner_m, double outer_m, double height_m) {
    for (int i = 0; i < number; ++i) {
      const double angle = 2.0 * kPi * (i + U(0.0, 0.6)) / number;
      const double radius = U(inner_m, outer_m),
                   height = height_m * U(0.4, 1.0);
      Block(radius * std::cos(angle), radius * std::sin(angle), 0.5 * height,
            0.8 * height_m * U(0.5, 1.0), height_m * U(0.5, 1.0), height,
            RadToDeg(angle) + U(-15.0, 15.0));
    }
  }

  // Houses and lamp posts on both sides of the x axis.
  void Facades(double begin_m, double end_m, double left_m) {
    for (const double side : {-1.0, 1.0}) {
      for (double x = begin_m; x < end_m;) {
        const double length = U(6.0, 14.0), height = U(5.0, 12.0);
        const double gap = U(0.0, 6.0), setback = U(0.0, 3.0);
        Block(x + 0.5 * length, side * (left_m + setback + 4.0), 0.5 * height,
              length, 8.0, height);
        Block(x + length + 0.5 * gap, side * (left_m - 1.0), 1.5, 0.4, 0.4,
              3.0);
        x += length + gap;
      }
    }
  }

  // A statue of boxes, 1 m high, at the origin.
  void Object() {
    density_ = 500.0;
    reach_m_ = 6.0;
    for (int i = 0; i < 14; ++i) {
      Block(U(-0.3, 0.3), U(-0.3, 0.3), U(0.1, 0.9), U(0.1, 0.4), U(0.1, 0.4),
            U(0.1, 0.4), U(0.0, 90.0));
    }
    Block(0.0, 0.0, -0.05, 1.2, 1.2, 0.1);
  }

  // Repeats the boxes from `first` on, displaced.
  void Repeat(size_t first, const Eigen::Vector3d& step, int num_copies) {
    const size_t last = plan_.boxes.size();
    for (int copy = 1; copy <= num_copies; ++copy) {
      // The second of each two equal parts is the duplicate of the first.
      const int duplicate = copy / 2;
      for (size_t i = first; i < last; ++i) {
        TexturedBox box = plan_.boxes[i];
        box.world_from_box.translation += copy * step;
        box.duplicate = duplicate;
        box.is_copy = copy % 2 == 1;
        plan_.boxes.push_back(box);
      }
      if (copy % 2 == 1) {
        plan_.copy_from_original.push_back(
            {Eigen::Quaterniond::Identity(), step});
      }
    }
    for (size_t i = first; i < last; ++i) plan_.boxes[i].duplicate = 0;
  }

  // How rigs move.

  // An ellipse with half axes along x and y.
  static std::function<Attitude(double)> Around(double period_s, double x_m,
                                                double y_m, double height_m,
                                                double turn_deg) {
    return [=](double t) {
      const double angle = 2.0 * kPi * t / period_s;
      return At(x_m * std::cos(angle), y_m * std::sin(angle), height_m,
                RadToDeg(angle) + turn_deg);
    };
  }

  void Go(double duration_s, std::function<Attitude(double)> path) {
    plan_.sessions_s = {{0.0, duration_s}};
    plan_.world_from_rigs.push_back(
        [path = std::move(path)](double t) { return WorldFromRig(path(t)); });
  }

  void GoShaken(double duration_s, std::function<Attitude(double)> path,
                double position_m, double angle_deg, double max_frequency_hz) {
    const Tremor tremor(position_m, angle_deg, 0.1 * max_frequency_hz,
                        max_frequency_hz, random_.NextBits());
    Go(duration_s, [path = std::move(path), tremor](double t) -> Attitude {
      return path(t) + tremor(t);
    });
  }

  // Boxes fixed to the rig, in its frame: x right, y down, z ahead. They sway.
  void Hull(const std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>>&
                centers_and_sizes,
            double share, double sway_m = 0.0, double sway_deg = 0.0) {
    plan_.body_feature_ratio = share;
    const Path world_from_rig = plan_.world_from_rigs.front();
    const Tremor sway(sway_m, sway_deg, 0.3, 1.5, random_.NextBits());
    for (const auto& [center, size] : centers_and_sizes) {
      const Path path = [world_from_rig, sway](double t) {
        const Attitude move = sway(t);
        return world_from_rig(t) *
               Rigid3{ExpSO3(move.tail<3>()), move.head<3>()};
      };
      const double area = 2.0 * (size.x() * size.y() + size.y() * size.z() +
                                 size.z() * size.x());
      plan_.bodies.push_back(
          {{Rigid3{Eigen::Quaterniond::Identity(), center}, 0.5 * size,
            900.0 / area, 30.0,
            static_cast<int>(plan_.boxes.size() + plan_.bodies.size())},
           path});
    }
  }

  // People who walk to and fro across a place.
  void People(int number, double radius_m) {
    plan_.body_feature_ratio = 0.35;
    for (int i = 0; i < number; ++i) {
      const Eigen::Vector2d center(U(-radius_m, radius_m),
                                   U(-radius_m, radius_m));
      const double heading = U(0.0, 2.0 * kPi), length = U(2.0, 6.0),
                   speed = U(0.7, 1.6), phase = U(0.0, 20.0);
      const Path path = [=](double t) {
        const double way = speed * (t + phase) / length;
        const double triangle =
            std::abs(way - 2.0 * std::floor(0.5 * way) - 1.0);
        const double along = length * (2.0 * triangle - 1.0);
        return Placed(center.x() + along * std::cos(heading),
                      center.y() + along * std::sin(heading), 0.85,
                      RadToDeg(heading));
      };
      plan_.bodies.push_back(
          {{Rigid3(),
            {0.15, 0.25, 0.85},
            60.0,
            12.0,
            static_cast<int>(plan_.boxes.size() + plan_.bodies.size())},
           path});
    }
  }

  double U(double low, double high) { return random_.Uniform(low, high); }

  const uint64_t seed_;
  Random random_;
  double density_ = 36.0;
  double reach_m_ = 12.0;
  WorldPlan plan_;
};

}  // namespace

bool IsPlanned(WorldPreset world) {
  return world != WorldPreset::kScatter && world != WorldPreset::kStreet;
}

WorldPlan PlanWorld(WorldPreset world, uint64_t seed) {
  return Planner(seed).Plan(world);
}

bool Crosses(const Eigen::Vector3d& half_size_m, const Eigen::Vector3d& begin,
             const Eigen::Vector3d& end) {
  const Eigen::Vector3d view = end - begin;
  // The part of the line of sight inside all three slabs of the box.
  double entry = 0.0, exit = 1.0;
  for (int k = 0; k < 3; ++k) {
    const double low = (-half_size_m[k] - begin[k]) / view[k];
    const double high = (half_size_m[k] - begin[k]) / view[k];
    entry = std::max(entry, std::min(low, high));
    exit = std::min(exit, std::max(low, high));
  }
  return entry < exit;
}

}  // namespace mgsfm
