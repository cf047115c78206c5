// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/schur_workspace.h"

#include <algorithm>

namespace mgsfm {
namespace {

using RowMajor3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using Eigen::MatrixXd;
using ImageMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0,
                                  kMaxNumImageColumns, kMaxNumImageColumns>;

// d(rotation, shift) / d(frame): the frame rotates the image by S w and shifts
// it by -S R d. Constant coordinates have zero columns.
template <int N>
Eigen::Matrix<double, N, N> FrameColumns(const ImagePose& pose,
                                         const PoseMask& mask) {
  Eigen::Matrix<double, N, N> columns = Eigen::Matrix<double, N, N>::Zero();
  if constexpr (N == 6) {
    columns.template topLeftCorner<3, 3>() =
        RowMajor3d::Map(pose.sensor_from_frame);
  }
  columns.template bottomRightCorner<3, 3>() =
      -RowMajor3d::Map(pose.cam_from_world);
  return columns * mask.template tail<N>().asDiagonal();
}

// Maps the columns of an image to the columns of its blocks.
template <int N>
class ImageBlocks {
 public:
  ImageBlocks(const RigProblemBase& problem, const ChunkImage& image,
              const ImagePose& pose)
      : image_(image) {
    const RigProblemBase::Image& of_problem = problem.images[image.image];
    if (image.frame != kNoBlock) {
      frame_ = FrameColumns<N>(pose, problem.frame_masks[of_problem.frame]);
    }
    if (image.sensor != kNoBlock) {
      sensor_ = problem.sensor_masks[of_problem.sensor].template tail<N>();
    }
  }

  // Adds the products of the columns (size x size) to the local matrix.
  void AddMatrix(const double* values, int size, SchurWorkspace* w) const {
    const Eigen::Map<const MatrixXd> all(values, size, size);
    const Eigen::Matrix<double, N, N> pose = all.template topLeftCorner<N, N>();
    const int k = size - N;
    if (image_.frame != kNoBlock) {
      const Eigen::Matrix<double, N, N> of_frame = pose * frame_;
      Add(image_.frame, image_.frame, frame_.transpose() * of_frame, w);
      if (image_.sensor != kNoBlock) {
        Add(image_.sensor, image_.frame, sensor_.asDiagonal() * of_frame, w);
      }
      if (image_.camera != kNoBlock) {
        Add(image_.camera, image_.frame,
            ImageMatrix(all.bottomLeftCorner(k, N) * frame_), w);
      }
    }
    if (image_.sensor != kNoBlock) {
      Add(image_.sensor, image_.sensor,
          sensor_.asDiagonal() * pose * sensor_.asDiagonal(), w);
      if (image_.camera != kNoBlock) {
        Add(image_.camera, image_.sensor,
            ImageMatrix(all.bottomLeftCorner(k, N) * sensor_.asDiagonal()), w);
      }
    }
    if (image_.camera != kNoBlock) {
      Add(image_.camera, image_.camera, all.bottomRightCorner(k, k), w);
    }
  }

  void AddVector(const double* values, int size, const SchurWorkspace& w,
                 double* sums) const {
    const Eigen::Map<const Eigen::VectorXd> all(values, size);
    const Eigen::Matrix<double, N, 1> pose = all.template head<N>();
    if (image_.frame != kNoBlock) {
      Eigen::Map<Eigen::Matrix<double, N, 1>>(
          sums + w.block_first[image_.frame]) += frame_.transpose() * pose;
    }
    if (image_.sensor != kNoBlock) {
      Eigen::Map<Eigen::Matrix<double, N, 1>>(
          sums + w.block_first[image_.sensor]) += sensor_.cwiseProduct(pose);
    }
    if (image_.camera != kNoBlock) {
      Eigen::VectorXd::Map(sums + w.block_first[image_.camera], size - N) +=
          all.tail(size - N);
    }
  }

