// SPDX-License-Identifier: BSD-3-Clause
#include <cstdio>

#include "mgsfm/pipeline/mapper.h"
#include "mgsfm/synthetic/simulation.h"

int main() {
  const mgsfm::Simulation simulation = mgsfm::Simulate({});
  const mgsfm::MapperResult result =
      mgsfm::RunMapper({simulation.scene, simulation.view_graph}, {}, {});
  std::printf("models: %zu\n", result.models.size());
  return result.models.size() == 1 ? 0 : 1;
}
