# SPDX-License-Identifier: BSD-3-Clause
"""What the drivers of data sets share: methods, steps that resume, tables.

A driver lists its sequences; run() makes the database of each, maps it with
each method, evaluates the models, and writes tables and pictures. Every step
leaves a file of its own in the folder of work, and what is there is not done
again.
"""
import argparse
import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import struct
import subprocess
import sys

import experiment_tables
import measuring

REPOSITORY = pathlib.Path(__file__).resolve().parents[1]
INPUTS = {"translations": "relative_translations", "tracks": "tracks",
          "hybrid": "hybrid"}
OBJECTIVES = ("bilinear", "non_bilinear")
ABLATION = [f"{name}_{objective}" for name in INPUTS
            for objective in OBJECTIVES]
# These are methods of ours by another name.
SAME_AS = {"tracks_bilinear": "dmra_mgp", "hybrid_non_bilinear": "mgsfm"}
# What averaging finds, before bundle adjustment makes methods alike: poses are
# held, points only triangulated.
AVERAGED = [f"{name}_averaged" for name in ABLATION]
HELD = ["--BundleAdjustment.refine_rig_from_world", "false",
        "--BundleAdjustment.refine_sensor_from_rig", "no"]
OURS = ["mgsfm", "dmra_mgp", "mma", "single"]
EXTERNAL = {
    "colmap": ["colmap", "mapper"],
    "glomap": ["glomap", "mapper"],
    "colmap_global": ["colmap", "global_mapper"],
}
# Exit codes of ours that are results: a model, or nothing to reconstruct.
# Others are of wrong options, a full disk or a defect.
RESULTS = (0, 2)
# Of the time of the paper's tables.
NOT_COUNTED = ("reading", "view graph", "writing")


def options_of(method):
    """Those of `mgsfm mapper`."""
    if method in OURS:
        return ["--method", method]
    name, objective = method.split("_", 1)
    objective, averaged, _ = objective.partition("_averaged")
    return ["--TranslationAveraging.input", INPUTS[name],
            "--TranslationAveraging.objective", objective,
            *(HELD if averaged else [])]


class Failed(Exception):
    """A step that failed by wrong options or input, a full disk, a signal or a
    defect: it says nothing of a method, so that it leaves no record."""


class Sequence:
    """One drive: images or a database, and what is true of it."""

    def __init__(self, name, database=None, image_path=None, image_list=(),
                 camera_lines=(), mask_path=None, mapper_options=(),
                 truth=(), truth_positions=None, rig_prefixes=()):
        self.name = name
        self.database = database  # given; else features are extracted
        self.image_path = image_path
        self.image_list = image_list
        self.camera_lines = camera_lines  # of --ImageReader.camera_params_path
        self.mask_path = mask_path
        self.mapper_options = list(mapper_options)
        # Prefixes of the cameras, the reference first, where folders do not
        # tell them.
        self.rig_prefixes = list(rig_prefixes)
        self.truth = list(truth)  # options of model_evaluator
        # Gives {image name: position}, for pictures; empty if not known.
        self.truth_positions = truth_positions or dict


def program_version(program):
    """The first line with a version in what a program says, or None."""
    if shutil.which(program) is None:
        return None
    said = subprocess.run([program, "-h"], capture_output=True, text=True,
                          env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
                          check=False)
    for line in (said.stdout + said.stderr).splitlines():
        if re.search(r"\d+\.\d+", line):
            return line.strip()
    return "unknown version"


def has_command(program, command):
    said = subprocess.run([program, "help"], capture_output=True, text=True,
                          env={**os.environ, "QT_QPA_PLATFORM": "offscreen"},
                          check=False)
    return command in said.stdout + said.stderr


def find_external():
    """{method: version} of those that are installed."""
    found = {}
    for method, (program, command) in EXTERNAL.items():
        version = program_version(program)
        if version and has_command(program, command):
            found[method] = version
    return found


def png_size(path):
    with open(path, "rb") as file:
        header = file.read(24)
    if header[:8] != b"\x89PNG\r\n\x1a\n":
        raise SystemExit(f"{path} is no PNG")
    return struct.unpack(">II", header[16:24])


