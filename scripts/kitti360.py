# SPDX-License-Identifier: BSD-3-Clause
"""The experiments on KITTI-360; see kitti360.sh."""
import pathlib

import numpy as np

import experiments
import mei_camera

PERSPECTIVE = ("image_00", "image_01")
FISHEYE = ("image_02", "image_03")


def folder_of(camera):
    return f"{camera}/{'data_rect' if camera in PERSPECTIVE else 'data_rgb'}"


def read_matrices(path, rows):
    """{first word without colon: matrix of so many rows}, 4 x 4 if it fits."""
    matrices = {}
    for line in path.read_text().splitlines():
        words = line.split()
        try:
            values = list(map(float, words[1:]))
        except ValueError:
            continue
        if len(values) % rows or len(values) < rows * 3:
            continue
        matrix = np.array(values).reshape(rows, -1)
        if matrix.shape == (3, 4):
            matrix = np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]])
        matrices[words[0].rstrip(":")] = matrix
    return matrices


class Calibration:
    """Cameras as COLMAP has them, and cam0_from_cam of the rectified ones."""

    def __init__(self, folder):
        pose_from_cam = read_matrices(folder / "calib_cam_to_pose.txt", 3)
        perspective = read_matrices(folder / "perspective.txt", 3)
        pose_from = {}
        for k, camera in enumerate(PERSPECTIVE):
            rectified = np.eye(4)
            rectified[:3, :3] = perspective[f"R_rect_{k:02}"]
            pose_from[camera] = pose_from_cam[camera] @ rectified.T
        for camera in FISHEYE:
            pose_from[camera] = pose_from_cam[camera]
        self.cam0_from = {
            camera: np.linalg.inv(pose_from[PERSPECTIVE[0]]) @ pose
            for camera, pose in pose_from.items()}
        self.params = {}
        for k, camera in enumerate(PERSPECTIVE):
            p = perspective[f"P_rect_{k:02}"]
            self.params[camera] = ("PINHOLE",
                                   [p[0, 0], p[1, 1], p[0, 2], p[1, 2]])
        for camera in FISHEYE:
            fitted, rms, largest = mei_camera.fit_fisheye(
                mei_camera.read_mei(folder / f"{camera}.yaml"))
            print(f"{camera}: OPENCV_FISHEYE differs from the calibration by "
                  f"{rms:.3f} px (root mean square), {largest:.3f} px at most, "
                  "up to 95 deg from the axis")
            self.params[camera] = ("OPENCV_FISHEYE", list(fitted))

    def line(self, camera, size):
        model, params = self.params[camera]
        return (f"{folder_of(camera)} {model} {size[0]} {size[1]} "
                + " ".join(repr(float(p)) for p in params))


def choose_drives(drives, text):
    """By their names, or by the number in them."""
    chosen = []
    for word in experiments.words_of(text):
        found = [d for d in drives if word in (d, number_of(d))]
        if not found:
            raise SystemExit(f"no drive '{word}'; there are "
                             + ", ".join(drives))
        chosen += found
    return list(dict.fromkeys(chosen))


def number_of(drive):
    """0000 of 2013_05_28_drive_0000_sync."""
    return drive.split("_")[-2] if "_drive_" in drive else drive


def make_sequence(root, drive, cameras, calibration, step, work):
    images = root / "data_2d_raw" / drive
    poses = read_matrices(
        root / "data_poses" / drive / "cam0_to_world.txt", 4)
    numbers = sorted(poses, key=int)[::step]
    names, lines = [], []
    files = [f"{int(n):010}.png" for n in numbers]
    for camera in cameras:
        folder = images / folder_of(camera)
        found = [f for f in files if (folder / f).exists()]
        if not found:
            raise SystemExit(f"{folder} has no image with a pose")
        lines.append(calibration.line(
            camera, experiments.png_size(folder / found[0])))
        names += [f"{folder_of(camera)}/{f}" for f in found]
    reference_from_cam0 = np.linalg.inv(calibration.cam0_from[cameras[0]])
    name = number_of(drive)
    folder = work / name / "truth"
    experiments.write_truth(
        folder, lines,
        {folder_of(c): reference_from_cam0 @ calibration.cam0_from[c]
         for c in cameras},
        {f: poses[n] @ calibration.cam0_from[cameras[0]]
         for f, n in zip(files, numbers)})
    masks = images / "masks"
    return experiments.Sequence(
        name, image_path=images, image_list=names, camera_lines=lines,
        mask_path=masks if masks.is_dir() else None,
        rig_prefixes=[folder_of(c) + "/" for c in cameras],
        mapper_options=["--BundleAdjustment.refine_focal_length", "no",
                        "--BundleAdjustment.refine_extra_params", "no"],
        truth=["--gt_path", folder],
        truth_positions=lambda: experiments.read_positions(folder))


def main():
    parser = experiments.argument_parser(
        __doc__, "build/experiments/kitti360")
    parser.add_argument("--cameras", default=",".join(PERSPECTIVE + FISHEYE))
    parser.add_argument("--frame_step", type=experiments.positive(int),
                        default=1,
                        help="of the frames with a true pose")
    arguments = parser.parse_args()
    root = pathlib.Path(arguments.root)
    drives = sorted(p.name for p in (root / "data_2d_raw").iterdir()
                    if p.is_dir())
    if arguments.sequences:
        drives = choose_drives(drives, arguments.sequences)
    calibration = Calibration(root / "calibration")
    cameras = experiments.words_of(arguments.cameras)
    _, num_failed = experiments.run(
        arguments,
        [make_sequence(root, drive, cameras, calibration, arguments.frame_step,
                       pathlib.Path(arguments.work)) for drive in drives],
        "KITTI-360")
    experiments.end(num_failed)


if __name__ == "__main__":
    experiments.call(main)
