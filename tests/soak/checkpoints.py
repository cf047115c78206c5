#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Kills the mapper at random moments and continues it from its checkpoint.

The models must have the same bytes as those of an undisturbed run, and stages
that the killed run had finished must come from the checkpoint, but for one at
most. Prints one line per kill; exit code 1 if a kill fails.

  tests/soak/checkpoints.py build/release/apps/mgsfm/mgsfm --num_kills 50
"""

import argparse
import hashlib
import pathlib
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

# Computed in every run: they take less time than reading what they make.
UNSAVED = {"rays", "input check"}
FINISHED = re.compile(r"info\s+([a-z ]+): [\d.]+ s$", re.MULTILINE)
LOADED = re.compile(r"info\s+([a-z ]+): from the checkpoint$", re.MULTILINE)


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--num_kills", type=int, default=50)
    parser.add_argument("--num_frames", type=int, default=120)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args()


def hash_models(folder):
    """Times and memory in the report differ from run to run."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "report.json"
    }


class Drive:
    def __init__(self, program, folder, num_frames):
        self.program = program
        self.folder = folder
        simulate = [program, "simulate", "--preset", "standard", "--rig", "stereo"]
        simulate += ["--num_frames", str(num_frames), "--quiet", "1"]
        subprocess.run(simulate + ["--output_path", folder / "drive"], check=True)

    def start(self, name):
        command = [self.program, "mapper", "--write_report", "0", "--num_threads", "1"]
        command += ["--database_path", self.folder / "drive" / "database.db"]
        command += ["--output_path", self.folder / name]
        command += ["--checkpoint_path", self.folder / f"{name}.checkpoint"]
        return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)

    def run(self, name):
        process = self.start(name)
        _, log = process.communicate()
        if process.returncode != 0:
            sys.exit(f"the mapper failed:\n{log}")
        return log

    def kill(self, name, seconds):
        process = self.start(name)
        time.sleep(seconds)
        process.send_signal(signal.SIGKILL)
        return process.communicate()[1]


def count_repeated(killed_log, resumed_log):
    """Stages may run twice, with and without moving objects."""
    finished = [s for s in FINISHED.findall(killed_log) if s not in UNSAVED]
    loaded = LOADED.findall(resumed_log)
    if "bundle adjustment" in finished:
        finished.remove("bundle adjustment")  # its solves are saved
    return len(finished) - len(loaded)


def main():
    arguments = parse_arguments()
    generator = random.Random(arguments.seed)
    num_failures = 0
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        drive = Drive(arguments.program.resolve(), folder, arguments.num_frames)
        start = time.monotonic()
        drive.run("undisturbed")
        seconds = time.monotonic() - start
        expected = hash_models(folder / "undisturbed")
        for i in range(arguments.num_kills):
            moment = generator.uniform(0.0, seconds)
            killed_log = drive.kill("killed", moment)
            was_complete = (folder / "killed").exists()
            resumed_log = drive.run("killed")
            is_equal = hash_models(folder / "killed") == expected
            num_repeated = 0 if was_complete else count_repeated(killed_log, resumed_log)
            is_right = is_equal and num_repeated <= 1
            num_failures += not is_right
            print(
                f"{i}: killed after {moment:.2f} s of {seconds:.2f} s, "
                f"{'same' if is_equal else 'OTHER'} bytes, {num_repeated} stages repeated",
                flush=True,
            )
            shutil.rmtree(folder / "killed")
    print(f"{arguments.num_kills} kills, {num_failures} failures")
    return 1 if num_failures else 0


if __name__ == "__main__":
    sys.exit(main())
