// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_structure.h"

namespace mgsfm {

// The blocks of unknowns of an image; kNoBlock if constant.
struct ImageBlockIndices {
  int frame = kNoBlock;
  int sensor = kNoBlock;
  int camera = kNoBlock;
};
ImageBlockIndices BlocksOfImage(const RigProblemBase& problem,
                                const RigStructure& structure, int image);

// Sorts the points and baseline terms of a problem, and splits them into
// chunks. Needs the numbering of blocks. Sets point_order, point_begin,
// observation_order, observation_image, term_order, term_images, chunks,
// chunk_images, chunk_blocks (in the order of first use) and the maxima over
// chunks, except those of pairs.
void BuildChunks(const RigProblemBase& problem,
                 const std::vector<int>& image_of_observation, int num_threads,
                 RigStructure* structure);

}  // namespace mgsfm