def rotation_to_quaternion(r):
    """w, x, y, z of a rotation matrix (rows)."""
    trace = r[0][0] + r[1][1] + r[2][2]
    k = max(range(3), key=lambda i: r[i][i])
    if trace > r[k][k]:
        s = 2.0 * (1.0 + trace) ** 0.5
        return (s / 4, (r[2][1] - r[1][2]) / s, (r[0][2] - r[2][0]) / s,
                (r[1][0] - r[0][1]) / s)
    i, j = (k + 1) % 3, (k + 2) % 3
    s = 2.0 * (1.0 + r[k][k] - r[i][i] - r[j][j]) ** 0.5
    q = [0.0] * 4
    q[0] = (r[j][i] - r[i][j]) / s
    q[1 + k], q[1 + i], q[1 + j] = (s / 4, (r[i][k] + r[k][i]) / s,
                                    (r[j][k] + r[k][j]) / s)
    return tuple(q)


def pose_text(pose):
    """Quaternion and translation of the inverse of a 4 x 4 matrix."""
    r = [[pose[k][i] for k in range(3)] for i in range(3)]
    t = [-sum(r[i][k] * pose[k][3] for k in range(3)) for i in range(3)]
    return " ".join(repr(float(n)) for n in [*rotation_to_quaternion(r), *t])


