# SPDX-License-Identifier: BSD-3-Clause
"""The drivers of simulated drives, ETH3D-SLAM and KITTI-360."""
import json
import math
import struct

import pytest

from experiments import sequence
from experiments.datasets import (eth3d_slam, kitti360, kitti_odometry,
                                  simulated_drives)


@pytest.fixture
def data(tmp_path):
    """A trajectory of 24 poses, and a recorded sequence without images."""
    folder = tmp_path / "data"
    (folder / "kitti_trajectories").mkdir(parents=True)
    (folder / "kitti_trajectories/03.txt").write_text("".join(
        f"1 0 0 {0.1 * math.sin(i)} 0 1 0 0 0 0 1 {1.0 * i}\n"
        for i in range(24)))
    recorded = folder / "kitti06_stereo"
    for k in range(2):
        (recorded / f"images/cam{k}").mkdir(parents=True)
    (recorded / "calib.txt").write_text(
        "1 0 2 0 0 1 3 0 0 0 1 0\n\n1 0 2 -5 0 1 3 0 0 0 1 0\n")
    (recorded / "gt_poses.txt").write_text("1 0 0 7 0 1 0 8 0 0 1 9\n")
    return folder


def write_png(path, width, height):
    """Only the part that says the size."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + struct.pack(
        ">I4sII", 13, b"IHDR", width, height) + b"\0" * 8)


def test_size_of_a_png(tmp_path):
    write_png(tmp_path / "a.png", 640, 480)
    assert sequence.png_size(tmp_path / "a.png") == (640, 480)
    (tmp_path / "b.png").write_bytes(b"JFIF" * 8)
    with pytest.raises(SystemExit, match="b.png is not a PNG"):
        sequence.png_size(tmp_path / "b.png")


def test_seeds_of_a_short_drive(run_experiments, program, data, tmp_path):
    work = tmp_path / "work"

    def call(*options):
        return run_experiments(
            "hardest_settings", data, "--sequences", "kitti360_03", "--seeds",
            2, "--methods", "mgsfm,mma", "--work", work, "--program", program,
            "--threads", 2, *options)
    # Every second pose, four cameras, two methods, two seeds.
    assert call().count("48 of 48") == 4
    tables = json.loads((work / "hardest_settings.json").read_text())
    rows = {table["name"]: table["rows"] for table in tables["tables"]}
    ((*setting, ours, mma),) = rows["errors_over_seeds"]
    assert setting == ["kitti360_03", "2"]
    assert max(ours, mma) < 0.2
    assert len(rows["ratios_over_seeds"]) == 1
    # The seeds differ.
    records = json.loads((work / "tables.json").read_text())["records"]
    assert len({r["errors"]["position_m"]["mean"] for r in records
                if r["method"] == "mgsfm"}) == 2
    assert "48 of 48" not in call("--only_done")


def test_unknown_settings_are_named(try_experiments, data):
    done = try_experiments("hardest_settings", data, "--sequences", "nothing")
    assert done.returncode == 1
    assert "unknown setting 'nothing'" in done.stderr


def test_a_tree_of_simulated_and_recorded_drives(run_experiments, program, data,
                                                 tmp_path):
    call = ("simulate_drives", data, tmp_path / "tree", "--program", program)
    out = run_experiments(*call, "--", "--max_num_features", 50)
    assert out == "simulating 03\n"
    assert run_experiments(*call) == ""
    folder = tmp_path / "tree/sequences"
    assert (folder / "06_recorded/image_1").resolve() == (
        data / "kitti06_stereo/images/cam1").resolve()
    projections = kitti_odometry.read_projections(
        folder / "06_recorded/calib.txt")
    assert projections["P1"][3] == -5.0
    positions = kitti_odometry.positions_by_name(
        tmp_path / "tree/poses/06_recorded.txt",
        ["image_0/000000.png", "image_0/000001.png"])
    assert positions == {"image_0/000000.png": (7.0, 8.0, 9.0)}
    found = simulated_drives.read_sequence(folder / "03")
    assert len(found.truth_positions()) == 48


def test_the_recorded_drive_belongs_to_stereo_trees(data):
    assert simulated_drives.all_sequences(data, "stereo") == [
        "03", "06_recorded"]
    assert simulated_drives.all_sequences(data, "kitti360") == ["03"]


def test_positions_at_the_time_of_an_image(tmp_path):
    path = tmp_path / "groundtruth.txt"
    path.write_text("# time x y z qx qy qz qw\n10 1 2 3 0 0 0 1\n"
                    "10.2 4 5 6 0 0 0 1\n10.4 7 8 9 0 0 0 1\n")
    names = ["rgb/10.08.png", "rgb/10.21.png", "rgb/10.7.png"]
    assert eth3d_slam.read_tum(path, names) == {
        "rgb/10.08.png": (1, 2, 3), "rgb/10.21.png": (4, 5, 6)}


@pytest.mark.parametrize("poses", ["", "10 1 2 3 0 0 0 1\n"])
def test_a_truth_without_an_interval_gives_no_positions(tmp_path, poses):
    path = tmp_path / "groundtruth.txt"
    path.write_text(poses)
    assert eth3d_slam.read_tum(path, ["rgb/10.png"]) == {}


def test_a_stereo_set_of_eth3d(tmp_path):
    folder = tmp_path / "root/training/desk_3"
    for name in ("1.0.png", "1.1.png", "1.2.png", "1.3.png"):
        write_png(folder / "rgb" / name, 739, 458)
    for name in ("1.0.png", "1.2.png", "1.3.png"):
        write_png(folder / "rgb2" / name, 740, 459)
    (folder / "calibration.txt").write_text("700 701 360 230")
    (folder / "calibration2.txt").write_text("710 711 361 231")
    (folder / "extrinsics_1_2.txt").write_text(
        "1 0 0 0.1\n0 1 0 0.2\n0 0 1 0.3\n")
    (folder / "groundtruth.txt").write_text("")
    assert eth3d_slam.find_folders(tmp_path / "root", "") == [folder]
    found = eth3d_slam.make_sequence(folder, 2, tmp_path / "work")
    # Every second of the three common images.
    assert found.image_list == ["rgb/1.0.png", "rgb/1.3.png", "rgb2/1.0.png",
                                "rgb2/1.3.png"]
    assert found.camera_lines == [
        "rgb PINHOLE 739 458 700.0 701.0 360.0 230.0",
        "rgb2 PINHOLE 740 459 710.0 711.0 361.0 231.0"]
    sensor = (tmp_path / "work/desk_3/rig/rgb2.yaml").read_text()
    assert "0.1, 0.0, 1.0, 0.0, 0.2," in sensor
    assert found.truth_positions() == {}


@pytest.mark.parametrize("reader, text, what", [
    (kitti_odometry.read_projections, "P0: 1 2 x\n", "'x'"),
    (kitti_odometry.read_projections, "P1: 1 2\n", "2 numbers, not 12"),
    (kitti_odometry.read_projections, "P0:" + " nan" * 12, "not finite"),
    (lambda path: kitti_odometry.positions_by_name(path, ["0.png"]),
     "1 2 3\n", "index"),
    (lambda path: eth3d_slam.read_numbers(path, 4), "700 701", "2 numbers"),
    (lambda path: eth3d_slam.read_tum(path, ["rgb/a.png"]),
     "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n", "'a'")])
def test_malformed_files_are_named(tmp_path, reader, text, what):
    path = tmp_path / "file.txt"
    path.write_text(text)
    with pytest.raises(SystemExit) as error:
        reader(path)
    assert str(path) in str(error.value) and what in str(error.value)


def test_malformed_calibrations_of_kitti360_are_named(tmp_path):
    pytest.importorskip("numpy")
    from experiments.datasets import kitti360_calibration, mei_camera
    def pose(path):
        return kitti360_calibration.read_matrices(path, 3, {"image_00": 4})
    gammas = "gamma1: 700.0\ngamma2: 700.0\n"
    for reader, text, what in (
            (mei_camera.read_mei, gammas, "xi"),
            (mei_camera.read_mei, gammas + "xi: -1.0\n", "-1.0"),
            (mei_camera.read_mei, "xi: 1\ngamma1: -700.0\n", "-700.0"),
            (pose, gammas, "image_00"),
            (pose, "image_00: 1 0 0 0 1 0 0 0 1\n", "9 numbers, not 12"),
            (pose, "image_00: 1 0 0 0 0 nan 0 0 0 0 1 0\n", "not finite"),
            (pose, "image_00: 2 0 0 0 0 1 0 0 0 0 1 0\n", "no rotation")):
        path = tmp_path / "file.txt"
        path.write_text(text)
        with pytest.raises(SystemExit) as error:
            reader(path)
        assert str(path) in str(error.value) and what in str(error.value)


def test_drives_of_kitti360_by_number():
    drives = ["2013_05_28_drive_0000_sync", "2013_05_28_drive_0002_sync"]
    assert kitti360.choose_drives(drives, "0002") == [drives[1]]
    assert kitti360.choose_drives(drives, "0000, " + drives[0]) == [drives[0]]
    with pytest.raises(SystemExit, match="no drive '0001'"):
        kitti360.choose_drives(drives, "0001")


def test_fisheye_fit_is_close():
    pytest.importorskip("numpy")
    from experiments.datasets import mei_camera
    mei = {"xi": 2.2, "k1": 0.02, "k2": 1.6, "p1": 0.0, "p2": 0.0,
           "gamma1": 1300.0, "gamma2": 1300.0, "u0": 700.0, "v0": 690.0}
    params, rms, largest = mei_camera.fit_fisheye(mei)
    assert rms < 0.1
    assert largest < 0.5
    assert params[0] == pytest.approx(params[1], abs=1e-6)


FISHEYE_YAML = """\
%YAML:1.0
mirror_parameters:
   xi: 2.2
