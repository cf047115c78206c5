# SPDX-License-Identifier: BSD-3-Clause
"""What the program writes, read from the definitions of the formats."""
import json
import re
import shutil
import sqlite3
import subprocess
import xml.etree.ElementTree

import colmap_files
import numpy
import pytest
import yaml
from numpy.testing import assert_allclose


def frame_poses(model):
    """world_from_cam of the reference camera, by frame."""
    return [numpy.linalg.inv(pose) for _, pose, _ in
            (model.frames[number] for number in sorted(model.frames))]


def rig_from_second(model):
    sensors = model.rigs[min(model.rigs)]
    return numpy.linalg.inv(sensors[max(sensors)])


def test_points_of_a_model_project_to_their_keypoints(model):
    num_observations = 0
    for number, (xyz, _, _, track) in model.points.items():
        for image_id, keypoint in track:
            image = model.images[image_id]
            x, y, point = image.keypoints[keypoint]
            assert point == number
            pixel = colmap_files.project(model.cameras[image.camera],
                                         image.cam_from_world @ [*xyz, 1])
            assert_allclose(pixel, [x, y], atol=0.01)
            num_observations += 1
    assert num_observations > 1000


def test_images_have_the_poses_of_frames_and_rigs(model):
    images = 0
    for rig, rig_from_world, ids in model.frames.values():
        for number in ids:
            image = model.images[number]
            assert_allclose(model.rigs[rig][image.camera] @ rig_from_world,
                            image.cam_from_world, atol=1e-9)
            images += 1
    assert images == len(model.images) == 24


def test_text_is_the_same_model(model, convert):
    text = colmap_files.read_text(convert("txt"))
    assert text.cameras == model.cameras
    assert len(text.points) == len(model.points)
    names = {image.name: image for image in model.images.values()}
    for image in text.images.values():
        same = names[image.name]
        assert_allclose(image.cam_from_world, same.cam_from_world, atol=1e-12)
        assert_allclose([k[:2] for k in image.keypoints],
                        [k[:2] for k in same.keypoints], atol=1e-5)


def test_ply(model, convert):
    data = convert("ply").read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    header = data[:end].decode().split("\n")
    assert header[1] == "format binary_little_endian 1.0"
    names = {"float": "f4", "double": "f8", "uchar": "u1"}
    fields = [line.split() for line in header if line.startswith("property")]
    points = numpy.frombuffer(data[end:], [(name, "<" + names[kind])
                                           for _, kind, name in fields])
    assert len(points) == len(model.points)
    expected = sorted(xyz for xyz, *_ in model.points.values())
    assert_allclose(sorted(zip(points["x"], points["y"], points["z"])),
                    expected, atol=1e-4)


def test_tum_and_euroc(model, convert, drive):
    times = ("--image_timestamps_path", drive / "timestamps.txt")
    tum = numpy.loadtxt(convert("tum", *times))
    euroc = numpy.loadtxt(convert("euroc", *times), delimiter=",")
    assert_allclose(1e-9 * euroc[:, 0], tum[:, 0])
    for row, ns, pose in zip(tum, euroc, frame_poses(model)):
        qx, qy, qz, qw = row[4:]
        assert_allclose(colmap_files.matrix_of([qw, qx, qy, qz, *row[1:4]]),
                        pose, atol=1e-9)
        assert_allclose(colmap_files.matrix_of([*ns[4:8], *ns[1:4]]), pose,
                        atol=1e-9)


def test_kitti(model, convert):
    rows = numpy.loadtxt(convert("kitti"))
    assert_allclose(rows.reshape(-1, 3, 4),
                    [pose[:3] for pose in frame_poses(model)], atol=1e-9)


def test_nvm(model, convert):
    """The principal point is the center of the image, as none is stored."""
    words = iter(convert("nvm").read_text().split())
    assert next(words) == "NVM_V3"

    def take(count):
        return numpy.array([float(next(words)) for _ in range(count)])
    cameras = {}
    for _ in range(int(next(words))):
        name = next(words)
        cameras[name] = take(10)
    poses = []
    for name, (focal, *pose, radial, _) in cameras.items():
        assert focal == pytest.approx(707.0912) and radial == 0
        poses.append((colmap_files.rotation_of(*pose[:4]), pose[4:]))
        image = next(i for i in model.images.values() if i.name == name)
        assert_allclose(poses[-1][0], image.cam_from_world[:3, :3], atol=1e-9)
        assert_allclose(
            pose[4:], numpy.linalg.inv(image.cam_from_world)[:3, 3], atol=1e-9)
    num_points, = take(1)
    assert num_points == len(model.points)
    for _ in range(int(num_points)):
        point, _ = take(3), take(3)
        for _ in range(int(next(words))):
            index, _, x, y = take(4)
            rotation, center = poses[int(index)]
            in_cam = rotation @ (point - center)
            pixel = 707.0912 * in_cam[:2] / in_cam[2] + [1226 / 2, 370 / 2]
            assert_allclose(pixel, [x, y], atol=0.01)


