# SPDX-License-Identifier: BSD-3-Clause
"""Error and registered share against one setting of the simulation."""
import dataclasses
import pathlib
import statistics

from experiments import options, requirements
from experiments.studies import oracle_runs

RIGS = ("stereo", "kitti360")
SEEDS = (1, 2, 3)


@dataclasses.dataclass(frozen=True)
class Sweep:
    """The values of one option of the simulation, and the axis of its figure.

    x_factor converts the option to the unit of x_label.
    """

    option: str
    x_label: str
    x_factor: float
    title: str
    values: tuple


SWEEPS = {sweep.option: sweep for sweep in (
    Sweep("mismatch_ratio", "mismatches before verification, %", 100,
          "Mismatches", (0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)),
    Sweep("isolated_wrong_pair_ratio", "wrong image pairs, %", 100,
          "Wrong pairs", (0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3)),
    Sweep("missing_image_ratio", "missing images, %", 100, "Missing images",
          (0, 0.1, 0.2, 0.3, 0.4, 0.5)),
    Sweep("trigger_jitter", "largest trigger jitter, ms", 1,
          "Trigger jitter at 10 m/s", (0, 10, 20, 30, 40, 50)),
)}
DESCRIPTION = """\
Error and registered share of the mapper against the share of mismatches, wrong
pairs and missing images, and against trigger jitter, on simulated drives of 60
frames. Draws the figures of docs/results/accuracy.md. Finished runs in the
output folder are reused.

  python3 -m experiments robustness --sweeps mismatch_ratio,trigger_jitter"""


def add_parser(subparsers):
    """The subcommand robustness."""
    parser = options.add_command(
        subparsers, "robustness", run,
        "error over mismatches, wrong pairs, missing images, trigger jitter",
        DESCRIPTION)
    parser.add_argument("--sweeps", default="", help="separated by commas, of "
                        + ", ".join(SWEEPS) + "; all if empty")
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/robustness",
                        help="folder of results; finished runs are reused")
    parser.add_argument("--pictures", type=pathlib.Path,
                        default=options.REPOSITORY / "docs/pictures",
                        help="folder of the figures")
    options.add_program(parser, options.ORACLE_BENCHMARK)


def run(arguments):
    """Runs what is missing, and draws one figure for each sweep."""
    requirements.require("matplotlib", "figures")
    names = options.words_of(arguments.sweeps) or list(SWEEPS)
    for name in names:
        if name not in SWEEPS:
            raise SystemExit(f"unknown sweep '{name}'; there are "
                             + ", ".join(SWEEPS))
    program = options.find_program(arguments.program)
    from experiments.figures import robustness
    arguments.pictures.mkdir(parents=True, exist_ok=True)
    for name in names:
        run_sweep(program, SWEEPS[name], arguments.output / name)
        runs = oracle_runs.read_runs(arguments.output / name)
        path = arguments.pictures / f"{name}.svg"
        robustness.draw(make_curves(runs, SWEEPS[name]), SWEEPS[name], path)
        print(f"wrote {path}", flush=True)


def run_sweep(program, sweep, output):
    """Runs all rigs, values and seeds of a sweep."""
    output.mkdir(parents=True, exist_ok=True)
    for rig in RIGS:
        for value in sweep.values:
            for seed in SEEDS:
                name = f"{rig}_{value}_{seed}"
                oracle_runs.run_once(
                    program, output / f"{name}.json", name,
                    ["--random_seed", seed, "--Simulation.rig", rig,
                     "--Simulation.path", "curve",
                     "--Simulation.num_frames", 60,
                     f"--Simulation.{sweep.option}", value])


def make_curves(runs, sweep):
    """{rig: {curve: {x: median over seeds}}}.

    Curves: mapper_m and full_oracle_m, mean position errors in meters, of runs
    with a model; registered_percent, of all runs. x has the unit of the axis.
    """
    values = {}
    for one in runs:
        curves = values.setdefault(one.rig, {
            "mapper_m": {}, "full_oracle_m": {}, "registered_percent": {}})
        x = sweep.x_factor * one.setting(sweep.option)
        points = {"registered_percent": one.registered_percent}
        if one.has_model:
            points["mapper_m"] = one.mean_error("mapper", "position_m")
            points["full_oracle_m"] = one.mean_error("full_oracle",
                                                     "position_m")
        for name, y in points.items():
            curves[name].setdefault(x, []).append(y)
    return {rig: {name: {x: statistics.median(curve[x]) for x in sorted(curve)}
                  for name, curve in curves.items()}
            for rig, curves in sorted(values.items())}
