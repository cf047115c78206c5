# SPDX-License-Identifier: BSD-3-Clause
"""Files written from the definitions of their formats, read by the program."""
import json
import sqlite3
import struct
import subprocess

import colmap_files
import numpy
import pytest
from numpy.testing import assert_allclose


def quaternion(rotation):
    """w, x, y, z of a rotation by less than 180 degrees."""
    w = 0.5 * numpy.sqrt(1 + numpy.trace(rotation))
    m = (rotation - rotation.T) / (4 * w)
    return [w, m[2, 1], m[0, 2], m[1, 0]]


def write_images(model, folder):
    """Headers of image files of the right size."""
    for image in model.images.values():
        _, width, height, _ = model.cameras[image.camera]
        path = folder / image.name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"P5 %d %d 255\n" % (width, height))


@pytest.fixture
def expect_poses(mgsfm, model, tmp_path):
    """The program reads the poses of the model from a file or folder."""
    def call(path, *words, names=None):
        mgsfm("model_converter", "--input_path", path, "--output_path",
              tmp_path / "read", "--output_type", "txt", *words)
        read = colmap_files.read_text(tmp_path / "read")
        poses = {image.name: image.cam_from_world
                 for image in read.images.values()}
        expected = {image.name: image.cam_from_world
                    for image in model.images.values()}
        assert set(poses) == set(names or expected)
        for name, pose in poses.items():
            assert_allclose(pose, expected[name], atol=1e-6)
        return read
    return call


def test_colmap_text_with_blank_lines_and_comments(model, expect_poses,
                                                   tmp_path):
    """As COLMAP 3.8 writes it, without rigs and in any order."""
    folder = tmp_path / "text"
    folder.mkdir()
    (folder / "cameras.txt").write_text("# Camera list\r\n" + "".join(
        f"{number} PINHOLE {w} {h} {' '.join(map(repr, params))}\r\n"
        for number, (_, w, h, params) in model.cameras.items()))
    text = "# Image list with two lines of data per image:\n"
    for number, image in reversed(list(model.images.items())):
        values = [*quaternion(image.cam_from_world[:3, :3]),
                  *image.cam_from_world[:3, 3]]
        keypoints = " ".join(
            f"{x} {y} {-1 if p == colmap_files.NO_POINT else p}"
            for x, y, p in image.keypoints)
        text += (f"{number} {' '.join(map(repr, map(float, values)))} "
                 f"{image.camera} {image.name}\n{keypoints}\n")
    (folder / "images.txt").write_text(text)
    (folder / "points3D.txt").write_text("".join(
        f"{number} {' '.join(map(repr, xyz))} 1 2 3 -1 "
        + " ".join(f"{i} {k}" for i, k in track) + "\n"
        for number, (xyz, _, _, track) in model.points.items()))
    read = expect_poses(folder)
    assert len(read.points) == len(model.points)


def test_colmap_binary_without_rigs(model, expect_poses, tmp_path):
    folder = tmp_path / "binary"
    folder.mkdir()
    data = struct.pack("<Q", len(model.cameras))
    for number, (kind, w, h, params) in model.cameras.items():
        data += struct.pack("<IiQQ4d", number, kind, w, h, *params)
    (folder / "cameras.bin").write_bytes(data)
    data = struct.pack("<Q", len(model.images))
    for number, image in model.images.items():
        data += struct.pack("<I7dI", number,
                            *quaternion(image.cam_from_world[:3, :3]),
                            *image.cam_from_world[:3, 3], image.camera)
        data += image.name.encode() + b"\0" + struct.pack("<Q", 0)
    (folder / "images.bin").write_bytes(data)
    (folder / "points3D.bin").write_bytes(struct.pack("<Q", 0))
    expect_poses(folder)


def test_transforms_json(model, expect_poses, tmp_path):
    """world_from_cam with the axes of OpenGL: y up, z backward."""
    write_images(model, tmp_path / "images")
    frames = [{"file_path": f"images/{image.name}",
               "transform_matrix": (numpy.linalg.inv(image.cam_from_world)
                                    @ numpy.diag([1, -1, -1, 1])).tolist()}
              for image in model.images.values()]
    _, w, h, (fx, fy, cx, cy) = next(iter(model.cameras.values()))
    path = tmp_path / "transforms.json"
    path.write_text(json.dumps({
        "camera_model": "OPENCV", "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
        "w": w, "h": h, "frames": frames}))
    read = expect_poses(path)
    assert_allclose(next(iter(read.cameras.values()))[3], [fx, fy, cx, cy])


