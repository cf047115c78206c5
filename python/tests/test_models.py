# SPDX-License-Identifier: BSD-3-Clause
"""Models in memory against a parser of their own, from COLMAP's documentation
of the format."""

import os
import pickle
import shutil
import struct
import subprocess
import sys
import types

import numpy as np
import pymgsfm
import pytest


class Parser:
    def __init__(self, path):
        self.data = path.read_bytes()
        self.at = 0

    def take(self, format):
        values = struct.unpack_from("<" + format, self.data, self.at)
        self.at += struct.calcsize("<" + format)
        return values if len(values) > 1 else values[0]

    def name(self):
        end = self.data.index(b"\0", self.at)
        name = self.data[self.at:end].decode()
        self.at = end + 1
        return name


def parse_images(folder):
    file = Parser(folder / "images.bin")
    images = {}
    for _ in range(file.take("Q")):
        image_id = file.take("I")
        w, x, y, z, *t = file.take("7d")
        camera_id = file.take("I")
        name = file.name()
        keypoints = [file.take("ddQ") for _ in range(file.take("Q"))]
        images[image_id] = ((x, y, z, w), t, camera_id, name, keypoints)
    assert file.at == len(file.data)
    return images


def parse_points(folder):
    file = Parser(folder / "points3D.bin")
    points = {}
    for _ in range(file.take("Q")):
        point_id = file.take("Q")
        xyz, rgb, error = file.take("3d"), file.take("3B"), file.take("d")
        points[point_id] = (xyz, rgb, error,
                            [file.take("II") for _ in range(file.take("Q"))])
    assert file.at == len(file.data)
    return points


def parse_cameras(folder):
    file = Parser(folder / "cameras.bin")
    cameras = {}
    for _ in range(file.take("Q")):
        camera_id, model, width, height = file.take("IiQQ")
        num_params = {0: 3, 1: 4, 2: 4, 3: 5, 4: 8}[model]
        cameras[camera_id] = (width, height, file.take(f"{num_params}d"))
    assert file.at == len(file.data)
    return cameras


def test_images(model, sparse):
    parsed = parse_images(sparse / "0")
    assert parsed.keys() == model.images.keys()
    for image_id, (quat, t, camera_id, name, keypoints) in parsed.items():
        image = model.images[image_id]
        pose = image.cam_from_world()
        sign = np.sign(np.dot(pose.rotation.quat, quat))
        np.testing.assert_allclose(sign * pose.rotation.quat, quat, atol=1e-14)
        np.testing.assert_allclose(pose.translation, t, atol=1e-12)
        assert image.cam_from_world == pose  # as in pycolmap before 3.12
        np.testing.assert_allclose(
            pose * image.projection_center(), 0.0, atol=1e-12)
        assert (image.camera_id, image.name) == (camera_id, name)
        assert [(*p.xy, p.point3D_id) for p in image.points2D] == keypoints
        assert image.num_points3D == sum(p.has_point3D()
                                         for p in image.points2D)


def test_points(model, sparse):
    parsed = parse_points(sparse / "0")
    assert list(model.points3D) == sorted(parsed)
    for point_id, (xyz, rgb, error, track) in parsed.items():
        point = model.points3D[point_id]
        assert (tuple(point.xyz), tuple(point.color)) == (xyz, rgb)
        assert (point.error, point.track.elements) == (error, track)
    with pytest.raises(KeyError):
        model.points3D[10**9]


def test_cameras(model, sparse):
    assert {camera_id: (camera.width, camera.height, tuple(camera.params))
            for camera_id, camera in model.cameras.items()
            } == parse_cameras(sparse / "0")


def test_rigs_and_frames_agree_with_images(model, drive):
    assert model.num_frames() == 12
    for frame in model.frames.values():
        assert model.rigs[frame.rig_id] is frame.rig
        for image_id in frame.image_ids:
            assert model.images[image_id].frame is frame
    rig = next(iter(model.rigs.values()))
    reference = rig.sensor_from_rig(rig.ref_camera_id)
    assert reference == pymgsfm.Rigid3d()


def test_summary_agrees_with_the_points(model):
    points = list(model.points3D.values())
    num_observations = sum(point.track.length() for point in points)
    assert model.compute_num_observations() == num_observations
    mean = sum(point.error * point.track.length()
               for point in points) / num_observations
    assert model.compute_mean_reprojection_error() == pytest.approx(mean)
    assert f"{len(points)} points" in model.summary()


def test_written_model_is_the_same(model, sparse, tmp_path):
    model.write(tmp_path)
    for name in ("cameras", "rigs", "frames", "images", "points3D"):
        assert ((tmp_path / f"{name}.bin").read_bytes()
                == (sparse / "0" / f"{name}.bin").read_bytes()), name


def test_text_model_is_the_same(model, tmp_path):
    model.write_text(tmp_path)
    again = pymgsfm.Reconstruction(tmp_path)
    assert again.points3D.xyz.tobytes() == model.points3D.xyz.tobytes()
    for frame_id, frame in model.frames.items():
        assert again.frames[frame_id].rig_from_world == frame.rig_from_world


def test_models_without_rigs(model, tmp_path):
    model.write(tmp_path)
    (tmp_path / "rigs.bin").unlink()
    (tmp_path / "frames.bin").unlink()
    single = pymgsfm.Reconstruction(tmp_path)
    assert single.num_frames() == single.num_reg_images()
    for image_id, image in model.images.items():
        np.testing.assert_allclose(single.images[image_id].cam_from_world().row(),
                                   image.cam_from_world().row(), atol=1e-12)


