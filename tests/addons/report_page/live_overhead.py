# SPDX-License-Identifier: BSD-3-Clause
"""Measures what --live_port costs: maps a database without it, with it, and with
it and a reader, in turns, and prints processor times.

  python3 tests/addons/report_page/live_overhead.py build/release/apps/mgsfm/mgsfm \
      database.db [ROUNDS]

The reader asks for what a browser does. Models must be equal.
"""

import json
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

MAX_OVERHEAD = 0.03
KINDS = ("without", "live", "reader")


class Reader(threading.Thread):
    """Asks for the state every second, and for each new model."""

    def __init__(self, url):
        super().__init__(daemon=True)
        self.url = url
        self.num_models = 0

    def get(self, path):
        with urllib.request.urlopen(self.url + path, timeout=10) as answer:
            return answer.read()

    def run(self):
        version = 0
        try:
            self.get("")
            while True:
                state = json.loads(self.get("state"))
                if state["model_version"] != version:
                    version = state["model_version"]
                    self.get("model")
                    self.num_models += 1
                if state["finished"]:
                    self.get("")
                    return
                time.sleep(1.0)
        except OSError:
            return  # the run has ended


def map_database(program, database, output, kind):
    """The processor time in s, and the number of models that were read."""
    command = [program, "mapper", "--database_path", database,
               "--output_path", output, "--num_threads", "1"]
    if kind != "without":
        command += ["--live_port", "0"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    reader = None
    for line in process.stderr:
        url = re.search(r"http://127\.0\.0\.1:\d+/", line)
        if url and kind == "reader":
            reader = Reader(url[0])
            reader.start()
    if process.wait() != 0:
        sys.exit("the mapper failed")
    process.stderr.close()
    if reader:
        reader.join()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
            reader.num_models if reader else 0)


def model_files(folder):
    return {path.relative_to(folder): path.read_bytes()
            for path in sorted(folder.rglob("*")) if path.is_file()
            and path.name not in ("report.json", "report.html")}


def main():
    program, database = sys.argv[1:3]
    num_rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    times = {kind: [] for kind in KINDS}
    num_models = 0
    shm = "/dev/shm" if os.path.isdir("/dev/shm") else None
    with tempfile.TemporaryDirectory(dir=shm) as folder:
        for _ in range(num_rounds):
            for kind in KINDS:
                seconds, num_models = map_database(program, database,
                                                   Path(folder) / kind, kind)
                times[kind].append(seconds)
        files = model_files(Path(folder) / "without")
        if not files or any(files != model_files(Path(folder) / kind)
                            for kind in KINDS):
            sys.exit("the models differ")
    is_good = True
    print(f"without  {statistics.median(times['without']):.2f} s "
          f"(median of {num_rounds})")
    for kind in KINDS[1:]:
        ratios = [a / b - 1 for a, b in zip(times[kind], times["without"])]
        overhead = statistics.median(ratios)
        is_good &= overhead <= MAX_OVERHEAD
        print(f"{kind:8} {statistics.median(times[kind]):.2f} s, "
              f"{100 * overhead:+.1f} % ({100 * min(ratios):+.1f} to "
              f"{100 * max(ratios):+.1f})")
    print(f"the last reader got {num_models} models")
    sys.exit(0 if is_good else 1)


if __name__ == "__main__":
    main()
