# SPDX-License-Identifier: BSD-3-Clause
"""Does the mapper name what is wrong with inconsistent input?

Each case changes a consistent database. The result must be as accurate as that
of the database before the change, or name the cause in `warnings` of the
report.
"""
import dataclasses
import json
import math
import pathlib
import shutil
import sqlite3
import struct
import subprocess

from experiments import options
from experiments.colmap_database import (FOCAL_LENGTHS, changed_copy,
                                         frame_number, image_ids_of_pair)

DESCRIPTION = """\
Changes simulated and recorded databases such that they contradict themselves,
runs the mapper, and prints whether it is correct or names the cause.

  python3 -m experiments inconsistent_input --data shared/data"""

# Mean errors of a correct result: three times those of the sound drive.
MAX_POSITION_M = 0.10
MAX_ROTATION_DEG = 0.5


@dataclasses.dataclass(frozen=True)
class Case:
    """change(connection) makes a database inconsistent. The mapper must name
    one of `causes`, or be correct; without causes it must warn of nothing."""

    name: str
    change: object
    causes: tuple
    mapper: tuple = ()


# --- Changes of databases ---


def images_of(connection, prefix=""):
    """{image id: name} of the images with a prefix."""
    return {i: name for i, name in connection.execute(
        "SELECT image_id, name FROM images") if name.startswith(prefix)}


def rename(connection, new_names):
    """Renames images, also in cycles."""
    for image_id in new_names:
        connection.execute("UPDATE images SET name = ? WHERE image_id = ?",
                           (f"changing {image_id}", image_id))
    for image_id, name in new_names.items():
        connection.execute("UPDATE images SET name = ? WHERE image_id = ?",
                           (name, image_id))


def forget_geometry(connection, image_ids):
    """Pairs of these images are verified, but without a relative pose."""
    for (pair,) in connection.execute(
            "SELECT pair_id FROM two_view_geometries").fetchall():
        if set(image_ids_of_pair(pair)) & image_ids:
            connection.execute(
                "UPDATE two_view_geometries SET config = 3, F = NULL, E = "
                "NULL, H = NULL, qvec = NULL, tvec = NULL WHERE pair_id = ?",
                (pair,))


def move_keypoints(connection, image_ids, move):
    """Replaces the coordinates of keypoints by move(camera, x, y)."""
    for image_id in image_ids:
        width, height, blob = connection.execute(
            "SELECT width, height, params FROM cameras NATURAL JOIN images "
            "WHERE image_id = ?", (image_id,)).fetchone()
        camera = (width, height, struct.unpack(f"<{len(blob) // 8}d", blob))
        rows, cols, data = connection.execute(
            "SELECT rows, cols, data FROM keypoints WHERE image_id = ?",
            (image_id,)).fetchone()
        values = list(struct.unpack(f"<{rows * cols}f", data))
        for i in range(0, len(values), cols):
            values[i:i + 2] = move(camera, *values[i:i + 2])
        connection.execute("UPDATE keypoints SET data = ? WHERE image_id = ?",
                           (struct.pack(f"<{len(values)}f", *values),
                            image_id))
    forget_geometry(connection, image_ids)


def lag(num_frames):
    """The second camera is late."""
    def change(connection):
        right = images_of(connection, "cam1/")
        by_time = sorted(right.items(), key=lambda item: item[1])
        late = {i: right[by_time[k + num_frames][0]]
                for k, (i, _) in enumerate(by_time[:-num_frames])}
        # The last images get the names of frames behind the last one.
        late.update({i: f"cam1/9999999999999999{k:03d}.png" for k, (i, _)
                     in enumerate(by_time[-num_frames:])})
        rename(connection, late)
    return change


