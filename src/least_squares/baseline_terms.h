// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "least_squares/chunk_workspace.h"
#include "least_squares/damping.h"
#include "least_squares/image_poses.h"
#include "least_squares/rig_problem.h"
#include "least_squares/rig_structure.h"

namespace mgsfm {

// The residual of a term and its derivative by the baseline; only the first
// `size` rows are used.
struct BaselineResidual {
  int size = 0;
  Eigen::Vector3d value = Eigen::Vector3d::Zero();
  Eigen::Matrix3d by_baseline = Eigen::Matrix3d::Zero();
  // Of kBilinear: derivative by the scale, and the residual on the length with
  // its own.
  Eigen::Vector3d by_scale = Eigen::Vector3d::Zero();
  double length_value = 0.0;
  double length_by_scale = 0.0;
};

// `scale` is of use to kBilinear only.
BaselineResidual EvaluateBaselineTerm(const BaselineTerm& term,
                                      const Eigen::Vector3d& baseline,
                                      double scale);

// What passes over terms read.
struct TermInput {
  const RigProblemBase& problem;
  const RigStructure& structure;
  const std::vector<ImagePose>& poses;
  // In the structure's order; empty if no term has one.
  const std::vector<double>& scales;
  double lambda;
  bool is_far_off;
};

// The terms of a chunk: their cost, and what they add to the local system with
// their scales eliminated.
double CostOfTerms(const TermInput& in, const ChunkRanges& chunk);
void AddTermsToSystem(const TermInput& in, const ChunkRanges& chunk,
                      ChunkWorkspace* workspace);
// Adds their J^T W J times the images' changes to workspace->product; only
// shifts count.
void MultiplyTerms(const TermInput& in, const ChunkRanges& chunk,
                   const std::vector<ImageTwist>& twists,
                   ChunkWorkspace* workspace);
// Moves their scales, given the images' changes.
void MoveScalesOfTerms(const TermInput& in, const ChunkRanges& chunk,
                       const std::vector<ImageTwist>& twists, double length,
                       std::vector<double>* new_scales, StepSums* sums);

}  // namespace mgsfm
