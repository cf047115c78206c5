# SPDX-License-Identifier: BSD-3-Clause
"""Averaging of relative poses of a rig with known truth."""

import pickle

import numpy as np
import pymgsfm
import pytest
from pymgsfm import Rigid3d, Rotation3d

NUM_FRAMES = 20
SENSOR_FROM_RIG = [
    Rigid3d(),
    Rigid3d(Rotation3d([0.0, 0.6, 0.0, 0.8]), [0.3, 0.1, -0.2]),
]


def random_rotation(random, angle_rad):
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    return Rotation3d([*(np.sin(angle_rad / 2) * axis), np.cos(angle_rad / 2)])


class Truth:
    """A rig with two cameras on a winding path, and pairs of near frames."""

    def __init__(self, noise_rad=0.0, seed=1):
        random = np.random.default_rng(seed)
        angles = np.linspace(0.0, 2.0 * np.pi, NUM_FRAMES, endpoint=False)
        self.centers = np.column_stack([5.0 * np.cos(angles),
                                        0.5 * np.sin(3.0 * angles),
                                        5.0 * np.sin(angles)])
        self.rig_from_world = []
        for center in self.centers:
            rotation = random_rotation(random, random.uniform(0.0, 1.0))
            self.rig_from_world.append(Rigid3d(rotation, -(rotation * center)))
        self.frame_idxs = np.repeat(np.arange(NUM_FRAMES), 2)
        self.sensor_idxs = np.tile([0, 1], NUM_FRAMES)
        poses = [SENSOR_FROM_RIG[s] * self.rig_from_world[f]
                 for f, s in zip(self.frame_idxs, self.sensor_idxs)]
        self.pairs = []
        rotations, translations = [], []
        for i in range(2 * NUM_FRAMES):
            for j in range(2 * NUM_FRAMES):
                gap = (self.frame_idxs[j] - self.frame_idxs[i]) % NUM_FRAMES
                if not 1 <= gap <= 4:
                    continue
                pose = poses[j] * poses[i].inverse()
                noise = random_rotation(random, noise_rad)
                self.pairs.append((i, j))
                rotations.append((noise * pose.rotation).quat)
                length = np.linalg.norm(pose.translation)
                translations.append(random_rotation(random, noise_rad)
                                    * pose.translation / length)
        self.rotations = np.array(rotations)
        self.translations = np.array(translations)

    def graph(self):
        return pymgsfm.ViewGraph(self.frame_idxs, self.sensor_idxs, self.pairs,
                                 self.rotations, self.translations)

    def max_rotation_error_deg(self, quats):
        # The world of the estimate is that of the truth, turned.
        offset = Rotation3d(quats[0]).inverse() * self.rig_from_world[0].rotation
        return max(np.degrees((Rotation3d(quat) * offset
                               * truth.rotation.inverse()).angle())
                   for quat, truth in zip(quats, self.rig_from_world))

    def max_center_error(self, centers, with_scale):
        a = centers - centers.mean(axis=0)
        b = self.centers - self.centers.mean(axis=0)
        U, singular, Vt = np.linalg.svd(b.T @ a)
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        scale = singular.sum() / (a * a).sum() if with_scale else 1.0
        return np.linalg.norm(scale * a @ R.T - b, axis=1).max()


def test_exact_poses_with_a_known_rig():
    truth = Truth()
    rotations = pymgsfm.average_rotations(truth.graph(), SENSOR_FROM_RIG)
    assert truth.max_rotation_error_deg(rotations.rig_from_world) < 1e-3
    assert rotations.pair_is_inlier.all()
    assert (rotations.components == 0).all()
    positions = pymgsfm.average_translations(truth.graph(), rotations,
                                             SENSOR_FROM_RIG)
    assert positions.is_metric
    assert truth.max_center_error(positions.centers, with_scale=False) < 0.02
    poses = positions.rig_from_world(rotations)
    np.testing.assert_allclose(poses[3].inverse().translation,
                               positions.centers[3], atol=1e-9)


def test_exact_poses_with_an_unknown_sensor():
    truth = Truth()
    rig = [Rigid3d(), None]
    rotations = pymgsfm.average_rotations(truth.graph(), rig)
    sensor = Rotation3d(rotations.sensor_from_rig[1])
    error = sensor * SENSOR_FROM_RIG[1].rotation.inverse()
    assert np.degrees(error.angle()) < 1e-3
    assert rotations.sensors[1].is_observable
    assert rotations.sensors[1].num_samples > 0
    assert rotations.summary["num_components"] == 1
    assert rotations.summary["joint"]["termination"] == "converged"
    positions = pymgsfm.average_translations(truth.graph(), rotations, rig)
    assert not positions.is_metric
    assert positions.summary["num_pairs_used"] > 0
    assert truth.max_center_error(positions.centers, with_scale=True) < 0.02
    pose = positions.sensor_from_rig_poses(rotations)[1]
    direction = SENSOR_FROM_RIG[1].translation
    cosine = (pose.translation @ direction / np.linalg.norm(pose.translation)
              / np.linalg.norm(direction))
    assert cosine > 0.99


def test_noise_and_wrong_pairs():
    truth = Truth(noise_rad=np.radians(0.3))
    random = np.random.default_rng(2)
    wrong = random.choice(len(truth.pairs), 20, replace=False)
    for i in wrong:
        truth.rotations[i] = random_rotation(random, 1.5).quat
    rotations = pymgsfm.average_rotations(truth.graph(), SENSOR_FROM_RIG)
    assert not rotations.pair_is_inlier[wrong].any()
    assert rotations.pair_is_inlier.sum() == len(truth.pairs) - 20
    assert truth.max_rotation_error_deg(rotations.rig_from_world) < 0.5
    positions = pymgsfm.average_translations(truth.graph(), rotations,
                                             SENSOR_FROM_RIG)
    # 0.3 degrees over the diameter of the path are 5 cm.
    assert truth.max_center_error(positions.centers, with_scale=True) < 0.1


