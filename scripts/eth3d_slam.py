# SPDX-License-Identifier: BSD-3-Clause
"""The experiments on the stereo training sets of ETH3D-SLAM; see
eth3d_slam.sh."""
import pathlib

import experiments

CAMERAS = {"rgb": "calibration.txt", "rgb2": "calibration2.txt"}


def read_numbers(path):
    return [float(w) for w in path.read_text().split()]


def write_sensor(path, rows):
    """The pose of a camera in the rig as EuRoC's sensor.yaml has it."""
    numbers = ", ".join(repr(v) for row in rows for v in row)
    path.write_text("T_BS:\n  cols: 4\n  rows: 4\n"
                    f"  data: [{numbers}, 0.0, 0.0, 0.0, 1.0]\n")


def read_tum(path, names):
    """{image name: position} by the time in the name, if that of a pose is
    nearer than half of the interval between poses, as in model_evaluator."""
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


def make_sequence(folder, step, work):
    common = sorted(p.name for p in (folder / "rgb2").iterdir()
                    if (folder / "rgb" / p.name).exists())[::step]
    if not common:
        raise SystemExit(f"{folder} has no stereo images of equal names")
    names, lines = [], []
    for camera, calibration in CAMERAS.items():
        width, height = experiments.png_size(folder / camera / common[0])
        params = " ".join(map(repr, read_numbers(folder / calibration)))
        lines.append(f"{camera} PINHOLE {width} {height} {params}")
        names += [f"{camera}/{name}" for name in common]
    rig = work / folder.name / "rig"
    rig.mkdir(parents=True, exist_ok=True)
    # It maps camera 2 to camera 1, which is the body here.
    values = read_numbers(folder / "extrinsics_1_2.txt")
    write_sensor(rig / "rgb.yaml", [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0],
                                    [0.0, 0.0, 1.0, 0.0]])
    write_sensor(rig / "rgb2.yaml", [values[4 * i:4 * i + 4]
                                     for i in range(3)])
    truth = folder / "groundtruth.txt"
    left = [n for n in names if n.startswith("rgb/")]
    return experiments.Sequence(
        folder.name, image_path=folder, image_list=names, camera_lines=lines,
        mapper_options=["--BundleAdjustment.refine_focal_length", "no",
                        "--BundleAdjustment.refine_extra_params", "no"],
        truth=["--gt_path", truth, "--gt_format", "tum", "--calib_path",
               f"{rig / 'rgb.yaml'},{rig / 'rgb2.yaml'}"],
        truth_positions=lambda: read_tum(truth, left))


def main():
    parser = experiments.argument_parser(
        __doc__, "build/experiments/eth3d_slam")
    parser.add_argument("--frame_step", type=experiments.positive(int),
                        default=1)
    arguments = parser.parse_args()
    root = pathlib.Path(arguments.root)
    training = root / "training" if (root / "training").is_dir() else root
    folders = sorted(p for p in training.iterdir()
                     if (p / "rgb2").is_dir()
                     and (p / "groundtruth.txt").exists())
    if arguments.sequences:
        folders = [training / n
                   for n in experiments.words_of(arguments.sequences)]
    _, num_failed = experiments.run(
        arguments,
        [make_sequence(folder, arguments.frame_step,
                       pathlib.Path(arguments.work)) for folder in folders],
        "ETH3D-SLAM")
    experiments.end(num_failed)


if __name__ == "__main__":
    experiments.call(main)
