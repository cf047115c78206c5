# SPDX-License-Identifier: BSD-3-Clause
"""Joins the results of a benchmark, and compares them with earlier ones."""


def stage_lines(runs):
    """The seconds of each stage, one line for each mapper run."""
    runs = [run for run in runs if "stages" in run]
    names = list(dict.fromkeys(name for run in runs for name in run["stages"]))
    return [f"{run['name']}: " + ", ".join(
        f"{name} {run['stages'][name]['seconds']:.2f}"
        for name in names if name in run["stages"]) for run in runs]


def values_of(run):
    """{name: value} of all that is compared."""
    values = {}
    for name, solver in run.get("solvers", {}).items():
        values[f"{name}, s/iteration"] = solver["seconds_per_iteration"]
    for name in ("seconds", "processor_seconds", "peak_memory_mib"):
        if name in run:
            values[name] = run[name]
    for name, stage in run.get("stages", {}).items():
        values[f"{name}, processor seconds"] = stage["processor_seconds"]
    if "position_m" in run:
        values["position error"] = run["position_m"]["mean"]
    return values


def ratio_lines(runs, old_runs):
    """new / old of each value that both have."""
    old = {run["name"]: values_of(run) for run in old_runs}
    lines = []
    for run in runs:
        for name, value in values_of(run).items():
            before = old.get(run["name"], {}).get(name)
            if before:
                lines.append(
                    f"{run['name']:24} {name:40} {value / before:8.3f}")
    return lines