def test_nvm(model, expect_poses, tmp_path):
    """name, focal length, w x y z of cam_from_world, center, distortion, 0."""
    write_images(model, tmp_path / "images")
    text = f"NVM_V3\n\n{len(model.images)}\n"
    for image in model.images.values():
        center = numpy.linalg.inv(image.cam_from_world)[:3, 3]
        values = [707.0912, *quaternion(image.cam_from_world[:3, :3]),
                  *center, 0, 0]
        text += f"{image.name} {' '.join(str(float(v)) for v in values)}\n"
    path = tmp_path / "model.nvm"
    path.write_text(text + "\n0\n")
    expect_poses(path, "--image_path", tmp_path / "images")


def test_bundler(model, expect_poses, tmp_path):
    """Cameras look along -z, with y up."""
    write_images(model, tmp_path / "images")
    text = f"# Bundle file v0.3\n{len(model.images)} 0\n"
    for image in model.images.values():
        pose = numpy.diag([1, -1, -1, 1]) @ image.cam_from_world
        for row in ([707.0912, 0, 0], *pose[:3, :3], pose[:3, 3]):
            text += " ".join(str(float(v)) for v in row) + "\n"
    (tmp_path / "bundle.out").write_text(text)
    (tmp_path / "list.txt").write_text("".join(
        f"{image.name} 0 707.0912\n" for image in model.images.values()))
    expect_poses(tmp_path / "bundle.out", "--image_path", tmp_path / "images")


def frames_in_order(model):
    return [numpy.linalg.inv(model.frames[number][1])
            for number in sorted(model.frames)]


def test_trajectories(model, expect_poses, drive, tmp_path):
    rig = ("--database_path", drive / "database.db", "--rig_config_path",
           drive / "truth" / "rig_config.json")
    times = ("--image_timestamps_path", drive / "timestamps.txt")
    poses = frames_in_order(model)
    kitti = tmp_path / "kitti.txt"
    numpy.savetxt(kitti, [pose[:3].ravel() for pose in poses])
    expect_poses(kitti, "--input_type", "kitti", *rig)
    rows = [[0.1 * k, *pose[:3, 3], *quaternion(pose[:3, :3])[1:],
             quaternion(pose[:3, :3])[0]] for k, pose in enumerate(poses)]
    tum = tmp_path / "tum.txt"
    numpy.savetxt(tum, rows, header="timestamp tx ty tz qx qy qz qw")
    expect_poses(tum, "--input_type", "tum", *rig, *times)
    euroc = tmp_path / "euroc.csv"
    euroc.write_text("#timestamp [ns],...\n" + "".join(
        f"{int(1e8) * k}," + ",".join(
            str(float(v)) for v in [*pose[:3, 3], *quaternion(pose[:3, :3])])
        + "\n" for k, pose in enumerate(poses)))
    expect_poses(euroc, "--input_type", "euroc", *rig, *times)


def test_other_orders_of_quaternions_are_named(mgsfm, model, drive, tmp_path):
    """By the rotations from image to image, without points."""
    mgsfm("model_converter", "--input_path", drive / "truth", "--output_path",
          tmp_path / "text", "--output_type", "txt")
    for name in ("rigs.txt", "frames.txt"):
        (tmp_path / "text" / name).unlink()
    path = tmp_path / "text" / "images.txt"
    lines = [line for line in path.read_text().split("\n")
             if line[:1] != "#"][::2]
    evaluate = ("model_evaluator", "--input_path", drive / "truth",
                "--gt_path", tmp_path / "text")
    for order in ([1, 2, 3, 4], [2, 3, 4, 1]):
        rows = [line.split() for line in lines if line]
        path.write_text("".join(
            " ".join([row[0], *(row[k] for k in order), *row[5:]]) + "\n\n"
            for row in rows))
        assert ("x y z w" in mgsfm(*evaluate)) == (order[0] == 2)


@pytest.fixture
def refused(request, tmp_path):
    """Calls the program, which must fail and write no `out`; returns its
    error."""
    program = request.config.getoption("--program").resolve()

    def call(*words):
        done = subprocess.run(
            list(map(str, [program, *words, "--output_path",
                           tmp_path / "out"])),
            capture_output=True, text=True, check=False)
        assert done.returncode == 1, done.stdout + done.stderr
        assert not (tmp_path / "out").exists()
        return done.stderr
    return call


