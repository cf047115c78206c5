// SPDX-License-Identifier: BSD-3-Clause
#include "least_squares/rig_structure.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "base/parallel.h"
#include "least_squares/chunk_groups.h"
#include "least_squares/point_cutter.h"
#include "math/sparse_solver.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/mask.h"

namespace mgsfm {
namespace {

// A chunk is large compared with what it costs to add it to the common system,
// and its local system fits the caches.
constexpr size_t kObservationsPerChunk = 4096;
constexpr size_t kTermsPerChunk = 1024;
constexpr size_t kBlocksPerChunk = 256;
constexpr uint32_t kFramesOfLocalPoint = 40;
// Internal poses and intrinsics are eliminated last, as long as they are few or
// meet many frames.
constexpr int kMaxSizeOfBorder = 200;
constexpr int kImagesOfBorderBlock = 64;
// Above, no factor is formed: 1.5 GB, and about what conjugate gradients take.
constexpr double kMaxFactorEntries = 2e8;
constexpr double kMinAffordableFlops = 4e9;
constexpr double kAffordableFlopsPerObservation = 2e4;
// Neighbours of each block that a preconditioner is tried with first.
constexpr int kMaxNumStrongNeighbours = 64;

class Builder {
 public:
  Builder(const RigProblemBase& problem,
          const std::vector<int>& image_of_observation, ReducedSolver solver,
          int num_threads, RigStructure* structure)
      : problem_(problem),
        image_of_observation_(image_of_observation),
        solver_(solver),
        num_threads_(num_threads),
        s_(*structure) {}

  void Build() {
    ChoosePoseSize();
    NumberBlocks();
    ChooseBorder();
    SortPoints();
    MakePointChunks();
    MakeTermChunks();
    ListPairsOfChunks();
    OrderBlocks();
    PlaceChunks();
  }

 private:
  using Pairs = std::vector<BlockPairKey>;

  int BlockOfFrame(int image) const {
    return s_.frame_block[problem_.images[image].frame];
  }
  int BlockOfSensor(int image) const {
    return s_.sensor_block[problem_.images[image].sensor];
  }
  int BlockOfCamera(int image) const {
    const int camera = problem_.images[image].camera;
    return camera < 0 ? -1 : s_.camera_block[camera];
  }
  int NumBlocks() const { return static_cast<int>(s_.block_size.size()); }

  void ChoosePoseSize();
  void NumberBlocks();
  Mask SeenImages() const;
  int AddPoseBlock(bool is_seen, const PoseMask& mask);
  int AddBlock(int size);
  void ChooseBorder();
  void SortPoints();
  void MakePointChunks();
  void MakeTermChunks();
  void StartChunk();
  void FinishChunk();
  int AddImage(int image);
  int AddChunkBlock(int block);
  bool ChunkHasManyBlocks() const {
    return s_.chunk_blocks.size() - s_.chunks.back().blocks.begin >=
           kBlocksPerChunk;
  }
  void ListPairsOfChunks();
  template <class Function>
  void ForEachLoosePair(const Function& function) const;
  Pairs PairsOfChunk(const ChunkRanges& chunk) const;
  Pairs UnitePairs() const;
  void OrderBlocks();
  EliminationOrder OrderGraph(const Pairs& pairs) const;
  bool IsAffordable(const EliminationOrder& order) const;
  bool ChooseIterative(const EliminationOrder& order) const;
  EliminationOrder OrderPreconditioner(Pairs* pairs);
  Pairs InseparablePairs() const;
  void PlaceChunks();
  void PlaceChunk(size_t chunk_idx);

  const RigProblemBase& problem_;
  const std::vector<int>& image_of_observation_;
  const ReducedSolver solver_;
  const int num_threads_;
  RigStructure& s_;

