# SPDX-License-Identifier: BSD-3-Clause
"""The subcommand use_cases: a table of all cases."""
import pathlib

from experiments import options, tables
from experiments.use_cases import (calibration, extension, priors, rigs,
                                   soft_rig)
from experiments.use_cases.workbench import Workbench

CASES = {
    "known_rig": rigs.known_rig,
    "positions": priors.positions,
    "drift": priors.drift,
    "gap": priors.gap,
    "gravity": priors.gravity,
    "covariances": calibration.covariances,
    "focal_lengths": calibration.focal_lengths,
    "panorama": rigs.panorama,
    "model_extension": extension.model_extension,
    "soft_rig": soft_rig.soft_rig,
    "portability": calibration.portability,
}
HEADER = ["case", "measured", "without", "with"]
DESCRIPTION = """\
Prints the benefit of prior knowledge beside images: one row for each case, with
an error without and with it. Drives are simulated with seed 0. Finished runs in
the output folder are reused.

  python3 -m experiments use_cases gravity gap

DATA contains kitti06_stereo/ and euroc_v101_stereo/; what is absent is skipped.
Cases: """ + ", ".join(CASES) + "."


def add_parser(subparsers):
    """The subcommand use_cases."""
    parser = options.add_command(
        subparsers, "use_cases", run,
        "accuracy with and without known rigs, GPS, gravity, ...", DESCRIPTION)
    parser.add_argument("cases", nargs="*", metavar="CASE",
                        help="all if there is none")
    parser.add_argument("--data", type=pathlib.Path,
                        default=options.shared_data(),
                        help="folder of recorded data")
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/use_cases",
                        help="folder of results; finished runs are reused")
    options.add_program(parser)


def run(arguments):
    """Runs the cases, and prints the rows of each when it ends."""
    for case in arguments.cases:
        if case not in CASES:
            raise SystemExit(f"unknown case '{case}'; there are "
                             + ", ".join(CASES))
    arguments.output.mkdir(parents=True, exist_ok=True)
    bench = Workbench(options.find_program(arguments.program),
                      arguments.output.resolve(), arguments.data.resolve())
    print(tables.markdown_table(HEADER, []), end="", flush=True)
    for case in arguments.cases or CASES:
        for row in CASES[case](bench):
            print("| " + " | ".join(row) + " |", flush=True)
