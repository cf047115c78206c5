# SPDX-License-Identifier: BSD-3-Clause
"""Known rigs, cameras without baseline, and a second rig."""
import json
import math
import re

from experiments import poses
from experiments.use_cases.workbench import (kitti_truth, position,
                                             registered_and_position,
                                             reprojection)

KITTI_BASELINE_M = 0.537150653


def known_rig(bench):
    """Rigs whose extrinsics are given."""
    rows = [simulated_rig(bench)]
    if bench.recorded("kitti06_stereo"):
        rows += kitti_rig(bench, bench.recorded("kitti06_stereo"))
    if bench.recorded("euroc_v101_stereo"):
        rows += euroc_rig(bench, bench.recorded("euroc_v101_stereo"))
    return rows


def simulated_rig(bench):
    """The same drive with and without the extrinsics in the database."""
    drive = ["--preset", "standard", "--rig", "stereo", "--num_frames", "60"]
    bench.simulate("rig_unknown", *drive)
    bench.simulate("rig_known", *drive, "--extrinsics_are_known", "1",
                   "--database_schema", "3.12")
    errors = []
    for name in ("rig_unknown", "rig_known"):
        bench.map(f"{name}/map", bench.output / name / "database.db")
        errors.append(bench.errors(
            f"{name}/map", "--gt_path", bench.output / name / "truth",
            "--alignment", "rigid"))
    return ("known rig, simulated stereo", "position, mean, rigid alignment",
            position(errors[0], 3), position(errors[1], 3))


def kitti_rig(bench, kitti):
    """The recorded stereo rig with its calibrated baseline."""
    config = bench.output / "kitti_rig.json"
    write_stereo_rig(config, [1, 0, 0, 0], [-KITTI_BASELINE_M, 0, 0])
    bench.map("kitti_unknown", kitti / "database.db")
    bench.map("kitti_known", kitti / "database.db",
              "--rig_config_path", config)
    truth = kitti_truth(kitti)
    rigid = [bench.errors(name, *truth, "--alignment", "rigid")
             for name in ("kitti_unknown", "kitti_known")]
    shares = [100 * e["position_m"]["mean"] / e["path_m"] for e in rigid]
    scale = bench.errors("kitti_known", *truth)["world_from_model"]["scale"]
    case = "known rig, KITTI 06"
    return [(case, "position, mean, rigid alignment",
             *[f"{share:.2f} % of the path" for share in shares]),
            (case, "scale", "arbitrary", f"{100 * (1 / scale - 1):+.2f} %")]


def euroc_rig(bench, euroc):
    """The recorded stereo rig with the poses of its calibration."""
    config = bench.output / "euroc_rig.json"
    write_euroc_rig(config, euroc)
    bench.map("euroc_unknown", euroc / "database.db")
    bench.map("euroc_known", euroc / "database.db", "--rig_config_path", config)
    truth = ["--gt_format", "rig", "--calib_path",
             f"{euroc / 'sensor0.yaml'},{euroc / 'sensor1.yaml'}"]
    names = ("euroc_unknown", "euroc_known")
    directions = [bench.errors(name, *truth)["sensors"][0]["direction_deg"]
                  for name in names]
    case = "known rig, EuRoC V1_01"
    return [(case, "direction of the baseline",
             *[f"{direction:.3f} deg" for direction in directions]),
            (case, "reprojection error, mean",
             *[reprojection(bench.report(name)) for name in names])]


def write_stereo_rig(path, rotation, translation):
    """A rig_config.json of cam0 and cam1; cam_from_rig of cam1 as quaternion
    and meters."""
    path.write_text(json.dumps([{"cameras": [
        {"image_prefix": "cam0/", "ref_sensor": True},
        {"image_prefix": "cam1/", "cam_from_rig_rotation": list(rotation),
         "cam_from_rig_translation": list(translation)}]}]))


