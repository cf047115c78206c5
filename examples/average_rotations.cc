// SPDX-License-Identifier: BSD-3-Clause
// Averages the relative rotations of a COLMAP database and prints the rotation
// of every frame and of every sensor in its rig.
//   average_rotations DATABASE
#include <cstdio>
#include <exception>
#include <optional>
#include <vector>

#include "mgsfm/base/mask.h"
#include "mgsfm/models/scene_loading.h"
#include "mgsfm/rotation_averaging/rotation_averaging.h"
#include "mgsfm/view_graph/view_graph_estimation.h"

namespace {

void PrintRotations(
    const char* name,
    const std::vector<std::optional<Eigen::Quaterniond>>& rotations) {
  for (size_t i = 0; i < rotations.size(); ++i) {
    if (!rotations[i]) continue;
    const Eigen::Quaterniond& q = *rotations[i];
    std::printf("%s %zu: %g %g %g %g\n", name, i, q.w(), q.x(), q.y(), q.z());
  }
}

void AverageRotationsOf(const char* database_path) {
  const mgsfm::Context context;
  const mgsfm::LoadedScene input = mgsfm::LoadScene(database_path, {}, context);
  const mgsfm::Bearings bearings =
      mgsfm::ComputeBearings(input.scene, context.num_threads);
  const mgsfm::ViewGraphResult pairs = mgsfm::EstimateViewGraph(
      input.scene, bearings, input.view_graph, {}, context);
  const mgsfm::Mask pair_is_used(pairs.estimate.pairs.size(), true);
  const mgsfm::RotationResult rotations = mgsfm::AverageRotations(
      {input.scene, pairs.estimate, pair_is_used}, {}, context);
  std::printf("# w x y z of rig_from_world per frame\n");
  PrintRotations("frame", rotations.estimate.rig_from_world);
  std::printf("# w x y z of sensor_from_rig per sensor\n");
  PrintRotations("sensor", rotations.estimate.sensor_from_rig);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 1;
  try {
    AverageRotationsOf(argv[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
