# SPDX-License-Identifier: BSD-3-Clause
"""Joins the runs of bench.sh to one file, and compares it with an earlier one.

usage: bench_table.py OUTPUT.json FOLDER_OF_RUNS [OLD.json]
"""
import json
import pathlib
import sys


def main():
    output, folder = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    runs = [json.loads(p.read_text()) for p in sorted(folder.glob("*.json"))]
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(json.dumps({"runs": runs}, indent=2) + "\n")
    print(f"wrote {output}")
    if len(sys.argv) < 4:
        return
    old_runs = json.loads(pathlib.Path(sys.argv[3]).read_text())["runs"]
    old = {run["name"]: run["solvers"] for run in old_runs}
    print(f"against {sys.argv[3]}: seconds per iteration, new / old")
    for run in runs:
        for name, solver in run["solvers"].items():
            before = old.get(run["name"], {}).get(name)
            if not before or not before["seconds_per_iteration"]:
                continue
            ratio = (solver["seconds_per_iteration"] /
                     before["seconds_per_iteration"])
            print(f"{run['name']:20} {name:18} {ratio:8.3f}")


if __name__ == "__main__":
    main()
