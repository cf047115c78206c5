# SPDX-License-Identifier: BSD-3-Clause
"""Poses, models, measured runs and databases."""
import contextlib
import math
import sqlite3
import struct

import pytest

from experiments import (colmap_database, colmap_model, measure, options, poses,
                         records)


def turn(axis, angle):
    """Rotation matrix and quaternion about one of the axes."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rows = [[float(r == c) for c in range(3)] for r in range(3)]
    rows[i][i] = rows[j][j] = math.cos(angle)
    rows[j][i], rows[i][j] = math.sin(angle), -math.sin(angle)
    quaternion = [math.cos(angle / 2), 0.0, 0.0, 0.0]
    quaternion[1 + axis] = math.sin(angle / 2)
    return rows, quaternion


def pose(axis, angle, position):
    """4 x 4 matrix of a turn and a position."""
    rows, _ = turn(axis, angle)
    return [row + [p] for row, p in zip(rows, position)] + [
        [0.0, 0.0, 0.0, 1.0]]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("angle", (0.0, 0.3, -1.2, 3.0))
def test_quaternions_of_turns(axis, angle):
    rows, quaternion = turn(axis, angle)
    found = poses.quaternion_from_rotation(rows)
    sign = math.copysign(1.0, sum(a * b for a, b in zip(found, quaternion)))
    assert [sign * a for a in found] == pytest.approx(quaternion, abs=1e-12)
    for row, back in zip(rows, poses.rotation_from_quaternion(*found)):
        assert back == pytest.approx(row, abs=1e-12)


def test_a_pose_times_its_inverse_is_the_identity():
    one = poses.product(pose(0, 0.7, [1, 2, 3]), pose(2, -0.4, [0, 5, 1]))
    r, t = poses.inverse(one)
    back = [[*row, x] for row, x in zip(r, t)] + [[0, 0, 0, 1]]
    for i, row in enumerate(poses.product(one, back)):
        assert row == pytest.approx([float(i == j) for j in range(4)],
                                    abs=1e-12)


def write_truth(folder):
    colmap_model.write_truth(
        folder, ["a PINHOLE 4 4 1 1 2 2", "b PINHOLE 4 4 1 1 2 2"],
        {"a": pose(1, 0.0, [0, 0, 0]), "b": pose(1, 0.5, [1, 0, 0])},
        {"1.png": pose(1, math.pi / 2, [3, 4, 5])})


def test_true_positions_are_those_of_the_cameras(tmp_path):
    write_truth(tmp_path)
    positions = colmap_model.read_positions(tmp_path)
    assert set(positions) == {"a/1.png", "b/1.png"}
    assert positions["a/1.png"] == pytest.approx((3, 4, 5), abs=1e-12)
    assert positions["b/1.png"] == pytest.approx((3, 4, 4), abs=1e-12)


def write_binary_images(folder, names):
    """images.bin with a keypoint each, at positions -1, -2, ... along x."""
    folder.mkdir()
    data = struct.pack("<Q", len(names))
    for k, name in enumerate(names, 1):
        data += struct.pack("<I7dI", k, 1, 0, 0, 0, float(k), 0, 0, 1)
        data += name.encode() + b"\0"
        data += struct.pack("<QddQ", 1, 0.5, 0.5, 7)
    (folder / "images.bin").write_bytes(data)


def test_binary_models(tmp_path):
    write_binary_images(tmp_path / "0", ["a", "b/c"])
    assert colmap_model.read_positions(tmp_path / "0") == {
        "a": (-1.0, 0.0, 0.0), "b/c": (-2.0, 0.0, 0.0)}


def test_the_largest_model_counts(tmp_path):
    assert colmap_model.largest_model(tmp_path) is None
    write_binary_images(tmp_path / "0", ["a"])
    write_truth(tmp_path / "1")
    write_binary_images(tmp_path / "2", ["a", "b"])
    # The first of two models with equally many images.
    assert colmap_model.largest_model(tmp_path) == tmp_path / "1"
    write_binary_images(tmp_path / "3", ["a", "b", "c"])
    assert colmap_model.largest_model(tmp_path) == tmp_path / "3"
    assert colmap_model.largest_model(tmp_path / "1") == tmp_path / "1"


def test_damaged_models_are_no_models(tmp_path):
    (tmp_path / "0").mkdir()
    (tmp_path / "0/images.bin").write_bytes(b"\2\0")
    assert colmap_model.largest_model(tmp_path) is None
    with pytest.raises(SystemExit, match="images.bin is not as expected"):
        colmap_model.read_poses(tmp_path / "0")


@pytest.mark.parametrize("keypoints", ["", "\n", "1.5 2.5 -1 3 4 7\n"])
def test_lines_of_keypoints_may_be_omitted(tmp_path, keypoints):
    (tmp_path / "images.txt").write_text(
        "\ufeff# header\n" + "".join(
            f"{k} 1 0 0 0 {k} 0 0 1 cam 0/{k}.png \n{keypoints}"
            for k in (1, 2, 3)))
    assert colmap_model.read_positions(tmp_path) == {
        f"cam 0/{k}.png": (-k, 0.0, 0.0) for k in (1, 2, 3)}
    assert colmap_model.num_images(tmp_path) == 3


def run_shell(folder, script, time_limit=0):
    return measure.run_logged(["sh", "-c", script], folder / "log", time_limit)


def test_who_ended_a_run(tmp_path):
    assert measure.was_killed(run_shell(tmp_path, "kill -9 $$"))
    assert measure.was_killed(run_shell(tmp_path, "kill -15 $$"))
    assert not measure.was_killed(run_shell(tmp_path, "kill -11 $$"))
    assert not measure.was_killed(run_shell(tmp_path, "exit 9"))
    assert not measure.was_killed(run_shell(tmp_path, "true"))
    stopped = run_shell(tmp_path, "sleep 100", 0.1)
    assert stopped["is_stopped"]
    assert not measure.was_killed(stopped)


def test_a_failed_step_shows_its_last_line(tmp_path):
    with pytest.raises(measure.StepFailed, match="second"):
        measure.run_step(["sh", "-c", "echo first; echo second; echo; exit 1"],
                         tmp_path / "log")


def test_stages_of_all_models_are_added():
    def part(seconds, memory):
        return {"seconds": {"tracks": seconds},
                "processor_seconds": {"tracks": 2 * seconds},
                "peak_memory_mib_after": {"tracks": memory}}
    report = {**part(1.0, 5.0), "models": [part(2.0, 9.0), part(4.0, 7.0)]}
    assert measure.stages_of(report) == {"tracks": {
        "seconds": 7.0, "processor_seconds": 14.0,
        "peak_memory_mib_after": 9.0}}


def test_reading_and_view_graph_do_not_count():
    part = {kind: {"reading": 1.0, "view graph": 2.0, "tracks": 4.0}
            for kind in ("seconds", "processor_seconds",
                         "peak_memory_mib_after")}
    record = {}
    records.add_stages(record, {**part, "models": []})
    assert record["seconds_counted"] == 4.0
    assert list(record["stages"]) == ["reading", "view graph", "tracks"]


def test_a_program_is_found_by_its_relative_path(tmp_path, monkeypatch):
    program = tmp_path / "mgsfm"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.chdir(tmp_path)
    assert options.find_program(program.relative_to(tmp_path)) == program
    with pytest.raises(SystemExit, match="no program nothing"):
        options.find_program(program.relative_to(tmp_path).with_name("nothing"))


@pytest.fixture
def database(tmp_path):
    """Frames 1 to 4 of one camera, all pairs."""
    path = tmp_path / "database.db"
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.executescript("""
            CREATE TABLE cameras (camera_id, model, params, prior_focal_length);
            CREATE TABLE images (image_id, name);
            CREATE TABLE two_view_geometries (pair_id, rows);""")
        connection.execute("INSERT INTO cameras VALUES (1, 1, ?, 1)",
                           (struct.pack("<4d", 100, 110, 20, 30),))
        for i in range(1, 5):
            connection.execute("INSERT INTO images VALUES (?, ?)",
                               (i, f"cam0/{i:06}.png"))
            for j in range(i + 1, 5):
                connection.execute(
                    "INSERT INTO two_view_geometries VALUES (?, 30)",
                    (i * colmap_database.MAX_NUM_IMAGES + j,))
        connection.commit()
    return path


def read_rows(path, query):
    with contextlib.closing(sqlite3.connect(path)) as connection:
        return connection.execute(query).fetchall()


def test_focal_lengths_are_scaled_in_a_copy(database):
    copy = database.with_name("copy.db")
    colmap_database.scale_focal_lengths(database, copy, 2.0, is_prior=False)
    query = "SELECT params, prior_focal_length FROM cameras"
    ((blob, is_prior),) = read_rows(copy, query)
    assert struct.unpack("<4d", blob) == (200, 220, 20, 30)
    assert is_prior == 0
    ((blob, is_prior),) = read_rows(database, query)
    assert struct.unpack("<4d", blob) == (100, 110, 20, 30)
    # Made once.
    colmap_database.scale_focal_lengths(database, copy, 3.0, is_prior=True)
    assert read_rows(copy, query)[0][1] == 0


def test_pairs_of_and_across_removed_frames_are_gone(database):
    copy = database.with_name("copy.db")
    colmap_database.remove_frames(database, copy, 2, 2)
    pairs = read_rows(copy, "SELECT pair_id FROM two_view_geometries")
    assert [colmap_database.image_ids_of_pair(p) for (p,) in pairs] == [(3, 4)]


def test_image_names_by_a_condition(database):
    assert colmap_database.image_names(
        database, lambda name: colmap_database.frame_number(name) > 2) == [
            "cam0/000003.png", "cam0/000004.png"]