def test_bundler(model, convert):
    """-f (X / Z, Y / Z), with y up, from the principal point."""
    path = convert("bundler")
    names = path.with_name("bundler.list.txt").read_text().split()
    text = path.with_name("bundler.bundle.out").read_text()
    words = iter(text.split("\n", 1)[1].split())

    def take(count):
        return numpy.array([float(next(words)) for _ in range(count)])
    num_cameras, num_points = map(int, take(2))
    assert (num_cameras, num_points) == (len(names), len(model.points))
    cameras = [(take(3), take(9).reshape(3, 3), take(3)) for _ in names]
    for _ in range(num_points):
        point, _ = take(3), take(3)
        for _ in range(int(next(words))):
            index, _, x, y = take(4)
            (focal, k1, k2), rotation, translation = cameras[int(index)]
            assert k1 == k2 == 0
            in_cam = rotation @ point + translation
            pixel = -focal * in_cam[:2] / in_cam[2]
            assert_allclose(pixel, [x, y], atol=0.01)


def test_calibrations(model, convert):
    second = rig_from_second(model)
    chain = yaml.safe_load(convert("kalibr").read_text())
    assert_allclose(numpy.linalg.inv(chain["cam1"]["T_cn_cnm1"]), second,
                    atol=1e-9)
    sensor = yaml.safe_load(
        (convert("euroc_sensor") / "cam1" / "sensor.yaml").read_text())
    assert_allclose(numpy.reshape(sensor["T_BS"]["data"], (4, 4)), second,
                    atol=1e-9)
    info = yaml.safe_load((convert("camera_info") / "cam1.yaml").read_text())
    fx, _, cx, _, fy, cy, *_ = info["camera_matrix"]["data"]
    # The center of the first pixel is (0.5, 0.5) in COLMAP.
    expected = [707.0912, 707.0912, 601.8873 - 0.5, 183.1104 - 0.5]
    for values in ([fx, fy, cx, cy], chain["cam1"]["intrinsics"],
                   sensor["intrinsics"]):
        assert_allclose(values, expected, atol=1e-4)
    transform = yaml.safe_load(convert("ros_tf").read_text())["transforms"][1]
    shift, turn = (transform["transform"][key]
                   for key in ("translation", "rotation"))
    assert_allclose(colmap_files.matrix_of(
        [*(turn[k] for k in "wxyz"), *(shift[k] for k in "xyz")]), second,
        atol=1e-9)
    launch = xml.etree.ElementTree.parse(convert("ros_launch")).getroot()
    nodes = [{arg[k]: arg[k + 1] for k in range(0, len(arg), 2)}
             for arg in (node.get("args").split()
                         for node in launch.iter("node"))]
    assert [node["--frame-id"] for node in nodes] == ["rig", "rig"]
    assert_allclose(colmap_files.matrix_of([
        float(nodes[1][f"--{key}"])
        for key in ("qw", "qx", "qy", "qz", "x", "y", "z")]), second,
        atol=1e-9)
    camera = json.loads(convert("rig_config").read_text())[0]["cameras"][1]
    assert_allclose(colmap_files.matrix_of(
        camera["cam_from_rig_rotation"] + camera["cam_from_rig_translation"]),
        numpy.linalg.inv(second), atol=1e-9)


