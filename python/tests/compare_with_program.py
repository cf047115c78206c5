#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Measures what Python costs: maps a database by the program and by pymgsfm in
turns, compares the files, and prints processor times.

    PYTHONPATH=build/release/python python/tests/compare_with_program.py \\
        build/release/apps/mgsfm/mgsfm data/demo/database.db [ROUNDS]

"call" is pymgsfm.global_mapping, which also reads the models; "process" includes
the start of Python and the import of numpy.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

CALL = """
import sys, time
import pymgsfm
start = time.process_time()
pymgsfm.global_mapping(sys.argv[1], None, sys.argv[2],
                       {"write_report": False, "num_threads": 1})
print(time.process_time() - start)
"""


def run(command):
    """Standard output, and the processor time in s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    text = subprocess.run(command, check=True, stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL, text=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return text, (after.ru_utime + after.ru_stime
                  - before.ru_utime - before.ru_stime)


def model_files(folder):
    return {path.relative_to(folder): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file() and path.name != "report.json"}


def main():
    program, database = sys.argv[1:3]
    num_rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 7
    shm = "/dev/shm" if os.path.isdir("/dev/shm") else None
    times = {"program": [], "call": [], "process": []}
    with tempfile.TemporaryDirectory(dir=shm) as folder:
        outputs = {name: Path(folder) / name for name in ("program", "python")}
        for _ in range(num_rounds):
            times["program"].append(run(
                [program, "mapper", "--database_path", database, "--output_path",
                 outputs["program"], "--write_report", "0", "--num_threads",
                 "1"])[1])
            text, seconds = run([sys.executable, "-c", CALL, database,
                                 outputs["python"]])
            times["call"].append(float(text))
            times["process"].append(seconds)
        files = model_files(outputs["program"])
        if files != model_files(outputs["python"]) or not files:
            sys.exit("the files differ")
        print(f"{len(files)} files are equal, byte for byte")
    program_s = statistics.median(times["program"])
    print(f"program  {program_s:.3f} s (median of {num_rounds})")
    for name in ("call", "process"):
        ratios = [a / b - 1 for a, b in zip(times[name], times["program"])]
        print(f"{name:8} {statistics.median(times[name]):.3f} s, "
              f"{100 * statistics.median(ratios):+.1f} %")


if __name__ == "__main__":
    main()