def second_half(connection, prefix):
    """Ids of the images of the second half of the drive."""
    names = images_of(connection, prefix)
    middle = sorted(frame_number(n) for n in names.values())[len(names) // 2]
    return {i for i, n in names.items() if frame_number(n) >= middle}


def turn(degrees):
    """Turns a pinhole camera about its vertical axis."""
    cosine, sine = math.cos(math.radians(degrees)), math.sin(
        math.radians(degrees))

    def move(camera, x, y):
        params = camera[2]
        # One focal length or two, then the principal point.
        f, (cx, cy) = params[0], params[1:3] if len(params) in (
            3, 5) else params[2:4]
        u, v = (x - cx) / f, (y - cy) / f
        z = cosine - sine * u
        return cx + f * (cosine * u + sine) / z, cy + f * v / z
    return move


def knock(degrees):
    """The second camera turns in the middle of the drive."""
    def change(connection):
        move_keypoints(connection, second_half(connection, "cam1/"),
                       turn(degrees))
    return change


def mirror(prefix):
    """Mirrored images of a camera."""
    def change(connection):
        move_keypoints(connection, set(images_of(connection, prefix)),
                       lambda camera, x, y: (camera[0] - x, y))
    return change


def resize(factor):
    """Images of another size than their camera."""
    def change(connection):
        move_keypoints(connection, set(images_of(connection, "cam1/")),
                       lambda _, x, y: (factor * x, factor * y))
    return change


def swap(connection):
    """Exchanges the images of two cameras in the second half."""
    late = second_half(connection, "")
    rename(connection, {
        i: ("cam1/" if name.startswith("cam0/") else "cam0/") + name[5:]
        for i, name in images_of(connection).items() if i in late})


def scale_trusted_focal_lengths(factor):
    """Wrong focal lengths that claim to be known."""
    def change(connection):
        for camera_id, model, blob in connection.execute(
                "SELECT camera_id, model, params FROM cameras").fetchall():
            layout = f"<{len(blob) // 8}d"
            params = list(struct.unpack(layout, blob))
            for i in FOCAL_LENGTHS[model]:
                params[i] *= factor
            connection.execute(
                "UPDATE cameras SET params = ?, prior_focal_length = 1 WHERE "
                "camera_id = ?", (struct.pack(layout, *params), camera_id))
        forget_geometry(connection, set(images_of(connection)))
    return change


def other_vehicle(connection):
    """The second camera drives the road in the opposite order."""
    right = sorted(images_of(connection, "cam1/").items(),
                   key=lambda item: item[1])
    names = [name for _, name in right]
    rename(connection, {i: name for (i, _), name in
                        zip(right, reversed(names))})


def jitter_names(connection):
    """Names are times that differ between the cameras."""
    rename(connection, {i: f"{name[:5]}{frame_number(name)}{1 + i % 7}.png"
                        for i, name in images_of(connection).items()})


def drop_pairs(connection):
    """Two thirds of the frames have no verified pair."""
    names = images_of(connection)
    late = {i for i, n in names.items() if frame_number(n) % 60 >= 20}
    for (pair,) in connection.execute(
            "SELECT pair_id FROM two_view_geometries").fetchall():
        if set(image_ids_of_pair(pair)) & late:
            connection.execute(
                "DELETE FROM two_view_geometries WHERE pair_id = ?", (pair,))


def ground_only(connection):
    """Keeps the keypoints in the lowest part of the images."""
    keep = {}
    for image_id, rows, cols, data in connection.execute(
            "SELECT image_id, rows, cols, data FROM keypoints").fetchall():
        (height,) = connection.execute(
            "SELECT height FROM cameras NATURAL JOIN images WHERE image_id = "
            "?", (image_id,)).fetchone()
        values = struct.unpack(f"<{rows * cols}f", data)
        keep[image_id] = {k for k in range(rows)
                          if values[k * cols + 1] > 0.75 * height}
    for pair, rows, data in connection.execute(
            "SELECT pair_id, rows, data FROM two_view_geometries").fetchall():
        a, b = image_ids_of_pair(pair)
        matches = [m for m in struct.iter_unpack("<2I", data or b"")
                   if m[0] in keep[a] and m[1] in keep[b]]
        connection.execute(
            "UPDATE two_view_geometries SET rows = ?, data = ? WHERE pair_id "
            "= ?", (len(matches), b"".join(struct.pack("<2I", *m)
                                           for m in matches), pair))
    forget_geometry(connection, set(keep))


def gps(positions):
    """positions(frame number) gives latitude, longitude and altitude."""
    def change(connection):
        connection.execute("DROP TABLE IF EXISTS pose_priors")
        connection.execute(
            "CREATE TABLE pose_priors (image_id INTEGER PRIMARY KEY NOT NULL, "
            "position BLOB, coordinate_system INTEGER NOT NULL, "
            "position_covariance BLOB)")
        for i, name in images_of(connection, "cam0/").items():
            connection.execute(
                "INSERT INTO pose_priors VALUES (?, ?, 0, NULL)",
                (i, struct.pack("<3d", *positions(frame_number(name)))))
    return change


def gravity_file(direction):
    """Lines of a file of gravity with one direction for all images."""
    def lines(connection):
        return "".join(f"{name} {direction}\n"
                       for name in images_of(connection).values())
    return lines


def turn_sensor(degrees):
    """Turns the second camera of a rig configuration about its z axis."""
    def change(config):
        half = math.radians(degrees) / 2
        camera = next(c for c in config[0]["cameras"]
                      if not c.get("ref_sensor"))
        w, x, y, z = camera["cam_from_rig_rotation"]
        c, s = math.cos(half), math.sin(half)
        camera["cam_from_rig_rotation"] = [
            c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w]
    return change


def nothing(connection):
    """Leaves the database unchanged."""


HEALTHY = Case("unchanged", nothing, ())
# Cases that make sense for any stereo drive with turns.
COMMON = (
    Case("camera lags by 1 frame", lag(1), ("camera_lag",)),
    Case("camera lags by 3 frames", lag(3), ("camera_lag",)),
    Case("rig knocked by 5 deg", knock(5), ("rig_moved",)),
    Case("rig knocked by 1 deg", knock(1), ("rig_moved",)),
    Case("focal lengths 30 % too long", scale_trusted_focal_lengths(1.3),
         ("wrong_focal_length",)),
    Case("focal lengths 30 % too short", scale_trusted_focal_lengths(0.7),
         ("wrong_focal_length",)),
    Case("mirrored camera", mirror("cam1/"), ("mirrored_camera",)),
    Case("smaller images", resize(0.5), ("wrong_image_size",)),
    Case("larger images", resize(2.0), ("wrong_image_size",)),
    # Cameras with different intrinsics are refused with an error.
    Case("cameras swapped in half", swap, ("swapped_cameras", "error")),
    Case("camera of another vehicle", other_vehicle, ("foreign_camera",)),
    Case("names differ between cameras", jitter_names, ("no_shared_frames",)),
    # Both are the warning that too few images are registered.
    Case("two thirds without pairs", drop_pairs,
         ("few_images_registered", "no_model")),
)
# Marks of cases that change a file beside the database.
GRAVITY = ("gravity",)
RIG = ("rig",)
SIMULATED = (
    HEALTHY, *COMMON,
    Case("ground only", ground_only,
         ("few_images_registered", "no_model", "lost_matches")),
    Case("half of the GPS fixes 0, 0",
         gps(lambda k: (49 + k * 1e-5, 8.4, 100.0) if k % 2 else (0, 0, 0)),
         ("outlier_position_priors",), ("--use_prior_position", "1")),
    Case("GPS of another place per frame",
         gps(lambda k: (49 + k * k % 7 * 1e-2, 8.4 + k * k % 5 * 1e-2, 100.0)),
         ("rejected_position_priors", "outlier_position_priors"),
         ("--use_prior_position", "1")),
    Case("known rotation true", turn_sensor(0), (), RIG),
    Case("known rotation wrong by 5 deg", turn_sensor(5),
         ("wrong_known_rotation",), RIG),
    Case("constant wrong gravity", gravity_file("0 0 1"),
         ("rejected_gravity_priors", "outlier_gravity_priors"), GRAVITY),
)


# --- Runs ---


def add_parser(subparsers):
    """The subcommand inconsistent_input."""
    parser = options.add_command(
        subparsers, "inconsistent_input", run,
        "whether the mapper names what is wrong with its input", DESCRIPTION)
    options.add_program(parser)
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/inconsistent_input",
                        help="folder of databases and results")
    parser.add_argument("--data", type=pathlib.Path, default=None,
                        help="folder with kitti06_stereo and "
                        "euroc_v101_stereo; without it, simulated drives only")
    parser.add_argument("--cases", default="",
                        help="only cases whose name contains this text")


