# SPDX-License-Identifier: BSD-3-Clause
"""Lenses of which nothing is known, in simulated worlds."""
import dataclasses
import json
import math
import pathlib
import random
import statistics
import struct
import tempfile

from experiments import (colmap_database, measure, options, records, tables)
from experiments.studies import worlds

WIDTH, HEIGHT = 1280, 800
# Principal points are off by 3 % of the width.
MARGIN = 0.06
# The fields of view that automatic_reconstructor tries for fisheyes.
FISHEYE_GUESSES_DEG = (120, 145, 170, 195, 220)
# Angles of the cameras of a rig about its vertical axis.
RIGS = {"mono": (0,), "stereo": (0, 0), "around": (0, 60, -60)}
DESCRIPTION = """\
Simulates rigs of mixed lenses between 60 and 190 degrees, forgets their
intrinsics, and maps the drives. Reports the errors of focal lengths, how many
are within two stated standard deviations, and which cameras are wrong by over
5 % though the mapper claims to know them. Positions are compared with those by
true lenses.

  python3 -m experiments lenses --worlds handheld,drone --rigs stereo"""


@dataclasses.dataclass(frozen=True)
class Lens:
    """A field of view across the width, and radial parameters."""
    name: str
    fov_deg: float
    radial: tuple

    @property
    def is_fisheye(self):
        """Whether radii follow angles instead of their tangents."""
        return self.name == "fisheye"

    def focal_length_px(self):
        """The focal length for which the images have the field of view."""
        half = math.radians(self.fov_deg / 2)
        radius = half if self.is_fisheye else math.tan(half)
        distorted = radius * (1 + sum(
            k * radius ** (2 * i) for i, k in enumerate(self.radial, 1)))
        return WIDTH / 2 / distorted

    def model_and_params(self):
        """The true camera model of COLMAP."""
        f = self.focal_length_px()
        center = [WIDTH / 2, HEIGHT / 2]
        if self.is_fisheye:
            return "OPENCV_FISHEYE", [f, f, *center, *self.radial, 0.0, 0.0]
        return "RADIAL", [f, *center, *self.radial]

    def guess(self):
        """Number of the model and parameters that are assumed at first."""
        width = WIDTH * (1 + MARGIN)
        center = [width / 2, HEIGHT / 2]
        if not self.is_fisheye:
            return 2, [1.2 * width, *center, 0.0]
        fov_deg = min(FISHEYE_GUESSES_DEG,
                      key=lambda angle: abs(angle - self.fov_deg))
        f = WIDTH / math.radians(fov_deg)
        return 5, [f, f, *center, 0.0, 0.0, 0.0, 0.0]


LENSES = (
    Lens("plain", 60, (0.0, 0.0)), Lens("plain", 75, (0.0, 0.0)),
    Lens("plain", 90, (0.0, 0.0)), Lens("barrel", 60, (-0.2, 0.05)),
    Lens("barrel", 90, (-0.28, 0.07)), Lens("barrel", 110, (-0.25, 0.05)),
    Lens("pincushion", 60, (0.1, 0.0)), Lens("pincushion", 80, (0.05, 0.02)),
    Lens("fisheye", 120, (0.02, -0.005)), Lens("fisheye", 150, (-0.02, 0.002)),
    Lens("fisheye", 180, (0.03, -0.006)), Lens("fisheye", 190, (0.0, 0.0)))


def add_parser(subparsers):
    """The subcommand lenses."""
    parser = options.add_command(subparsers, "lenses", run,
                                 "unknown lenses", DESCRIPTION)
    for option, default in (("worlds", "handheld,stairs,drone,robot"),
                            ("rigs", ",".join(RIGS)), ("seeds", "1,2,3,4")):
        parser.add_argument(f"--{option}", default=default,
                            help="separated by commas")
    parser.add_argument("--num_frames", type=options.positive(int), default=100)
    parser.add_argument("--frame_rate", type=options.positive(float),
                        default=5.0)
    options.add_study(parser, "lenses")


def run(arguments):
    """Maps all combinations, and writes lenses.json and lenses.md."""
    arguments.program = options.find_program(arguments.program)
    arguments.output.mkdir(parents=True, exist_ok=True)
    rows = []
    for world in options.words_of(arguments.worlds):
        for rig in options.words_of(arguments.rigs):
            for seed in options.words_of(arguments.seeds):
                case = run_case(arguments, world, rig, seed)
                rows += case
                for row in case:
                    print(" | ".join(cells_of(row)), flush=True)
    records.write_json(arguments.output / "lenses.json", rows)
    text = table_of(rows) + "\n" + summary_of(rows)
    (arguments.output / "lenses.md").write_text(text)
    print(summary_of(rows), end="")


def lenses_of(world, rig, seed):
    """Different lenses for each rig, the same in every run."""
    return random.Random(f"{world} {rig} {seed}").sample(
        LENSES, len(RIGS[rig]))


