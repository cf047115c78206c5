# SPDX-License-Identifier: BSD-3-Clause
"""Measures the speed of whole mappers and of the solvers."""
import json
import pathlib
import subprocess
import tempfile

from experiments import options
from experiments.sequence import FIXED_INTRINSICS
from experiments.studies import bench_table, end_to_end
from experiments.text_files import read_json

DESCRIPTION = """\
Measures speed, prints tables, and writes all numbers as JSON:
- whole mappers, from the database to the model on disk, with the time of each
  stage, peak memory and accuracy: kitti06_stereo, euroc_v101_stereo and
  simulated drives of all rigs, the fastest of 3 runs each;
- the solvers of bundle adjustment on the same problem: native, Ceres with the
  same derivatives, Ceres with six blocks and automatic derivatives.
Ratios are those of one call, so they hold on a busy machine; seconds do not.

  python3 -m experiments bench --output NEW.json --compare OLD.json

DATA contains kitti06_stereo/, euroc_v101_stereo/ and kitti_trajectories/07.txt;
what is absent is skipped, and a simulated curve replaces the trajectory. Inner
loops alone: build/release/bench/mgsfm_micro_benchmark."""


def add_parser(subparsers):
    """The subcommand bench."""
    parser = options.add_command(
        subparsers, "bench", run, "speed of whole mappers and of the solvers",
        DESCRIPTION)
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/release/bench.json",
                        help="file for all numbers")
    parser.add_argument("--compare", type=pathlib.Path, metavar="OLD.json",
                        help="an earlier output, to print ratios to")
    parser.add_argument("--data", type=pathlib.Path,
                        default=options.shared_data(),
                        help="folder of recorded data")
    parser.add_argument("--runs", type=options.positive(int), default=3,
                        help="runs of each mapper; the fastest counts")
    parser.add_argument("--only", choices=("end_to_end", "solvers"),
                        help="one of the two parts")
    parser.add_argument("--colmap", action="store_true",
                        help="run COLMAP's mapper, too, in turn")
    options.add_threads(parser, 2)
    options.add_program(parser)
    options.add_program(parser, options.SOLVER_BENCHMARK, "--solver_program")


def run(arguments):
    """Runs both parts, and writes the joined results."""
    program = options.find_program(arguments.program)
    solver = options.find_program(arguments.solver_program)
    old = (read_json(arguments.compare)["runs"]
           if arguments.compare else [])
    with tempfile.TemporaryDirectory() as parts:
        parts = pathlib.Path(parts)
        if arguments.only != "solvers":
            end_to_end.run_all(program, arguments.threads, arguments.runs,
                               arguments.data, parts, arguments.colmap)
        if arguments.only != "end_to_end":
            run_solvers(solver, arguments.threads, arguments.data, parts)
        runs = [json.loads(p.read_text()) for p in sorted(parts.glob("*.json"))]
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(json.dumps({"runs": runs}, indent=2) + "\n")
    print("\n".join(bench_table.stage_lines(runs)))
    print(f"wrote {arguments.output}")
    if arguments.compare:
        print(f"against {arguments.compare}: new / old")
        print("\n".join(bench_table.ratio_lines(runs, old)))


def run_solvers(program, threads, data, parts):
    """The solver benchmark on recorded and on simulated problems."""
    database = data / "kitti06_stereo/database.db"
    if database.exists():
        run_solver(program, threads, parts, "solvers_kitti06",
                   ["--database_path", database])
    else:
        print(f"no {database.parent}: skipped")
    trajectory = data / "kitti_trajectories/07.txt"
    if trajectory.exists():
        name, drive = "solvers_simulated_kitti07", ["--trajectory_path",
                                                    trajectory]
    else:
        name, drive = "solvers_simulated_curve", ["--Simulation.num_frames",
                                                  300]
    run_solver(program, threads, parts, name,
               [*drive, "--Simulation.max_num_features", 400])


def run_solver(program, threads, parts, name, problem):
    """Writes PARTS/NAME.json."""
    fixed = [word.replace("--", "--Mapper.", 1) for word in FIXED_INTRINSICS]
    subprocess.run(
        list(map(str, [program, "--name", name,
                       "--json_path", parts / f"{name}.json",
                       "--num_threads", threads, "--log_level", "warning",
                       "--max_num_iterations", 30, *fixed, *problem])),
        check=True)