def simulate(program, folder, seed):
    """A database of a winding stereo drive in a street, and its truth."""
    if not (folder / "database.db").exists():
        subprocess.run(
            [program, "simulate", "--preset", "standard", "--rig", "stereo",
             "--path", "curve", "--num_frames", "60", "--max_num_features",
             "400", "--random_seed", str(seed), "--extrinsics_are_known", "0",
             "--output_path", str(folder), "--log_level", "warning"],
            check=True)
    return folder / "database.db"


def run_case(program, case, source, folder, truth):
    """Runs the mapper on the changed database. Returns a row of the table."""
    folder.mkdir(parents=True, exist_ok=True)
    database = folder / "database.db"
    arguments = prepare(case, source, database)
    with open(folder / "mapper.log", "w") as log:
        subprocess.run([program, "mapper", "--database_path", str(database),
                        "--output_path", str(folder / "sparse"),
                        "--num_threads", "1", *arguments],
                       stderr=log, check=False)
    warnings, registered, error = [], "failed", None
    report = folder / "sparse/report.json"
    if report.exists():
        content = json.loads(report.read_text())
        warnings = content["warnings"]
        registered = "{num_registered_images} of {num_images}".format(
            **content["summary"])
        error = error_of(program, folder, truth)
    else:
        warnings = [{"cause": "error",
                     "text": (folder / "mapper.log").read_text()
                     .strip().splitlines()[-1]}]
    return case.name, registered, error, judge(case, warnings, error), warnings


