# SPDX-License-Identifier: BSD-3-Clause
"""The experiments on KITTI-360."""
from experiments import colmap_model, driver, options, requirements
from experiments.sequence import FIXED_INTRINSICS, Sequence, png_size

PERSPECTIVE = ("image_00", "image_01")
FISHEYE = ("image_02", "image_03")
DESCRIPTION = """\
Repeats the paper's experiments on KITTI-360 as it is downloaded:

  python3 -m experiments kitti360 ROOT --sequences 0000,0002

ROOT contains data_2d_raw/2013_05_28_drive_0000_sync/image_00/data_rect, ...,
image_03/data_rgb; calibration/; and
data_poses/2013_05_28_drive_0000_sync/cam0_to_world.txt. Masks, if any, are
data_2d_raw/DRIVE/masks/image_00/data_rect/NAME.png.png. Frames with a true pose
are used. COLMAP does not know the model of the fisheye cameras; OPENCV_FISHEYE
is fitted to it, and the difference is printed."""


def add_parser(subparsers):
    """The subcommand kitti360."""
    parser = options.add_command(
        subparsers, "kitti360", run, "run methods on KITTI-360", DESCRIPTION)
    options.add_dataset_options(parser, "build/experiments/kitti360")
    parser.add_argument("--cameras", default=",".join(PERSPECTIVE + FISHEYE),
                        help="separated by commas, the reference camera first")
    parser.add_argument("--frame_step", type=options.positive(int), default=1,
                        help="use every n-th frame with a true pose")


def run(arguments):
    """Runs the methods on all drives."""
    requirements.require("numpy", "the calibrations of KITTI-360")
    from experiments.datasets import kitti360_calibration
    plan = driver.prepare(arguments)
    root = arguments.root
    drives = sorted(p.name for p in (root / "data_2d_raw").iterdir()
                    if p.is_dir())
    if arguments.sequences:
        drives = choose_drives(drives, arguments.sequences)
    calibration = kitti360_calibration.Calibration(
        root / "calibration", PERSPECTIVE, FISHEYE)
    cameras = options.words_of(arguments.cameras)
    sequences = [
        make_sequence(root, drive, cameras, calibration,
                      kitti360_calibration.read_world_from_cam0(
                          root / "data_poses" / drive / "cam0_to_world.txt"),
                      arguments.frame_step, plan.settings.work)
        for drive in drives]
    driver.run(plan, sequences, "KITTI-360").end()


def choose_drives(drives, text):
    """Drives by their names, or by the number in them."""
    chosen = []
    for word in options.words_of(text):
        found = [d for d in drives if word in (d, number_of(d))]
        if not found:
            raise SystemExit(f"no drive '{word}'; there are "
                             + ", ".join(drives))
        chosen += found
    return list(dict.fromkeys(chosen))


def number_of(drive):
    """0000 of 2013_05_28_drive_0000_sync."""
    return drive.split("_")[-2] if "_drive_" in drive else drive


def folder_of(camera):
    """The folder of the images of a camera, in the folder of the drive."""
    return f"{camera}/{'data_rect' if camera in PERSPECTIVE else 'data_rgb'}"


def make_sequence(root, drive, cameras, calibration, world_from_cam0, step,
                  work):
    """A sequence with every `step`-th frame that has a true pose.

    world_from_cam0: {frame number as text: 4 x 4 matrix, meters}.
    """
    images = root / "data_2d_raw" / drive
    files = {f"{int(n):010}.png": world_from_cam0[n]
             for n in sorted(world_from_cam0, key=int)[::step]}
    names, lines = [], []
    for camera in cameras:
        folder = images / folder_of(camera)
        found = [f for f in files if (folder / f).exists()]
        if not found:
            raise SystemExit(f"{folder} has no image with a pose")
        lines.append(f"{folder_of(camera)} " + calibration.camera_text(
            camera, png_size(folder / found[0])))
        names += [f"{folder_of(camera)}/{f}" for f in found]
    name = number_of(drive)
    truth = work / name / "truth"
    colmap_model.write_truth(
        truth, lines,
        {folder_of(c): calibration.cam_from_cam(cameras[0], c)
         for c in cameras},
        {f: pose @ calibration.cam0_from[cameras[0]]
         for f, pose in files.items()})
    masks = images / "masks"
    return Sequence(
        name, image_path=images, image_list=names, camera_lines=lines,
        mask_path=masks if masks.is_dir() else None,
        rig_prefixes=[folder_of(c) + "/" for c in cameras],
        mapper_options=list(FIXED_INTRINSICS), truth=["--gt_path", truth],
        truth_positions=lambda: colmap_model.read_positions(truth))
