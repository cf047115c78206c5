# SPDX-License-Identifier: BSD-3-Clause
"""Gross failures of the mapper on hard simulated drives, and its seams."""
import concurrent.futures
import csv
import dataclasses
import json
import pathlib
import shlex
import tempfile

from experiments import (alignment, colmap_model, measure, options, records,
                         tables)
from experiments.studies import hard_evaluation, seam_reliability

PRESETS = "moderate,hard"
RIGS = "stereo,kitti360"
DESCRIPTION = """\
Simulates drives along the trajectories of KITTI, maps them, and reports gross
failures (a mean error above 1 m, or a frame off by more than 5 m or 5 degrees),
which share of the misplaced frames lies beyond a seam that the report names,
false seams, how well the standard deviations of seams predict errors, and the
cost. Options behind -- go to mgsfm mapper. Finished drives
are kept; their databases and models are removed.

  python3 -m experiments hard_drives DATA --sequences 03,04 --seeds 1,2,3 \\
      [-- OPTIONS of mgsfm mapper]

DATA contains 00.txt, ... in KITTI's format."""


@dataclasses.dataclass(frozen=True)
class Drive:
    """One simulated drive."""

    preset: str
    trajectory: str
    rig: str
    seed: int

    @property
    def name(self):
        """A file name, which sorts drives by preset and trajectory."""
        return f"{self.preset}_{self.trajectory}_{self.rig}_{self.seed}"


def add_parser(subparsers):
    """The subcommand hard_drives."""
    parser = options.add_command(
        subparsers, "hard_drives", run,
        "gross failures and seams on hard simulated drives", DESCRIPTION)
    parser.set_defaults(takes_passed_on=True)
    add_drive_options(parser)
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/hard_drives",
                        help="folder of results; finished drives are reused")
    options.add_threads(parser, 1)
    options.add_program(parser)


def add_drive_options(parser):
    """Which drives to simulate, and how many at the same time."""
    parser.add_argument("data", type=pathlib.Path,
                        help="folder of trajectories")
    for option, default in (("sequences", ""), ("presets", PRESETS),
                            ("rigs", RIGS), ("seeds", "1,2,3")):
        parser.add_argument(f"--{option}", default=default,
                            help="separated by commas"
                            + ("" if default else "; all if empty"))
    parser.add_argument("--frame_step", type=options.positive(int), default=3,
                        help="use every n-th pose")
    parser.add_argument("--simulate_options", default="",
                        help="further options of mgsfm simulate, in one word")
    parser.add_argument("--jobs", type=options.positive(int), default=1,
                        help="drives at the same time")


def run(arguments):
    """Runs what is missing, and writes drives.csv and drives.md."""
    arguments.program = options.find_program(arguments.program)
    arguments.output.mkdir(parents=True, exist_ok=True)
    rows = run_drives(arguments, run_drive)
    write_csv(arguments.output / "drives.csv", rows)
    text = "\n".join([summary_table(rows), failures_table(rows),
                      seam_reliability.reliability_table(rows)])
    (arguments.output / "drives.md").write_text(text)
    print(text, end="")


def run_drives(arguments, run_one):
    """The rows run_one(arguments, drive) of all drives. After a failure, no
    other drive starts."""
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        running = [pool.submit(run_one, arguments, drive)
                   for drive in list_drives(arguments)]
        try:
            return [one.result() for one in running]
        finally:
            for one in running:
                one.cancel()


def list_drives(arguments):
    """All combinations, ordered by trajectory, so that presets compare early."""
    sequences = options.words_of(arguments.sequences) or sorted(
        path.stem for path in arguments.data.glob("*.txt"))
    for sequence in sequences:
        if not (arguments.data / f"{sequence}.txt").exists():
            raise SystemExit(f"no trajectory {arguments.data}/{sequence}.txt")
    return [Drive(preset, sequence, rig, int(seed))
            for seed in options.words_of(arguments.seeds)
            for sequence in sequences
            for rig in options.words_of(arguments.rigs)
            for preset in options.words_of(arguments.presets)]


def run_drive(arguments, drive):
    """The row of a drive, from its file if it is finished."""
    path = arguments.output / f"{drive.name}.json"
    commands = [shlex.join(map(str, words)) for words in
                (simulate_words(arguments, drive), arguments.passed_on)]
    if path.exists():
        row = json.loads(path.read_text())
        if row["commands"] != commands:
            raise SystemExit(f"{path} has other options; choose another "
                             "--output")
        return row
    with tempfile.TemporaryDirectory(dir=arguments.output) as scratch:
        row = {**dataclasses.asdict(drive), "name": drive.name,
               **map_drive(arguments, drive, pathlib.Path(scratch)),
               "commands": commands}
    records.write_json(path, row)
    print(line_of(row), flush=True)
    return row


