# SPDX-License-Identifier: BSD-3-Clause
"""The subcommand drive_bounds."""
import sqlite3
import struct

from experiments import colmap_database
from experiments.studies import drive_bounds


def write_matches(path, names, pairs):
    """A database of images, ids from 1, and {(id, id): matches}."""
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE images (image_id, name)")
        connection.executemany("INSERT INTO images VALUES (?, ?)",
                               enumerate(names, 1))
        connection.execute("CREATE TABLE matches (pair_id, rows, data)")
        for (a, b), matches in pairs.items():
            connection.execute(
                "INSERT INTO matches VALUES (?, ?, ?)",
                (a * colmap_database.MAX_NUM_IMAGES + b, len(matches),
                 b"".join(struct.pack("<2I", *m) for m in matches)))
    connection.close()


def test_only_right_matches_join_keypoints(tmp_path):
    names = ["a", "b", "c", "d", "e"]
    # Keypoint 0 is of point 7 in all images, keypoint 1 of point 8.
    point_of = {(name, k): 7 + k for name in names for k in (0, 1)}
    write_matches(tmp_path / "database.db", names, {
        (1, 2): [(0, 0), (1, 1)],
        (2, 3): [(0, 0), (1, 0)],  # the second one is wrong
        (3, 4): [(2, 2)],          # on a vehicle: of no point
        (4, 5): [(0, 0)], (1, 5): []})
    tracks = drive_bounds.join_matches(tmp_path / "database.db", point_of)
    assert sorted((point, sorted(track)) for point, track in tracks) == [
        (7, [("a", 0), ("b", 0), ("c", 0)]), (7, [("d", 0), ("e", 0)]),
        (8, [("a", 1), ("b", 1)])]


def test_right_matches_give_small_errors_and_are_reused(
        program, run_experiments, tmp_path):
    data = tmp_path / "trajectories"
    data.mkdir()
    (data / "07.txt").write_text("".join(
        f"1 0 0 0 0 1 0 0 0 0 1 {0.8 * i}\n" for i in range(40)))
    words = ["drive_bounds", data, "--program", program, "--presets", "hard",
             "--rigs", "stereo", "--seeds", "1", "--frame_step", "2",
             "--output", tmp_path / "out"]
    first = run_experiments(*words)
    assert [path.name for path in (tmp_path / "out").iterdir()] == [
        "hard_07_stereo_1.json"]
    line = first.splitlines()[0].split()
    assert int(line[1]) > 100
    assert 0.0 < float(line[3]) < 0.1
    assert first.endswith(run_experiments(*words))