def write_truth(folder, camera_lines, rig_from_cam, frames):
    """A model of COLMAP's without points.

    rig_from_cam has a 4 x 4 matrix for each folder of camera_lines, the first
    the identity. frames: {name: world_from_rig}; image names are
    folder/name.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cameras = [line.split(maxsplit=1)[0] for line in camera_lines]
    with open(folder / "cameras.txt", "w", encoding="utf-8") as file:
        for k, line in enumerate(camera_lines, 1):
            file.write(f"{k} {line.split(maxsplit=1)[1]}\n")
    with open(folder / "rigs.txt", "w", encoding="utf-8") as file:
        others = "".join(f" CAMERA {k} 1 {pose_text(rig_from_cam[camera])}"
                         for k, camera in enumerate(cameras[1:], 2))
        file.write(f"1 {len(cameras)} CAMERA 1{others}\n")
    images = open(folder / "images.txt", "w", encoding="utf-8")
    rows = open(folder / "frames.txt", "w", encoding="utf-8")
    with images, rows:
        image_id = 0
        for frame_id, (name, pose) in enumerate(frames.items(), 1):
            data = ""
            for k, camera in enumerate(cameras, 1):
                image_id += 1
                data += f" CAMERA {k} {image_id}"
                world_from_cam = product(pose, rig_from_cam[camera])
                images.write(f"{image_id} {pose_text(world_from_cam)} {k} "
                             f"{camera}/{name}\n\n")
            rows.write(f"{frame_id} 1 {pose_text(pose)} {len(cameras)}{data}\n")
    (folder / "points3D.txt").write_text("")


def product(a, b):
    """Of 4 x 4 matrices."""
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)]
            for i in range(4)]


def write_json(path, value):
    """All of it or nothing."""
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(value, indent=2) + "\n")
    part.replace(path)


class Runner:
    def __init__(self, arguments):
        self.program = arguments.program
        self.threads = arguments.threads
        self.work = pathlib.Path(arguments.work)
        self.time_limit = arguments.time_limit
        self.extra = shlex.split(arguments.mapper_options)
        self.only_done = arguments.only_done
        self.databases = {}  # or why there is none, by sequence

    def mgsfm(self, command, *options):
        return [self.program, command, "--log_level", "warning",
                "--num_threads", self.threads, *map(str, options)]

    def must(self, command, log_path):
        measured = measuring.run_logged(command, log_path)
        if measured["exit_code"] != 0:
            raise Failed(f"{last_line(log_path)} ({log_path})")
        return measured

    def folder(self, sequence):
        folder = self.work / sequence.name
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    def database_of(self, sequence):
        """Its path; it is made, or fails, once."""
        if sequence.name not in self.databases:
            try:
                self.databases[sequence.name] = self.make_database(sequence)
            except Failed as failure:
                self.databases[sequence.name] = failure
        if isinstance(self.databases[sequence.name], Failed):
            raise self.databases[sequence.name]
        return self.databases[sequence.name]

    def make_database(self, sequence):
        """Features and matches, unless they are given or done."""
        if sequence.database:
            return pathlib.Path(sequence.database)
        folder = self.folder(sequence)
        database = folder / "database.db"
        done = folder / "view_graph.json"
        image_list = folder / "images.txt"
        cameras = folder / "cameras.txt"
        for path, lines in ((image_list, sequence.image_list),
                            (cameras, sequence.camera_lines)):
            text = "".join(f"{line}\n" for line in lines)
            if database.exists() and path.read_text() != text:
                raise Failed(f"{database} was made of other images or cameras; "
                             "choose another --work")
            path.write_text(text)
        if done.exists():
            return database
        print(f"{sequence.name}: features and matches", flush=True)
        masks = (["--ImageReader.mask_path", sequence.mask_path]
                 if sequence.mask_path else [])
        # Both go on where they were interrupted.
        features = self.must(self.mgsfm(
            "feature_extractor", "--database_path", database,
            "--image_path", sequence.image_path, "--image_list_path",
            image_list, "--ImageReader.camera_params_path", cameras, *masks),
            folder / "features.log")
        # Warnings, such as of masks without an image.
        print((folder / "features.log").read_text(errors="replace"), end="")
        if sequence.rig_prefixes:
            config = folder / "rig_config.json"
            cameras = [{"image_prefix": p} for p in sequence.rig_prefixes]
            cameras[0]["ref_sensor"] = True
            write_json(config, [{"cameras": cameras}])
            self.must(self.mgsfm("rig_configurator", "--database_path",
                                 database, "--rig_config_path", config),
                      folder / "rig.log")
        matches = self.must(self.mgsfm(
            "sequential_matcher", "--database_path", database),
            folder / "matches.log")
        write_json(done, {"features": features, "matches": matches})
        return database

    def options(self, sequence, method):
        """Those of the mapper that decide what it finds."""
        if method in EXTERNAL:
            return []
        return [*map(str, sequence.mapper_options), *options_of(method),
                *self.extra]

    def record(self, sequence, method):
        """Of a run that was done before, or None."""
        path = self.work / sequence.name / f"{method}.json"
        record = json.loads(path.read_text()) if path.exists() else None
        if not record or not is_result(record):
            return None
        if self.only_done:
            return record
        if record["is_stopped"] and record["seconds"] < self.time_limit:
            return None
        if "options" in record and record["options"] != self.options(
                sequence, method):
            raise Failed(f"{path} is of other options ("
                         + " ".join(record["options"])
                         + "); choose another --work")
        return record

    def map(self, sequence, method):
        """The record of a run, from its file if it was done before."""
        folder = self.folder(sequence)
        path = folder / f"{method}.json"
        database = None if self.only_done else self.database_of(sequence)
        record = self.record(sequence, method)
        if not record:
            record = self.run_mapper(sequence, method, database, folder)
            write_json(path, record)
        is_evaluated = record.get("errors") or not sequence.truth
        if "model" not in record or is_evaluated or self.only_done:
            return record
        record["errors"] = self.evaluate(sequence, self.work / record["model"],
                                         folder / f"{method}.errors.json")
        write_json(path, record)
        print_record(record)
        return record

    def run_mapper(self, sequence, method, database, folder):
        model = folder / method
        log = folder / f"{method}.log"
        if method in EXTERNAL:
            record = self.map_external(method, database, sequence, model, log)
        else:
            record = self.map_ours(method, database, sequence, model, log)
        record.update({"sequence": sequence.name, "method": method})
        if not is_result(record):
            what = "killed" if measuring.was_killed(record) else last_line(log)
            raise Failed(f"{what} ({log})")
        chosen = largest_model(model) if record["exit_code"] == 0 else None
        if chosen:
            record["model"] = str(chosen.relative_to(self.work))
        if not chosen or not sequence.truth:
            print_record(record)
        return record

    def map_ours(self, method, database, sequence, model, log):
        command = self.mgsfm(
            "mapper", "--database_path", database, "--output_path", model,
            *self.options(sequence, method))
        record = measuring.run_logged(command, log, self.time_limit)
        record["command"] = " ".join(map(str, command))
        record["options"] = self.options(sequence, method)
        if record["exit_code"] == 0:
            report = json.loads((model / "report.json").read_text())
            record["stages"] = measuring.stages_of(report)
            for kind in ("seconds", "processor_seconds"):
                record[f"{kind}_counted"] = sum(
                    stage[kind] for name, stage in record["stages"].items()
                    if name not in NOT_COUNTED)
        return record

    def map_external(self, method, database, sequence, model, log):
        shutil.rmtree(model, ignore_errors=True)
        model.mkdir()
        # They may write to the database.
        copy = model / "database.db"
        shutil.copyfile(database, copy)
        command = [*EXTERNAL[method], "--database_path", copy,
                   "--output_path", model, "--image_path",
                   sequence.image_path or model]
        if method == "colmap":
            command += ["--Mapper.num_threads", self.threads,
                        "--Mapper.extract_colors", 0,
                        "--Mapper.ba_refine_focal_length", 0,
                        "--Mapper.ba_refine_extra_params", 0,
                        "--Mapper.init_min_tri_angle", 4,
                        "--Mapper.init_max_forward_motion", 1]
        os.environ["QT_QPA_PLATFORM"] = "offscreen"
        record = measuring.run_logged(command, log, self.time_limit)
        copy.unlink()
        record["command"] = " ".join(map(str, command))
        if record["exit_code"] == 0:
            for kind in ("seconds", "processor_seconds"):
                record[f"{kind}_counted"] = record[kind]
        return record

    def evaluate(self, sequence, model, path):
        self.must(self.mgsfm("model_evaluator", "--input_path", model,
                             "--json", path, *sequence.truth),
                  path.with_suffix(".log"))
        return json.loads(path.read_text())


def is_result(record):
    """Of a mapper; a time limit that is reached is one, too. What the exit
    codes of external ones mean is not known."""
    if record["method"] in EXTERNAL:
        return not measuring.was_killed(record)
    return record["is_stopped"] or record["exit_code"] in RESULTS


def last_line(log_path):
    lines = log_path.read_text(errors="replace").split("\n")
    return next((line for line in reversed(lines) if line.strip()),
                f"see {log_path}")


def largest_model(folder):
    """The sub-folder whose model has most images, or None."""
    best, most = None, 0
    for images in sorted(folder.glob("*/images.bin")):
        with open(images, "rb") as file:
            (count,) = struct.unpack("<Q", file.read(8))
        if count > most:
            best, most = images.parent, count
    return best


def rotation_rows(w, x, y, z):
    """Of the matrix of a unit quaternion."""
    return ((1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)))


def center(quaternion, translation):
    """-R^T t of a pose of an image."""
    rows = rotation_rows(*quaternion)
    a, b, c = translation
    return tuple(-(rows[0][i] * a + rows[1][i] * b + rows[2][i] * c)
                 for i in range(3))


def read_positions(model):
    """{image name: position of the camera} of a model of COLMAP's."""
    if (model / "images.bin").exists():
        return read_binary_positions(model / "images.bin")
    positions = {}
    lines = [line for line in (model / "images.txt").read_text().splitlines()
             if not line.startswith("#")]
    for line in lines[::2]:
        words = line.split(maxsplit=9)
        numbers = list(map(float, words[1:8]))
        positions[words[9]] = center(numbers[:4], numbers[4:])
    return positions


