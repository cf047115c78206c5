// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/baseline_terms.h"

#include <array>
#include <cmath>

namespace mgsfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using RowMajor3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Vector3d CenterOf(const ImagePose& pose) {
  return Vector3d::Map(pose.center) -
         RowMajor3d::Map(pose.cam_from_world).transpose() *
             Vector3d::Map(pose.translation);
}

const BaselineTerm& TermOf(const TermInput& in, size_t t) {
  return in.problem.baselines[in.structure.term_order[t]];
}

BaselineResidual ResidualOf(const TermInput& in, size_t t) {
  const BaselineTerm& term = TermOf(in, t);
  return EvaluateBaselineTerm(
      term, CenterOf(in.poses[term.image2]) - CenterOf(in.poses[term.image1]));
}

// A term and its derivatives with respect to the blocks of a chunk, times the
// square root of its weight.
class LinearTermOfBlocks {
 public:
  LinearTermOfBlocks(const TermInput& in, const ChunkRanges& chunk, size_t t)
      : residual_(ResidualOf(in, t)) {
    const RigStructure& structure = in.structure;
    const RobustLoss& loss = in.problem.loss;
    for (int side = 0; side < 2; ++side) {
      images_[side] = &structure.chunk_images[chunk.images.begin +
                                              structure.term_images[t][side]];
    }
    const double root = std::sqrt(loss.Weight(residual_.value.squaredNorm()));
    residual_.value *= root;
    residual_.by_baseline *= root;
    for (int side = 0; side < 2; ++side) {
      const double sign = side == 0 ? -1.0 : 1.0;
      const ImagePose& pose = in.poses[images_[side]->image];
      const auto& image = in.problem.images[images_[side]->image];
      Add(images_[side]->frame, sign * Matrix3d::Identity(),
          in.problem.frame_masks[image.frame]);
      Add(images_[side]->sensor,
          -sign * RowMajor3d::Map(pose.cam_from_world).transpose(),
          in.problem.sensor_masks[image.sensor]);
    }
  }

  void AddTo(SchurWorkspace* w) const {
    // If not, the preconditioner omits the term: parts of it may be indefinite.
    const bool is_whole = AllPairsAreIn(*w);
    for (int a = 0; a < num_blocks_; ++a) {
      const int row = blocks_[a];
      const Matrix3d J = residual_.by_baseline * coefficients_[a];
      Eigen::Map<Vector3d>(w->gradient.data() + w->block_first[row]) +=
          J.transpose() * residual_.value;
      Eigen::Map<Vector3d>(w->diagonal.data() + w->block_first[row]) +=
          J.colwise().squaredNorm().transpose();
      for (int b = 0; b < num_blocks_; ++b) {
        if (blocks_[b] > row || !is_whole) continue;
        Eigen::Map<Matrix3d>(w->Pair(row, blocks_[b])).noalias() +=
            J.transpose() * (residual_.by_baseline * coefficients_[b]);
      }
    }
  }

  void MultiplyTo(const std::vector<ImagePose>& poses,
                  const std::vector<ImageTwist>& twists,
                  SchurWorkspace* w) const {
    const Vector3d force =
        residual_.by_baseline.transpose() *
        (residual_.by_baseline * ChangeOfBaseline(poses, twists));
    for (int a = 0; a < num_blocks_; ++a) {
      Eigen::Map<Vector3d>(w->product.data() + w->block_first[blocks_[a]]) +=
          coefficients_[a].transpose() * force;
    }
  }

 private:
  Vector3d ChangeOfBaseline(const std::vector<ImagePose>& poses,
                            const std::vector<ImageTwist>& twists) const {
    // A center moves by -(S R)^T shift.
    Vector3d change = Vector3d::Zero();
    for (int side = 0; side < 2; ++side) {
      const int image = images_[side]->image;
      const Vector3d moved =
          RowMajor3d::Map(poses[image].cam_from_world).transpose() *
          Vector3d::Map(twists[image].shift);
      change += side == 0 ? moved : Vector3d(-moved);
    }
    return change;
  }
  bool AllPairsAreIn(const SchurWorkspace& w) const {
    for (int a = 0; a < num_blocks_; ++a) {
      for (int b = 0; b < num_blocks_; ++b) {
        if (blocks_[b] <= blocks_[a] && !w.HasPair(blocks_[a], blocks_[b])) {
          return false;
        }
      }
    }
    return true;
  }
  void Add(int block, const Matrix3d& coefficients, const PoseMask& mask) {
    if (block < 0) return;
    int k = 0;
    while (k < num_blocks_ && blocks_[k] != block) ++k;
    if (k == num_blocks_) {
      blocks_[num_blocks_++] = block;
      coefficients_[k].setZero();
    }
    coefficients_[k] += coefficients * mask.tail<3>().asDiagonal();
  }

  std::array<const ChunkImage*, 2> images_;
  BaselineResidual residual_;
  int num_blocks_ = 0;
  std::array<int, 4> blocks_;
  std::array<Matrix3d, 4> coefficients_;
};

}  // namespace

BaselineResidual EvaluateBaselineTerm(const BaselineTerm& term,
                                      const Vector3d& baseline) {
  BaselineResidual r;
  if (term.kind == BaselineTerm::Kind::kZero) {
    r.size = 3;
    r.value = term.weight * baseline;
    r.by_baseline = term.weight * Matrix3d::Identity();
    return r;
  }
  const double squared =
      baseline.squaredNorm() + term.min_length * term.min_length;
  const double length = std::sqrt(squared);
  if (term.kind == BaselineTerm::Kind::kLength) {
    r.size = 1;
    r.value[0] = term.weight * std::log(length / term.length);
    r.by_baseline.row(0) = term.weight / squared * baseline.transpose();
    return r;
  }
  const Vector3d unit = baseline / length;
  r.size = 3;
  r.value = term.weight * (unit - term.direction);
  r.by_baseline =
      term.weight / length * (Matrix3d::Identity() - unit * unit.transpose());
  return r;
}

double CostOfTerms(const TermInput& in, const ChunkRanges& chunk) {
  const RobustLoss& loss = in.problem.loss;
  double cost = 0.0;
  for (size_t t = chunk.terms.begin; t < chunk.terms.end; ++t) {
    const BaselineResidual r = ResidualOf(in, t);
    cost += 0.5 * loss.Cost(r.value.squaredNorm());
  }
  return cost;
}

void AddTermsToSystem(const TermInput& in, const ChunkRanges& chunk,
                      SchurWorkspace* workspace) {
  for (size_t t = chunk.terms.begin; t < chunk.terms.end; ++t) {
    LinearTermOfBlocks(in, chunk, t).AddTo(workspace);
  }
}

void MultiplyTerms(const TermInput& in, const ChunkRanges& chunk,
                   const std::vector<ImageTwist>& twists,
                   SchurWorkspace* workspace) {
  for (size_t t = chunk.terms.begin; t < chunk.terms.end; ++t) {
    LinearTermOfBlocks(in, chunk, t).MultiplyTo(in.poses, twists, workspace);
  }
}

}  // namespace mgsfm