  Mask block_is_border_;
  // The chunk that an image or block was last added to, and where.
  std::vector<int> image_chunk_, image_position_;
  std::vector<int> block_chunk_, block_position_;
  std::vector<Pairs> pairs_;  // of each chunk, by positions in its blocks
};

Mask Builder::SeenImages() const {
  Mask is_seen(problem_.images.size(), false);
  for (const int image : image_of_observation_) is_seen[image] = true;
  for (const BaselineTerm& term : problem_.baselines) {
    is_seen[term.image1] = is_seen[term.image2] = true;
  }
  return is_seen;
}

int Builder::AddBlock(int size) {
  s_.block_size.push_back(size);
  s_.block_is_masked.push_back(false);
  return NumBlocks() - 1;
}

int Builder::AddPoseBlock(bool is_seen, const PoseMask& mask) {
  if (!is_seen || mask.isZero(0.0)) return -1;
  const int block = AddBlock(s_.pose_size);
  s_.block_is_masked[block] = (mask.tail(s_.pose_size).array() == 0.0).any();
  return block;
}

void Builder::ChoosePoseSize() {
  const auto turns = [](const PoseMask& mask) {
    return !mask.head<3>().isZero(0.0);
  };
  const auto any_turns = [&](const std::vector<PoseMask>& masks) {
    return std::any_of(masks.begin(), masks.end(), turns);
  };
  if (any_turns(problem_.frame_masks) || any_turns(problem_.sensor_masks)) {
    s_.pose_size = 6;
    MGSFM_CHECK(problem_.baselines.empty());
    MGSFM_CHECK(problem_.held_cam_from_world.empty());
  }
}

void Builder::NumberBlocks() {
  const Mask image_is_seen = SeenImages();
  Mask frame_is_seen(problem_.frame_masks.size(), false);
  Mask sensor_is_seen(problem_.sensor_masks.size(), false);
  Mask camera_is_seen(problem_.cameras.size(), false);
  for (size_t i = 0; i < image_is_seen.size(); ++i) {
    if (!image_is_seen[i]) continue;
    const RigProblemBase::Image& image = problem_.images[i];
    frame_is_seen[image.frame] = sensor_is_seen[image.sensor] = true;
    if (image.camera >= 0) camera_is_seen[image.camera] = true;
  }
  for (const LinearTerm& term : problem_.linear_terms) {
    for (const LinearTerm::Part& part : term.parts) {
      (part.is_frame ? frame_is_seen : sensor_is_seen)[part.idx] = true;
    }
  }
  for (size_t i = 0; i < frame_is_seen.size(); ++i) {
    s_.frame_block.push_back(
        AddPoseBlock(frame_is_seen[i], problem_.frame_masks[i]));
  }
  for (size_t i = 0; i < sensor_is_seen.size(); ++i) {
    s_.sensor_block.push_back(
        AddPoseBlock(sensor_is_seen[i], problem_.sensor_masks[i]));
  }
  for (size_t i = 0; i < camera_is_seen.size(); ++i) {
    const int size = static_cast<int>(problem_.cameras[i].free_params.size());
    s_.camera_block.push_back(camera_is_seen[i] && size > 0 ? AddBlock(size)
                                                            : -1);
  }
  s_.num_unknowns =
      std::accumulate(s_.block_size.begin(), s_.block_size.end(), 0);
}

void Builder::ChooseBorder() {
  std::vector<int> num_images(NumBlocks(), 0);
  for (size_t i = 0; i < problem_.images.size(); ++i) {
    const int image = static_cast<int>(i);
    for (const int block : {BlockOfSensor(image), BlockOfCamera(image)}) {
      if (block >= 0) ++num_images[block];
    }
  }
  block_is_border_.assign(NumBlocks(), false);
  int size = 0;
  const auto visit = [&](const std::vector<int>& blocks, const auto& function) {
    for (const int block : blocks) {
      if (block >= 0) function(block);
    }
  };
  const auto add_size = [&](int block) { size += s_.block_size[block]; };
  visit(s_.sensor_block, add_size);
  visit(s_.camera_block, add_size);
  const auto choose = [&](int block) {
    block_is_border_[block] =
        size <= kMaxSizeOfBorder || num_images[block] >= kImagesOfBorderBlock;
  };
  visit(s_.sensor_block, choose);
  visit(s_.camera_block, choose);
}

// By the first, then the last frame that sees them; points of loops, which
// bring frames from elsewhere into a chunk, after all others.
void Builder::SortPoints() {
  const size_t num_points = problem_.num_points();
  std::vector<std::pair<uint64_t, int>> keys(num_points);
  ParallelFor(
      num_points, num_threads_,
      [&](size_t p) {
        uint32_t first = ~0u, last = 0;
        for (size_t o = problem_.point_begin[p];
             o < problem_.point_begin[p + 1]; ++o) {
          const auto frame = static_cast<uint32_t>(
              problem_.images[image_of_observation_[o]].frame);
          first = std::min(first, frame);
          last = std::max(last, frame);
        }
        const bool is_of_loop = last > first + kFramesOfLocalPoint;
        keys[p] = {static_cast<uint64_t>(is_of_loop) << 63 |
                       static_cast<uint64_t>(first) << 32 | last,
                   static_cast<int>(p)};
      },
      1024);
  std::sort(keys.begin(), keys.end());
  s_.point_order.reserve(num_points);
  for (const auto& [key, point] : keys) s_.point_order.push_back(point);
}

void Builder::StartChunk() {
  ChunkRanges chunk;
  chunk.points.begin = s_.point_begin.size() - 1;
  chunk.observations.begin = s_.observation_image.size();
  chunk.terms.begin = s_.term_images.size();
  chunk.images.begin = s_.chunk_images.size();
  chunk.blocks.begin = s_.chunk_blocks.size();
  s_.chunks.push_back(chunk);
}

void Builder::FinishChunk() {
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
    const int camera = BlockOfCamera(s_.chunk_images[i].image);
    const size_t num_columns =
        s_.pose_size + (camera < 0 ? 0 : s_.block_size[camera]);
    num_image_values += num_columns * num_columns;
  }
  s_.max_num_image_values = std::max(s_.max_num_image_values, num_image_values);
}

int Builder::AddChunkBlock(int block) {
  if (block < 0) return -1;
  const int chunk = static_cast<int>(s_.chunks.size()) - 1;
  if (block_chunk_[block] != chunk) {
    block_chunk_[block] = chunk;
    block_position_[block] = static_cast<int>(s_.chunk_blocks.size() -
                                              s_.chunks.back().blocks.begin);
    s_.chunk_blocks.push_back(block);
  }
  return block_position_[block];
}

int Builder::AddImage(int image) {
  const int chunk = static_cast<int>(s_.chunks.size()) - 1;
  if (image_chunk_[image] != chunk) {
    image_chunk_[image] = chunk;
    image_position_[image] = static_cast<int>(s_.chunk_images.size() -
                                              s_.chunks.back().images.begin);
    s_.chunk_images.push_back({image, AddChunkBlock(BlockOfFrame(image)),
                               AddChunkBlock(BlockOfSensor(image)),
                               AddChunkBlock(BlockOfCamera(image))});
  }
  return image_position_[image];
}

void Builder::MakePointChunks() {
  image_chunk_.assign(problem_.images.size(), -1);
  image_position_.resize(problem_.images.size());
  block_chunk_.assign(NumBlocks(), -1);
  block_position_.resize(NumBlocks());
  const size_t num_observations = image_of_observation_.size();
  s_.observation_order.reserve(num_observations);
  s_.observation_image.reserve(num_observations);
  s_.point_begin.reserve(problem_.num_points() + 1);
  s_.point_begin.push_back(0);
  const auto frame = [this](uint32_t o) {
    return problem_.images[image_of_observation_[o]].frame;
  };
  bool is_open = false;
  for (const int p : s_.point_order) {
    if (!is_open) StartChunk();
    const size_t begin = s_.observation_order.size();
    for (size_t o = problem_.point_begin[p]; o < problem_.point_begin[p + 1];
         ++o) {
      s_.observation_order.push_back(static_cast<uint32_t>(o));
    }
    std::sort(s_.observation_order.begin() + begin, s_.observation_order.end(),
              [&](uint32_t a, uint32_t b) {
                return std::make_pair(frame(a), a) <
                       std::make_pair(frame(b), b);
              });
    for (size_t k = begin; k < s_.observation_order.size(); ++k) {
      s_.observation_image.push_back(
          AddImage(image_of_observation_[s_.observation_order[k]]));
    }
    s_.point_begin.push_back(s_.observation_image.size());
    is_open =
        !ChunkHasManyBlocks() &&
        s_.observation_image.size() - s_.chunks.back().observations.begin <
            kObservationsPerChunk;
    if (!is_open) FinishChunk();
  }
  if (is_open) FinishChunk();
}

void Builder::MakeTermChunks() {
  const auto key = [this](int t) {
    const BaselineTerm& term = problem_.baselines[t];
    const int frame1 = problem_.images[term.image1].frame;
    const int frame2 = problem_.images[term.image2].frame;
    return std::make_tuple(std::min(frame1, frame2), std::max(frame1, frame2),
                           t);
  };
  s_.term_order.resize(problem_.baselines.size());
  std::iota(s_.term_order.begin(), s_.term_order.end(), 0);
  std::sort(s_.term_order.begin(), s_.term_order.end(),
            [&](int a, int b) { return key(a) < key(b); });
  bool is_open = false;
  for (const int t : s_.term_order) {
    if (!is_open) StartChunk();
    const int image1 = AddImage(problem_.baselines[t].image1);
    const int image2 = AddImage(problem_.baselines[t].image2);
    s_.term_images.push_back({image1, image2});
    is_open =
        !ChunkHasManyBlocks() &&
        s_.term_images.size() - s_.chunks.back().terms.begin < kTermsPerChunk;
    if (!is_open) FinishChunk();
  }
  if (is_open) FinishChunk();
}

void Builder::ListPairsOfChunks() {
  pairs_.resize(s_.chunks.size());
  ParallelFor(
      s_.chunks.size(), num_threads_,
      [this](size_t c) { pairs_[c] = PairsOfChunk(s_.chunks[c]); }, 1);
}

Builder::Pairs Builder::PairsOfChunk(const ChunkRanges& chunk) const {
  const size_t num_blocks = chunk.blocks.size();
  Mask is_met(num_blocks * num_blocks, false);
  const auto add = [&](const std::vector<int>& met) {
    for (const int a : met) {
      for (const int b : met) is_met[a * num_blocks + b] = true;
    }
  };
  ForEachGroup(s_, chunk, problem_.points_are_free, add);
  Pairs pairs;
  for (size_t a = 0; a < num_blocks; ++a) {
    for (size_t b = 0; b <= a; ++b) {
      if (!is_met[a * num_blocks + b]) continue;
      pairs.push_back(
          MakeBlockPairKey(static_cast<int>(b), static_cast<int>(a)));
    }
  }
  return pairs;
}

// Calls function(a, b) for blocks that meet otherwise than in a chunk.
template <class Function>
void Builder::ForEachLoosePair(const Function& function) const {
  const auto block_of = [this](const LinearTerm::Part& part) {
    return (part.is_frame ? s_.frame_block : s_.sensor_block)[part.idx];
  };
  for (const LinearTerm& term : problem_.linear_terms) {
    for (const LinearTerm::Part& a : term.parts) {
      for (const LinearTerm::Part& b : term.parts) {
        if (block_of(a) >= 0 && block_of(b) >= 0) {
          function(block_of(a), block_of(b));
        }
      }
    }
  }
  const auto visit_poses_of = [&](int image) {
    const int frame = BlockOfFrame(image), sensor = BlockOfSensor(image);
    if (frame >= 0 && sensor >= 0) function(frame, sensor);
  };
  for (const PositionPrior& prior : problem_.position_priors) {
    visit_poses_of(prior.image);
  }
  for (const GravityPrior& prior : problem_.gravity_priors) {
    visit_poses_of(prior.image);
  }
}

// All pairs of blocks, by number, each once.
Builder::Pairs Builder::UnitePairs() const {
  Pairs all;
  const auto add = [&all](int a, int b) {
    all.push_back(MakeBlockPairKey(std::min(a, b), std::max(a, b)));
  };
  for (size_t c = 0; c < s_.chunks.size(); ++c) {
    const int* blocks = s_.chunk_blocks.data() + s_.chunks[c].blocks.begin;
    for (const BlockPairKey pair : pairs_[c]) {
      add(blocks[ColumnOf(pair)], blocks[RowOf(pair)]);
    }
  }
  ForEachLoosePair(add);
  for (int a = 0; a < NumBlocks(); ++a) {
    add(a, a);
    if (!block_is_border_[a]) continue;
    for (int b = 0; b < a; ++b) {
      if (block_is_border_[b]) add(a, b);
    }
  }
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

// Of the blocks that are not border, as if they were numbers.
EliminationOrder Builder::OrderGraph(const Pairs& pairs) const {
  std::vector<int> node(NumBlocks(), -1);
  int num_nodes = 0;
  for (int b = 0; b < NumBlocks(); ++b) {
    if (!block_is_border_[b]) node[b] = num_nodes++;
  }
  Pairs node_pairs;
  for (const BlockPairKey pair : pairs) {
    const int column = node[ColumnOf(pair)], row = node[RowOf(pair)];
    if (column < 0 || row < 0) continue;
    node_pairs.push_back(MakeBlockPairKey(column, row));
  }
  EliminationOrder order = FindEliminationOrder(
      BlockPattern(std::vector<int>(num_nodes, 1), node_pairs).MakeMatrix());
  std::vector<int> blocks;
  for (int b = 0; b < NumBlocks(); ++b) {
    if (!block_is_border_[b]) blocks.push_back(b);
  }
  for (int& position : order.order) position = blocks[position];
  return order;
}

bool Builder::IsAffordable(const EliminationOrder& order) const {
  const double size = s_.pose_size;
  const double affordable =
      std::max(kMinAffordableFlops,
               kAffordableFlopsPerObservation *
                   static_cast<double>(image_of_observation_.size()));
  return order.num_factor_entries * size * size <= kMaxFactorEntries &&
         order.num_flops * size * size * size <= affordable;
}

bool Builder::ChooseIterative(const EliminationOrder& order) const {
  if (solver_ != ReducedSolver::kAuto) {
    return solver_ == ReducedSolver::kIterative;
  }
  return !IsAffordable(order);
}

// Pairs of blocks of one image or prior, of those that are not border.
Builder::Pairs Builder::InseparablePairs() const {
  Pairs pairs;
  const auto add = [&](int a, int b) {
    if (a == b || block_is_border_[a] || block_is_border_[b]) return;
    pairs.push_back(MakeBlockPairKey(std::min(a, b), std::max(a, b)));
  };
  ForEachLoosePair(add);
  for (size_t i = 0; i < problem_.images.size(); ++i) {
    const int image = static_cast<int>(i);
    const int frame = BlockOfFrame(image);
    const int sensor = BlockOfSensor(image);
    const int camera = BlockOfCamera(image);
    if (frame >= 0 && sensor >= 0) add(frame, sensor);
    if (frame >= 0 && camera >= 0) add(frame, camera);
    if (sensor >= 0 && camera >= 0) add(sensor, camera);
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  return pairs;
}

// Cuts points until the factor is affordable.
EliminationOrder Builder::OrderPreconditioner(Pairs* pairs) {
  PointCutter cutter(problem_.points_are_free, block_is_border_,
                     InseparablePairs(), num_threads_, &s_);
  for (int num_kept = kMaxNumStrongNeighbours;; num_kept /= 2) {
    cutter.Cut(num_kept);
    ListPairsOfChunks();
    *pairs = UnitePairs();
    EliminationOrder order = OrderGraph(*pairs);
    if (num_kept == 0 || IsAffordable(order)) {
      return order;
    }
  }
}

void Builder::OrderBlocks() {
  Pairs pairs = UnitePairs();
  EliminationOrder order = OrderGraph(pairs);
  s_.is_iterative = ChooseIterative(order);
  if (s_.is_iterative) order = OrderPreconditioner(&pairs);
  for (int b = 0; b < NumBlocks(); ++b) {
    if (block_is_border_[b]) order.order.push_back(b);
  }
  s_.block_rank.resize(NumBlocks());
  s_.block_first.resize(NumBlocks());
  std::vector<int> sizes;
  int first = 0;
  for (const int block : order.order) {
    s_.block_rank[block] = static_cast<int>(sizes.size());
    s_.block_first[block] = first;
    sizes.push_back(s_.block_size[block]);
    first += sizes.back();
  }
  for (BlockPairKey& pair : pairs) {
    const int a = s_.block_rank[ColumnOf(pair)], b = s_.block_rank[RowOf(pair)];
    pair = MakeBlockPairKey(std::min(a, b), std::max(a, b));
  }
  std::sort(pairs.begin(), pairs.end());
  s_.pattern = BlockPattern(sizes, pairs);
}

void Builder::PlaceChunks() {
  for (size_t c = 0; c < s_.chunks.size(); ++c) PlaceChunk(c);
}

// Puts the blocks of a chunk in the order of elimination.
void Builder::PlaceChunk(size_t chunk_idx) {
  ChunkRanges& chunk = s_.chunks[chunk_idx];
  const size_t num_blocks = chunk.blocks.size();
  int* blocks = s_.chunk_blocks.data() + chunk.blocks.begin;
  std::vector<int> order(num_blocks), position(num_blocks);
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return s_.block_rank[blocks[a]] < s_.block_rank[blocks[b]];
  });
  std::vector<int> sorted;
  size_t num_unknowns = 0;
  for (size_t k = 0; k < num_blocks; ++k) {
    position[order[k]] = static_cast<int>(k);
    sorted.push_back(blocks[order[k]]);
    num_unknowns += s_.block_size[sorted.back()];
  }
  std::copy(sorted.begin(), sorted.end(), blocks);
  for (size_t i = chunk.images.begin; i < chunk.images.end; ++i) {
    ChunkImage& image = s_.chunk_images[i];
    for (int* block : {&image.frame, &image.sensor, &image.camera}) {
      if (*block >= 0) *block = position[*block];
    }
  }
  Pairs& pairs = pairs_[chunk_idx];
  for (BlockPairKey& pair : pairs) {
    const int a = position[ColumnOf(pair)], b = position[RowOf(pair)];
    pair = MakeBlockPairKey(std::min(a, b), std::max(a, b));
  }
  std::sort(pairs.begin(), pairs.end());
  chunk.pairs.begin = s_.chunk_pairs.size();
  size_t num_values = 0;
  for (const BlockPairKey pair : pairs) {
    const int column = blocks[ColumnOf(pair)], row = blocks[RowOf(pair)];
    const auto [first, stride] =
        s_.pattern.Find(s_.block_rank[column], s_.block_rank[row]);
    s_.chunk_pairs.push_back({RowOf(pair), ColumnOf(pair), stride, first});
    num_values +=
        static_cast<size_t>(s_.block_size[column]) * s_.block_size[row];
  }
  chunk.pairs.end = s_.chunk_pairs.size();
  pairs = Pairs();
  s_.max_num_unknowns = std::max(s_.max_num_unknowns, num_unknowns);
  s_.max_num_pair_values = std::max(s_.max_num_pair_values, num_values);
}

}  // namespace

RigStructure::RigStructure(const RigProblemBase& problem,
                           const std::vector<int>& image_of_observation,
                           ReducedSolver solver, int num_threads) {
  Builder(problem, image_of_observation, solver, num_threads, this).Build();
}

}  // namespace mgsfm