def prepare(case, source, database):
    """Writes the changed database. Returns arguments of the mapper."""
    folder = database.parent
    if case.mapper is GRAVITY:
        with sqlite3.connect(source) as connection:
            (folder / "gravity.txt").write_text(case.change(connection))
        shutil.copy(source, database)
        return ["--gravity_path", str(folder / "gravity.txt")]
    if case.mapper is RIG:
        config = json.loads((folder.parent / name_of(HEALTHY) /
                             "sparse/0/rig_config.json").read_text())
        case.change(config)
        (folder / "rig_config.json").write_text(json.dumps(config))
        shutil.copy(source, database)
        return ["--rig_config_path", str(folder / "rig_config.json")]
    with changed_copy(source, database) as connection:
        case.change(connection)
    return list(case.mapper)


def name_of(case):
    """The name of the folder of a case."""
    return case.name.replace("%", "percent").replace(",", "").replace(" ", "_")


def error_of(program, folder, truth):
    """Mean position and rotation errors, if the truth is known."""
    if not truth or not (folder / "sparse/0").exists():
        return None
    run_ = subprocess.run(
        [program, "model_evaluator", "--input_path", str(folder / "sparse/0"),
         "--gt_path", str(truth), "--json",
         str(folder / "evaluation.json")],
        capture_output=True, text=True, check=False)
    if run_.returncode != 0:
        return None
    content = json.loads((folder / "evaluation.json").read_text())
    if not content["position_m"] or not content["rotation_deg"]:
        return None  # too few images
    return (content["position_m"]["mean"], content["rotation_deg"]["mean"])


def judge(case, warnings, error):
    """A word on one case."""
    causes = [w["cause"] for w in warnings]
    if not case.causes:
        return "no warning" if not causes else "FALSE ALARM"
    if set(causes) & set(case.causes):
        others = set(causes) - set(case.causes)
        return "named" if not others else "named, and others"
    if error and error[0] < MAX_POSITION_M and error[1] < MAX_ROTATION_DEG:
        return "correct"
    return "OTHER CAUSE" if causes else "SILENT"


def print_rows(title, rows):
    """A table in Markdown."""
    print(f"\n### {title}\n\n| case | images | error | verdict | warnings |\n"
          "|---|---|---|---|---|")
    for name, registered, error, verdict, warnings in rows:
        numbers = f"{error[0]:.3g} m, {error[1]:.3g} deg" if error else ""
        texts = "; ".join(f"{w['cause']}: {w['text']}" for w in warnings)
        print(f"| {name} | {registered} | {numbers} | {verdict} | {texts} |",
              flush=True)


def run(arguments):
    """Runs all cases of all sources."""
    program = options.find_program(arguments.program)
    output = arguments.output.resolve()
    sources = [("simulated", simulate(program, output / "drive", 0),
                output / "drive/truth", SIMULATED)]
    if arguments.data:
        sources += [
            (name, arguments.data / name / "database.db", None,
             (HEALTHY, *COMMON))
            for name in ("kitti06_stereo", "euroc_v101_stereo")]
    for title, database, truth, cases in sources:
        rows = [run_case(program, case, database,
                         output / title / name_of(case), truth)
                for case in cases if arguments.cases in case.name]
        print_rows(title, rows)
