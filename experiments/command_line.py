# SPDX-License-Identifier: BSD-3-Clause
"""The subcommands of `python3 -m experiments`."""
import argparse
import signal
import subprocess
import sys

from experiments.datasets import (eth3d_slam, hardest_settings, kitti360,
                                  kitti_odometry, simulated_drives)
from experiments.studies import (bench, drive_bounds, front_end, growth,
                                 hard_drives, inconsistent_input, lenses,
                                 oracle_table, robustness, sub_maps, worlds)
from experiments.use_cases import study

# Each has add_parser(subparsers).
COMMANDS = (kitti_odometry, kitti360, eth3d_slam, simulated_drives,
            hardest_settings, hard_drives, drive_bounds, oracle_table,
            robustness, growth, sub_maps, bench, front_end, inconsistent_input,
            worlds, lenses, study)
DESCRIPTION = """\
Runs mgsfm and other methods on data sets, and writes tables and figures. Call
it from the root of the repository, after scripts/build.sh release. Figures need
Debian's python3-matplotlib. experiments/README.md has an example of each."""


def make_parser():
    """The parser of all subcommands."""
    parser = argparse.ArgumentParser(
        prog="python3 -m experiments", description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    subparsers = parser.add_subparsers(metavar="SUBCOMMAND", required=True)
    for command in COMMANDS:
        command.add_parser(subparsers)
    return parser


def parse(values):
    """The arguments; words behind "--" go to `passed_on`."""
    end = values.index("--") if "--" in values else len(values)
    parser = make_parser()
    arguments = parser.parse_args(values[:end])
    arguments.passed_on = values[end + 1:]
    if arguments.passed_on and not arguments.takes_passed_on:
        parser.error("this subcommand takes no arguments behind --")
    return arguments


def main():
    """Runs a subcommand; a missing file or a failed program is one line."""
    # An exception, so that running programs are ended, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    arguments = parse(sys.argv[1:])
    try:
        arguments.run(arguments)
    except OSError as error:
        if error.filename is None:
            raise
        raise SystemExit(f"{error.filename}: {error.strerror}") from None
    except subprocess.CalledProcessError as error:
        command = " ".join(map(str, error.cmd))
        raise SystemExit(f"exit code {error.returncode}: {command}") from None
