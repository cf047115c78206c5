# SPDX-License-Identifier: BSD-3-Clause
"""The experiments on KITTI odometry; see kitti_odometry.sh."""
import functools
import pathlib

import experiments

CAMERAS = ("image_0", "image_1")


def read_projections(path):
    """{name: 3x4 matrix, row by row} of calib.txt."""
    projections = {}
    for line in path.read_text().splitlines():
        name, _, numbers = line.partition(":")
        values = [float(v) for v in numbers.split()]
        if len(values) == 12:
            projections[name.strip()] = values
    return projections


def positions_by_name(poses_path, names):
    """World positions of the left camera, by the number in the image name."""
    rows = [list(map(float, line.split()))
            for line in poses_path.read_text().splitlines() if line.strip()]
    positions = {}
    for name in names:
        number = int("".join(c for c in pathlib.PurePath(name).stem
                             if c.isdigit()))
        if number < len(rows):
            row = rows[number]
            positions[name] = (row[3], row[7], row[11])
    return positions


def simulated(folder):
    """A sequence folder with database.db and truth/, as simulate writes."""
    truth = folder / "truth"
    return experiments.Sequence(
        folder.name, database=folder / "database.db",
        truth=["--gt_path", truth],
        truth_positions=lambda: experiments.read_positions(truth))


def recorded(folder, poses_path):
    projections = read_projections(folder / "calib.txt")
    names, lines = [], []
    for camera, key in zip(CAMERAS, ("P0", "P1")):
        files = sorted(p for p in (folder / camera).iterdir()
                       if p.suffix == ".png")
        if not files:
            raise SystemExit(f"{folder / camera} holds no PNG")
        names += [f"{camera}/{p.name}" for p in files]
        width, height = experiments.png_size(files[0])
        p = projections[key]
        lines.append(f"{camera} PINHOLE {width} {height} "
                     f"{p[0]} {p[5]} {p[2]} {p[6]}")
    masks = folder / "masks"
    left = [n for n in names if n.startswith(CAMERAS[0])]
    truth, truth_positions = [], None
    if poses_path.exists():
        truth_positions = functools.partial(positions_by_name, poses_path, left)
        truth = ["--gt_path", poses_path, "--gt_format", "kitti",
                 "--calib_path", folder / "calib.txt"]
    return experiments.Sequence(
        folder.name, image_path=folder, image_list=names, camera_lines=lines,
        mask_path=masks if masks.is_dir() else None,
        mapper_options=["--BundleAdjustment.refine_focal_length", "no",
                        "--BundleAdjustment.refine_extra_params", "no"],
        truth=truth, truth_positions=truth_positions)


def find_sequences(root, chosen):
    # Hidden ones are what a stopped simulation left.
    folders = sorted(p for p in (root / "sequences").iterdir()
                     if p.is_dir() and not p.name.startswith("."))
    if chosen:
        folders = [root / "sequences" / name
                   for name in experiments.words_of(chosen)]
    sequences = []
    for folder in folders:
        if (folder / "database.db").exists():
            sequences.append(simulated(folder))
        elif (folder / CAMERAS[0]).is_dir():
            sequences.append(
                recorded(folder, root / "poses" / f"{folder.name}.txt"))
        else:
            raise SystemExit(f"{folder} has neither image_0 nor database.db")
    return sequences


def main():
    arguments = experiments.argument_parser(
        __doc__, "build/experiments/kitti_odometry").parse_args()
    root = pathlib.Path(arguments.root)
    _, num_failed = experiments.run(
        arguments, find_sequences(root, arguments.sequences), "KITTI odometry")
    experiments.end(num_failed)


if __name__ == "__main__":
    experiments.call(main)
