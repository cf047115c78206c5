// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include "mgsfm/mapper/mapper.h"
#include "mgsfm/simulator/simulation.h"
#include "support/model_comparison.h"

namespace mgsfm {

// All images of a simulation are in one model, near their true poses.
inline void ExpectTrueModel(const Simulation& simulation,
                            const MapperResult& result) {
  ASSERT_EQ(result.models.size(), 1u);
  EXPECT_TRUE(result.unregistered_frames.empty());
  const ModelDifference difference =
      CompareModels(simulation.scene, result.models[0].reconstruction,
                    simulation.ground_truth);
  EXPECT_EQ(difference.num_images,
            static_cast<int>(simulation.scene.images.size()));
  EXPECT_LT(difference.max_rotation_deg, 0.2);
  EXPECT_LT(difference.max_position, 0.1);
}

}  // namespace mgsfm
