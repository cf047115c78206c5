# SPDX-License-Identifier: BSD-3-Clause
"""Wrong focal lengths, covariances, and runs on other processors."""
import json

from experiments import colmap_database
from experiments.use_cases.workbench import position

KITTI_FOCAL_LENGTHS_PX = (707.0912, 707.0912)
PORTABLE = {"MGSFM_PORTABLE": "1",
            "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
            "OPENBLAS_CORETYPE": "PRESCOTT"}
NOT_CALIBRATED = ["--FocalLengths.calibrate", "0"]
WORST_FOCAL = "focal length, worst, after bundle adjustment"


def covariances(bench):
    """The standard deviation of sensor_from_rig against its error."""
    drive = bench.simulate("covariance", "--preset", "street", "--pixel_noise",
                           "0.7", "--rig", "stereo", "--num_frames", "40")
    bench.map("covariance/map", drive / "database.db",
              "--compute_covariances", "1")
    errors = bench.errors("covariance/map", "--gt_path", drive / "truth")
    rig = bench.report("covariance/map")["models"][0]["rigs"][0]
    sigma_deg = sum(x * x for sensor in rig["sensors"]
                    if not sensor["is_reference"]
                    for x in sensor["sigma"]["rotations_deg"]) ** 0.5
    return [("covariances, simulated stereo",
             "rotation in the rig: error, sigma",
             f"{errors['sensors'][0]['rotation_deg']:.4f} deg",
             f"{sigma_deg:.4f} deg")]


def focal_lengths(bench):
    """Focal lengths that are wrong and not trusted."""
    rows = simulated_focal_lengths(bench)
    if bench.recorded("kitti06_stereo"):
        rows += kitti_focal_lengths(bench, bench.recorded("kitti06_stereo"))
    return rows


def simulated_focal_lengths(bench):
    """Twice too long, on a drive that turns."""
    drive = bench.simulate("focal", "--preset", "standard", "--rig", "stereo",
                           "--path", "loop", "--num_frames", "60")
    wrong = drive / "wrong.db"
    colmap_database.scale_focal_lengths(drive / "database.db", wrong, 2,
                                        is_prior=False)
    bench.map("focal/without", wrong, *NOT_CALIBRATED)
    bench.map("focal/with", wrong)
    true_px = focal_lengths_of(drive / "truth")
    names = ("focal/without", "focal/with")
    case = "focal lengths twice too long, not trusted, simulated loop"
    return [(case, WORST_FOCAL,
             *[worst_focal(bench.output / name / "0", true_px)
               for name in names]),
            (case, "position, mean",
             *[position(bench.errors(name, "--gt_path", drive / "truth"), 3)
               for name in names])]


def kitti_focal_lengths(bench, kitti):
    """20 % too long, on a straight drive that cannot determine them."""
    wrong = bench.output / "kitti_wrong.db"
    colmap_database.scale_focal_lengths(kitti / "database.db", wrong, 1.2,
                                        is_prior=False)
    bench.map("kitti_focal_without", wrong, *NOT_CALIBRATED)
    bench.map("kitti_focal_with", wrong)
    report = bench.report("kitti_focal_with")
    sigma = report["models"][0]["lenses"][0]["relative_sigma"]
    return [("focal lengths 20 % wrong, not trusted, KITTI 06", WORST_FOCAL,
             *[worst_focal(bench.output / name / "0", KITTI_FOCAL_LENGTHS_PX)
               for name in ("kitti_focal_without", "kitti_focal_with")]),
            ("the same", "message in the report", "nothing",
             report["focal_lengths"][0]["message"] or "found"),
            ("the same", "relative standard deviation after bundle adjustment",
             "-", f"{sigma:.3f}")]


def focal_lengths_of(model):
    """The first focal length of each camera in pixels."""
    rigs = json.loads((model / "rig_config.json").read_text())
    return [camera["camera_params"][0] for camera in rigs[0]["cameras"]]


def worst_focal(model, true_px):
    """The largest relative error of the focal lengths."""
    errors = [100 * abs(f / true - 1)
              for f, true in zip(focal_lengths_of(model), true_px)]
    return f"{max(errors):.2f} %"


def portability(bench):
    """The same run with and without AVX2 and FMA."""
    drive = bench.simulate("portable", "--preset", "standard", "--rig",
                           "stereo", "--num_frames", "60")
    bench.map("portable/fast", drive / "database.db")
    bench.map("portable/portable", drive / "database.db", environment=PORTABLE)
    errors = bench.errors("portable/portable", "--gt_path", drive / "fast/0",
                          "--alignment", "none")
    return [("the same database with and without AVX2 and FMA, path of "
             f"{errors['path_m']:.0f} units",
             "difference of positions, of rotations, largest", "-",
             f"{errors['position_m']['max']:.1e}, "
             f"{errors['rotation_deg']['max']:.1e} deg")]
