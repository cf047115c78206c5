# SPDX-License-Identifier: BSD-3-Clause
"""What the right matches of hard simulated drives allow."""
import collections
import contextlib
import dataclasses
import json
import pathlib
import shutil
import sqlite3
import statistics
import struct
import tempfile

from experiments import (alignment, colmap_database, colmap_model, measure,
                         options, records, tables)
from experiments.studies import hard_drives, hard_evaluation

NO_POINT = 2**64 - 1  # of a keypoint, in COLMAP's format
DESCRIPTION = """\
Simulates the drives of the subcommand hard_drives, joins all right matches of
their databases to tracks, and adjusts poses, rig and points from the true
values with these tracks (mgsfm bundle_adjuster). An estimator that knows which
matches are right, and places all frames in one model, has about these errors.
Parts that no right match joins keep their true relative pose. Prints for how
many drives the errors are gross failures. Finished drives are kept.

  python3 -m experiments drive_bounds DATA --sequences 01,02 --rigs stereo

DATA contains 00.txt, ... in KITTI's format."""


def add_parser(subparsers):
    """The subcommand drive_bounds."""
    parser = options.add_command(
        subparsers, "drive_bounds", run,
        "errors of hard simulated drives by all right matches", DESCRIPTION)
    hard_drives.add_drive_options(parser)
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/drive_bounds",
                        help="folder of results; finished drives are reused")
    options.add_threads(parser, 1)
    options.add_program(parser)


def run(arguments):
    """Runs what is missing, and prints a table."""
    arguments.program = options.find_program(arguments.program)
    arguments.output.mkdir(parents=True, exist_ok=True)
    print(summary_table(hard_drives.run_drives(arguments, run_drive)), end="")


def run_drive(arguments, drive):
    """The row of a drive, from its file if it is finished."""
    path = arguments.output / f"{drive.name}.json"
    words = list(map(str, hard_drives.simulate_words(arguments, drive)))
    if path.exists():
        row = json.loads(path.read_text())
        if row["command"] != words:
            raise SystemExit(f"{path} has other options; choose another "
                             "--output")
        return row
    with tempfile.TemporaryDirectory(dir=arguments.output) as scratch:
        row = {**dataclasses.asdict(drive), "name": drive.name,
               "command": words,
               **adjust_drive(arguments, words, pathlib.Path(scratch))}
    records.write_json(path, row)
    print(f"{row['name']:28} {row['num_tracks']:7} tracks "
          f"{row['mean_m']:8.3f} m, at most {row['max_m']:.1f} m "
          f"{row['max_deg']:.1f} deg{'  GROSS' if row['is_gross'] else ''}",
          flush=True)
    return row


def adjust_drive(arguments, words, scratch):
    """Simulates and adjusts a drive; returns its errors."""
    common = ["--log_level", "warning", "--num_threads", arguments.threads]
    measure.run_step([arguments.program, "simulate", "--output_path",
                      scratch / "drive", *words, *common], scratch / "log")
    truth = scratch / "drive/truth"
    images = read_images(truth / "images.bin")
    positions, point_of = read_points(truth / "points3D.bin", images)
    tracks = join_matches(scratch / "drive/database.db", point_of)
    write_model(truth, scratch / "right", images, positions, tracks)
    measure.run_step([arguments.program, "bundle_adjuster", "--input_path",
                      scratch / "right", "--output_path", scratch / "adjusted",
                      *common], scratch / "log")
    observed = {hard_evaluation.frame_of(name)
                for _, track in tracks for name, _ in track}
    poses = {name: alignment.pose_of(*pose)
             for name, pose in colmap_model.read_poses(truth).items()
             if hard_evaluation.frame_of(name) in observed}
    frames = hard_evaluation.read_frames(scratch / "adjusted", poses)
    errors = hard_evaluation.errors_of(frames, frames).values()
    mean, worst_m, worst_deg = (statistics.mean(e[0] for e in errors),
                                max(e[0] for e in errors),
                                max(e[1] for e in errors))
    misplaced = sum(map(hard_evaluation.is_misplaced, errors))
    return {"num_frames": len(frames), "num_tracks": len(tracks),
            "mean_m": mean, "max_m": worst_m, "max_deg": worst_deg,
            "num_misplaced": misplaced,
            "is_gross": mean > hard_evaluation.MAX_MEAN_M or misplaced > 0}


