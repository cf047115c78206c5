// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "rig_solver/image_poses.h"
#include "rig_solver/rig_problem.h"
#include "rig_solver/rig_structure.h"
#include "rig_solver/schur_workspace.h"

namespace mgsfm {

// The residual of a term and its derivative with respect to the baseline; only
// the first `size` rows are used.
struct BaselineResidual {
  int size = 0;
  Eigen::Vector3d value = Eigen::Vector3d::Zero();
  Eigen::Matrix3d by_baseline = Eigen::Matrix3d::Zero();
};

BaselineResidual EvaluateBaselineTerm(const BaselineTerm& term,
                                      const Eigen::Vector3d& baseline);

// Inputs of the passes over terms.
struct TermInput {
  const RigProblemBase& problem;
  const RigStructure& structure;
  const std::vector<ImagePose>& poses;
};

// The cost of the terms of a chunk, and their contribution to the local system.
double CostOfTerms(const TermInput& in, const ChunkRanges& chunk);
void AddTermsToSystem(const TermInput& in, const ChunkRanges& chunk,
                      SchurWorkspace* workspace);
// Adds J^T W J of the terms times the changes of images to workspace->product;
// only shifts count.
void MultiplyTerms(const TermInput& in, const ChunkRanges& chunk,
                   const std::vector<ImageTwist>& twists,
                   SchurWorkspace* workspace);

}  // namespace mgsfm
