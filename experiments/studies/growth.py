# SPDX-License-Identifier: BSD-3-Clause
"""How time and memory of the mapper grow with its input."""
import pathlib
import shutil
import subprocess
import tempfile

from experiments import options, requirements
from experiments.studies import growth_numbers

SIZES = "1000,2000,4000,9000,18000,36000"
DESCRIPTION = """\
Simulates the first frames of one street (stereo, 400 features an image), maps
them from the database to the model on disk, and prints time and peak memory of
each stage, and the exponents of their growth with the observations. Finished
sizes in the output folder are reused; databases and models are removed. 36,000
images take about 10 GB of disk.

  python3 -m experiments growth --sizes 1000,2000 --figure build/growth.svg"""


def add_parser(subparsers):
    """The subcommand growth."""
    parser = options.add_command(
        subparsers, "growth", run,
        "time and memory of the mapper over the number of images", DESCRIPTION)
    parser.add_argument("--sizes", default=SIZES,
                        help="numbers of images, separated by commas")
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/growth",
                        help="folder of results; finished sizes are reused")
    parser.add_argument("--trajectory", type=pathlib.Path,
                        help="poses in KITTI's format; their first ones "
                        "replace the simulated street")
    parser.add_argument("--figure", type=pathlib.Path,
                        help="file for a figure, .svg or .png")
    options.add_threads(parser, 2)
    options.add_program(parser)


def run(arguments):
    """Runs what is missing, prints tables, draws the figure."""
    if arguments.figure:
        requirements.require("matplotlib", "figures")
        if arguments.figure.suffix not in (".svg", ".png"):
            raise SystemExit(f"--figure {arguments.figure}: use .svg or .png")
    program = options.find_program(arguments.program)
    sizes = [parse_size(word) for word in options.words_of(arguments.sizes)]
    arguments.output.mkdir(parents=True, exist_ok=True)
    for size in sizes:
        report = arguments.output / f"{size}.json"
        if not report.exists():
            with tempfile.TemporaryDirectory(dir=arguments.output) as scratch:
                measure_size(program, arguments, size, pathlib.Path(scratch),
                             report)
            print(f"{size} images are done", flush=True)
    runs = growth_numbers.read_runs(arguments.output)
    print(growth_numbers.runs_table(runs))
    print(growth_numbers.stages_table(runs), end="")
    if arguments.figure:
        from experiments.figures import growth
        growth.draw(*growth_numbers.figure_curves(runs), arguments.figure)
        print(f"\nwrote {arguments.figure}")


def parse_size(word):
    """An even number of images: two cameras."""
    if not word.isdigit() or int(word) < 2 or int(word) % 2:
        raise SystemExit(f"--sizes: '{word}' is not an even number of images")
    return int(word)


def measure_size(program, arguments, num_images, scratch, report):
    """Simulates a drive, maps it, and keeps the report of the mapper."""
    num_frames = num_images // 2
    drive = ["--num_frames", num_frames]
    if arguments.trajectory:
        lines = arguments.trajectory.read_text().splitlines(keepends=True)
        (scratch / "path.txt").write_text("".join(lines[:num_frames]))
        drive = ["--trajectory_path", scratch / "path.txt"]
    common = ["--num_threads", arguments.threads, "--log_level", "warning"]
    call(program, "simulate", "--output_path", scratch / "input",
         "--preset", "standard", "--rig", "stereo",
         "--max_num_features", 400, *drive, *common)
    call(program, "mapper", "--database_path", scratch / "input/database.db",
         "--output_path", scratch / "model", *common)
    shutil.copy(scratch / "model/report.json", report)


def call(*command):
    """Runs a command that must succeed."""
    subprocess.run(list(map(str, command)), check=True)
