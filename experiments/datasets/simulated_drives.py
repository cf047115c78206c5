# SPDX-License-Identifier: BSD-3-Clause
"""Simulated drives along recorded trajectories, in the layout of KITTI."""
import os
import pathlib
import shutil
import subprocess

from experiments import colmap_model, options
from experiments.sequence import Sequence

RECORDED = "06_recorded"
DESCRIPTION = """\
Simulates drives along the trajectories of KITTI, in the folder layout that
kitti_odometry reads:

  python3 -m experiments simulate_drives DATA TREE --sequences 00,04 \\
      [-- OPTIONS of mgsfm simulate]

DATA contains kitti_trajectories/00.txt, ... and optionally kitti06_stereo/
(images/cam0, images/cam1, calib.txt, gt_poses.txt), which becomes sequence
06_recorded of a stereo tree. Finished drives are kept."""


def add_parser(subparsers):
    """The subcommand simulate_drives."""
    parser = options.add_command(
        subparsers, "simulate_drives", run,
        "simulate drives along trajectories, for kitti_odometry", DESCRIPTION)
    parser.set_defaults(takes_passed_on=True)
    parser.add_argument("data", type=pathlib.Path,
                        help="folder of recorded data")
    parser.add_argument("tree", type=pathlib.Path, help="folder to make")
    parser.add_argument("--sequences", default="",
                        help="names, separated by commas; all if empty")
    parser.add_argument("--rig", default="stereo",
                        help="rig of mgsfm simulate")
    parser.add_argument("--frame_step", type=options.positive(int), default=1,
                        help="use every n-th pose")
    options.add_program(parser)


def run(arguments):
    """Makes TREE/sequences and TREE/poses."""
    program = options.find_program(arguments.program)
    names = (options.words_of(arguments.sequences)
             or all_sequences(arguments.data, arguments.rig))
    sequences = arguments.tree / "sequences"
    sequences.mkdir(parents=True, exist_ok=True)
    (arguments.tree / "poses").mkdir(exist_ok=True)
    for name in names:
        if name == RECORDED:
            add_recorded(arguments.data / "kitti06_stereo", arguments.tree)
        else:
            simulate(program, arguments.data, sequences / name, name,
                     ["--rig", arguments.rig,
                      "--frame_step", arguments.frame_step,
                      *arguments.passed_on])


def all_sequences(data, rig):
    """The names of all trajectories, and the recorded sequence."""
    names = sorted(p.stem for p in (data / "kitti_trajectories").iterdir()
                   if p.suffix == ".txt")
    if rig == "stereo" and (data / "kitti06_stereo").is_dir():
        names.append(RECORDED)
    return names


def simulate(program, data, folder, trajectory, simulate_options):
    """Makes one drive, unless it is there."""
    if (folder / "database.db").exists():
        return
    print(f"simulating {folder.name}", flush=True)
    path = data / "kitti_trajectories" / f"{trajectory}.txt"
    subprocess.run(
        list(map(str, [program, "simulate", "--log_level", "warning",
                       "--output_path", folder, "--preset", "standard",
                       "--trajectory_path", path, *simulate_options])),
        check=True)


def add_recorded(recorded, tree):
    """Links the images of the recorded sequence, and copies its truth."""
    folder = tree / "sequences" / RECORDED
    if folder.exists():
        return
    if not recorded.is_dir():
        raise SystemExit(f"no folder {recorded} for {RECORDED}")
    folder.mkdir()
    for k in range(2):
        os.symlink((recorded / f"images/cam{k}").resolve(),
                   folder / f"image_{k}")
    # KITTI names the matrices of its calibration.
    rows = [line for line in (recorded / "calib.txt").read_text().splitlines()
            if len(line.split()) == 12]
    (folder / "calib.txt").write_text(
        "".join(f"P{k}: {row}\n" for k, row in enumerate(rows)))
    shutil.copy(recorded / "gt_poses.txt", tree / f"poses/{RECORDED}.txt")


def read_sequence(folder):
    """A folder with database.db and truth/, as `mgsfm simulate` writes."""
    truth = folder / "truth"
    return Sequence(
        folder.name, database=folder / "database.db",
        truth=["--gt_path", truth],
        truth_positions=lambda: colmap_model.read_positions(truth))
