# SPDX-License-Identifier: BSD-3-Clause
"""The mapper in simulated worlds off the street."""
import json
import math
import pathlib
import shlex
import tempfile

from experiments import (alignment, colmap_model, measure, options, records,
                         tables)
from experiments.studies import hard_evaluation

WORLDS = ("handheld,stairs,elevator,robot,drone,dome,turntable,square,head360,"
          "corridor,sessions,boat,train,crane,two_rigs,pedestrians,pole360,"
          "bridge")
DESCRIPTION = """\
Simulates worlds off the street, maps them with sets of options, and reports
registered images, errors relative to the extent of the true path (each model is
aligned on its own), false seams, warnings, and rejected right pairs.

  python3 -m experiments worlds --sets \\
      'default=;off=--PairFiltering.use_motion_continuity 0'"""


def add_parser(subparsers):
    """The subcommand worlds."""
    parser = options.add_command(subparsers, "worlds", run,
                                 "the mapper off the street", DESCRIPTION)
    for option, default in (("worlds", WORLDS), ("seeds", "1,2,3"),
                            ("levels", "mild,medium"), ("rates", "10")):
        parser.add_argument(f"--{option}", default=default,
                            help="separated by commas")
    parser.add_argument("--sets", default="default=",
                        help="NAME=OPTIONS of mgsfm mapper, separated by ;")
    options.add_study(parser, "worlds")


def run(arguments):
    """Maps all combinations, and writes worlds.json and worlds.md."""
    arguments.program = options.find_program(arguments.program)
    arguments.output.mkdir(parents=True, exist_ok=True)
    sets = [entry.partition("=")[::2] for entry in arguments.sets.split(";")]
    rows = []
    for world in options.words_of(arguments.worlds):
        for level in options.words_of(arguments.levels):
            for rate in options.words_of(arguments.rates):
                for seed in options.words_of(arguments.seeds):
                    rows += run_world(
                        arguments, sets,
                        {"world": world, "level": level, "rate": rate,
                         "seed": seed})
    records.write_json(arguments.output / "worlds.json", rows)
    text = table_of(rows)
    (arguments.output / "worlds.md").write_text(text)
    print(text, end="")


def run_world(arguments, sets, key):
    """The rows of one world, one for each set of options."""
    common = ["--log_level", "warning", "--num_threads", arguments.threads]
    rows = []
    with tempfile.TemporaryDirectory(dir=arguments.output) as folder:
        scratch = pathlib.Path(folder)
        measure.run_step(
            [arguments.program, "simulate", "--output_path", scratch / "world",
             "--world", key["world"], "--level", key["level"], "--frame_rate",
             key["rate"], "--random_seed", key["seed"],
             *shlex.split(arguments.simulate_options), *common],
            scratch / "log")
        for name, words in sets:
            costs = measure.run_logged(
                [arguments.program, "mapper", "--database_path",
                 scratch / "world/database.db", "--output_path",
                 scratch / name, *common, *shlex.split(words)],
                scratch / "log")
            row = {**key, "set": name, "exit_code": costs["exit_code"],
                   "processor_s": costs["processor_seconds"]}
            if costs["exit_code"] == 0:
                row.update(evaluate(scratch / name, scratch / "world/truth"))
            rows.append(row)
            print(" | ".join(cells_of(row)), flush=True)
    return rows


def evaluate(run_folder, truth_folder):
    """Registered images, errors, seams, warnings and rejected pairs."""
    report = json.loads((run_folder / "report.json").read_text())
    truth = {name: alignment.pose_of(*pose) for name, pose in
             colmap_model.read_poses(truth_folder).items()}
    folders = [run_folder / str(i) for i in range(len(report["models"]))]
    sizes = [len(colmap_model.read_poses(folder)) for folder in folders]
    centers = [center for _, center in truth.values()]
    extent = math.dist([min(axis) for axis in zip(*centers)],
                       [max(axis) for axis in zip(*centers)])
    row = hard_evaluation.evaluate(report, folders, truth)
    return {"images": len(truth), "largest": max(sizes, default=0),
            "models": len(sizes), "registered": sum(sizes),
            "error": row.get("mean_m", math.nan) / extent,
            "misplaced": row["num_misplaced"],
            "false_seams": row["num_false_seams"],
            "warnings": report["warnings"],
            "rejected": {name: number for name, number in
                         report["rejected_pairs"].items() if number}}


def cells_of(row):
    """The cells of a row of the table."""
    cells = [row["world"], row["level"], row["rate"], row["seed"], row["set"]]
    if row["exit_code"] != 0:
        return cells + ["no model"] + ["-"] * 7 + [f"{row['processor_s']:.0f}"]
    rejected = ", ".join(f"{name} {number}" for name, number in
                         row["rejected"].items())
    return cells + [
        str(row["images"]), str(row["largest"]), str(row["models"]),
        str(row["registered"]), f"{100.0 * row['error']:.3f} %",
        str(row["false_seams"]), str(len(row["warnings"])), rejected or "none",
        f"{row['processor_s']:.0f}"]


def table_of(rows):
    """A Markdown table of all rows."""
    return tables.markdown_table(
        ["world", "level", "Hz", "seed", "options", "images", "largest model",
         "models", "registered", "error / extent", "false seams", "warnings",
         "rejected pairs", "processor s"], [cells_of(row) for row in rows])