def test_other_conventions_of_trajectories_are_refused(refused, model, drive,
                                                       tmp_path):
    """By the rotations between matched images."""
    rig = ("--database_path", drive / "database.db", "--rig_config_path",
           drive / "truth" / "rig_config.json", "--image_timestamps_path",
           drive / "timestamps.txt")
    path = tmp_path / "poses"
    poses = frames_in_order(model)

    def write(time, separator, values_of):
        path.write_text("".join(
            separator.join(map(str, [*([time(k)] if time else []),
                                     *map(float, values_of(pose))])) + "\n"
            for k, pose in enumerate(poses)))

    def message(kind):
        return refused("model_converter", "--input_path", path,
                       "--input_type", kind, *rig)
    write(lambda k: 0.1 * k, " ",
          lambda pose: [*pose[:3, 3], *quaternion(pose[:3, :3])])
    assert "w x y z" in message("tum")
    write(lambda k: int(1e8) * k, ",", lambda pose: [
        *pose[:3, 3], *numpy.roll(quaternion(pose[:3, :3]), -1)])
    assert "x y z w" in message("euroc")
    write(None, " ", lambda pose: numpy.linalg.inv(pose)[:3].ravel())
    assert "cam_from_world" in message("kitti")


def test_calibrations_in_millimeters_are_refused(refused, drive, tmp_path):
    rows = ([1, 0, 0, -540], [0, 1, 0, 0], [0, 0, 1, 0])
    (tmp_path / "chain.yaml").write_text(KALIBR.format(*rows))
    assert "540" in refused("mapper", "--database_path", drive / "database.db",
                            "--calibration_path", tmp_path / "chain.yaml")


KALIBR = """cam0:
  camera_model: pinhole
  distortion_coeffs: [0, 0, 0, 0]
  distortion_model: radtan
  intrinsics: [707.0912, 707.0912, 601.3873, 182.6104]
  resolution: [1226, 370]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - {}
  - {}
  - {}
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [0, 0, 0, 0]
  distortion_model: radtan
  intrinsics: [707.0912, 707.0912, 601.3873, 182.6104]
  resolution: [1226, 370]
  rostopic: /cam1/image_raw
"""


def test_kalibr(mgsfm, model, drive, tmp_path):
    sensors = model.rigs[min(model.rigs)]
    pose = sensors[max(sensors)]
    (tmp_path / "chain.yaml").write_text(
        KALIBR.format(*(row.tolist() for row in pose[:3])))
    mgsfm("mapper", "--database_path", drive / "database.db",
          "--calibration_path", tmp_path / "chain.yaml", "--output_path",
          tmp_path / "out", "--write_report", 0)
    read = colmap_files.read_binary(tmp_path / "out" / "0")
    sensors = read.rigs[min(read.rigs)]
    assert_allclose(sensors[max(sensors)], pose, atol=1e-9)
    for camera in read.cameras.values():
        assert_allclose(camera[3], [707.0912, 707.0912, 601.8873, 183.1104],
                        atol=1e-9)


def test_images_of_another_library(mgsfm, tmp_path):
    """All formats give keypoints at the same places."""
    image_module = pytest.importorskip("PIL.Image")
    random = numpy.random.default_rng(1)
    small = random.integers(0, 256, (12, 16), dtype=numpy.uint8)
    pixels = numpy.kron(small, numpy.ones((10, 10), numpy.uint8))
    picture = image_module.fromarray(pixels)
    folder = tmp_path / "images"
    folder.mkdir()
    for name in ("a.png", "b.bmp", "c.tif", "d.pgm"):
        picture.save(folder / name)
    picture.save(folder / "e.webp", lossless=True)
    # 12 bits in 16, as industrial cameras write them.
    image_module.fromarray(pixels.astype(numpy.uint16) * 16).save(
        folder / "f.png")
    database = tmp_path / "database.db"
    mgsfm("feature_extractor", "--database_path", database, "--image_path",
          folder)
    keypoints = [numpy.frombuffer(data, "<f4").reshape(rows, cols)[:, :2]
                 for rows, cols, data in sqlite3.connect(database).execute(
                     "select rows, cols, data from keypoints "
                     "order by image_id")]
    assert len(keypoints) == 6 and len(keypoints[0]) > 50
    for others in keypoints[1:]:
        assert abs(len(others) - len(keypoints[0])) < 0.2 * len(keypoints[0])
        distances = numpy.linalg.norm(
            others[:, None] - keypoints[0][None], axis=2).min(axis=1)
        assert numpy.median(distances) < 0.1
