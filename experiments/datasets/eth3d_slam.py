# SPDX-License-Identifier: BSD-3-Clause
"""The experiments on the stereo training sets of ETH3D-SLAM."""
import functools
import pathlib

from experiments import driver, options
from experiments.sequence import FIXED_INTRINSICS, Sequence, png_size
from experiments.text_files import names_its_file, numbers_of

CAMERAS = {"rgb": "calibration.txt", "rgb2": "calibration2.txt"}
DESCRIPTION = """\
Repeats the paper's experiments on ETH3D-SLAM's stereo training sets:

  python3 -m experiments eth3d_slam ROOT --sequences desk_3,repetitive

ROOT or ROOT/training contains desk_3/{rgb,rgb2,calibration.txt,
calibration2.txt,extrinsics_1_2.txt,groundtruth.txt}. Images of equal names
form a frame."""


def add_parser(subparsers):
    """The subcommand eth3d_slam."""
    parser = options.add_command(
        subparsers, "eth3d_slam", run,
        "run methods on the stereo sets of ETH3D-SLAM", DESCRIPTION)
    options.add_dataset_options(parser, "build/experiments/eth3d_slam")
    parser.add_argument("--frame_step", type=options.positive(int), default=1,
                        help="use every n-th frame")


def run(arguments):
    """Runs the methods on all sequences."""
    plan = driver.prepare(arguments)
    folders = find_folders(arguments.root, arguments.sequences)
    sequences = [make_sequence(folder, arguments.frame_step, plan.settings.work)
                 for folder in folders]
    driver.run(plan, sequences, "ETH3D-SLAM").end()


def find_folders(root, chosen):
    """The folders of sequences; `chosen`: names, all stereo sets if empty."""
    training = root / "training" if (root / "training").is_dir() else root
    if chosen:
        return [training / name for name in options.words_of(chosen)]
    return sorted(p for p in training.iterdir()
                  if (p / "rgb2").is_dir()
                  and (p / "groundtruth.txt").exists())


def make_sequence(folder, step, work):
    """A sequence with every `step`-th stereo frame."""
    common = sorted(p.name for p in (folder / "rgb2").iterdir()
                    if (folder / "rgb" / p.name).exists())[::step]
    if not common:
        raise SystemExit(f"{folder} has no stereo images of equal names")
    names, lines = [], []
    for camera, calibration in CAMERAS.items():
        width, height = png_size(folder / camera / common[0])
        params = " ".join(map(repr, read_numbers(folder / calibration, 4)))
        lines.append(f"{camera} PINHOLE {width} {height} {params}")
        names += [f"{camera}/{name}" for name in common]
    rig = work / folder.name / "rig"
    write_rig(rig, read_numbers(folder / "extrinsics_1_2.txt", 12))
    truth = folder / "groundtruth.txt"
    left = [n for n in names if n.startswith("rgb/")]
    return Sequence(
        folder.name, image_path=folder, image_list=names, camera_lines=lines,
        mapper_options=list(FIXED_INTRINSICS),
        truth=["--gt_path", truth, "--gt_format", "tum", "--calib_path",
               f"{rig / 'rgb.yaml'},{rig / 'rgb2.yaml'}"],
        truth_positions=functools.partial(read_tum, truth, left))


@names_its_file
def read_numbers(path, count):
    """The first numbers of a file."""
    numbers = numbers_of(path.read_text())
    if len(numbers) < count:
        raise ValueError(f"it has {len(numbers)} numbers, not {count}")
    return numbers[:count]


def write_rig(folder, cam1_from_cam2):
    """The poses of both cameras in the body, which is camera 1.

    cam1_from_cam2: the first 12 numbers of the matrix, row by row.
    """
    folder.mkdir(parents=True, exist_ok=True)
    write_sensor(folder / "rgb.yaml", [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0,
                                       0.0, 0.0, 1.0, 0.0])
    write_sensor(folder / "rgb2.yaml", cam1_from_cam2)


def write_sensor(path, body_from_cam):
    """12 numbers of a pose in the format of EuRoC's sensor.yaml."""
    numbers = ", ".join(map(repr, body_from_cam))
    path.write_text("T_BS:\n  cols: 4\n  rows: 4\n"
                    f"  data: [{numbers}, 0.0, 0.0, 0.0, 1.0]\n")


@names_its_file
def read_tum(path, names):
    """{image name: position, meters} at the time that the name says.

    As in model_evaluator, the nearest pose counts if it is nearer than half the
    mean interval between poses. Empty with fewer than two poses.
    """
    positions = {}
    for line in path.read_text().splitlines():
        words = line.split()
        if len(words) == 8 and not line.startswith("#"):
            positions[float(words[0])] = tuple(map(float, words[1:4]))
    if len(positions) < 2:
        return {}
    limit = 0.5 * (max(positions) - min(positions)) / (len(positions) - 1)
    found = {}
    for name in names:
        time = float(pathlib.PurePath(name).stem)
        nearest = min(positions, key=lambda t: abs(t - time))
        if abs(nearest - time) <= limit:
            found[name] = positions[nearest]
    return found
