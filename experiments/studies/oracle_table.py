# SPDX-License-Identifier: BSD-3-Clause
"""Accuracy against the oracles, along recorded trajectories."""
import pathlib

from experiments import options, tables
from experiments.studies import oracle_runs

RIGS = ("stereo", "kitti360")
# Largest accepted ratios to the oracle and to the full oracle, by preset. On
# all but standard drives the aim is a model that is not folded.
MAX_RATIOS = {"standard": (1.1, 1.3), "aliased": (1.5, 1.5),
              "moderate": (1.5, 1.5), "hard": (1.5, 1.5)}
HEADER = ["run", "registered", "position, mean", "oracle", "ratio",
          "full oracle", "ratio", "rotation, mean", "rig, worst", "mapper",
          "peak memory"]
DESCRIPTION = """\
Simulates drives along TRAJECTORIES/*.txt (poses in KITTI's format) with the
rigs stereo and kitti360, maps them, and compares with the oracles of
bench/oracle/oracle.h. Prints the table of docs/results/accuracy.md; ratios
beyond the aim are bold. Finished runs in the output folder are reused.

  python3 -m experiments oracle_table TRAJECTORIES --setting aliased"""


def add_parser(subparsers):
    """The subcommand oracle_table."""
    parser = options.add_command(
        subparsers, "oracle_table", run,
        "compare the mapper with the best that its input allows", DESCRIPTION)
    parser.add_argument("trajectories", type=pathlib.Path,
                        help="folder of *.txt with poses")
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/oracle",
                        help="folder of results; finished runs are reused")
    parser.add_argument("--setting", choices=list(MAX_RATIOS),
                        default="standard", help="preset of mgsfm simulate")
    parser.add_argument("--random_seed", type=int, default=0,
                        help="of the simulation")
    parser.add_argument("--frame_step", type=options.positive(int), default=2,
                        help="use every n-th pose")
    options.add_program(parser, options.ORACLE_BENCHMARK)


def run(arguments):
    """Runs what is missing, and prints the table."""
    program = options.find_program(arguments.program)
    output = arguments.output / arguments.setting
    if arguments.random_seed:
        output = output / str(arguments.random_seed)
    output.mkdir(parents=True, exist_ok=True)
    trajectories = sorted(arguments.trajectories.glob("*.txt"))
    if not trajectories:
        raise SystemExit(f"no trajectory in {arguments.trajectories}")
    for trajectory in trajectories:
        for rig in RIGS:
            oracle_runs.run_once(
                program, output / f"{trajectory.stem}_{rig}.json",
                f"{trajectory.stem} {rig}",
                ["--preset", arguments.setting, "--trajectory_path", trajectory,
                 "--Simulation.rig", rig, "--Simulation.frame_step",
                 arguments.frame_step, "--random_seed",
                 arguments.random_seed])
    print(report(oracle_runs.read_runs(output),
                 *MAX_RATIOS[arguments.setting]), end="")


def report(runs, max_oracle_ratio, max_full_oracle_ratio):
    """The table in Markdown, and how many runs are within the ratios."""
    rows = [row(r, max_oracle_ratio, max_full_oracle_ratio) for r in runs]
    num_good = sum(is_within(r, max_oracle_ratio, max_full_oracle_ratio)
                   for r in runs)
    return (tables.markdown_table(HEADER, rows)
            + f"\n{num_good} of {len(runs)} runs registered all images with "
            f"ratios of at most {max_oracle_ratio:g} and "
            f"{max_full_oracle_ratio:g}.\n")


def row(run_, max_oracle_ratio, max_full_oracle_ratio):
    """The cells of a run; empty ones if there is no model."""
    values = run_.values
    start = [run_.name, bold_if(
        run_.num_registered < run_.num_images,
        f"{run_.num_registered} of {run_.num_images}")]
    end = [f"{values['seconds']['mapper']:.0f} s",
           f"{values['peak_memory_mib']:.0f} MiB"]
    if not run_.has_model:
        return [*start, *[""] * (len(HEADER) - 4), *end]
    ratio, full_ratio = values["oracle_ratio"], values["full_oracle_ratio"]
    return [
        *start, f"{run_.mean_error('mapper', 'position_m'):.4f} m",
        f"{run_.mean_error('oracle', 'position_m'):.4f} m",
        bold_if(ratio > max_oracle_ratio, f"{ratio:.3f}"),
        f"{run_.mean_error('full_oracle', 'position_m'):.4f} m",
        bold_if(full_ratio > max_full_oracle_ratio, f"{full_ratio:.3f}"),
        f"{run_.mean_error('mapper', 'rotation_deg'):.4f} deg",
        rig_cell(values["mapper"]["rig"]), *end]


def bold_if(is_bold, text):
    """Bold text in Markdown."""
    return f"**{text}**" if is_bold else text


def rig_cell(sensors):
    """The largest errors of sensor_from_rig."""
    rotation_deg = max([s.get("rotation_deg", 0.0) for s in sensors],
                       default=0.0)
    position_m = max([s.get("position_m", 0.0) for s in sensors], default=0.0)
    return f"{rotation_deg:.4f} deg, {position_m:.4f} m"


def is_within(run_, max_oracle_ratio, max_full_oracle_ratio):
    """True if all images are registered and the ratios meet the aim."""
    return (run_.has_model and run_.num_registered == run_.num_images
            and run_.values["oracle_ratio"] <= max_oracle_ratio
            and run_.values["full_oracle_ratio"] <= max_full_oracle_ratio)