def test_kapture(model, convert):
    """World to rig, rig to sensor; its folder is no model."""
    folder = convert("kapture") / "sensors"

    def read(name):
        lines = (folder / f"{name}.txt").read_text().splitlines()
        assert lines[0] == "# kapture format: 1.1"
        return [line.split(", ") for line in lines if line[0] != "#"]

    sensors = {line[0]: list(map(float, line[4:])) for line in read("sensors")}
    assert_allclose(sensors["cam1"][:4], [1226, 370, 707.0912, 707.0912])
    cam_from_rig = {sensor: colmap_files.matrix_of(list(map(float, pose)))
                    for _, sensor, *pose in read("rigs")}
    rig_from_world = {time: colmap_files.matrix_of(list(map(float, pose)))
                      for time, _, *pose in read("trajectories")}
    records = {path: cam_from_rig[sensor] @ rig_from_world[time]
               for time, sensor, path in read("records_camera")}
    assert len(records) == len(model.images)
    for image in model.images.values():
        assert_allclose(records[image.name], image.cam_from_world, atol=1e-9)


def test_maps(model, convert):
    origin = ("--origin", "48,11,500")
    path = json.loads(convert("geojson", *origin).read_text())
    places = path["features"][0]["geometry"]["coordinates"]
    kml = xml.etree.ElementTree.parse(convert("kml", *origin)).getroot()
    text = next(e.text for e in kml.iter() if e.tag.endswith("coordinates"))
    assert_allclose([list(map(float, p.split(","))) for p in text.split()],
                    places, atol=1e-6)
    meters = 111_200  # per degree of latitude, within 0.1 %
    for (lon, lat, height), pose in zip(places, frame_poses(model)):
        east, north, up = pose[:3, 3]
        east_per_deg = meters * numpy.cos(numpy.radians(48))
        assert abs(east - (lon - 11) * east_per_deg) < 0.01 * abs(east) + 1e-3
        assert abs(north - (lat - 48) * meters) < 0.01 * abs(north) + 1e-3
        assert abs(up - (height - 500)) < 0.01


def test_tables_beside_a_model(mgsfm, drive, tmp_path):
    mgsfm("mapper", "--database_path", drive / "database.db", "--output_path",
          tmp_path, "--compute_covariances", 1, "--write_report", 0)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["models"]
    frames = numpy.genfromtxt(tmp_path / "0" / "frames.csv", delimiter=",",
                              names=True, dtype=None, encoding="utf-8")
    assert len(frames) == 12 and all(0 <= frames["confidence"])
    rows = numpy.genfromtxt(tmp_path / "0" / "covariances.csv", delimiter=",",
                            names=True, dtype=None, encoding="utf-8")
    for row in rows:
        covariance = numpy.zeros((6, 6))
        covariance[numpy.triu_indices(6)] = [row[f"c{i}{k}"] for i in range(6)
                                             for k in range(i, 6)]
        sigma = numpy.degrees(numpy.sqrt(covariance[0, 0]))
        assert_allclose(row["sigma_rotation_x_deg"], sigma, rtol=1e-3)


def test_database(drive, model):
    database = sqlite3.connect(drive / "database.db")
    names = dict(database.execute("select image_id, name from images"))
    for number, image in model.images.items():
        assert names[number] == image.name
        rows, cols, data = database.execute(
            "select rows, cols, data from keypoints where image_id = ?",
            (number,)).fetchone()
        keypoints = numpy.frombuffer(data, "<f4").reshape(rows, cols)
        assert_allclose(keypoints[:, :2], [k[:2] for k in image.keypoints],
                        atol=1e-3)
    pairs = database.execute(
        "select pair_id, rows, cols, data from two_view_geometries "
        "where rows > 0").fetchall()
    assert pairs
    for pair, rows, cols, data in pairs:
        first, second = divmod(pair, 2147483647)
        assert first < second and first in names and second in names
        assert numpy.frombuffer(data, "<u4").reshape(rows, cols).shape[1] == 2


@pytest.mark.skipif(not shutil.which("colmap"), reason="no colmap")
def test_colmap_reads_and_writes_the_same_model(mgsfm, drive, tmp_path):
    """Our model, written by COLMAP as text and as binary, and read again."""
    for kind in ("TXT", "BIN"):
        folder = tmp_path / kind
        folder.mkdir()
        subprocess.run(
            ["colmap", "model_converter", "--input_path", drive / "truth",
             "--output_path", folder, "--output_type", kind],
            env={"QT_QPA_PLATFORM": "offscreen", "PATH": "/usr/bin:/bin"},
            check=True, capture_output=True)
        text = mgsfm("model_evaluator", "--input_path", folder, "--gt_path",
                     drive / "truth", "--alignment", "none")
        assert re.search(r"registered +24 of 24", text)
        assert float(re.search(r"position +([\d.e-]+)", text)[1]) < 1e-6
