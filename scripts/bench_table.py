# SPDX-License-Identifier: BSD-3-Clause
"""Joins the runs of bench.sh to one file, and compares it with an earlier one.

usage: bench_table.py OUTPUT.json FOLDER_OF_RUNS [OLD.json]
"""
import json
import pathlib
import sys


def print_stages(runs):
    """Seconds of each stage of whole runs, one column a run."""
    runs = [run for run in runs if "stages" in run]
    names = list(dict.fromkeys(name for run in runs for name in run["stages"]))
    for run in runs:
        print(f"{run['name']}: " + ", ".join(
            f"{name} {run['stages'][name]['seconds']:.2f}"
            for name in names if name in run["stages"]))


def values_of(run):
    """What is compared, by name."""
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


def main():
    output, folder = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    runs = [json.loads(p.read_text()) for p in sorted(folder.glob("*.json"))]
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(json.dumps({"runs": runs}, indent=2) + "\n")
    print_stages(runs)
    print(f"wrote {output}")
    if len(sys.argv) < 4:
        return
    old_runs = json.loads(pathlib.Path(sys.argv[3]).read_text())["runs"]
    old = {run["name"]: values_of(run) for run in old_runs}
    print(f"against {sys.argv[3]}: new / old")
    for run in runs:
        for name, value in values_of(run).items():
            before = old.get(run["name"], {}).get(name)
            if before:
                print(f"{run['name']:24} {name:40} {value / before:8.3f}")


if __name__ == "__main__":
    main()
