# SPDX-License-Identifier: BSD-3-Clause
"""Command-line options that subcommands share."""
import argparse
import os
import pathlib
import shutil

REPOSITORY = pathlib.Path(__file__).resolve().parents[1]
PROGRAM = REPOSITORY / "build/release/apps/mgsfm/mgsfm"
ORACLE_BENCHMARK = REPOSITORY / "build/release/bench/mgsfm_oracle_benchmark"
SOLVER_BENCHMARK = REPOSITORY / "build/release/bench/mgsfm_solver_benchmark"


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter,
                    argparse.RawDescriptionHelpFormatter):
    """Keeps the lines of a description, and appends defaults to help texts."""

    def _get_help_string(self, action):
        default = action.default
        if default in (None, "", False) or default == [] or not action.help:
            return action.help
        if isinstance(default, pathlib.Path) and default.is_relative_to(
                REPOSITORY):
            return f"{action.help} (default: {default.relative_to(REPOSITORY)})"
        return super()._get_help_string(action)


def add_command(subparsers, name, run, help_line, description=None):
    """A subcommand; `run` takes the parsed arguments."""
    parser = subparsers.add_parser(
        name, help=help_line, formatter_class=HelpFormatter,
        description=description or help_line)
    parser.set_defaults(run=run, takes_passed_on=False)
    return parser


def shared_data():
    """The folder of recorded data that tests and studies look for."""
    return pathlib.Path(os.environ.get("MGSFM_SHARED_DATA")
                        or REPOSITORY.parent / "shared/data")


def words_of(text):
    """The words of a list separated by commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def positive(kind):
    """A parser for argparse: a positive number of type `kind`."""
    def parse(text):
        value = kind(text)
        if not value > 0:
            raise argparse.ArgumentTypeError(f"{text} is not positive")
        return value
    parse.__name__ = kind.__name__
    return parse


def add_program(parser, default=PROGRAM, option="--program"):
    """The path of a program of this repository."""
    parser.add_argument(option, default=default, type=pathlib.Path,
                        help=f"the program {default.name}")


def find_program(path):
    """The absolute path of a program; ends with one line if it is missing."""
    build = "scripts/build.sh release"
    if path.name.endswith("_benchmark"):
        build = f"cmake --preset release -DMGSFM_BUILD_BENCHMARKS=ON && {build}"
    # A bare name is looked up in PATH only if there is no such file.
    found = path.resolve() if path.exists() else shutil.which(path)
    if found is None or shutil.which(found) is None:
        raise SystemExit(f"no program {path}; build it with '{build}', or name "
                         "another (see --help)")
    return pathlib.Path(found)


def add_threads(parser, default=None):
    """--threads, by default all processors."""
    parser.add_argument("--threads", type=positive(int),
                        default=default or os.cpu_count(),
                        help="threads of each program")


def add_study(parser, name):
    """Options that the studies on simulated scenes share."""
    parser.add_argument("--simulate_options", default="",
                        help="further options of mgsfm simulate, in one word")
    parser.add_argument("--output", type=pathlib.Path,
                        default=REPOSITORY / "build" / name,
                        help="folder of results")
    add_threads(parser, 1)
    add_program(parser)


def add_dataset_options(parser, work):
    """The options that all drivers of data sets share.

    work: the default folder of results, relative to the repository.
    """
    parser.add_argument("root", type=pathlib.Path,
                        help="folder of the data set")
    parser.add_argument("--sequences", default="",
                        help="names, separated by commas; all if empty")
    parser.add_argument("--methods", default="paper",
                        help="names separated by commas, or all, paper, "
                        "ablation")
    parser.add_argument("--external", action="append", default=[],
                        metavar="NAME=COMMAND", help="add an external method; "
                        "the command uses {database} and {output}, and may use "
                        "{images} and {threads}; repeatable")
    parser.add_argument("--work", type=pathlib.Path, default=REPOSITORY / work,
                        help="folder of results; finished runs in it are "
                        "reused")
    add_program(parser)
    add_threads(parser)
    parser.add_argument("--time_limit", type=positive(float), default=3600.0,
                        help="of one mapper, in seconds")
    parser.add_argument("--mapper_options", default="",
                        help="further options of mgsfm mapper, in one word")
    parser.add_argument("--no_pictures", action="store_true",
                        help="draw no figures; matplotlib is not needed then")
    parser.add_argument("--only_done", action="store_true",
                        help="run nothing; make tables and figures of finished "
                        "runs")
