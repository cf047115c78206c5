# SPDX-License-Identifier: BSD-3-Clause
"""Where a model says a thing twice, a change of one of them is refused."""
import contextlib
import shutil
import sqlite3
import subprocess

import pytest


@pytest.fixture(scope="module")
def text_model(mgsfm, drive, tmp_path_factory):
    folder = tmp_path_factory.mktemp("text")
    mgsfm("model_converter", "--input_path", drive / "truth", "--output_path",
          folder, "--output_type", "txt")
    return folder


def changed(word):
    """Another number of the same kind."""
    return repr(float(word) + 0.1) if "." in word else str(int(word) + 1)


# Per file: which content line, and which of its words the other files repeat.
REDUNDANT = [
    ("rigs", 0, range(7, 14)),  # the pose of the second camera
    ("rigs", 0, [0, 3, 5]),  # ids of the rig and of its cameras
    ("frames", 1, range(2, 9)),  # its pose
    ("frames", 1, [1, 11, 12, 14, 15]),  # ids of rig, cameras and images
    ("images", 4, range(1, 8)),  # its pose
    ("images", 4, [0, 8]),  # ids of image and camera
    ("images", 5, [2]),  # the point of a keypoint
    ("points3D", 3, [8, 9]),  # image and keypoint of an observation
]


@pytest.mark.parametrize("name, line, columns", REDUNDANT)
def test_changes_are_refused(request, text_model, tmp_path, name, line,
                             columns):
    program = request.config.getoption("--program").resolve()
    path = text_model / f"{name}.txt"
    original = path.read_text()
    lines = original.split("\n")
    content = [i for i, text in enumerate(lines) if text[:1] != "#"]
    for column in columns:
        words = lines[content[line]].split()
        words[column] = changed(words[column])
        path.write_text("\n".join([*lines[:content[line]], " ".join(words),
                                   *lines[content[line] + 1:]]))
        done = subprocess.run(
            [program, "model_converter", "--input_path", text_model,
             "--output_path", tmp_path / "out"], capture_output=True,
            text=True, check=False)
        path.write_text(original)
        assert done.returncode == 1, (column, words[column])
        assert not (tmp_path / "out").exists()


def test_a_calibration_of_another_model_is_refused(request, drive, text_model,
                                                   tmp_path):
    """rig_config.json stays behind when another program writes the model."""
    program = request.config.getoption("--program").resolve()
    database = tmp_path / "database.db"
    shutil.copy(drive / "database.db", database)

    def configure(path):
        done = subprocess.run(
            [program, "rig_configurator", "--database_path", database,
             "--rig_config_path", path], capture_output=True, text=True,
            check=False)
        return done.returncode, done.stderr
    model = tmp_path / "model"
    for name, column, problem in (("cameras", 4, "intrinsics"),
                                  ("rigs", 11, "pose in the rig")):
        shutil.copytree(text_model, model)
        assert configure(model)[0] == 0
        path = model / f"{name}.txt"
        lines = path.read_text().split("\n")
        content = [i for i, line in enumerate(lines) if line[:1] != "#"]
        words = lines[content[0]].split()
        words[column] = changed(words[column])
        lines[content[0]] = " ".join(words)
        path.write_text("\n".join(lines))
        code, message = configure(model)
        assert code == 1 and problem in message, message
        assert configure(model / "rig_config.json")[0] == 0
        shutil.rmtree(model)


@pytest.fixture(scope="module")
def known_rig(mgsfm, tmp_path_factory):
    folder = tmp_path_factory.mktemp("known")
    mgsfm("simulate", "--rig", "stereo", "--num_frames", 4, "--output_path",
          folder, "--extrinsics_are_known", 1, "--database_schema", "3.12")
    return folder / "database.db"


@pytest.mark.parametrize("table, columns", [
    ("rigs", ["rig_id", "ref_sensor_id", "ref_sensor_type"]),
    ("rig_sensors", ["rig_id", "sensor_id", "sensor_type"]),
    ("frames", ["frame_id", "rig_id"]),
    ("frame_data", ["frame_id", "data_id", "sensor_id"]),
    ("images", ["image_id", "camera_id"]),
])
def test_changed_rows_are_refused(request, known_rig, tmp_path, table, columns):
    """Rows of a database that name each other by ids, as COLMAP's do."""
    program = request.config.getoption("--program").resolve()
    path = tmp_path / "changed.db"
    for column in columns:
        shutil.copy(known_rig, path)
        with contextlib.closing(sqlite3.connect(path)) as database:
            database.execute(f"UPDATE {table} SET {column} = {column} + 1000 "
                             f"WHERE rowid = (SELECT max(rowid) FROM {table})")
            database.commit()
        done = subprocess.run(
            [program, "mapper", "--database_path", path, "--output_path",
             tmp_path / "out"], capture_output=True, text=True, check=False)
        assert done.returncode == 1, (column, done.stderr)
        assert "changed.db" in done.stderr, (column, done.stderr)
        assert not (tmp_path / "out").exists()
