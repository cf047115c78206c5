// SPDX-License-Identifier: BSD-3-Clause
#include "rig_solver/linear_terms.h"

#include <algorithm>
#include <optional>

namespace mgsfm {
namespace {

using Eigen::Vector3d;

double ResidualOf(const LinearTerm& term, const RigState& state) {
  double sum = -term.value;
  for (const LinearTerm::Part& part : term.parts) {
    sum += part.coefficients.dot(part.is_frame
                                     ? state.frames[part.idx].center
                                     : state.sensors[part.idx].translation);
  }
  return term.weight * sum;
}

double ResidualOf(const RigProblemBase::ParameterPrior& prior,
                  const RigState& state) {
  return (state.cameras[prior.camera][prior.param] - prior.value) / prior.sigma;
}

// The derivative of a term with respect to one of its parts.
struct PartColumns {
  int block = kNoBlock;
  int first = 0;  // unknown of its first coordinate
  Vector3d values = Vector3d::Zero();
};

PartColumns ColumnsOf(const RigProblemBase& problem, const RigStructure& s,
                      const LinearTerm& term, const LinearTerm::Part& part) {
  const auto& blocks = part.is_frame ? s.frame_block : s.sensor_block;
  const auto& masks =
      part.is_frame ? problem.frame_masks : problem.sensor_masks;
  PartColumns columns;
  columns.block = blocks[part.idx];
  if (columns.block == kNoBlock) return columns;
  columns.first = s.block_first[columns.block] + s.pose_size - 3;
  columns.values =
      term.weight * part.coefficients.cwiseProduct(masks[part.idx].tail<3>());
  return columns;
}

// The unknown of a prior; nullopt if the parameter is constant.
std::optional<int> UnknownOf(const RigProblemBase& problem,
                             const RigStructure& s,
                             const RigProblemBase::ParameterPrior& prior) {
  const int block = s.camera_block[prior.camera];
  const std::vector<int>& params = problem.cameras[prior.camera].free_params;
  const auto it = std::find(params.begin(), params.end(), prior.param);
  if (block == kNoBlock || it == params.end()) return std::nullopt;
  return s.block_first[block] + static_cast<int>(it - params.begin());
}

void AddProduct(const RigStructure& s, const PartColumns& a,
                const PartColumns& b, double* matrix) {
  const int row = s.block_rank[a.block], column = s.block_rank[b.block];
  if (row < column || !s.pattern.Contains(column, row)) return;
  const auto [position, stride] = s.pattern.Find(column, row);
  const int offset = s.pose_size - 3;
  double* values = matrix + position + offset;
  for (int j = 0; j < 3; ++j) {
    for (int i = 0; i < 3; ++i) {
      values[static_cast<size_t>(j + offset) * stride + i] +=
          a.values[i] * b.values[j];
    }
  }
}

}  // namespace

double CostOfLinearTerms(const RigProblemBase& problem, const RigState& state) {
  double cost = 0.0;
  for (const LinearTerm& term : problem.linear_terms) {
    const double r = ResidualOf(term, state);
    cost += 0.5 * r * r;
  }
  for (const RigProblemBase::ParameterPrior& prior : problem.priors) {
    const double r = ResidualOf(prior, state);
    cost += 0.5 * r * r;
  }
  return cost;
}

void AddLinearTerms(const RigProblemBase& problem, const RigStructure& s,
                    const RigState& state, Eigen::VectorXd* gradient,
                    Eigen::VectorXd* diagonal, double* matrix) {
  for (const LinearTerm& term : problem.linear_terms) {
    const double r = ResidualOf(term, state);
    for (const LinearTerm::Part& part : term.parts) {
      const PartColumns a = ColumnsOf(problem, s, term, part);
      if (a.block == kNoBlock) continue;
      gradient->segment<3>(a.first) += r * a.values;
      diagonal->segment<3>(a.first) += a.values.cwiseAbs2();
      for (const LinearTerm::Part& other : term.parts) {
        const PartColumns b = ColumnsOf(problem, s, term, other);
        if (b.block != kNoBlock) AddProduct(s, a, b, matrix);
      }
    }
  }
  for (const RigProblemBase::ParameterPrior& prior : problem.priors) {
    const std::optional<int> unknown = UnknownOf(problem, s, prior);
    if (!unknown) continue;
    const int i = *unknown;
    const double weight = 1.0 / (prior.sigma * prior.sigma);
    (*gradient)[i] += ResidualOf(prior, state) / prior.sigma;
    (*diagonal)[i] += weight;
    const int block = s.camera_block[prior.camera];
    const int rank = s.block_rank[block];
    const auto [position, stride] = s.pattern.Find(rank, rank);
    const auto offset = static_cast<size_t>(i - s.block_first[block]);
    matrix[position + offset * stride + offset] += weight;
  }
}

void MultiplyLinearTerms(const RigProblemBase& problem, const RigStructure& s,
                         const Eigen::VectorXd& x, Eigen::VectorXd* y) {
  for (const LinearTerm& term : problem.linear_terms) {
    double sum = 0.0;
    for (const LinearTerm::Part& part : term.parts) {
      const PartColumns a = ColumnsOf(problem, s, term, part);
      if (a.block != kNoBlock) sum += a.values.dot(x.segment<3>(a.first));
    }
    for (const LinearTerm::Part& part : term.parts) {
      const PartColumns a = ColumnsOf(problem, s, term, part);
      if (a.block != kNoBlock) y->segment<3>(a.first) += sum * a.values;
    }
  }
  for (const RigProblemBase::ParameterPrior& prior : problem.priors) {
    const std::optional<int> i = UnknownOf(problem, s, prior);
    if (i) (*y)[*i] += x[*i] / (prior.sigma * prior.sigma);
  }
}

}  // namespace mgsfm
