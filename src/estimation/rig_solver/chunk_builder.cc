// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/chunk_builder.h"

#include <algorithm>
#include <cstdint>
#include <tuple>
#include <utility>

#include "base/parallel.h"
#include "base/ranges.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// Appends chunks to a structure. Chunks of up to 4096 observations, 1024 terms
// and 256 blocks are large enough that adding them to the common system is
// cheap, and small enough that their local systems fit the caches. Stores, for
// each image and block, the last chunk that it was added to and its position
// there.
class ChunkBuilder {
 public:
  ChunkBuilder(const RigProblemBase& problem, RigStructure* structure)
      : problem_(problem),
        s_(*structure),
        images_(problem.images.size()),
        blocks_(structure->block_size.size()) {}

  void StartChunk();
  void FinishChunk();
  // Adds an image to the current chunk if necessary. Returns its position.
  int AddImage(int image);

  const ChunkRanges& chunk() const { return s_.chunks.back(); }
  bool HasManyBlocks() const {
    return s_.chunk_blocks.size() - chunk().blocks.begin >= 256;
  }

 private:
  struct Place {
    size_t end_chunk = 0;  // number of chunks when it was added; 0: never
    int position = 0;
  };
  int AddBlock(int block);

  const RigProblemBase& problem_;
  RigStructure& s_;
  std::vector<Place> images_;
  std::vector<Place> blocks_;
};

void ChunkBuilder::StartChunk() {
  ChunkRanges chunk;
  chunk.points.begin = s_.point_begin.size() - 1;
  chunk.observations.begin = s_.observation_image.size();
  chunk.terms.begin = s_.term_images.size();
  chunk.images.begin = s_.chunk_images.size();
  chunk.blocks.begin = s_.chunk_blocks.size();
  s_.chunks.push_back(chunk);
}

void ChunkBuilder::FinishChunk() {
  ChunkRanges& chunk = s_.chunks.back();
  chunk.points.end = s_.point_begin.size() - 1;
  chunk.observations.end = s_.observation_image.size();
  chunk.terms.end = s_.term_images.size();
  chunk.images.end = s_.chunk_images.size();
  chunk.blocks.end = s_.chunk_blocks.size();
  s_.max_num_images = std::max(s_.max_num_images, chunk.images.size());
  s_.max_num_blocks = std::max(s_.max_num_blocks, chunk.blocks.size());
  size_t num_image_values = 0;
  for (size_t i = chunk.images.begin; i < chunk.images.end; ++i) {
    const int camera =
        BlocksOfImage(problem_, s_, s_.chunk_images[i].image).camera;
    const size_t num_columns =
        s_.pose_size + (camera == kNoBlock ? 0 : s_.block_size[camera]);
    num_image_values += num_columns * num_columns;
  }
  s_.max_num_image_values = std::max(s_.max_num_image_values, num_image_values);
}

int ChunkBuilder::AddBlock(int block) {
  if (block == kNoBlock) return kNoBlock;
  Place& place = blocks_[block];
  if (place.end_chunk != s_.chunks.size()) {
    place = {s_.chunks.size(),
             static_cast<int>(s_.chunk_blocks.size() - chunk().blocks.begin)};
    s_.chunk_blocks.push_back(block);
  }
  return place.position;
}

int ChunkBuilder::AddImage(int image) {
  Place& place = images_[image];
  if (place.end_chunk != s_.chunks.size()) {
    const size_t position = s_.chunk_images.size() - chunk().images.begin;
    MGSFM_CHECK_LT(position, size_t{1} << 16);
    place = {s_.chunks.size(), static_cast<int>(position)};
    const ImageBlockIndices blocks = BlocksOfImage(problem_, s_, image);
    s_.chunk_images.push_back({image, AddBlock(blocks.frame),
                               AddBlock(blocks.sensor),
                               AddBlock(blocks.camera)});
  }
  return place.position;
}