def test_arrays_are_views(sparse, tmp_path):
    model = pymgsfm.Reconstruction(sparse / "0")
    point = model.points3D[next(iter(model.points3D))]
    assert np.shares_memory(point.xyz, model.points3D.xyz)
    xyz = model.points3D.xyz
    del model, point
    assert np.isfinite(xyz).all()  # the array keeps its memory


def test_changes_are_written(sparse, tmp_path):
    model = pymgsfm.Reconstruction(sparse / "0")
    model.points3D.xyz[:] += 1.0
    first, second = list(model.frames)[:2]
    model.frames[first].rig_from_world.translation[:] = (1.0, 2.0, 3.0)
    model.frames[second].rig_from_world = pymgsfm.Rigid3d()
    model.write(tmp_path)
    again = pymgsfm.Reconstruction(tmp_path)
    assert (again.points3D.xyz == model.points3D.xyz).all()
    assert list(again.frames[first].rig_from_world.translation) == [1, 2, 3]
    assert again.frames[second].rig_from_world == pymgsfm.Rigid3d()


def test_broken_models_are_refused(sparse, tmp_path):
    model = pymgsfm.Reconstruction(sparse / "0")
    model.points3D._track[0, 0] = 10**6
    with pytest.raises(pymgsfm.InputError, match="image 1000000"):
        model.write(tmp_path)
    model = pymgsfm.Reconstruction(sparse / "0")
    camera_id = next(iter(model.cameras))
    model.cameras[camera_id].params = np.ones(2)
    with pytest.raises(pymgsfm.InputError, match=f"camera {camera_id} needs"):
        model.write(tmp_path)


def test_pickle(model, tmp_path):
    again = pickle.loads(pickle.dumps(model))
    again.write(tmp_path / "again")
    model.write(tmp_path / "first")
    for name in ("rigs.bin", "frames.bin", "images.bin", "points3D.bin"):
        assert ((tmp_path / "again" / name).read_bytes()
                == (tmp_path / "first" / name).read_bytes())
    image = next(iter(model.images.values()))
    assert (pickle.loads(pickle.dumps(image)).cam_from_world()
            == image.cam_from_world())
    point = pickle.loads(pickle.dumps(model.points3D[1]))
    assert point.track.elements == model.points3D[1].track.elements


def test_to_pycolmap_hands_over_a_folder(model, monkeypatch):
    """With pycolmap replaced: it is not among Debian's packages."""
    fake = types.ModuleType("pycolmap")
    fake.Reconstruction = pymgsfm.Reconstruction
    monkeypatch.setitem(sys.modules, "pycolmap", fake)
    assert (model.to_pycolmap().points3D.xyz == model.points3D.xyz).all()


@pytest.mark.skipif(not shutil.which("colmap"), reason="no colmap")
def test_colmap_reads_what_to_pycolmap_hands_over(model, tmp_path, monkeypatch):
    """pycolmap reads folders by the code of COLMAP."""
    def convert(folder):
        subprocess.run(["colmap", "model_converter", "--input_path", folder,
                        "--output_path", str(tmp_path), "--output_type", "TXT"],
                       check=True, stdout=subprocess.DEVNULL,
                       env={**os.environ, "QT_QPA_PLATFORM": "offscreen"})

    fake = types.ModuleType("pycolmap")
    fake.Reconstruction = convert
    monkeypatch.setitem(sys.modules, "pycolmap", fake)
    model.to_pycolmap()
    rows = [line.split() for line in
            (tmp_path / "points3D.txt").read_text().splitlines()
            if not line.startswith("#")]
    assert len(rows) == model.num_points3D()
    for row in rows:
        np.testing.assert_allclose(np.array(row[1:4], dtype=float),
                                   model.points3D[int(row[0])].xyz, rtol=1e-9)
    lines = [line for line in (tmp_path / "images.txt").read_text().splitlines()
             if not line.startswith("#")][::2]
    assert len(lines) == model.num_reg_images()
    for line in lines:
        words = line.split()
        pose = model.images[int(words[0])].cam_from_world()
        np.testing.assert_allclose(np.array(words[5:8], dtype=float),
                                   pose.translation, atol=1e-9)


class TestTransforms:
    def rotations(self):
        random = np.random.default_rng(1)
        quats = random.normal(size=(20, 4))
        return [pymgsfm.Rotation3d(q / np.linalg.norm(q)) for q in quats]

    def test_products_agree_with_matrices(self):
        for a, b in zip(self.rotations(), self.rotations()[::-1]):
            np.testing.assert_allclose((a * b).matrix(),
                                       a.matrix() @ b.matrix(), atol=1e-12)
            x = np.array([1.0, 2.0, 3.0])
            np.testing.assert_allclose(a * x, a.matrix() @ x)
            pose = pymgsfm.Rigid3d(a, x) * pymgsfm.Rigid3d(b, 2 * x)
            np.testing.assert_allclose(pose * x, a * (b * x + 2 * x) + x)
            np.testing.assert_allclose(
                (pose.inverse() * pose).matrix(), np.eye(3, 4), atol=1e-12)

    def test_matrix_and_quaternion(self):
        for a in self.rotations():
            b = pymgsfm.Rotation3d.from_matrix(a.matrix())
            np.testing.assert_allclose(b.matrix(), a.matrix(), atol=1e-12)
        half_turn = pymgsfm.Rotation3d([1.0, 0.0, 0.0, 0.0])
        assert half_turn.angle() == pytest.approx(np.pi)