def test_order_of_pairs_and_images_of_a_pair_do_not_matter():
    truth = Truth(noise_rad=0.01)
    first = pymgsfm.average_rotations(truth.graph(), SENSOR_FROM_RIG)
    order = np.random.default_rng(3).permutation(len(truth.pairs))
    swapped = [(j, i) for i, j in truth.pairs]
    inverse = truth.rotations * (-1.0, -1.0, -1.0, 1.0)
    graph = pymgsfm.ViewGraph(truth.frame_idxs, truth.sensor_idxs,
                              np.array(swapped)[order], inverse[order])
    second = pymgsfm.average_rotations(graph, SENSOR_FROM_RIG)
    np.testing.assert_allclose(second.rig_from_world, first.rig_from_world,
                               atol=1e-9)
    assert (second.pair_is_inlier == first.pair_is_inlier[order]).all()


def test_components_have_worlds_of_their_own():
    truth = Truth()
    near = [k for k, (i, j) in enumerate(truth.pairs)
            if (truth.frame_idxs[i] < 12) == (truth.frame_idxs[j] < 12)
            and abs(truth.frame_idxs[i] - truth.frame_idxs[j]) < 5]
    graph = pymgsfm.ViewGraph(truth.frame_idxs, truth.sensor_idxs,
                              np.array(truth.pairs)[near],
                              truth.rotations[near], truth.translations[near])
    rotations = pymgsfm.average_rotations(graph, SENSOR_FROM_RIG)
    assert rotations.components.tolist() == 12 * [0] + 8 * [1]
    positions = pymgsfm.average_translations(graph, rotations, SENSOR_FROM_RIG,
                                             component=1)
    is_placed = np.isfinite(positions.centers).all(axis=1)
    assert is_placed.tolist() == 12 * [False] + 8 * [True]
    assert positions.rig_from_world(rotations)[0] is None


def test_one_camera():
    truth = Truth()
    keep = [k for k, (i, j) in enumerate(truth.pairs)
            if truth.sensor_idxs[i] == 0 and truth.sensor_idxs[j] == 0]
    pairs = np.array(truth.pairs)[keep] // 2
    graph = pymgsfm.ViewGraph(np.arange(NUM_FRAMES), None, pairs,
                              truth.rotations[keep], truth.translations[keep])
    rotations = pymgsfm.average_rotations(graph)
    assert truth.max_rotation_error_deg(rotations.rig_from_world) < 1e-3
    positions = pymgsfm.average_translations(graph, rotations)
    assert truth.max_center_error(positions.centers, with_scale=True) < 0.05


@pytest.mark.parametrize("change, message", [
    ({"pairs": [[0, 0]]}, "not of two images"),
    ({"pairs": [[0, 9]]}, "not of two images"),
    ({"pairs": [[0, 1], [1, 0]], "rotations": [[0, 0, 0, 1]] * 2},
     "given twice"),
    ({"rotations": [[0, 0, 0, 0]]}, "zero"),
    ({"rotations": [[np.nan, 0, 0, 1]]}, "not finite"),
    ({"rotations": [[0, 0, 1]]}, r"shape \(1, 4\)"),
    ({"frame_idxs": [0, -1]}, "out of range"),
    ({"frame_idxs": [0, 0]}, "same frame and sensor"),
    ({"num_matches": [1, 2]}, r"shape \(1,\)"),
    ({"pairs": [[0, 1.5]]}, r"pairs\[0, 1\] is 1.5; must be an integer"),
    ({"frame_idxs": [0, np.nan]}, r"frame_idxs\[1\] is nan"),
    ({"frame_idxs": [0, 2**40]}, r"frame_idxs\[1\] is 1099511627776"),
])
def test_bad_input(change, message):
    arguments = {"frame_idxs": [0, 1], "sensor_idxs": None, "pairs": [[0, 1]],
                 "rotations": [[0, 0, 0, 1]], **change}
    with pytest.raises(pymgsfm.InputError, match=message):
        pymgsfm.average_rotations(pymgsfm.ViewGraph(**arguments))


@pytest.mark.parametrize("rig", [
    [], [None], [Rigid3d(translation=[0.0, 0.0, 1.0])]])
def test_the_reference_sensor_is_the_identity(rig):
    graph = pymgsfm.ViewGraph([0, 1], None, [[0, 1]], [[0, 0, 0, 1]])
    with pytest.raises(pymgsfm.InputError, match="identity"):
        pymgsfm.average_rotations(graph, rig)


def test_options():
    with pytest.raises(pymgsfm.InputError, match="max_error_deg"):
        pymgsfm.average_rotations(Truth().graph(), SENSOR_FROM_RIG,
                                  {"max_error_deg": -1.0})
    options = pymgsfm.Options("mapper").RotationAveraging
    options.max_error_deg = 0.0
    rotations = pymgsfm.average_rotations(Truth(noise_rad=0.01).graph(),
                                          SENSOR_FROM_RIG, options)
    assert not rotations.pair_is_inlier.all()


def test_pickle():
    rotations = pymgsfm.average_rotations(Truth().graph(), SENSOR_FROM_RIG)
    again = pickle.loads(pickle.dumps(rotations))
    assert (again.rig_from_world == rotations.rig_from_world).all()