def simulate_words(arguments, drive):
    """The options of mgsfm simulate that define a drive."""
    return ["--preset", drive.preset, "--rig", drive.rig, "--frame_step",
            arguments.frame_step, "--random_seed", drive.seed,
            "--trajectory_path", arguments.data / f"{drive.trajectory}.txt",
            *shlex.split(arguments.simulate_options)]


def map_drive(arguments, drive, scratch):
    """Simulates and maps a drive; returns its errors and costs."""
    common = ["--log_level", "warning", "--num_threads", arguments.threads]
    measure.run_step(
        [arguments.program, "simulate", "--output_path", scratch / "drive",
         *simulate_words(arguments, drive), *common], scratch / "log")
    costs = measure.run_logged(
        [arguments.program, "mapper", "--database_path",
         scratch / "drive/database.db", "--output_path", scratch / "sparse",
         *common, *arguments.passed_on], scratch / "log")
    if costs["exit_code"] not in records.RESULTS:
        raise SystemExit(f"{drive.name}: {measure.last_line(scratch / 'log')}")
    if costs["exit_code"] == 0:
        row = evaluate(scratch / "sparse", scratch / "drive/truth")
    else:
        row = hard_evaluation.summarize([], 0)
    return {**row, "processor_s": costs["processor_seconds"]}


def evaluate(run_folder, truth_folder):
    """The row of a drive: each model is aligned on its own."""
    report = json.loads((run_folder / "report.json").read_text())
    truth = {name: alignment.pose_of(*pose) for name, pose in
             colmap_model.read_poses(truth_folder).items()}
    folders = [run_folder / str(i) for i in range(len(report["models"]))]
    row = hard_evaluation.evaluate(report, folders, truth)
    row["seam_errors"] = [
        entry for model, folder in zip(report["models"], folders)
        for entry in seam_reliability.evaluate_seams(model, folder, truth)]
    return row


def line_of(row):
    """One line on a finished drive."""
    error = (f"{row['mean_m']:8.3f} m {row['median_m']:8.3f} m"
             if "mean_m" in row else "no model")
    gross = (f"  GROSS, {row['num_misplaced']} misplaced, "
             f"{row['num_silent']} silent" if row["is_gross"] else "")
    return (f"{row['name']:28} {error} {row['num_models']} models "
            f"{row['num_seams']} seams {row['processor_s']:.0f} s{gross}")


def write_csv(path, rows):
    """One row for each drive."""
    names = ["name", "preset", "trajectory", "rig", "seed", "num_frames",
             "num_placed", "num_models", "mean_m", "median_m", "max_m",
             "max_deg", "is_gross", "num_misplaced", "num_silent", "num_seams",
             "num_false_seams", "processor_s"]
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, names, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def summary_table(rows):
    """A Markdown table with one row for each preset and rig."""
    groups = {}
    for row in rows:
        groups.setdefault((row["preset"], row["rig"]), []).append(row)
    cells = []
    for (preset, rig), members in sorted(groups.items()):
        def total(key, members=members):
            return sum(row[key] for row in members)
        misplaced, placed = total("num_misplaced"), total("num_placed")
        named = 1.0 - total("num_silent") / misplaced if misplaced else 1.0
        false = 1000.0 * total("num_false_seams") / max(1, placed)
        cells.append([
            preset, rig, str(len(members)), str(total("is_gross")),
            str(misplaced), f"{100.0 * named:.1f} %",
            str(total("num_seams")), f"{false:.2f}",
            f"{total('processor_s'):.0f} s"])
    return tables.markdown_table(
        ["preset", "rig", "drives", "gross failures", "misplaced frames",
         "beyond a named seam", "seams", "false seams per 1,000 frames",
         "processor time"], cells)


def failures_table(rows):
    """A Markdown table of the gross failures."""
    cells = [[row["name"],
              f"{row['mean_m']:.2f} m" if "mean_m" in row else "no model",
              f"{row['median_m']:.2f} m" if "median_m" in row else "-",
              f"{row['max_deg']:.1f} deg" if "max_deg" in row else "-",
              str(row["num_models"]), str(row["num_misplaced"]),
              str(row["num_silent"]), str(row["num_seams"])]
             for row in rows if row["is_gross"]]
    return tables.markdown_table(
        ["gross failure", "mean", "median", "worst rotation", "models",
         "misplaced", "silent", "seams"], cells)
