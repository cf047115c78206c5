// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/geometry/rigid3.h"

#include <gtest/gtest.h>

#include "base/random.h"
#include "geometry/so3.h"

namespace mgsfm {
namespace {

using Eigen::Vector3d;

class Rigid3Test : public testing::Test {
 protected:
  Vector3d RandomVector() {
    return {random_.Normal(), random_.Normal(), random_.Normal()};
  }
  Rigid3 RandomRigid() { return {ExpSO3(RandomVector()), RandomVector()}; }
  Sim3 RandomSim() {
    return {random_.Uniform(0.2, 5.0), ExpSO3(RandomVector()), RandomVector()};
  }

  Random random_{7};
};

TEST_F(Rigid3Test, DefaultIsTheIdentity) {
  const Vector3d x = RandomVector();
  EXPECT_EQ(Rigid3() * x, x);
  EXPECT_EQ(Sim3() * x, x);
}

TEST_F(Rigid3Test, InverseUndoes) {
  const Rigid3 b_from_a = RandomRigid();
  const Sim3 d_from_c = RandomSim();
  const Vector3d x = RandomVector();
  EXPECT_LT((b_from_a.Inverse() * (b_from_a * x) - x).norm(), 1e-14);
  EXPECT_LT((d_from_c.Inverse() * (d_from_c * x) - x).norm(), 1e-13);
}

TEST_F(Rigid3Test, CompositionIsOneAfterTheOther) {
  const Rigid3 b_from_a = RandomRigid(), c_from_b = RandomRigid();
  const Vector3d x = RandomVector();
  EXPECT_LT(((c_from_b * b_from_a) * x - c_from_b * (b_from_a * x)).norm(),
            1e-14);
}

TEST_F(Rigid3Test, CompositionStaysNormalized) {
  Rigid3 pose;
  const Rigid3 step = RandomRigid();
  for (int i = 0; i < 10000; ++i) pose = step * pose;
  EXPECT_NEAR(pose.rotation.norm(), 1.0, 1e-15);
}

TEST_F(Rigid3Test, CenterIsWhatGoesToTheOrigin) {
  const Rigid3 cam_from_world = RandomRigid();
  EXPECT_LT((cam_from_world * cam_from_world.Center()).norm(), 1e-14);
  const Rigid3 again = Rigid3::FromRotationAndCenter(cam_from_world.rotation,
                                                     cam_from_world.Center());
  EXPECT_LT((again.translation - cam_from_world.translation).norm(), 1e-14);
}

// Projections are invariant to a joint transform of camera and points.
TEST_F(Rigid3Test, TransformWorldKeepsWhatTheCameraSees) {
  for (int i = 0; i < 20; ++i) {
    const Rigid3 cam_from_old = RandomRigid();
    const Sim3 new_from_old = RandomSim();
    const Rigid3 cam_from_new = TransformWorld(new_from_old, cam_from_old);
    const Vector3d x_in_old = RandomVector();
    const Vector3d seen_old = cam_from_old * x_in_old;
    const Vector3d seen_new = cam_from_new * (new_from_old * x_in_old);
    EXPECT_LT((seen_new - new_from_old.scale * seen_old).norm(), 1e-13);
  }
}

}  // namespace
}  // namespace mgsfm