def read_binary_positions(path):
    data = path.read_bytes()
    (count,) = struct.unpack_from("<Q", data)
    positions, at = {}, 8
    for _ in range(count):
        numbers = struct.unpack_from("<7d", data, at + 4)
        at += 4 + 56 + 4
        end = data.index(b"\0", at)
        positions[data[at:end].decode()] = center(numbers[:4], numbers[4:])
        (num_points,) = struct.unpack_from("<Q", data, end + 1)
        at = end + 9 + 24 * num_points
    return positions


def print_record(record):
    line = f"{record['sequence']:12} {record['method']:26}"
    errors = record.get("errors")
    if record["exit_code"] != 0:
        why = "time limit" if record["is_stopped"] else "no model"
        print(f"{line} {why} after {record['seconds']:.1f} s", flush=True)
        return
    line += f" {record.get('seconds_counted', record['seconds']):8.1f} s"
    if errors and errors.get("position_m"):
        line += (f"  position {errors['position_m']['mean']:.4f} m"
                 f"  rotation {errors['rotation_deg']['mean']:.4f} deg"
                 f"  {errors['num_registered']} of {errors['num_images']}")
    print(line, flush=True)


def words_of(text):
    """Those between commas."""
    return [word.strip() for word in text.split(",") if word.strip()]


def positive(kind):
    """For argparse: a positive number of a type."""
    def parse(text):
        value = kind(text)
        if not value > 0:
            raise argparse.ArgumentTypeError(f"{text} is not positive")
        return value
    parse.__name__ = kind.__name__
    return parse


