// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <optional>
#include <vector>

#include "math/sparse_solver.h"
#include "rotation_averaging/rotation_problem.h"

namespace mgsfm {

// Columns of the unknowns; nullopt for fixed nodes and sensors. The first node
// of each connected component is fixed. In a component with gravity terms, only
// its rotation about gravity is fixed.
struct RotationUnknowns {
  std::vector<std::optional<int>> column_of_node;
  int num_node_columns = 0;
  std::vector<std::optional<int>> column_of_sensor;
  int num_sensor_columns = 0;
  std::vector<int> leveled_columns;  // nodes that are fixed about gravity
};

RotationUnknowns NumberUnknowns(const RotationProblem& problem);

struct RotationStep {
  Eigen::MatrixXd nodes;    // node columns x 3
  Eigen::MatrixXd sensors;  // 3 x sensor columns
  double MaxNorm() const;   // over all unknown rotations
};

// G <- G Exp(d), S <- S Exp(c).
void ApplyStep(const RotationUnknowns& unknowns, const RotationStep& step,
               RotationState* state);

// Residuals and weights of the gravity terms at a state.
struct GravityValues {
  std::vector<Eigen::Vector3d> residuals;
  std::vector<double> weights;
};

// Weighted Gauss-Newton steps: minimizes over d and c
//
//   sum_e w_e |e + (d_1 + G_1^T c_1) - (d_2 + G_2^T c_2)|^2
//   + sum_g w_g |e_g + P (d + G^T c)|^2,        P = diag(1, 0, 1).
//
// The normal matrix is [L (x) I_3, B; B^T, D]: L is the Laplacian of the graph
// of nodes without the fixed ones, B and D a dense border of 3 columns for each
// unknown sensor. L is analyzed once and factorized in every step; the border
// is eliminated by its Schur complement D - B^T (L^-1 (x) I_3) B.
//
// Gravity terms add their weights to the diagonal of L for the coordinates x
// and z, but not for y, so there are two matrices and two factors. The matrix
// for y gets an additional 1 for the node that is fixed about gravity. This
// fixes it exactly, whatever the value, because edges do not change if all
// nodes of a component rotate alike.
class RotationEquations {
 public:
  explicit RotationEquations(const RotationProblem& problem,
                             int num_threads = 1);

  const RotationUnknowns& unknowns() const { return unknowns_; }

  // False if the equations are singular or not finite.
  [[nodiscard]] bool Solve(const std::vector<double>& weights,
                           const std::vector<Eigen::Vector3d>& residuals,
                           const RotationState& state, RotationStep* step,
                           const GravityValues& gravity = {});

 private:
  // Positions of an edge's entries in the values of the Laplacian, if any.
  struct EdgeEntries {
    std::optional<int> diagonal1;
    std::optional<int> diagonal2;
    std::optional<int> off_diagonal;
  };

  void BuildPattern();
  int FindEntry(int row, int column) const;
  void Assemble(const std::vector<double>& weights,
                const std::vector<Eigen::Vector3d>& residuals,
                const RotationState& state, const GravityValues& gravity);
  void AddNodeEntries(size_t e, double weight, const Eigen::Vector3d& residual);
  void AddSensorEntries(const RotationEdge& edge, double weight,
                        const Eigen::Vector3d& residual,
                        const RotationState& state);
  void AddGravity(const GravityValues& gravity, const RotationState& state);
  void AddGravityOfSensor(const GravityTerm& term, double weight,
                          const Eigen::Vector3d& residual,
                          const RotationState& state);
  bool SolveNodes(RotationStep* step);
  bool SolveSensors(RotationStep* step) const;

  const RotationProblem& problem_;
  const RotationUnknowns unknowns_;
  std::vector<EdgeEntries> entries_;
  Eigen::SparseMatrix<double> laplacian_;  // lower triangle
  SparseCholesky solver_;
  // The same for x and z, if there are gravity terms.
  Eigen::SparseMatrix<double> leveled_laplacian_;
  SparseCholesky leveled_solver_;
  Eigen::MatrixXd node_gradient_;    // node columns x 3
  Eigen::VectorXd sensor_gradient_;  // 3 sensor columns
  // Column 3 q + a contains the rows of coordinate a of all nodes of border
  // column q. Three consecutive columns are one column of B with its rows
  // ordered by coordinate.
  Eigen::MatrixXd border_;         // node columns x 9 sensor columns
  Eigen::MatrixXd solved_border_;  // (L^-1 (x) I_3) B, likewise
  Eigen::MatrixXd sensor_block_;   // D
};

}  // namespace mgsfm
