# SPDX-License-Identifier: BSD-3-Clause
"""Compares methods on the hardest simulated drives, over several seeds."""
from experiments import driver, options, paper_tables, tables
from experiments.datasets import simulated_drives

FEW = ["--max_num_features", "200", "--mismatch_ratio", "0.3",
       "--isolated_wrong_pair_ratio", "0.03"]
# Rig, trajectory, frame step, further options of mgsfm simulate.
SETTINGS = {
    "stereo_01": ("stereo", "01", 1, []),
    "stereo_01_few": ("stereo", "01", 1, FEW),
    # Drives without loops.
    "kitti360_01": ("kitti360", "01", 2, []),
    "kitti360_03": ("kitti360", "03", 2, []),
    "kitti360_04": ("kitti360", "04", 2, []),
    "kitti360_10": ("kitti360", "10", 2, []),
}
DESCRIPTION = """\
Compares methods where it is hardest, over several seeds of the noise, because
one drive does not decide which of two methods is better by one percent:
trajectory 01 with the stereo rig, the same with few and wrong features, and the
rig kitti360 without loops.

  python3 -m experiments hardest_settings DATA --sequences stereo_01 --seeds 8

DATA contains kitti_trajectories/01.txt, ...; --sequences names settings:
""" + ", ".join(SETTINGS) + "."


def add_parser(subparsers):
    """The subcommand hardest_settings."""
    parser = options.add_command(
        subparsers, "hardest_settings", run,
        "compare methods on hard simulated drives over several seeds",
        DESCRIPTION)
    options.add_dataset_options(parser, "build/experiments/hardest_settings")
    parser.set_defaults(methods="mgsfm,dmra_mgp,mma", no_pictures=True)
    parser.add_argument("--seeds", type=options.positive(int), default=8,
                        help="drives of each setting, with seeds from 0")


def run(arguments):
    """Simulates the drives, runs the methods, and compares over seeds."""
    settings = options.words_of(arguments.sequences) or list(SETTINGS)
    for setting in settings:
        if setting not in SETTINGS:
            raise SystemExit(f"unknown setting '{setting}'; there are "
                             + ", ".join(SETTINGS))
    plan = driver.prepare(arguments)
    work = plan.settings.work
    trees = work / "trees"
    sequences = [
        simulate(plan.settings.program, arguments.root, trees, setting, seed)
        for setting in settings for seed in range(arguments.seeds)
        if not arguments.only_done
        or (trees / run_name(setting, seed)).exists()]
    results = driver.run(plan, sequences, "Hardest settings")
    runs = {s: [run_name(s, seed) for seed in range(arguments.seeds)]
            for s in settings}
    tables.write(paper_tables.over_seeds(results.records, runs, plan.methods),
                 work / "hardest_settings", {"title": "Hardest settings"})
    results.end()


def run_name(setting, seed):
    """The name of a sequence."""
    return f"{setting}_{seed}"


def simulate(program, data, trees, setting, seed):
    """The sequence of a setting with a seed; it is simulated once."""
    rig, trajectory, frame_step, simulate_options = SETTINGS[setting]
    name = run_name(setting, seed)
    folder = trees / name / "sequences" / trajectory
    simulated_drives.simulate(
        program, data, folder, trajectory,
        ["--rig", rig, "--frame_step", frame_step, "--random_seed", seed,
         *simulate_options])
    sequence = simulated_drives.read_sequence(folder)
    sequence.name = name
    return sequence
