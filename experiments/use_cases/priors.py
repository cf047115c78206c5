# SPDX-License-Identifier: BSD-3-Clause
"""Measured positions and gravity."""
from experiments import colmap_database
from experiments.use_cases.workbench import position

GPS = ["--prior_sigma", "0.5", "--prior_outlier_ratio", "0.1"]
USE_POSITIONS = ["--use_prior_position", "1"]


def map_both(bench, name, database, *prior_options):
    """Maps a database into NAME/without, and with the prior into NAME/with."""
    bench.map(f"{name}/without", database)
    bench.map(f"{name}/with", database, *prior_options)


def position_errors(bench, name):
    """Position errors: aligned with the truth without the prior, not aligned
    with it."""
    truth = ["--gt_path", bench.output / name / "truth"]
    return [position(bench.errors(f"{name}/without", *truth)),
            position(bench.errors(f"{name}/with", *truth,
                                  "--alignment", "none"))]


def outliers(priors):
    """The number of rejected priors, of all."""
    return f"{len(priors['outliers'])} of {priors['num_priors']}"


def largest_shift(priors):
    """The largest shift of a frame by the pose-graph deformation."""
    deformation = priors["deformation"]
    return f"{deformation['max_shift']:.1f} m" if deformation else "none"


def positions_of(bench, name):
    """The entry on position priors in the report of the first model."""
    return bench.report(f"{name}/with")["models"][0]["position_priors"]


def positions(bench):
    """GPS of 1 m with gross outliers."""
    drive = bench.simulate(
        "gps", "--preset", "standard", "--rig", "mono", "--num_frames", "300",
        "--path", "curve", "--prior_sigma", "1", "--prior_outlier_ratio", "0.1")
    map_both(bench, "gps", drive / "database.db", *USE_POSITIONS)
    return [("GPS of 1 m, 10 % gross outliers, simulated",
             "position, mean; with: not aligned",
             *position_errors(bench, "gps")),
            ("the same", "outliers found", "-",
             outliers(positions_of(bench, "gps")))]


def drift(bench):
    """GPS, and focal lengths 3 % too long, which make all turns too short."""
    drive = bench.simulate("drift", "--preset", "standard", "--rig", "mono",
                           "--num_frames", "400", "--path", "curve", *GPS)
    wrong = drive / "wrong.db"
    colmap_database.scale_focal_lengths(drive / "database.db", wrong, 1.03,
                                        is_prior=True)
    map_both(bench, "drift", wrong, *USE_POSITIONS)
    found = positions_of(bench, "drift")
    return [("GPS of 0.5 m, 10 % gross outliers; intrinsics 3 % wrong and "
             "fixed", "position, mean; with: not aligned",
             *position_errors(bench, "drift")),
            ("the same", "outliers found; largest shift of the deformation",
             "-", f"{outliers(found)}; {largest_shift(found)}")]


def gap(bench):
    """GPS across a gap without matches: two models in one world."""
    drive = bench.simulate("gap", "--preset", "standard", "--rig", "stereo",
                           "--num_frames", "120", "--path", "curve", *GPS)
    parted = drive / "parted.db"
    colmap_database.remove_frames(drive / "database.db", parted, 55, 64)
    map_both(bench, "gap", parted, *USE_POSITIONS)
    cells = [", ".join(
        position(bench.errors(f"gap/{name}", "--gt_path", drive / "truth",
                              "--alignment", "none", model=model))
        for model in ("0", "1")) for name in ("without", "with")]
    return [("GPS of 0.5 m, 10 % gross outliers; a gap of 10 frames, two "
             "models", "position, mean, of each, not aligned", *cells)]


def gravity(bench):
    """Gravity, with few features and noisy keypoints."""
    drive = bench.simulate(
        "gravity", "--preset", "standard", "--rig", "mono", "--num_frames",
        "300", "--path", "curve", "--max_num_features", "150",
        "--num_matched_frames", "3", "--pixel_noise", "2", "--gravity_sigma",
        "0.5", "--gravity_outlier_ratio", "0.1")
    map_both(bench, "gravity", drive / "database.db", "--gravity_path",
             drive / "gravity.txt")
    rotations = [bench.errors(f"gravity/{name}", "--gt_path", drive / "truth")[
        "rotation_deg"]["mean"] for name in ("without", "with")]
    found = bench.report("gravity/with")["models"][0]["gravity"]
    return [("gravity of 0.5 deg, 10 % gross outliers; few and weak pairs",
             "rotation, mean", *[f"{r:.2f} deg" for r in rotations]),
            ("the same", "outliers found", "-", outliers(found))]
