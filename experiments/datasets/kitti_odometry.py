# SPDX-License-Identifier: BSD-3-Clause
"""The experiments on KITTI odometry."""
import functools
import pathlib

from experiments import driver, options
from experiments.datasets import simulated_drives
from experiments.sequence import FIXED_INTRINSICS, Sequence, png_size
from experiments.text_files import names_its_file, numbers_of

CAMERAS = ("image_0", "image_1")
DESCRIPTION = """\
Repeats the paper's experiments on KITTI odometry as it is downloaded:

  python3 -m experiments kitti_odometry ROOT --sequences 00,06 --methods all

ROOT contains sequences/00/{image_0,image_1,calib.txt} and poses/00.txt; masks,
if any, are sequences/00/masks/image_0/000000.png.png. A sequence with
database.db and truth/ instead, from simulate_drives, needs no images."""


def add_parser(subparsers):
    """The subcommand kitti_odometry."""
    parser = options.add_command(
        subparsers, "kitti_odometry", run,
        "run methods on KITTI odometry or on simulated drives", DESCRIPTION)
    options.add_dataset_options(parser, "build/experiments/kitti_odometry")


def run(arguments):
    """Runs the methods on all sequences."""
    plan = driver.prepare(arguments)
    sequences = find_sequences(arguments.root, arguments.sequences)
    driver.run(plan, sequences, "KITTI odometry").end()


def find_sequences(root, chosen):
    """The sequences of a tree; `chosen`: names, all if empty."""
    # Hidden folders are left by an interrupted simulation.
    folders = sorted(p for p in (root / "sequences").iterdir()
                     if p.is_dir() and not p.name.startswith("."))
    if chosen:
        folders = [root / "sequences" / name
                   for name in options.words_of(chosen)]
    sequences = []
    for folder in folders:
        if (folder / "database.db").exists():
            sequences.append(simulated_drives.read_sequence(folder))
        elif (folder / CAMERAS[0]).is_dir():
            sequences.append(
                recorded(folder, root / "poses" / f"{folder.name}.txt"))
        else:
            raise SystemExit(f"{folder} has neither image_0 nor database.db")
    return sequences


def recorded(folder, poses_path):
    """A recorded stereo sequence; the file of poses may be missing."""
    projections = read_projections(folder / "calib.txt")
    names, lines = [], []
    for camera, key in zip(CAMERAS, ("P0", "P1")):
        files = sorted(p for p in (folder / camera).iterdir()
                       if p.suffix == ".png")
        if not files:
            raise SystemExit(f"{folder / camera} contains no PNG file")
        if key not in projections:
            raise SystemExit(f"{folder / 'calib.txt'} has no matrix {key}")
        names += [f"{camera}/{p.name}" for p in files]
        width, height = png_size(files[0])
        p = projections[key]
        lines.append(f"{camera} PINHOLE {width} {height} "
                     f"{p[0]} {p[5]} {p[2]} {p[6]}")
    masks = folder / "masks"
    left = [n for n in names if n.startswith(CAMERAS[0])]
    truth, truth_positions = [], dict
    if poses_path.exists():
        truth_positions = functools.partial(positions_by_name, poses_path, left)
        truth = ["--gt_path", poses_path, "--gt_format", "kitti",
                 "--calib_path", folder / "calib.txt"]
    return Sequence(
        folder.name, image_path=folder, image_list=names, camera_lines=lines,
        mask_path=masks if masks.is_dir() else None,
        mapper_options=list(FIXED_INTRINSICS),
        truth=truth, truth_positions=truth_positions)


@names_its_file
def read_projections(path):
    """{name: 12 numbers of a 3 x 4 matrix, row by row} of calib.txt."""
    projections = {}
    for line in path.read_text().splitlines():
        name, _, numbers = line.partition(":")
        if name.strip() not in ("P0", "P1"):
            continue
        values = numbers_of(numbers)
        if len(values) != 12:
            raise ValueError(f"{name} has {len(values)} numbers, not 12")
        projections[name.strip()] = values
    return projections


@names_its_file
def positions_by_name(poses_path, names):
    """{name: position of the left camera, meters}; the number in an image name
    is the row of the file of poses."""
    rows = [numbers_of(line) for line in poses_path.read_text().splitlines()
            if line.strip()]
    positions = {}
    for name in names:
        number = int("".join(c for c in pathlib.PurePath(name).stem
                             if c.isdigit()))
        if number < len(rows):
            row = rows[number]
            positions[name] = (row[3], row[7], row[11])
    return positions