distortion_parameters:
   k1: 0.02
   k2: 1.6
   p1: 0.0
   p2: 0.0
projection_parameters:
   gamma1: 1.3e+03
   gamma2: 1.3e+03
   u0: 700.0
   v0: 690.0
"""


@pytest.fixture
def kitti360_root(tmp_path):
    """Two frames of a drive; only the first has all images."""
    root = tmp_path / "root"
    drive = "2013_05_28_drive_0000_sync"
    for camera in kitti360.PERSPECTIVE + kitti360.FISHEYE:
        folder = root / "data_2d_raw" / drive / kitti360.folder_of(camera)
        write_png(folder / "0000000007.png", 1400, 1300)
    write_png(root / "data_2d_raw" / drive
              / kitti360.folder_of("image_00") / "0000000009.png", 1400, 1300)
    calibration = root / "calibration"
    calibration.mkdir()
    shifts = {"image_00": 1, "image_01": 2, "image_02": 3, "image_03": 4}
    (calibration / "calib_cam_to_pose.txt").write_text("".join(
        f"{camera}: 1 0 0 {x} 0 1 0 0 0 0 1 0\n"
        for camera, x in shifts.items()))
    # image_01 is rectified by a quarter turn about z.
    (calibration / "perspective.txt").write_text(
        "R_rect_00: 1 0 0 0 1 0 0 0 1\nR_rect_01: 0 -1 0 1 0 0 0 0 1\n"
        "S_rect_00: 1400 1300\n"
        "P_rect_00: 550 0 680 0 0 551 230 0 0 0 1 0\n"
        "P_rect_01: 552 0 681 -3 0 553 231 0 0 0 1 0\n")
    for camera in kitti360.FISHEYE:
        (calibration / f"{camera}.yaml").write_text(FISHEYE_YAML)
    poses = root / "data_poses" / drive
    poses.mkdir(parents=True)
    (poses / "cam0_to_world.txt").write_text("".join(
        f"{n} 1 0 0 {n} 0 1 0 0 0 0 1 5 0 0 0 1\n" for n in (7, 9)))
    return root


def test_a_drive_of_kitti360(kitti360_root, tmp_path):
    pytest.importorskip("numpy")
    from experiments.datasets import kitti360_calibration
    root, drive = kitti360_root, "2013_05_28_drive_0000_sync"
    calibration = kitti360_calibration.Calibration(
        root / "calibration", kitti360.PERSPECTIVE, kitti360.FISHEYE)
    world_from_cam0 = kitti360_calibration.read_world_from_cam0(
        root / "data_poses" / drive / "cam0_to_world.txt")
    found = kitti360.make_sequence(
        root, drive, ["image_01", "image_00", "image_02"], calibration,
        world_from_cam0, 1, tmp_path / "work")
    assert found.name == "0000"
    assert found.image_list == [
        "image_01/data_rect/0000000007.png",
        "image_00/data_rect/0000000007.png",
        "image_00/data_rect/0000000009.png", "image_02/data_rgb/0000000007.png"]
    assert found.rig_prefixes == ["image_01/data_rect/", "image_00/data_rect/",
                                  "image_02/data_rgb/"]
    assert found.camera_lines[0].startswith(
        "image_01/data_rect PINHOLE 1400 1300 552.0 553.0 681.0 231.0")
    assert found.camera_lines[2].startswith(
        "image_02/data_rgb OPENCV_FISHEYE 1400 1300 ")
    # Centers do not depend on rectification.
    positions = found.truth_positions()
    for camera, x in (("image_00/data_rect", 0), ("image_01/data_rect", 1),
                      ("image_02/data_rgb", 2)):
        for number in (7, 9):
            assert positions[f"{camera}/{number:010}.png"] == pytest.approx(
                (number + x, 0, 5), abs=1e-12)