@dataclasses.dataclass
class TrueImage:
    """An image of the true model, as in images.bin."""

    name: str
    head: bytes  # id, pose and camera
    keypoints: list  # (x, y)


def read_images(path):
    """{image id: TrueImage} of images.bin."""
    data = path.read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    images, at = {}, 8
    for _ in range(count):
        end = data.index(b"\0", at + 64)
        (size,) = struct.unpack_from("<Q", data, end + 1)
        rows = struct.iter_unpack("<2dQ", data[end + 9:end + 9 + 24 * size])
        (image_id,) = struct.unpack_from("<I", data, at)
        images[image_id] = TrueImage(data[at + 64:end].decode(),
                                     data[at:at + 64],
                                     [(x, y) for x, y, _ in rows])
        at = end + 9 + 24 * size
    return images


def read_points(path, images):
    """({point id: position}, {(image name, keypoint): point id})."""
    data = path.read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    positions, point_of, at = {}, {}, 8
    for _ in range(count):
        point, *position = struct.unpack_from("<Q3d", data, at)
        positions[point] = position
        (length,) = struct.unpack_from("<Q", data, at + 43)
        at += 51
        for image_id, keypoint in struct.iter_unpack(
                "<2I", data[at:at + 8 * length]):
            point_of[images[image_id].name, keypoint] = point
        at += 8 * length
    return positions, point_of


def join_matches(database, point_of):
    """[(point id, [(image name, keypoint), ...])] of all right matches: both
    keypoints are of one point. A point has several tracks if no match joins
    them."""
    root = {}

    def find(node):
        while root.setdefault(node, node) != node:
            root[node] = root[root[node]]
            node = root[node]
        return node

    uri = f"file:{database}?mode=ro"
    with contextlib.closing(sqlite3.connect(uri, uri=True)) as connection:
        names = dict(connection.execute("SELECT image_id, name FROM images"))
        for pair, data in connection.execute(
                "SELECT pair_id, data FROM matches WHERE rows > 0"):
            name1, name2 = (names[i] for i in
                            colmap_database.image_ids_of_pair(pair))
            for k1, k2 in struct.iter_unpack("<2I", data):
                point = point_of.get((name1, k1))
                if point is not None and point == point_of.get((name2, k2)):
                    root[find((name1, k1))] = find((name2, k2))
    tracks = collections.defaultdict(list)
    for node in list(root):
        tracks[find(node)].append(node)
    return [(point_of[track[0]], track) for track in tracks.values()]


def write_model(truth, folder, images, positions, tracks):
    """The true model with other tracks."""
    shutil.copytree(truth, folder)
    id_of = {image.name: image_id for image_id, image in images.items()}
    track_of = {node: number for number, (_, track) in enumerate(tracks, 1)
                for node in track}
    with open(folder / "images.bin", "wb") as file:
        file.write(struct.pack("<Q", len(images)))
        for image in images.values():
            file.write(image.head + image.name.encode() + b"\0"
                       + struct.pack("<Q", len(image.keypoints)))
            for k, (x, y) in enumerate(image.keypoints):
                file.write(struct.pack(
                    "<2dQ", x, y, track_of.get((image.name, k), NO_POINT)))
    with open(folder / "points3D.bin", "wb") as file:
        file.write(struct.pack("<Q", len(tracks)))
        for number, (point, track) in enumerate(tracks, 1):
            file.write(struct.pack("<Q3d3BdQ", number, *positions[point],
                                   0, 0, 0, 0.0, len(track)))
            for name, keypoint in track:
                file.write(struct.pack("<2I", id_of[name], keypoint))


def summary_table(rows):
    """A Markdown table with one row for each preset and rig."""
    groups = collections.defaultdict(list)
    for row in rows:
        groups[row["preset"], row["rig"]].append(row)
    cells = [[preset, rig, str(len(members)),
              str(sum(row["is_gross"] for row in members)),
              str(sum(row["num_misplaced"] for row in members)),
              f"{statistics.median(row['mean_m'] for row in members):.3f} m"]
             for (preset, rig), members in sorted(groups.items())]
    return tables.markdown_table(
        ["preset", "rig", "drives", "gross failures", "misplaced frames",
         "median of the mean errors"], cells)