def choose_methods(text, external):
    """From the words of --methods."""
    chosen = []
    for word in words_of(text):
        if word == "all":
            chosen += [*OURS, *external, *ABLATION, *AVERAGED]
        elif word == "paper":
            chosen += [*OURS, *external]
        elif word == "ablation":
            chosen += [*ABLATION, *AVERAGED]
        elif word in [*OURS, *ABLATION, *AVERAGED, *external]:
            chosen.append(word)
        elif word in EXTERNAL:
            raise SystemExit(f"{word} is not installed")
        else:
            raise SystemExit(
                f"unknown method '{word}'; there are all, paper, ablation, "
                + ", ".join([*OURS, *EXTERNAL, *ABLATION, *AVERAGED]))
    return list(dict.fromkeys(chosen))


def argument_parser(description, default_work):
    parser = argparse.ArgumentParser(
        description=description,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("root", help="the data set as it was downloaded")
    parser.add_argument("--sequences", default="",
                        help="separated by commas; all that are there if empty")
    parser.add_argument("--methods", default="paper",
                        help="separated by commas: all, paper, ablation, or "
                        "names")
    parser.add_argument("--work", default=REPOSITORY / default_work,
                        help="folder of results; what is there is not done "
                        "again")
    parser.add_argument("--program",
                        default=REPOSITORY / "build/release/apps/mgsfm/mgsfm")
    parser.add_argument("--threads", type=positive(int),
                        default=os.cpu_count())
    parser.add_argument("--time_limit", type=positive(float), default=3600.0,
                        help="of a mapper, in seconds")
    parser.add_argument("--mapper_options", default="",
                        help="further ones of mgsfm mapper, in one word")
    parser.add_argument("--no_pictures", action="store_true")
    parser.add_argument("--only_done", action="store_true",
                        help="run nothing: tables and pictures of what is "
                        "done")
    return parser


def recorded_external(work, sequences):
    """{method: version} of those that were run earlier."""
    return {method: "run earlier" for method in EXTERNAL
            if any((work / s.name / f"{method}.json").exists()
                   for s in sequences)}


def run(arguments, sequences, title):
    """Makes tables and pictures. Gives the records by sequence and method, and
    how many runs failed."""
    # So that what was started ends, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    runner = Runner(arguments)
    external = find_external()
    if arguments.only_done:
        external = {**recorded_external(runner.work, sequences), **external}
    for method, version in external.items():
        print(f"{method}: {version}")
    methods = choose_methods(arguments.methods, external)
    different = dict.fromkeys(SAME_AS.get(m, m) for m in methods)
    runs = [(sequence, method)
            for sequence in sequences for method in different
            if not arguments.only_done or runner.record(sequence, method)]
    if not runs:
        raise SystemExit(f"nothing is done in {runner.work}"
                         if arguments.only_done else "no sequence or method")
    if not arguments.only_done and shutil.which(arguments.program) is None:
        raise SystemExit(f"no program {arguments.program}; scripts/build.sh "
                         "release builds it, --program names another")
    records, num_failed = [], 0
    for sequence, method in runs:
        try:
            records.append(runner.map(sequence, method))
        except Failed as failure:
            print(f"{sequence.name:12} {method:26} failed: {failure}",
                  flush=True)
            num_failed += 1
    by_name = {(r["sequence"], r["method"]): r for r in records}
    for sequence in sequences:
        for method, same in SAME_AS.items():
            if (sequence.name, same) in by_name:
                by_name[sequence.name, method] = by_name[sequence.name, same]
    if records:
        tables = experiment_tables.make_tables(
            by_name, [[m for m in methods if m in group]
                      for group in ([*OURS, *EXTERNAL], ABLATION, AVERAGED)])
        experiment_tables.write_tables(tables, runner.work / "tables", {
            "title": title, "versions": external, "records": records})
    compared = [r for r in records if r["method"] in [*OURS, *EXTERNAL]]
    if compared and not arguments.no_pictures:
        import experiment_pictures  # needs matplotlib
        experiment_pictures.draw(runner.work, sequences, compared)
    return by_name, num_failed


def end(num_failed):
    """What a driver does last."""
    if num_failed:
        raise SystemExit(f"{num_failed} of the runs failed; called again, the "
                         "driver does what is missing")


def call(main):
    """With one line in place of a trace where a file is missing."""
    try:
        main()
    except OSError as error:
        if error.filename is None:
            raise
        raise SystemExit(f"{error.filename}: {error.strerror}") from None