def rig_config(rig, lenses):
    """The rig in COLMAP's format."""
    cameras = []
    for i, (angle_deg, lens) in enumerate(zip(RIGS[rig], lenses)):
        model, params = lens.model_and_params()
        half = math.radians(angle_deg / 2)
        camera = {"image_prefix": f"cam{i}/", "camera_model_name": model,
                  "camera_params": params}
        if i == 0:
            camera["ref_sensor"] = True
        else:
            camera["cam_from_rig_rotation"] = [math.cos(half), 0,
                                               math.sin(half), 0]
            camera["cam_from_rig_translation"] = [0.3 * i, 0, 0]
        cameras.append(camera)
    return [{"cameras": cameras}]


def forget(source, target, lenses):
    """Copies a database without relative poses, and without the intrinsics of
    `lenses`. Returns the ids of the cameras."""
    with colmap_database.changed_copy(source, target) as connection:
        ids = [i for (i,) in connection.execute(
            "SELECT camera_id FROM cameras ORDER BY camera_id")]
        for camera_id, lens in zip(ids, lenses):
            model, params = lens.guess()
            connection.execute(
                "UPDATE cameras SET model = ?, width = ?, params = ?, "
                "prior_focal_length = 0 WHERE camera_id = ?",
                (model, round(WIDTH * (1 + MARGIN)),
                 struct.pack(f"<{len(params)}d", *params), camera_id))
        connection.execute(
            "UPDATE two_view_geometries SET config = 3, F = NULL, E = NULL, "
            "H = NULL, qvec = NULL, tvec = NULL")
    return ids


def run_case(arguments, world, rig, seed):
    """One row for each camera."""
    lenses = lenses_of(world, rig, seed)
    common = ["--log_level", "warning", "--num_threads", arguments.threads]
    with tempfile.TemporaryDirectory(dir=arguments.output) as folder:
        scratch = pathlib.Path(folder)
        records.write_json(scratch / "rig.json", rig_config(rig, lenses))
        measure.run_step(
            [arguments.program, "simulate", "--output_path", scratch / "world",
             "--world", world, "--rig_config_path", scratch / "rig.json",
             "--num_frames", arguments.num_frames, "--frame_rate",
             arguments.frame_rate, "--random_seed", seed,
             *arguments.simulate_options.split(), *common], scratch / "log")
        database = scratch / "world/database.db"
        costs, errors, report = {}, {}, None
        for name, forgotten in (("true", ()), ("unknown", lenses)):
            ids = forget(database, scratch / f"{name}.db", forgotten)
            costs[name] = measure.run_logged(
                [arguments.program, "mapper", "--database_path",
                 scratch / f"{name}.db", "--output_path", scratch / name,
                 *common], scratch / "log")
            if costs[name]["exit_code"] == 0:
                errors[name] = worlds.evaluate(
                    scratch / name, scratch / "world/truth")["error"]
        if "unknown" in errors:
            report = json.loads((scratch / "unknown/report.json").read_text())
    ratio = (errors["unknown"] / errors["true"]
             if len(errors) == 2 and errors["true"] > 0 else None)
    times = [cost["processor_seconds"] for cost in costs.values()]
    return [{"world": world, "rig": rig, "seed": seed,
             "lens": f"{lens.name} {lens.fov_deg}",
             "error_ratio": ratio, "time_ratio": times[1] / times[0],
             **focal_length_row(report, camera_id, lens)}
            for camera_id, lens in zip(ids, lenses)]


def focal_length_row(report, camera_id, lens):
    """The estimate of the largest model next to the truth."""
    found = [entry for entry in (report or {"models": []})["models"][:1]
             for entry in entry["lenses"] if entry["camera_id"] == camera_id]
    if not found:
        return {"error": None, "sigma": None, "source": "no model"}
    return {"error": found[0]["focal_length_px"] / lens.focal_length_px() - 1,
            "sigma": found[0]["relative_sigma"], "source": found[0]["source"]}


def cells_of(row):
    """The cells of a row of the table."""
    def percent(value):
        return "-" if value is None else f"{100 * value:.2f} %"
    ratio = row["error_ratio"]
    return [row["world"], row["rig"], row["seed"], row["lens"],
            percent(row["error"]), percent(row["sigma"]), row["source"],
            "-" if ratio is None else f"{ratio:.2f}",
            f"{row['time_ratio']:.1f}"]


def table_of(rows):
    """A Markdown table of all rows."""
    return tables.markdown_table(
        ["world", "rig", "seed", "lens", "error of the focal length",
         "stated deviation", "source", "position error / with true lenses",
         "time / with true lenses"], [cells_of(row) for row in rows])


def summary_of(rows):
    """Coverage, median error and false claims, in words."""
    known = [row for row in rows if row["error"] is not None]
    if not known:
        return f"0 of {len(rows)} cameras have a model.\n"
    errors = [abs(row["error"]) for row in known]
    covered = sum(row["sigma"] is not None
                  and abs(row["error"]) <= 2 * row["sigma"] for row in known)
    claims = sum(abs(row["error"]) > 0.05 and row["source"] == "adjustment"
                 for row in known)
    return (f"{len(known)} of {len(rows)} cameras have a model; median error "
            f"{100 * statistics.median(errors):.2f} %; {covered} within two "
            f"standard deviations; {claims} wrong by over 5 % and claimed to "
            "be known.\n")
