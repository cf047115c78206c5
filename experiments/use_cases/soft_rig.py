# SPDX-License-Identifier: BSD-3-Clause
"""Cameras that do not trigger simultaneously."""
from experiments.use_cases.workbench import position, reprojection

DRIVE = ["--preset", "standard", "--rig", "stereo", "--path", "curve",
         "--num_frames", "80"]
MEASURED = "position of images, mean"


def soft_rig(bench):
    """Random trigger jitter, then a constant delay of one camera."""
    rows = []
    for jitter_ms in (20, 50):
        rows += jitter(bench, jitter_ms)
    return rows + late_camera(bench)


def image_errors(bench, name, drive):
    """Errors of images against their own true poses; the true rig is not rigid.
    """
    return bench.errors(name, "--gt_path", drive / "truth_images",
                        "--rig_name_rule", "none")


def jitter(bench, jitter_ms):
    """Each camera triggers up to jitter_ms early or late."""
    name = f"jitter_{jitter_ms}"
    drive = bench.simulate(name, *DRIVE, "--trigger_jitter", jitter_ms)
    bench.map(f"{name}/rigid", drive / "database.db")
    bench.map(f"{name}/soft", drive / "database.db",
              "--SoftRig.method", "soft")
    names = (f"{name}/rigid", f"{name}/soft")
    return [(f"cameras trigger up to {jitter_ms} ms early or late, at 10 m/s; "
             "with: soft", MEASURED,
             *[position(image_errors(bench, n, drive), 3) for n in names]),
            ("the same", "reprojection error, mean",
             *[reprojection(bench.report(n)) for n in names])]


def late_camera(bench):
    """One camera triggers 30 ms late in all frames."""
    drive = bench.simulate("late", *DRIVE, "--trigger_offset", "30")
    bench.map("late/rigid", drive / "database.db")
    bench.map("late/offset", drive / "database.db",
              "--SoftRig.method", "time_offset",
              "--image_timestamps_path", drive / "timestamps.txt")
    return [("one camera 30 ms late, at 10 m/s; with: time_offset", MEASURED,
             *[position(image_errors(bench, n, drive), 3)
               for n in ("late/rigid", "late/offset")]),
            ("the same", "time offset, standard deviation", "none",
             offset(bench.report("late/offset")))]


def offset(report):
    """The time offset of the second sensor, and its standard deviation."""
    sensor = report["models"][0]["soft_rig"]["sensors"][1]
    return (f"{1e3 * sensor['time_offset_s']:.2f} ms, "
            f"{1e3 * sensor['time_offset_sigma_s']:.2f} ms")
