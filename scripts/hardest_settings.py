# SPDX-License-Identifier: BSD-3-Clause
"""Methods where it is hardest, over several seeds; see hardest_settings.sh."""
import pathlib
import subprocess

import experiment_tables
import experiments
import kitti_odometry

FEW = ["--max_num_features", "200", "--mismatch_ratio", "0.3",
       "--isolated_wrong_pair_ratio", "0.03"]
# Rig, sequence, every how many frames, further options of mgsfm simulate.
SETTINGS = {
    "stereo_01": ("stereo", "01", 1, []),
    "stereo_01_few": ("stereo", "01", 1, FEW),
    # Drives without loops.
    "kitti360_01": ("kitti360", "01", 2, []),
    "kitti360_03": ("kitti360", "03", 2, []),
    "kitti360_04": ("kitti360", "04", 2, []),
    "kitti360_10": ("kitti360", "10", 2, []),
}


def run_name(setting, seed):
    return f"{setting}_{seed}"


def simulate(program, data, trees, setting, seed):
    rig, name, frame_step, options = SETTINGS[setting]
    tree = trees / run_name(setting, seed)
    subprocess.run(
        [experiments.REPOSITORY / "scripts/make_kitti_tree.sh", data, str(tree), "--sequences", name,
         "--rig", rig, "--frame_step", str(frame_step), "--program",
         str(program), "--",
         "--random_seed", str(seed), *options], check=True)
    sequence = kitti_odometry.simulated(tree / "sequences" / name)
    sequence.name = run_name(setting, seed)
    return sequence


def main():
    parser = experiments.argument_parser(
        __doc__, "build/experiments/hardest_settings")
    parser.set_defaults(methods="mgsfm,dmra_mgp,mma", no_pictures=True)
    parser.add_argument("--seeds", type=experiments.positive(int), default=8,
                        help="drives of each setting, with seeds from 0")
    arguments = parser.parse_args()
    settings = experiments.words_of(arguments.sequences) or list(SETTINGS)
    for setting in settings:
        if setting not in SETTINGS:
            raise SystemExit(f"unknown setting '{setting}'; there are "
                             + ", ".join(SETTINGS))
    methods = experiments.choose_methods(arguments.methods,
                                         experiments.find_external())
    work = pathlib.Path(arguments.work)
    trees = work / "trees"
    sequences = [
        simulate(arguments.program, arguments.root, trees, setting, seed)
        for setting in settings for seed in range(arguments.seeds)
        if not arguments.only_done
        or (trees / run_name(setting, seed)).exists()]
    records, num_failed = experiments.run(arguments, sequences,
                                          "Hardest settings")
    runs = {s: [run_name(s, seed) for seed in range(arguments.seeds)]
            for s in settings}
    experiment_tables.write_tables(
        experiment_tables.over_seeds(records, runs, methods),
        work / "hardest_settings", {"title": "Hardest settings"})
    experiments.end(num_failed)


if __name__ == "__main__":
    experiments.call(main)
