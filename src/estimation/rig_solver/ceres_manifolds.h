// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/problem.h>
#include <ceres/version.h>

#define MGSFM_CERES_HAS_MANIFOLDS \
  (CERES_VERSION_MAJOR > 2 ||     \
   (CERES_VERSION_MAJOR == 2 && CERES_VERSION_MINOR >= 1))

#if MGSFM_CERES_HAS_MANIFOLDS
#include <ceres/manifold.h>
#else
#include <ceres/local_parameterization.h>
#endif

// Manifolds of Ceres 2.1 and later. Ceres 2.0 calls them local
// parameterizations, with different function names.
namespace mgsfm {

#if MGSFM_CERES_HAS_MANIFOLDS

using CeresManifold = ceres::Manifold;
using CeresSubsetManifold = ceres::SubsetManifold;
using CeresQuaternionManifold = ceres::EigenQuaternionManifold;

inline void SetManifold(double* block, CeresManifold* manifold,
                        ceres::Problem* problem) {
  problem->SetManifold(block, manifold);
}

#else

class CeresManifold : public ceres::LocalParameterization {
 public:
  virtual int AmbientSize() const = 0;
  virtual int TangentSize() const = 0;
  virtual bool PlusJacobian(const double* x, double* jacobian) const = 0;
  virtual bool Minus(const double* y, const double* x,
                     double* y_minus_x) const = 0;
  virtual bool MinusJacobian(const double* x, double* jacobian) const = 0;

 private:
  int GlobalSize() const final { return AmbientSize(); }
  int LocalSize() const final { return TangentSize(); }
  bool ComputeJacobian(const double* x, double* jacobian) const final {
    return PlusJacobian(x, jacobian);
  }
};
using CeresSubsetManifold = ceres::SubsetParameterization;
using CeresQuaternionManifold = ceres::EigenQuaternionParameterization;

inline void SetManifold(double* block, ceres::LocalParameterization* manifold,
                        ceres::Problem* problem) {
  problem->SetParameterization(block, manifold);
}

#endif

}  // namespace mgsfm