// Orders points by the first, then the last frame that observes them. Points
// that close a loop come last, because they bring distant frames into a chunk.
std::vector<int> SortPoints(const RigProblemBase& problem,
                            const std::vector<int>& image_of_observation,
                            int num_threads) {
  const size_t num_points = problem.num_points();
  std::vector<std::pair<uint64_t, int>> keys(num_points);
  ParallelFor(
      num_points, num_threads,
      [&](size_t p) {
        uint32_t first = ~0u, last = 0;
        for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
             ++o) {
          const auto frame = static_cast<uint32_t>(
              problem.images[image_of_observation[o]].frame);
          first = std::min(first, frame);
          last = std::max(last, frame);
        }
        // Points that are observed over more frames close a loop. Only the
        // order of points depends on it.
        const bool closes_loop = last > first + 40;
        keys[p] = {static_cast<uint64_t>(closes_loop) << 63 |
                       static_cast<uint64_t>(first) << 32 | last,
                   static_cast<int>(p)};
      },
      1024);
  std::sort(keys.begin(), keys.end());
  return Transformed(keys, [](const auto& entry) { return entry.second; });
}

// Orders terms by the frames of their images.
std::vector<int> SortTerms(const RigProblemBase& problem) {
  const auto key = [&](int t) {
    const BaselineTerm& term = problem.baselines[t];
    const int frame1 = problem.images[term.image1].frame;
    const int frame2 = problem.images[term.image2].frame;
    return std::make_tuple(std::min(frame1, frame2), std::max(frame1, frame2),
                           t);
  };
  std::vector<int> order = Indices(problem.baselines.size());
  SortBy(&order, key);
  return order;
}

void AddPointChunks(const RigProblemBase& problem,
                    const std::vector<int>& image_of_observation,
                    ChunkBuilder* builder, RigStructure* s) {
  const size_t num_observations = image_of_observation.size();
  s->observation_order.reserve(num_observations);
  s->observation_image.reserve(num_observations);
  s->point_begin.reserve(problem.num_points() + 1);
  s->point_begin.push_back(0);
  const auto key = [&](uint32_t o) {
    return std::make_pair(problem.images[image_of_observation[o]].frame, o);
  };
  bool is_open = false;
  for (const int p : s->point_order) {
    if (!is_open) builder->StartChunk();
    const size_t begin = s->observation_order.size();
    for (size_t o = problem.point_begin[p]; o < problem.point_begin[p + 1];
         ++o) {
      s->observation_order.push_back(static_cast<uint32_t>(o));
    }
    std::sort(s->observation_order.begin() + begin, s->observation_order.end(),
              [&](uint32_t a, uint32_t b) { return key(a) < key(b); });
    for (size_t k = begin; k < s->observation_order.size(); ++k) {
      s->observation_image.push_back(static_cast<uint16_t>(
          builder->AddImage(image_of_observation[s->observation_order[k]])));
    }
    s->point_begin.push_back(
        static_cast<uint32_t>(s->observation_image.size()));
    is_open =
        !builder->HasManyBlocks() &&
        s->observation_image.size() - builder->chunk().observations.begin <
            4096;
    if (!is_open) builder->FinishChunk();
  }
  if (is_open) builder->FinishChunk();
}

void AddTermChunks(const RigProblemBase& problem, ChunkBuilder* builder,
                   RigStructure* s) {
  bool is_open = false;
  for (const int t : s->term_order) {
    if (!is_open) builder->StartChunk();
    const int image1 = builder->AddImage(problem.baselines[t].image1);
    const int image2 = builder->AddImage(problem.baselines[t].image2);
    s->term_images.push_back({image1, image2});
    is_open = !builder->HasManyBlocks() &&
              s->term_images.size() - builder->chunk().terms.begin < 1024;
    if (!is_open) builder->FinishChunk();
  }
  if (is_open) builder->FinishChunk();
}

}  // namespace

ImageBlockIndices BlocksOfImage(const RigProblemBase& problem,
                                const RigStructure& structure, int image) {
  const RigProblemBase::Image& of_problem = problem.images[image];
  return {structure.frame_block[of_problem.frame],
          structure.sensor_block[of_problem.sensor],
          of_problem.camera < 0 ? kNoBlock
                                : structure.camera_block[of_problem.camera]};
}

void BuildChunks(const RigProblemBase& problem,
                 const std::vector<int>& image_of_observation, int num_threads,
                 RigStructure* structure) {
  ChunkBuilder builder(problem, structure);
  structure->point_order =
      SortPoints(problem, image_of_observation, num_threads);
  AddPointChunks(problem, image_of_observation, &builder, structure);
  structure->term_order = SortTerms(problem);
  AddTermChunks(problem, &builder, structure);
}

}  // namespace mgsfm