def write_euroc_rig(path, euroc):
    """The rig_config.json of EuRoC, which has both poses in the body."""
    body_from_cam = []
    for k in range(2):
        text = (euroc / f"sensor{k}.yaml").read_text()
        numbers = re.search(r"data: \[([^\]]*)\]", text).group(1)
        values = [float(x) for x in numbers.split(",")]
        body_from_cam.append([values[4 * i:4 * i + 4] for i in range(4)])
    r, t = poses.inverse(body_from_cam[1])
    cam1_from_body = [[*row, x] for row, x in zip(r, t)] + [[0, 0, 0, 1]]
    cam1_from_cam0 = poses.product(cam1_from_body, body_from_cam[0])
    write_stereo_rig(path, poses.quaternion_from_rotation(cam1_from_cam0),
                     [row[3] for row in cam1_from_cam0[:3]])


def panorama(bench):
    """Cameras that share a center, mapped as single images and as a rig."""
    config = bench.output / "panorama_rig.json"
    pinhole = {"camera_model_name": "PINHOLE",
               "camera_params": [400, 400, 320, 240]}
    config.write_text(json.dumps([{"cameras": [
        {"image_prefix": "cam0/", "ref_sensor": True, **pinhole},
        {"image_prefix": "cam1/",
         "cam_from_rig_rotation": [0.866025404, 0, 0.5, 0],
         "cam_from_rig_translation": [0, 0, 0], **pinhole},
        {"image_prefix": "cam2/",
         "cam_from_rig_rotation": [0.866025404, 0, -0.5, 0],
         "cam_from_rig_translation": [0, 0, 0],
         "camera_model_name": "EQUIRECTANGULAR",
         "camera_params": [1600, 800]}]}]))
    drive = bench.simulate("panorama", "--preset", "standard", "--num_frames",
                           "60", "--rig_config_path", config)
    single = ["--rig_name_rule", "none"]
    bench.map("panorama/single", drive / "database.db", *single)
    bench.map("panorama/rig", drive / "database.db")
    truth = ["--gt_path", drive / "truth"]
    cells = []
    for errors in (bench.errors("panorama/single", *truth, *single),
                   bench.errors("panorama/rig", *truth)):
        cells.append(f"{position(errors, 3)}, {errors['num_registered']} of "
                     f"{errors['num_images']}")
    return [("cameras that share a center, one EQUIRECTANGULAR; without: no "
             "rig", "position, mean; registered", *cells)]


# Two rigs of two cameras; the second is wider and tilted, and counts as another
# vehicle on the same road.
TWO_RIGS = {"all": [[0, 1, 2, 3]], "first": [[0, 1]], "both": [[0, 1], [2, 3]]}


def tilt(x, y):
    """The quaternion of a rotation about x, then y (radians)."""
    cx, sx, cy, sy = (f(angle / 2) for angle in (x, y)
                      for f in (math.cos, math.sin))
    return [cx * cy, sx * cy, cx * sy, sx * sy]


def write_two_rigs(path, rigs, with_poses):
    """A rig_config.json of a member of TWO_RIGS; only simulate needs poses."""
    cam_from_rig = [([1, 0, 0, 0], [0, 0, 0]), ([1, 0, 0, 0], [-0.54, 0, 0]),
                    (tilt(0.05, 0.1), [0.2, 0.3, 0.1]),
                    (tilt(0.05, 0.1), [-0.7, 0.3, 0.1])]

    def camera(i, is_reference):
        entry = {"image_prefix": f"cam{i}/"}
        if is_reference:
            entry["ref_sensor"] = True
        elif with_poses:
            (entry["cam_from_rig_rotation"],
             entry["cam_from_rig_translation"]) = cam_from_rig[i]
        if with_poses:
            f = 700 if i < 2 else 560
            entry["camera_model_name"] = "PINHOLE"
            entry["camera_params"] = [f, f, 620, 188]
        return entry
    path.write_text(json.dumps(
        [{"cameras": [camera(i, i == rig[0]) for i in rig]}
         for rig in TWO_RIGS[rigs]]))


def second_baseline(model, scale):
    """The baseline of the second rig in meters."""
    rigs = json.loads((model / "rig_config.json").read_text())
    t = rigs[1]["cameras"][1]["cam_from_rig_translation"]
    return f"{scale * sum(x * x for x in t) ** 0.5:.3f} m"


def registered_cells(bench, runs, truth, digits):
    """Registered images and position error of each run."""
    return [registered_and_position(bench.errors(run, *truth), digits)
            for run in runs]
