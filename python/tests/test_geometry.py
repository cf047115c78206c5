# SPDX-License-Identifier: BSD-3-Clause
"""Similarities and other ways to make transforms, against matrices."""

import numpy as np
import pymgsfm
import pytest


def transforms():
    random = np.random.default_rng(2)
    for _ in range(10):
        rotation = pymgsfm.Rotation3d(random.normal(size=3))
        yield pymgsfm.Sim3d(random.uniform(0.5, 2.0), rotation,
                            random.normal(size=3))


def square(matrix):
    return np.vstack([matrix, [0, 0, 0, 1]])


def test_similarities_are_their_matrices():
    points = np.random.default_rng(3).normal(size=(5, 3))
    for a, b in zip(transforms(), list(transforms())[::-1]):
        np.testing.assert_allclose(square((a * b).matrix()),
                                   square(a.matrix()) @ square(b.matrix()))
        np.testing.assert_allclose(square(a.inverse().matrix()),
                                   np.linalg.inv(square(a.matrix())))
        np.testing.assert_allclose(
            a * points, points @ a.matrix()[:, :3].T + a.matrix()[:, 3])
        np.testing.assert_allclose(a * points[0], (a * points)[0])
        for matrix in (a.matrix(), square(a.matrix())):
            np.testing.assert_allclose(pymgsfm.Sim3d(matrix).matrix(),
                                       a.matrix(), atol=1e-12)
    assert pymgsfm.Sim3d() == pymgsfm.Sim3d(np.eye(3, 4))
    with pytest.raises(ValueError, match="positive"):
        pymgsfm.Sim3d(-1.0)


def test_a_moved_camera_sees_moved_points():
    points = np.random.default_rng(4).normal(size=(5, 3))
    cam_from_world = pymgsfm.Rigid3d([0.1, 0.2, 0.3], [1.0, 2.0, 3.0])
    for new_from_old in transforms():
        cam_from_new = new_from_old.transform_camera_world(cam_from_world)
        np.testing.assert_allclose(
            cam_from_new * (new_from_old * points),
            new_from_old.scale * (cam_from_world * points))
        np.testing.assert_allclose(cam_from_new * (
            new_from_old * cam_from_world.tgt_origin_in_src()), 0, atol=1e-12)


def test_ways_to_make_rotations_and_poses():
    vector = np.array([0.3, -0.2, 0.5])
    rotation = pymgsfm.Rotation3d(vector)
    assert rotation.angle() == pytest.approx(np.linalg.norm(vector))
    np.testing.assert_allclose(rotation * vector, vector)
    np.testing.assert_allclose(
        pymgsfm.Rotation3d(rotation.matrix()).quat, rotation.quat)
    assert pymgsfm.Rotation3d(np.zeros(3)) == pymgsfm.Rotation3d()
    twice = pymgsfm.Rotation3d(2 * vector)
    assert rotation.angle_to(twice) == pytest.approx(rotation.angle())
    pose = pymgsfm.Rigid3d(rotation, [1, 2, 3])
    for matrix in (pose.matrix(), square(pose.matrix())):
        np.testing.assert_allclose(pymgsfm.Rigid3d(matrix).matrix(),
                                   pose.matrix())
    with pytest.raises(ValueError, match="shape"):
        pymgsfm.Rigid3d(np.eye(2))
