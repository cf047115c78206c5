#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Random small drives with random options, until the time is over or a number
of drives is reached.

Each drive is mapped with the default options, whose model must be complete and
accurate, and with random valid ones, which may fail to reconstruct it but must
end with exit code 0 or 2. All models are the same with another number of
threads.
"""
import argparse
import filecmp
import json
import math
import pathlib
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time

# What a simulation may look like; all of it can be reconstructed.
DRIVES = {
    "rig": ["mono", "stereo", "kitti360", "cube6"],
    "path": ["loop", "curve", "straight"],
    "num_frames": range(8, 25),
    "frame_spacing": [0.5, 1.0, 2.0],
    "num_points_per_frame": range(80, 200),
    "pixel_noise": [0.0, 0.3, 0.7],
    "mismatch_ratio": [0.0, 0.05],
    "missing_image_ratio": [0.0, 0.1],
    "wrong_pair_ratio": [0.0, 0.02],
    "num_matched_frames": range(3, 6),
    "database_schema": ["3.8", "3.12"],
    "extrinsics_are_known": ["false", "true"],
}
# Options of the mapper that name files or baselines, or that change what the
# report must hold.
FIXED = re.compile(r".*path$|.*_path|output_format|method|SoftRig\.method|"
                   r"use_prior_.*|ref_is_gps|rig_name_rule|min_num_frames|"
                   r".*prior_position.*|overwrite.*|Mapper\..*")
# Errors of models with noise of 0.7 px at distances of up to 30 m. The rotation
# is that between neighbors, and that of the model beyond the alignment.
MAX_POSITION_ERROR_M = 0.1
MAX_ROTATION_ERROR_DEG = 0.3


class Failure(Exception):
    pass


class Program:
    def __init__(self, path):
        self.path = path
        self.num_runs = 0

    def run(self, *arguments, accepted=(0,)):
        command = [self.path, *map(str, arguments)]
        result = subprocess.run(command, capture_output=True, text=True,
                                timeout=600)
        self.num_runs += 1
        if result.returncode not in accepted:
            raise Failure(f"{' '.join(command)}\nexit code "
                          f"{result.returncode}\n{result.stderr[-2000:]}")
        return result.returncode, result.stdout

    def mapper_options(self):
        """Names, defaults and ranges of the mapper's options, as declared."""
        text = self.run("print_options_markdown")[1]
        section = text.split("\n## mapper\n")[1].split("\n## ")[0]
        rows = re.findall(r"^\| `([^`]+)` \| (\S+) \| (.*?[^\\]) \|", section,
                          re.M)
        return [row for row in rows if not FIXED.fullmatch(row[0])]


def random_value(rng, default, values):
    """A valid value: any of a list, or a number near the default."""
    choices = values.replace("\\|", "|").split("|")
    if len(choices) > 1:
        return rng.choice(choices)
    match = re.match(r"(int|number)(?: in ([\[(])(\S+), (\S+)([\])]))?", values)
    if not match:
        return None
    low, high = float(match[3] or "-inf"), float(match[4] or "inf")
    value = float(default) * rng.choice([0.5, 0.8, 1.25, 2.0])
    if value == 0.0:
        value = rng.choice([0.0, 1.0])
    value = min(max(value, low), high)
    if (match[2] == "(" and value == low) or (match[5] == ")" and
                                              value == high):
        return None
    return int(value) if match[1] == "int" else value


def check_same(a, b):
    """All files of two outputs are equal but the reports, which hold times and
    paths."""
    names = [sorted(p.relative_to(folder) for p in folder.rglob("*")
                    if p.is_file() and p.stem != "report")
             for folder in (a, b)]
    if names[0] != names[1]:
        raise Failure(f"{a} and {b} hold different files")
    for name in names[0]:
        if not filecmp.cmp(a / name, b / name, shallow=False):
            raise Failure(f"{name} depends on the number of threads")


def map_twice(program, rng, folder, name, options, accepted):
    outputs = []
    for threads in rng.sample([1, 2, 3, 4], 2):
        output = folder / f"{name}_{threads}"
        code, _ = program.run("mapper", "--database_path",
                              folder / "drive/database.db", "--output_path",
                              output, f"--num_threads={threads}", *options,
                              accepted=accepted)
        outputs.append((code, output))
    if outputs[0][0] != outputs[1][0]:
        raise Failure("the exit code depends on the number of threads")
    if outputs[0][0] == 0:
        check_same(outputs[0][1], outputs[1][1])
    return outputs[0]


def check_accuracy(program, folder, model):
    result = folder / "errors.json"
    program.run("model_evaluator", "--input_path", model, "--gt_path",
                folder / "drive/truth", "--json", result)
    errors = json.loads(result.read_text())
    if errors["num_registered"] < errors["num_images"]:
        raise Failure(f"{errors['num_registered']} of {errors['num_images']} "
                      "images registered")
    position_m = errors["position_m"]["median"]
    # Positions align the model with the ground truth. Their errors, at the ends
    # of the drive in opposite directions, turn all of it.
    alignment_deg = math.degrees(2.0 * position_m / errors["extent_m"])
    step_deg = errors["rpe"]["rotation_deg"]["median"]
    rotation_deg = errors["rotation_deg"]["median"] - alignment_deg
    if (position_m > MAX_POSITION_ERROR_M or
            max(step_deg, rotation_deg) > MAX_ROTATION_ERROR_DEG):
        raise Failure(f"inaccurate: {errors['position_m']} m, "
                      f"{errors['rotation_deg']} deg, "
                      f"between neighbors {errors['rpe']['rotation_deg']}")


def test_drive(program, seed, folder, mapper_options):
    rng = random.Random(seed)
    drive = [f"--{name}={rng.choice(values)}"
             for name, values in DRIVES.items()]
    program.run("simulate", "--output_path", folder / "drive",
                f"--random_seed={seed}", *drive)
    _, output = map_twice(program, rng, folder, "default", [], (0,))
    check_accuracy(program, folder, output / "0")
    options = []
    for name, default, values in rng.sample(mapper_options, 6):
        value = random_value(rng, default, values)
        if value is not None:
            options.append(f"--{name}={value}")
    # Bad combinations are rejected; a valid one may reconstruct nothing.
    map_twice(program, rng, folder, "random", options, (0, 1, 2))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("minutes", type=float)
    parser.add_argument("--first_seed", type=int, default=1)
    parser.add_argument("--num_drives", type=int)
    arguments = parser.parse_args()
    program = Program(arguments.program)
    mapper_options = program.mapper_options()
    end = time.monotonic() + 60.0 * arguments.minutes
    seed, failures = arguments.first_seed, []
    stop = seed + (arguments.num_drives or sys.maxsize)
    while time.monotonic() < end and seed < stop:
        folder = pathlib.Path(tempfile.mkdtemp(prefix="mgsfm_soak_"))
        try:
            test_drive(program, seed, folder, mapper_options)
        except (Failure, subprocess.TimeoutExpired) as failure:
            failures.append(seed)
            print(f"drive {seed}: {failure}", flush=True)
        shutil.rmtree(folder)
        seed += 1
    print(f"{seed - arguments.first_seed} drives, {program.num_runs} runs, "
          f"{len(failures)} failures {failures}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
