# SPDX-License-Identifier: BSD-3-Clause
"""Costs of mapper runs of growing size, and the exponents of their growth."""
import dataclasses
import json
import math
import statistics

from experiments import measure, tables

TOTAL = "total"
KINDS = ("seconds", "processor_seconds", "peak_memory_mib")
# Smaller values are not drawn: the clock does not resolve them.
MIN_DRAWN = {"seconds": 0.01, "processor_seconds": 0.01, "peak_memory_mib": 1.0}


@dataclasses.dataclass
class GrowthRun:
    """One run. costs: {stage, or TOTAL: {kind of KINDS: value}}; the memory of
    a stage is the peak of the process until the stage ended."""

    num_images: int
    num_registered: int
    num_observations: float  # of all tracks
    costs: dict

    def cost(self, stage, kind):
        """0 if the run has no such stage."""
        return self.costs.get(stage, {}).get(kind, 0.0)

    def stages(self):
        """Their names, in the order of the report."""
        return [name for name in self.costs if name != TOTAL]


def read_runs(folder):
    """The runs of all reports in a folder, by number of images."""
    if not folder.is_dir():
        raise SystemExit(f"{folder} is not a folder")
    runs = []
    for path in folder.glob("*.json"):
        try:
            runs.append(make_run(json.loads(path.read_text())))
        except (json.JSONDecodeError, KeyError, TypeError) as error:
            raise SystemExit(
                f"{path} is not a report of the mapper: {error}") from None
    if not runs:
        raise SystemExit(f"no report in {folder}")
    return sorted(runs, key=lambda run: run.num_images)


def make_run(report):
    """Reads report.json; costs are summed over the run and its models."""
    costs = {name: {"seconds": stage["seconds"],
                    "processor_seconds": stage["processor_seconds"],
                    "peak_memory_mib": stage["peak_memory_mib_after"]}
             for name, stage in measure.stages_of(report).items()}
    total = {kind: sum(cost[kind] for cost in costs.values())
             for kind in ("seconds", "processor_seconds")}
    total["peak_memory_mib"] = report["peak_memory_mib"]
    return GrowthRun(
        report["input"]["num_images"],
        sum(model["num_images"] for model in report["models"]),
        sum(model["tracks"]["num_observations"] for model in report["models"]),
        {**costs, TOTAL: total})


def fit_exponent(runs, stage, kind):
    """p of the least-squares fit of log(cost) = log(c) + p log(observations).

    None with fewer than two different sizes.
    """
    points = [(math.log(run.num_observations), math.log(run.cost(stage, kind)))
              for run in runs
              if run.num_observations > 0.0 and run.cost(stage, kind) > 0.0]
    if len({x for x, _ in points}) < 2:
        return None
    x, y = zip(*points)
    return statistics.linear_regression(x, y).slope


def exponent_text(runs, stage, kind):
    """The exponent with two decimals, or the sign for a missing value."""
    exponent = fit_exponent(runs, stage, kind)
    return tables.MISSING if exponent is None else f"{exponent:.2f}"


def runs_table(runs):
    """Markdown: size, time and memory of each run, and exponents."""
    rows = [[str(run.num_images), str(run.num_registered),
             f"{run.num_observations:.0f}",
             f"{run.cost(TOTAL, 'seconds'):.1f} s",
             f"{run.cost(TOTAL, 'processor_seconds'):.1f} s",
             f"{run.cost(TOTAL, 'peak_memory_mib'):.0f} MiB"] for run in runs]
    rows.append(["exponent", "", "",
                 *[exponent_text(runs, TOTAL, kind) for kind in KINDS]])
    return tables.markdown_table(
        ["images", "registered", "observations", "wall", "processors",
         "peak memory"], rows)


def stages_table(runs):
    """Markdown: wall and processor time and peak memory after each stage."""
    rows = []
    for stage in runs[-1].stages():
        cells = [f"{run.cost(stage, 'seconds'):.2f} s, "
                 f"{run.cost(stage, 'processor_seconds'):.2f} s, "
                 f"{run.cost(stage, 'peak_memory_mib'):.0f} MiB"
                 for run in runs]
        rows.append([stage, *cells,
                     exponent_text(runs, stage, "processor_seconds")])
    return tables.markdown_table(
        ["stage", *[str(run.num_images) for run in runs],
         "exponent of processor time"], rows)


def curve(runs, stage, kind):
    """(label with the exponent, [(observations, cost), ...]) for a figure."""
    points = [(run.num_observations, run.cost(stage, kind)) for run in runs
              if run.num_observations > 0
              and run.cost(stage, kind) >= MIN_DRAWN[kind]]
    return f"{stage}, {exponent_text(runs, stage, kind)}", points


def figure_curves(runs):
    """Processor time of all stages together and of each, and peak memory."""
    return ([curve(runs, stage, "processor_seconds")
             for stage in (TOTAL, *runs[-1].stages())],
            [curve(runs, TOTAL, "peak_memory_mib")])
