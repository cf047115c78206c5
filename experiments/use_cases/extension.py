# SPDX-License-Identifier: BSD-3-Clause
"""Images that are added to an existing model."""
from experiments import colmap_database
from experiments.use_cases import rigs
from experiments.use_cases.workbench import kitti_truth

KITTI_HALF = 26  # of 51 frames
MEASURED = "registered; position, mean"


def model_extension(bench):
    """A second rig, and the second half of a recorded drive."""
    rows = second_rig(bench)
    if bench.recorded("kitti06_stereo"):
        rows += second_half(bench, bench.recorded("kitti06_stereo"))
    return rows


def second_rig(bench):
    """A second rig joins the model of the first."""
    config = {name: bench.output / f"two_rigs.{name}.json"
              for name in rigs.TWO_RIGS}
    for name, path in config.items():
        rigs.write_two_rigs(path, name, with_poses=name == "all")
    drive = bench.simulate("extension", "--preset", "standard", "--num_frames",
                           "60", "--rig_config_path", config["all"])
    database = drive / "database.db"
    first = write_list(bench.output / "first_rig.txt", database,
                       lambda name: name[:4] in ("cam0", "cam1"))
    bench.map("extension/first", database, "--image_list_path", first,
              "--rig_config_path", config["first"])
    bench.map("extension/both", database,
              "--input_path", drive / "first/0",
              "--rig_config_path", config["both"])
    bench.map("extension/at_once", database, "--rig_config_path",
              config["both"])
    truth = ["--gt_path", drive / "truth"]
    before, at_once, after = rigs.registered_cells(
        bench, ("extension/first", "extension/at_once", "extension/both"),
        truth, 3)
    scale = bench.errors("extension/both", *truth)["world_from_model"]["scale"]
    return [("a second rig joins the model of the first, simulated", MEASURED,
             before, after),
            ("the same; without: both mapped at once", MEASURED, at_once,
             after),
            ("the same", "baseline of the second rig, true 0.900 m", "-",
             rigs.second_baseline(drive / "both/0", scale))]


def second_half(bench, kitti):
    """The second half of a drive joins the model of the first half."""
    database = kitti / "database.db"
    half = write_list(
        bench.output / "kitti_half.txt", database,
        lambda name: colmap_database.frame_number(name) < KITTI_HALF)
    bench.map("kitti_half", database, "--image_list_path", half)
    bench.map("kitti_extended", database,
              "--input_path", bench.output / "kitti_half/0")
    bench.map("kitti_unknown", database)
    before, at_once, after = rigs.registered_cells(
        bench, ("kitti_half", "kitti_unknown", "kitti_extended"),
        kitti_truth(kitti), 4)
    return [("KITTI 06 in two halves, the second added to the first", MEASURED,
             before, after),
            ("the same; without: all mapped at once", MEASURED, at_once,
             after)]


def write_list(path, database, belongs):
    """Writes the names of images for --image_list_path."""
    path.write_text("".join(f"{name}\n" for name in
                            colmap_database.image_names(database, belongs)))
    return path
