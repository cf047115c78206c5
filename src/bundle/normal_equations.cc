// SPDX-License-Identifier: BSD-3-Clause
#include "bundle/normal_equations.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <atomic>

#include "bundle/chunks.h"
#include "mgsfm/math/robust_loss.h"

namespace mgsfm {
namespace {

constexpr size_t kPointsPerChunk = 64;

double ClampDiagonal(double value) { return std::clamp(value, 1e-6, 1e32); }

// panel -= left * right^T for blocks of any size; almost all have 6
// rows and columns.
template <class Panel, class Left, class Right>
void SubtractProduct(const Left& left, const Right& right, Panel panel) {
  if (left.rows() == 6 && right.rows() == 6) {
    const Eigen::Matrix<double, 6, 3> a = left;
    const Eigen::Matrix<double, 6, 3> b = right;
    panel.template topLeftCorner<6, 6>() -= a.lazyProduct(b.transpose());
  } else {
    panel -= left.lazyProduct(right.transpose());
  }
}

}  // namespace

NormalEquations::NormalEquations(const BundleProblem& problem,
                                 const BundleStructure& structure,
                                 int num_threads)
    : problem_(problem), structure_(structure), num_threads_(num_threads) {
  const size_t num_points = problem.num_points();
  const size_t num_images = problem.images.size();
  point_hessians_.resize(num_points);
  point_gradients_.resize(num_points);
  point_inverses_.resize(num_points);
  couplings_.resize(structure.coupling_size);
  image_hessians_.resize(num_images);
  image_gradients_.resize(num_images);
  for (size_t i = 0; i < num_images; ++i) {
    const int size = structure.layouts[i].num_columns;
    image_hessians_[i].resize(size, size);
    image_gradients_[i].resize(size);
  }
  prior_hessian_.resize(structure.num_unknowns);
  gradient_.resize(structure.num_unknowns);
  hessian_diagonal_.resize(structure.num_unknowns);
  reduced_rhs_.resize(structure.num_unknowns);
  MakePattern();
}

void NormalEquations::MakePattern() {
  const int num_unknowns = structure_.num_unknowns;
  columns_.resize(structure_.blocks.size());
  ParallelFor(
      columns_.size(), num_threads_,
      [this](size_t block) {
        columns_[block] = MakeColumn(static_cast<int>(block));
      },
      1);
  reduced_.resize(num_unknowns, num_unknowns);
  if (num_unknowns == 0) return;
  size_t num_values = 0;
  for (size_t b = 0; b < columns_.size(); ++b) {
    columns_[b].first_value = num_values;
    num_values +=
        static_cast<size_t>(columns_[b].height) * structure_.blocks[b].size;
  }
  reduced_.resizeNonZeros(static_cast<Eigen::Index>(num_values));
  int* outer = reduced_.outerIndexPtr();
  int* inner = reduced_.innerIndexPtr();
  *outer = 0;
  for (size_t b = 0; b < columns_.size(); ++b) {
    for (int c = 0; c < structure_.blocks[b].size; ++c) {
      for (const int row_block : columns_[b].blocks) {
        const ParameterBlock& block = structure_.blocks[row_block];
        for (int r = 0; r < block.size; ++r) *inner++ = block.first + r;
      }
      ++outer;
      *outer = *(outer - 1) + columns_[b].height;
    }
  }
  std::fill_n(reduced_.valuePtr(), num_values, 0.0);
  solver_.Analyze(reduced_);
}

NormalEquations::Column NormalEquations::MakeColumn(int block) const {
  const BundleStructure& s = structure_;
  std::vector<char> is_met(s.blocks.size(), false);
  for (size_t k = s.block_incidences.begin[block];
       k < s.block_incidences.begin[block + 1]; ++k) {
    const int first = s.block_incidences.items[k];
    const size_t end = s.point_incidences[s.incidence_point[first] + 1];
    for (size_t e = first; e < end; ++e) is_met[s.incidence_block[e]] = true;
  }
  Column column;
  for (size_t b = block; b < is_met.size(); ++b) {
    if (!is_met[b]) continue;
    column.blocks.push_back(static_cast<int>(b));
    column.rows.push_back(column.height);
    column.height += s.blocks[b].size;
  }
  return column;
}

bool NormalEquations::Linearize(const BundleState& state) {
  const std::vector<ImagePose> poses = ComputeImagePoses(problem_, state);
  points_ = state.points;
  std::atomic<bool> is_valid{true};
  ParallelFor(
      problem_.num_points(), num_threads_,
      [&](size_t point) {
        if (!LinearizePoint(poses, point)) is_valid = false;
      },
      kPointsPerChunk);
  if (!is_valid) return false;
  ParallelFor(
      problem_.images.size(), num_threads_,
      [&](size_t image) { LinearizeImage(poses, image); }, 1);
  AddPriors(state);
  for (size_t i = 0; i < problem_.images.size(); ++i) {
    // In the order of the columns of the image.
    int column = 0;
    const BundleProblem::Image& image = problem_.images[i];
    for (const int block : {structure_.frame_block[image.frame],
                            structure_.sensor_block[image.sensor],
                            structure_.camera_block[image.camera]}) {
      if (block < 0) continue;
      const auto [size, first] = structure_.blocks[block];
      gradient_.segment(first, size) +=
          image_gradients_[i].segment(column, size);
      hessian_diagonal_.segment(first, size) +=
          image_hessians_[i].diagonal().segment(column, size);
      column += size;
    }
  }
  return gradient_.allFinite() && hessian_diagonal_.allFinite();
}

bool NormalEquations::LinearizePoint(const std::vector<ImagePose>& poses,
                                     size_t point) {
  const RobustLoss loss{RobustLossType::kHuber, problem_.loss_scale_px};
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  const size_t first_incidence = structure_.point_incidences[point];
  const size_t last_incidence = structure_.point_incidences[point + 1];
  for (size_t e = first_incidence; e < last_incidence; ++e) {
    std::fill_n(&couplings_[structure_.incidence_coupling[e]],
                3 * structure_.blocks[structure_.incidence_block[e]].size, 0.0);
  }
  ObservationTerms terms;
  ObservationColumns columns;
  for (size_t o = problem_.point_begin[point];
       o < problem_.point_begin[point + 1]; ++o) {
    const BundleProblem::PixelObservation& observation =
        problem_.observations[o];
    const BundleProblem::Image& image = problem_.images[observation.image];
    const ColumnLayout& layout = structure_.layouts[observation.image];
    const ImagePose& pose = poses[observation.image];
    if (!EvaluateTerms(pose, points_[point], observation.pixel,
                       layout.camera >= 0, &terms)) {
      return false;
    }
    columns.resize(2, layout.num_columns);
    FillColumns(problem_, image, pose, terms, layout, &columns);
    const double weight = loss.Weight(terms.residual.squaredNorm());
    const Eigen::Matrix<double, 2, 3> weighted = weight * terms.point;
    hessian.noalias() += weighted.transpose() * terms.point;
    gradient.noalias() += weighted.transpose() * terms.residual;
    const int offsets[] = {layout.frame, layout.sensor, layout.camera};
    for (int k = 0; k < 3; ++k) {
      const int e = structure_.observation_incidences[o][k];
      if (e < 0) continue;
      double* coupling = &couplings_[structure_.incidence_coupling[e]];
      const int size = structure_.blocks[structure_.incidence_block[e]].size;
      if (size == 6) {
        Eigen::Map<Eigen::Matrix<double, 6, 3>>(coupling) +=
            columns.middleCols<6>(offsets[k]).transpose() * weighted;
      } else {
        Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 3>>(
            coupling, size, 3) += columns.middleCols(offsets[k], size)
                                      .transpose()
                                      .lazyProduct(weighted);
      }
    }
  }
  point_hessians_[point] = hessian;
  point_gradients_[point] = gradient;
  return hessian.allFinite() && gradient.allFinite();
}

void NormalEquations::LinearizeImage(const std::vector<ImagePose>& poses,
                                     size_t image) {
  const RobustLoss loss{RobustLossType::kHuber, problem_.loss_scale_px};
  const ColumnLayout& layout = structure_.layouts[image];
  const int size = layout.num_columns;
  Eigen::MatrixXd& hessian = image_hessians_[image];
  Eigen::VectorXd& gradient = image_gradients_[image];
  hessian.setZero();
  gradient.setZero();
  if (size == 0) return;
  ObservationTerms terms;
  ObservationColumns columns(2, size);
  const IndexGroups& groups = structure_.image_observations;
  for (size_t k = groups.begin[image]; k < groups.begin[image + 1]; ++k) {
    const size_t o = groups.items[k];
    EvaluateTerms(poses[image], points_[structure_.observation_point[o]],
                  problem_.observations[o].pixel, layout.camera >= 0, &terms);
    FillColumns(problem_, problem_.images[image], poses[image], terms, layout,
                &columns);
    const double weight = loss.Weight(terms.residual.squaredNorm());
    for (int c = 0; c < size; ++c) {
      const double u = weight * columns(0, c);
      const double v = weight * columns(1, c);
      gradient[c] += u * terms.residual.x() + v * terms.residual.y();
      for (int r = c; r < size; ++r) {
        hessian(r, c) += u * columns(0, r) + v * columns(1, r);
      }
    }
  }
}

void NormalEquations::AddPriors(const BundleState& state) {
  gradient_.setZero();
  prior_hessian_.setZero();
  for (const BundleProblem::ParameterPrior& prior : problem_.priors) {
    const int block = structure_.camera_block[prior.camera];
    if (block < 0) continue;
    const std::vector<int>& params = problem_.cameras[prior.camera].free_params;
    const auto it = std::find(params.begin(), params.end(), prior.param);
    if (it == params.end()) continue;
    const int i =
        structure_.blocks[block].first + static_cast<int>(it - params.begin());
    const double weight = 1.0 / (prior.sigma * prior.sigma);
    prior_hessian_[i] += weight;
    gradient_[i] +=
        weight * (state.cameras[prior.camera][prior.param] - prior.value);
  }
  hessian_diagonal_ = prior_hessian_;
}

bool NormalEquations::Solve(double lambda, BundleStep* step) {
  ParallelFor(
      problem_.num_points(), num_threads_,
      [&](size_t point) { InvertPoint(lambda, point); }, kPointsPerChunk);
  step->blocks.setZero(structure_.num_unknowns);
  if (structure_.num_unknowns > 0) {
    const int num_blocks = static_cast<int>(columns_.size());
    // Last blocks first: sensors and cameras meet the most points.
    ParallelFor(
        columns_.size(), num_threads_,
        [&](size_t i) {
          AssembleColumn(lambda, num_blocks - 1 - static_cast<int>(i));
        },
        1);
    if (!solver_.Factorize(reduced_)) return false;
    solver_.Solve(reduced_rhs_, step->blocks);
  }
  step->points.resize(problem_.num_points());
  ParallelFor(
      problem_.num_points(), num_threads_,
      [&](size_t point) {
        step->points[point] = PointStep(point, step->blocks);
      },
      kPointsPerChunk);
  return step->blocks.allFinite();
}

void NormalEquations::InvertPoint(double lambda, size_t point) {
  if (!problem_.points_are_free) {
    point_inverses_[point].setZero();
    return;
  }
  Eigen::Matrix3d damped = point_hessians_[point];
  for (int i = 0; i < 3; ++i) {
    damped(i, i) += lambda * ClampDiagonal(damped(i, i));
  }
  point_inverses_[point] = damped.llt().solve(Eigen::Matrix3d::Identity());
}

void NormalEquations::AssembleColumn(double lambda, int block) {
  const Column& column = columns_[block];
  std::vector<int> row_of_block(columns_.size());
  for (size_t k = 0; k < column.blocks.size(); ++k) {
    row_of_block[column.blocks[k]] = column.rows[k];
  }
  Panel(block).setZero();
  AddImages(block, row_of_block);
  SubtractPoints(block, row_of_block);
  DampColumn(lambda, block);
}

void NormalEquations::AddImages(int block,
                                const std::vector<int>& row_of_block) {
  const IndexGroups& groups = structure_.block_images;
  auto panel = Panel(block);
  const int width = structure_.blocks[block].size;
  for (size_t k = groups.begin[block]; k < groups.begin[block + 1]; ++k) {
    const BundleProblem::Image& image = problem_.images[groups.items[k]];
    const Eigen::MatrixXd& hessian = image_hessians_[groups.items[k]];
    int row = 0;
    int own_row = -1;
    for (const int other : {structure_.frame_block[image.frame],
                            structure_.sensor_block[image.sensor],
                            structure_.camera_block[image.camera]}) {
      if (other < 0) continue;
      if (other == block) own_row = row;
      const int height = structure_.blocks[other].size;
      if (own_row >= 0) {
        panel.middleRows(row_of_block[other], height) +=
            hessian.block(row, own_row, height, width);
      }
      row += height;
    }
  }
}

void NormalEquations::SubtractPoints(int block,
                                     const std::vector<int>& row_of_block) {
  using Coupling =
      Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, 3>, 0>;
  using SmallCoupling =
      Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kMaxNumCameraParams, 3>;
  const BundleStructure& s = structure_;
  const int width = s.blocks[block].size;
  auto panel = Panel(block);
  auto rhs = reduced_rhs_.segment(s.blocks[block].first, width);
  rhs = -gradient_.segment(s.blocks[block].first, width);
  for (size_t k = s.block_incidences.begin[block];
       k < s.block_incidences.begin[block + 1]; ++k) {
    const int first = s.block_incidences.items[k];
    const int point = s.incidence_point[first];
    const SmallCoupling scaled =
        Coupling(&couplings_[s.incidence_coupling[first]], width, 3)
            .lazyProduct(point_inverses_[point]);
    rhs += scaled.lazyProduct(point_gradients_[point]);
    const size_t end = s.point_incidences[point + 1];
    for (size_t e = first; e < end; ++e) {
      const int other = s.incidence_block[e];
      const int height = s.blocks[other].size;
      SubtractProduct(Coupling(&couplings_[s.incidence_coupling[e]], height, 3),
                      scaled, panel.middleRows(row_of_block[other], height));
    }
  }
}

void NormalEquations::DampColumn(double lambda, int block) {
  const ParameterBlock& b = structure_.blocks[block];
  auto panel = Panel(block);
  for (int i = 0; i < b.size; ++i) {
    const double diagonal = hessian_diagonal_[b.first + i];
    // A held coordinate has a zero row and column.
    panel(i, i) += diagonal > 0.0 ? prior_hessian_[b.first + i] +
                                        lambda * ClampDiagonal(diagonal)
                                  : 1.0;
  }
}

Eigen::Vector3d NormalEquations::PointStep(size_t point,
                                           const Eigen::VectorXd& dz) const {
  Eigen::Vector3d rhs = -point_gradients_[point];
  for (size_t e = structure_.point_incidences[point];
       e < structure_.point_incidences[point + 1]; ++e) {
    const ParameterBlock& block =
        structure_.blocks[structure_.incidence_block[e]];
    const double* coupling = &couplings_[structure_.incidence_coupling[e]];
    for (int j = 0; j < 3; ++j) {
      double sum = 0.0;
      for (int i = 0; i < block.size; ++i) {
        sum += coupling[j * block.size + i] * dz[block.first + i];
      }
      rhs[j] -= sum;
    }
  }
  return point_inverses_[point] * rhs;
}

double NormalEquations::PredictedDecrease(double lambda,
                                          const BundleStep& step) const {
  // With (1), the model cost g^T d + d^T H d / 2 is (g^T d - lambda d^T D d)/2.
  double blocks = 0.0;
  for (int i = 0; i < structure_.num_unknowns; ++i) {
    const double d = step.blocks[i];
    blocks +=
        d * (lambda * ClampDiagonal(hessian_diagonal_[i]) * d - gradient_[i]);
  }
  const double points =
      ParallelSum(problem_.num_points(), num_threads_, [&](size_t p) {
        const Eigen::Vector3d& d = step.points[p];
        double sum = -d.dot(point_gradients_[p]);
        for (int i = 0; i < 3; ++i) {
          sum += lambda * ClampDiagonal(point_hessians_[p](i, i)) * d[i] * d[i];
        }
        return sum;
      });
  return 0.5 * (blocks + points);
}

}  // namespace mgsfm
