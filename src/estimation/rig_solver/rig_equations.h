// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <vector>

#include "math/sparse_solver.h"
#include "rig_solver/baseline_terms.h"
#include "rig_solver/levenberg_marquardt.h"
#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_structure.h"
#include "rig_solver/schur_passes.h"
#include "rig_solver/schur_workspace.h"

namespace mgsfm {

// The Schur complement of a rig problem, or its preconditioner, in the pattern
// of the structure, and its factor.
class SchurComplement {
 public:
  explicit SchurComplement(int num_threads);

  // Allocates the matrix when first called.
  void Allocate(const RigStructure& structure);

  // BlockPattern::Find() of the structure returns the positions.
  double* values() { return matrix_.valuePtr(); }
  size_t num_values() const { return static_cast<size_t>(matrix_.nonZeros()); }
  void SetZero();
  // The diagonal entry of unknown i.
  double& Diagonal(Eigen::Index i) { return values()[diagonal_position_[i]]; }

  [[nodiscard]] bool Factorize() { return solver_.Factorize(matrix_); }
  // X must have the size of B and may alias it.
  template <class Matrix>
  void Solve(const Eigen::Ref<const Eigen::MatrixXd>& B, Matrix* X) const {
    solver_.Solve(B, *X);
  }

 private:
  const int num_threads_;
  bool is_allocated_ = false;
  std::vector<size_t> diagonal_position_;  // in the values
  Eigen::SparseMatrix<double> matrix_;
  SparseCholesky solver_;
};

// The damped normal equations of a rig problem,
//
//   [ H    W^T ] [dz]     [g_z]
//   [ W    V   ] [dp] = - [g_p],   H += lambda D_z,  V += lambda D_p,       (1)
//
// with residuals weighted by rho' (iteratively re-weighted least squares), D
// the diagonal of the undamped matrix within [1e-6, 1e32], and V block-diagonal
// over the points. Points are eliminated first:
//
//   (H - W^T V^-1 W) dz = -g_z + W^T V^-1 g_p,   dp = -V^-1 (g_p + W dz).
//
// One pass over the observations linearizes and eliminates. A second one steps
// (with shortened steps of single points, see rig_solver.h) and evaluates the
// new cost. Both compute the derivatives, which is faster than storing them; V
// and W are never stored. The Schur complement is factorized. If that is too
// expensive, the matrix is applied without being formed, and the Schur
// complement of cut points is the preconditioner (docs/maths/rig_solver.md).
class RigEquationsBase : public DampedProblem {
 public:
  RigEquationsBase(const RigProblemBase& problem,
                   const std::vector<int>& image_of_observation,
                   ReducedSolver solver, const Context& context);

  // Sets and copies the current state. GetState() frees the points of trial
  // steps.
  void SetState(const RigState& state);
  void GetState(RigState* state);

  double Cost() override;
  bool Linearize(double lambda) override;
  bool Solve() override;
  TrialStep TryStep() override;
  double MinimizeTrialPoints(double cost, double tolerance) override;
  void AcceptStep() override;

  // Factorizes the matrix of Linearize(), and solves with it.
  bool Factorize() { return matrix_.Factorize(); }
  void SolveColumns(const Eigen::MatrixXd& B, Eigen::MatrixXd* X) const {
    matrix_.Solve(B, X);
  }

  const RigStructure& structure() const { return structure_; }
  const Eigen::VectorXd& step() const { return step_; }
  // The change of a pose block by the last step.
  PoseVector PoseStep(int block) const;
  // Points of the current state and after TryStep(), in the structure's order.
  const std::vector<Eigen::Vector3d>& points() const { return points_; }
  const std::vector<Eigen::Vector3d>& trial_points() const {
    return trial_points_;
  }

 protected:
  // The passes over one chunk; see schur_passes.h.
  virtual double CostOfChunk(const ChunkRanges& chunk) const = 0;
  virtual bool LinearizeChunk(const ChunkRanges& chunk,
                              SchurWorkspace* workspace) = 0;
  virtual StepSums StepChunk(const ChunkRanges& chunk) = 0;
  // Returns the cost after minimization over the points.
  virtual double MinimizeTrialChunk(const ChunkRanges& chunk,
                                    double tolerance) = 0;
  virtual void MultiplyChunk(const ChunkRanges& chunk,
                             SchurWorkspace* workspace) = 0;

  const RigProblemBase& problem_;
  const Context context_;
  RigStructure structure_;
  double lambda_ = 0.0;
  std::vector<Eigen::Vector3d> points_, trial_points_;
  std::vector<ImagePose> poses_, trial_poses_;
  ImageSteps steps_;

 private:
  double TrialCost() const;  // by the sums of chunks
  void MergeSystem(const ChunkRanges& chunk, size_t section,
                   const SchurWorkspace& workspace);
  void MergeVectors(const ChunkRanges& chunk, const SchurWorkspace& workspace);
  void DampMatrix();
  bool SolveByConjugateGradients();
  void Multiply(const Eigen::VectorXd& x, Eigen::VectorXd* y);
  void SetImageSteps(const Eigen::VectorXd& z);
  void MoveBlocks();
  TermInput Terms() const { return {problem_, structure_, poses_}; }
  TermInput TrialTerms() const { return {problem_, structure_, trial_poses_}; }

  RigState state_, trial_state_;  // without points
  OrderedChunks chunks_;
  std::vector<double> chunk_costs_;
  std::vector<StepSums> chunk_sums_;
  SchurComplement matrix_;
  Eigen::VectorXd gradient_;    // g_z
  Eigen::VectorXd correction_;  // W^T V^-1 g_p
  Eigen::VectorXd diagonal_;    // D_z without bounds, 0 if constant
  Eigen::VectorXd rhs_, step_;
  Eigen::VectorXd residual_;  // of the reduced system, if iterative
};

// The equations of one residual type R of residuals.h. The passes are compiled
// once, in rig_equations_passes.cc.
template <class R>
class RigEquations : public RigEquationsBase {
 public:
  using Problem = RigProblem<typename R::Observation>;

  RigEquations(const Problem& problem, ReducedSolver solver,
               const Context& context);

 protected:
  double CostOfChunk(const ChunkRanges& chunk) const override;
  bool LinearizeChunk(const ChunkRanges& chunk,
                      SchurWorkspace* workspace) override;
  StepSums StepChunk(const ChunkRanges& chunk) override;
  double MinimizeTrialChunk(const ChunkRanges& chunk,
                            double tolerance) override;
  void MultiplyChunk(const ChunkRanges& chunk,
                     SchurWorkspace* workspace) override;

 private:
  PassInput<R> Input() const {
    return {problem_, structure_, measured_, poses_, points_, lambda_};
  }

  std::vector<typename R::Scalar> measured_;
  KeptDerivatives kept_;
};

extern template class RigEquations<PixelResidual>;
extern template class RigEquations<RayResidual>;

}  // namespace mgsfm
