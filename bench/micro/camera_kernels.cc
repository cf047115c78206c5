// SPDX-License-Identifier: BSD-3-Clause
#include <benchmark/benchmark.h>

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "base/random.h"
#include "mgsfm/geometry/camera_models.h"
#include "micro/camera_of_model.h"
#include "micro/groups.h"

namespace mgsfm {
namespace {

constexpr int kNumPoints = 1000;

// Random points in a cone within the domain of all models.
std::vector<Eigen::Vector3d> PointsInView() {
  Random random(1);
  std::vector<Eigen::Vector3d> points(kNumPoints);
  for (Eigen::Vector3d& point : points) {
    point << random.Uniform() - 0.5, random.Uniform() - 0.5, 1.0;
    point *= 1.0 + 9.0 * random.Uniform();
  }
  return points;
}

void Project(const TestCamera& camera, benchmark::State* state) {
  const std::vector<Eigen::Vector3d> points = PointsInView();
  const PixelProjection projection = FindPixelProjection(camera.model);
  double pixel[2], by_point[6];
  for (auto _ : *state) {
    for (const Eigen::Vector3d& point : points) {
      benchmark::DoNotOptimize(projection.linearize(
          camera.params.data(), point.data(), pixel, by_point, nullptr));
      benchmark::DoNotOptimize(by_point);
    }
  }
  state->SetItemsProcessed(state->iterations() * kNumPoints);
}

void Unproject(const TestCamera& camera, benchmark::State* state) {
  std::vector<Eigen::Vector2d> pixels;
  for (const Eigen::Vector3d& point : PointsInView()) {
    if (const auto pixel = camera.Project(point)) pixels.push_back(*pixel);
  }
  for (auto _ : *state) {
    for (const Eigen::Vector2d& pixel : pixels) {
      benchmark::DoNotOptimize(camera.Ray(pixel));
    }
  }
  state->SetItemsProcessed(state->iterations() *
                           static_cast<int64_t>(pixels.size()));
}

void Register(const char* name, const TestCamera& camera,
              void (*run)(const TestCamera&, benchmark::State*)) {
  benchmark::RegisterBenchmark(
      (name + ModelName(camera)).c_str(),
      [camera, run](benchmark::State& state) { run(camera, &state); })
      ->Unit(benchmark::kMicrosecond);
}

}  // namespace

void RegisterCameraBenchmarks() {
  for (const TestCamera& camera : CameraOfEachModel()) {
    Register("project_with_derivatives/", camera, Project);
    Register("ray_from_pixel/", camera, Unproject);
  }
}

}  // namespace mgsfm
