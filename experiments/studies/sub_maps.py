# SPDX-License-Identifier: BSD-3-Clause
"""Sub-maps that are joined against a single run of the mapper."""
import json
import pathlib
import tempfile

from experiments import measure, options, tables

DESCRIPTION = """\
Maps simulated drives in one run and as clusters that are joined, and prints
position errors, processor time, and the peak memory of each job. Numbers in
brackets are relative to the single run. Finished drives in the output folder
are reused; models are removed.

  mgsfm simulate --preset standard --output_path drive
  python3 -m experiments sub_maps drive --join_memory 0.6"""
HEADER = ["drive", "images", "error, single run", "joined",
          "processor time, single run", "sub-maps", "memory, single run", "cut",
          "a cluster", "join"]


def add_parser(subparsers):
    """The subcommand sub_maps."""
    parser = options.add_command(
        subparsers, "sub_maps", run,
        "sub-maps that are joined against a single run", DESCRIPTION)
    parser.add_argument("drives", nargs="+", type=pathlib.Path,
                        help="folders that mgsfm simulate wrote")
    parser.add_argument("--num_clusters", type=options.positive(int), default=8,
                        help="about this many")
    parser.add_argument("--join_memory", type=options.positive(float),
                        metavar="SHARE",
                        help="limit of the join's memory relative to the "
                        "single run; no limit by default")
    parser.add_argument("--output", type=pathlib.Path,
                        default=options.REPOSITORY / "build/sub_maps",
                        help="folder of results; finished drives are reused")
    options.add_threads(parser, 1)
    options.add_program(parser)


def run(arguments):
    """Measures what is missing, and prints the table."""
    program = options.find_program(arguments.program)
    for drive in arguments.drives:
        if not (drive / "truth").is_dir():
            raise SystemExit(f"{drive} has no folder truth; write it with "
                             "mgsfm simulate")
    arguments.output.mkdir(parents=True, exist_ok=True)
    rows = []
    for drive in arguments.drives:
        path = arguments.output / f"{drive.resolve().name}.json"
        if not path.exists():
            with tempfile.TemporaryDirectory(dir=arguments.output) as scratch:
                values = measure_drive(program, arguments, drive,
                                       pathlib.Path(scratch))
            path.write_text(json.dumps(values, indent=2) + "\n")
        rows.append(row_of(path.stem, json.loads(path.read_text())))
    print(tables.markdown_table(HEADER, rows), end="")


def measure_drive(program, arguments, drive, scratch):
    """The costs of all jobs, and the errors of both models."""
    def call(*words):
        return measure.run_measured(
            [program, *words, "--num_threads", arguments.threads,
             "--log_level", "warning"])

    database = ["--database_path", drive / "database.db"]

    def mapper(output, *words):
        return call("mapper", *database, "--output_path", output, *words)

    def evaluate(model):
        path = scratch / "errors.json"
        call("model_evaluator", "--input_path", model, "--gt_path",
             drive / "truth", "--json", path)
        return json.loads(path.read_text())

    clusters, maps = scratch / "clusters", scratch / "maps"
    values = {"single": mapper(scratch / "single", "--write_report", 0)}
    values["cut"] = mapper(clusters, "--partition", arguments.num_clusters)
    values["clusters"] = map_clusters(mapper, clusters, maps)
    limit_mib = ((arguments.join_memory or 0.0) *
                 values["single"]["peak_memory_mib"])
    values["join"] = call(
        "model_merger", "--graph", 1, *database, "--cluster_path", clusters,
        "--input_path", maps, "--output_path", scratch / "joined",
        "--max_memory", round(limit_mib))
    return {**values, "single_errors": evaluate(scratch / "single/0"),
            "joined_errors": evaluate(scratch / "joined/0")}


def map_clusters(mapper, clusters, maps):
    """Maps the calibration cluster, then the others with its calibration."""
    description = json.loads((clusters / "clusters.json").read_text())
    lists = [cluster["image_list"] for cluster in description["clusters"]]
    first = next(iter(description["calibration_clusters"]), None)
    order = sorted(range(len(lists)), key=lambda i: (i != first, i))
    maps.mkdir()
    costs = []
    for i in order:
        words = ["--write_report", 0, "--image_list_path", clusters / lists[i]]
        if first is not None and i != first:
            words += ["--rig_config_path", maps / str(first) / "0",
                      "--BundleAdjustment.refine_sensor_from_rig", "yes"]
        costs.append(mapper(maps / str(i), *words))
    return costs


def row_of(name, values):
    """The texts of a row."""
    single = values["single"]

    def error(which):
        return values[f"{which}_errors"]["position_m"]["mean"]

    def memory(job):
        mib = job["peak_memory_mib"]
        return f"{mib:.0f} MiB ({mib / single['peak_memory_mib']:.2f})"

    jobs = [values["cut"], *values["clusters"], values["join"]]
    seconds = sum(job["processor_seconds"] for job in jobs)
    largest = max(values["clusters"], key=lambda job: job["peak_memory_mib"])
    return [name, str(values["joined_errors"]["num_registered"]),
            f"{error('single'):.4f} m",
            f"{error('joined'):.4f} m ({error('joined') / error('single'):.2f})",
            f"{single['processor_seconds']:.1f} s",
            f"{seconds:.1f} s ({seconds / single['processor_seconds']:.2f})",
            f"{single['peak_memory_mib']:.0f} MiB", memory(values["cut"]),
            memory(largest), memory(values["join"])]