 private:
  // Adds to the block (row, column) of J^T W J.
  template <class Matrix>
  void Add(int row, int column, const Matrix& values, SchurWorkspace* w) const {
    if (row == column) {
      Eigen::VectorXd::Map(w->diagonal.data() + w->block_first[row],
                           values.rows()) += values.diagonal();
    }
    if (row >= column) {
      if (!w->HasPair(row, column)) return;
      Eigen::Map<MatrixXd>(w->Pair(row, column), values.rows(),
                           values.cols()) += values;
    } else {
      if (!w->HasPair(column, row)) return;
      Eigen::Map<MatrixXd>(w->Pair(column, row), values.cols(),
                           values.rows()) += values.transpose();
    }
  }

  const ChunkImage& image_;
  Eigen::Matrix<double, N, N> frame_;
  Eigen::Matrix<double, N, 1> sensor_;
};

// Calls function(blocks, i, size) for the images of a chunk that have columns.
template <class Function>
void ForEachImage(const RigProblemBase& problem, const RigStructure& structure,
                  const ChunkRanges& chunk, const std::vector<ImagePose>& poses,
                  const SchurWorkspace& w, const Function& function) {
  for (size_t i = 0; i < chunk.images.size(); ++i) {
    const int size = w.image_num_columns[i];
    if (size == 0) continue;
    const ChunkImage& image = structure.chunk_images[chunk.images.begin + i];
    const ImagePose& pose = poses[image.image];
    if (structure.pose_size == 6) {
      function(ImageBlocks<6>(problem, image, pose), i, size);
    } else {
      function(ImageBlocks<3>(problem, image, pose), i, size);
    }
  }
}

const PoseMask& MaskOf(const RigProblemBase& problem, const ChunkImage& image,
                       int block) {
  const RigProblemBase::Image& of_problem = problem.images[image.image];
  return block == image.frame ? problem.frame_masks[of_problem.frame]
                              : problem.sensor_masks[of_problem.sensor];
}

size_t MaxNumObservationsOfPoint(const RigStructure& s) {
  size_t most = 0;
  for (size_t p = 0; p + 1 < s.point_begin.size(); ++p) {
    most = std::max(most, size_t{s.point_begin[p + 1]} - s.point_begin[p]);
  }
  return most;
}

}  // namespace

SchurWorkspace::SchurWorkspace(const RigStructure& s)
    : block_size(s.max_num_blocks),
      block_first(s.max_num_blocks),
      block_is_masked(s.max_num_blocks),
      block_mask(6 * s.max_num_blocks),
      pair_begin(s.max_num_blocks * s.max_num_blocks),
      pair_values(s.max_num_pair_values),
      gradient(s.max_num_unknowns),
      correction(s.max_num_unknowns),
      diagonal(s.max_num_unknowns),
      product(s.max_num_unknowns),
      image_num_columns(s.max_num_images),
      image_hessian_begin(s.max_num_images),
      image_hessians(s.max_num_image_values),
      image_gradients(kMaxNumImageColumns * s.max_num_images),
      met(s.max_num_blocks),
      last_point(s.max_num_blocks),
      couplings(kCouplingSize * s.max_num_blocks),
      product_terms(s.is_iterative ? MaxNumObservationsOfPoint(s) : 0) {}

void SchurWorkspace::StartVectors(const RigProblemBase& problem,
                                  const RigStructure& s,
                                  const ChunkRanges& chunk,
                                  const std::vector<ImagePose>& poses) {
  num_blocks = chunk.blocks.size();
  int num_unknowns = 0;
  for (size_t b = 0; b < num_blocks; ++b) {
    const int block = s.chunk_blocks[chunk.blocks.begin + b];
    block_size[b] = s.block_size[block];
    block_first[b] = num_unknowns;
    block_is_masked[b] = s.block_is_masked[block];
    num_unknowns += block_size[b];
    last_point[b] = ~size_t{0};
  }
  for (std::vector<double>* sums :
       {&gradient, &correction, &diagonal, &product}) {
    std::fill_n(sums->begin(), num_unknowns, 0.0);
  }
  for (size_t i = 0; i < chunk.images.size(); ++i) {
    const ChunkImage& image = s.chunk_images[chunk.images.begin + i];
    const bool is_free = image.frame != kNoBlock || image.sensor != kNoBlock ||
                         image.camera != kNoBlock;
    image_num_columns[i] =
        is_free ? s.pose_size + poses[image.image].num_free_params : 0;
    for (const int block : {image.frame, image.sensor}) {
      if (block == kNoBlock || !block_is_masked[block]) continue;
      PoseMask::Map(&block_mask[6 * block]) = MaskOf(problem, image, block);
    }
  }
  std::fill_n(image_gradients.begin(),
              kMaxNumImageColumns * chunk.images.size(), 0.0);
}

void SchurWorkspace::Start(const RigProblemBase& problem, const RigStructure& s,
                           const ChunkRanges& chunk,
                           const std::vector<ImagePose>& poses) {
  StartVectors(problem, s, chunk, poses);
  std::fill_n(pair_begin.begin(), num_blocks * num_blocks, kNoPair);
  int num_values = 0;
  for (size_t k = chunk.pairs.begin; k < chunk.pairs.end; ++k) {
    const ChunkPair& pair = s.chunk_pairs[k];
    pair_begin[pair.row * num_blocks + pair.column] = num_values;
    num_values += block_size[pair.row] * block_size[pair.column];
  }
  std::fill_n(pair_values.begin(), num_values, 0.0);
  size_t num_image_values = 0;
  for (size_t i = 0; i < chunk.images.size(); ++i) {
    image_hessian_begin[i] = num_image_values;
    num_image_values +=
        static_cast<size_t>(image_num_columns[i]) * image_num_columns[i];
  }
  std::fill_n(image_hessians.begin(), num_image_values, 0.0);
}

void AddImagesToSystem(const RigProblemBase& problem,
                       const RigStructure& structure, const ChunkRanges& chunk,
                       const std::vector<ImagePose>& poses, SchurWorkspace* w) {
  ForEachImage(
      problem, structure, chunk, poses, *w,
      [w](const auto& blocks, size_t i, int size) {
        blocks.AddMatrix(w->image_hessians.data() + w->image_hessian_begin[i],
                         size, w);
        blocks.AddVector(w->image_gradients.data() + kMaxNumImageColumns * i,
                         size, *w, w->gradient.data());
      });
}

void AddImageVectors(const RigProblemBase& problem,
                     const RigStructure& structure, const ChunkRanges& chunk,
                     const std::vector<ImagePose>& poses, SchurWorkspace* w) {
  ForEachImage(problem, structure, chunk, poses, *w,
               [w](const auto& blocks, size_t i, int size) {
                 blocks.AddVector(
                     w->image_gradients.data() + kMaxNumImageColumns * i, size,
                     *w, w->product.data());
               });
}

OrderedChunks::OrderedChunks(const RigStructure& structure, int num_threads)
    : num_chunks_(structure.chunks.size()), num_threads_(num_threads) {
  const size_t num_workspaces = std::max<size_t>(
      1, std::min<size_t>(num_threads < 1 ? 1 : num_threads, num_chunks_));
  workspaces_.reserve(num_workspaces);
  for (size_t i = 0; i < num_workspaces; ++i) {
    workspaces_.emplace_back(structure);
  }
  for (SchurWorkspace& workspace : workspaces_) free_.push_back(&workspace);
}

SchurWorkspace* OrderedChunks::Take() {
  const std::lock_guard<std::mutex> lock(mutex_);
  SchurWorkspace* workspace = free_.back();
  free_.pop_back();
  return workspace;
}

void OrderedChunks::PutBack(SchurWorkspace* workspace) {
  const std::lock_guard<std::mutex> lock(mutex_);
  free_.push_back(workspace);
}

void OrderedChunks::WaitForTurn(size_t chunk, size_t section) {
  std::unique_lock<std::mutex> lock(mutex_);
  next_chunk_changed_.wait(lock, [&] { return next_chunk_[section] == chunk; });
}

void OrderedChunks::FinishTurn(size_t section) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    ++next_chunk_[section];
  }
  next_chunk_changed_.notify_all();
}

}  // namespace mgsfm
