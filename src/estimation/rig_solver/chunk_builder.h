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

// Calls function(blocks) for each group of blocks that residuals of a chunk
// connect: the blocks of a part of a point, of an image if points are constant,
// or of a term; the two images of a cut term are separate groups. `blocks` is a
// std::vector<int> of positions in the chunk, without duplicates. Linear in the
// observations and terms of the chunk.
template <class Function>
void ForEachGroup(const RigStructure& structure, const ChunkRanges& chunk,
                  bool points_are_free, const Function& function) {
  constexpr int kNoGroup = -1;
  const RigStructure& s = structure;
  std::vector<int> met, last_group(chunk.blocks.size(), kNoGroup);
  int group = 0;
  const auto add_image = [&](int position) {
    const ChunkImage& image = s.chunk_images[chunk.images.begin + position];
    for (const int block : {image.frame, image.sensor, image.camera}) {
      if (block == kNoBlock || last_group[block] == group) continue;
      last_group[block] = group;
      met.push_back(block);
    }
  };
  const auto finish_group = [&] {
    function(met);
    met.clear();
    ++group;
  };
  for (size_t p = chunk.points.begin; p < chunk.points.end; ++p) {
    for (size_t o = s.point_begin[p]; o < s.point_begin[p + 1]; ++o) {
      if (!s.observation_starts_part.empty() && s.observation_starts_part[o]) {
        finish_group();
      }
      add_image(s.observation_image[o]);
      if (!points_are_free) finish_group();
    }
    finish_group();
  }
  for (size_t t = chunk.terms.begin; t < chunk.terms.end; ++t) {
    add_image(s.term_images[t][0]);
    if (!s.term_is_cut.empty() && s.term_is_cut[t]) finish_group();
    add_image(s.term_images[t][1]);
    finish_group();
  }
}

}  // namespace mgsfm
