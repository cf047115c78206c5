# SPDX-License-Identifier: BSD-3-Clause
"""Runs methods on sequences in steps that resume.

Each step leaves a file in the folder of results, and a finished step is not
repeated. A step that fails for a reason outside the method leaves no record.
"""
import dataclasses
import pathlib
import shlex
import shutil

from experiments import colmap_model, measure, methods, peers, records
from experiments.database import make_database
from experiments.measure import StepFailed
from experiments.text_files import read_json


@dataclasses.dataclass(frozen=True)
class Settings:
    """Settings that all runs of one call share."""

    program: pathlib.Path
    threads: int
    work: pathlib.Path
    time_limit: float  # of one mapper, seconds
    mapper_options: tuple = ()
    only_done: bool = False
    peers: dict = dataclasses.field(default_factory=dict)

    @staticmethod
    def of(arguments, found_peers):
        """The settings in the options of add_dataset_options()."""
        return Settings(arguments.program, arguments.threads,
                        arguments.work.resolve(), arguments.time_limit,
                        tuple(shlex.split(arguments.mapper_options)),
                        arguments.only_done, found_peers)

    def mgsfm(self, command, *options):
        """The command line of a command of mgsfm."""
        return [self.program, command, "--log_level", "warning",
                "--num_threads", self.threads, *options]

    def folder_of(self, sequence):
        """The folder of results of a sequence; it is made."""
        folder = self.work / sequence.name
        folder.mkdir(parents=True, exist_ok=True)
        return folder


class Runner:
    """Maps sequences; makes, or fails to make, each database only once."""

    def __init__(self, settings):
        self.settings = settings
        self.databases = {}  # the path or the StepFailed, by sequence

    def database_of(self, sequence):
        """The path of its database; throws StepFailed if it cannot be made."""
        if sequence.name not in self.databases:
            try:
                self.databases[sequence.name] = make_database(
                    self.settings, sequence)
            except StepFailed as failure:
                self.databases[sequence.name] = failure
        if isinstance(self.databases[sequence.name], StepFailed):
            raise self.databases[sequence.name]
        return self.databases[sequence.name]

    def run(self, sequence, method):
        """The record of a run, with errors if there is ground truth."""
        settings = self.settings
        database = None if settings.only_done else self.database_of(sequence)
        record = find_record(settings, sequence, method)
        path = settings.folder_of(sequence) / f"{method}.json"
        if not record:
            record = run_method(settings, sequence, method, database)
            records.write_json(path, record)
            if not records.is_result(record):
                raise StepFailed(record["failure"], record)
        is_evaluated = record.get("errors") or not sequence.truth
        if "model" not in record or is_evaluated or settings.only_done:
            return record
        record["errors"] = evaluate(settings, sequence, record, path)
        records.write_json(path, record)
        records.print_record(record)
        return record


def options_of(settings, sequence, method):
    """The options that decide the result of a method, or a peer's command."""
    if method in settings.peers:
        return list(settings.peers[method].words)
    return [*map(str, sequence.mapper_options),
            *methods.mapper_options_of(method), *settings.mapper_options]


def find_record(settings, sequence, method):
    """The record of an earlier run, or None; throws StepFailed if that run had
    other options."""
    path = settings.work / sequence.name / f"{method}.json"
    record = read_json(path) if path.exists() else None
    if record and settings.only_done:
        return record
    if not record or not records.is_result(record):
        return None
    if record["is_stopped"] and record["seconds"] < settings.time_limit:
        return None
    if "options" in record and record["options"] != options_of(
            settings, sequence, method):
        raise StepFailed(f"{path} has other options ("
                         + " ".join(record["options"])
                         + "); choose another --work")
    return record


def run_method(settings, sequence, method, database):
    """Runs a method on a database; returns its record, without errors."""
    folder = settings.folder_of(sequence)
    model, log = folder / method, folder / f"{method}.log"
    run = run_peer if method in settings.peers else run_mapper
    record = run(settings, sequence, method, database, model, log)
    record.update({"sequence": sequence.name, "method": method,
                   "options": options_of(settings, sequence, method)})
    chosen = (colmap_model.largest_model(model)
              if record["exit_code"] == 0 and model.is_dir() else None)
    if chosen:
        record["model"] = str(chosen.relative_to(settings.work))
    if not records.is_result(record):
        record["failure"] = failure_of(record, model, log)
        if method not in settings.peers or measure.was_killed(record):
            raise StepFailed(record["failure"])
    elif not chosen or not sequence.truth:
        records.print_record(record)
    return record


def failure_of(record, model, log):
    """Why a run has no result, in one line."""
    if measure.was_killed(record):
        return f"killed ({log})"
    if record["exit_code"] == 0:
        return f"it wrote no images.bin or images.txt that can be read into {model} ({log})"
    return f"exit code {record['exit_code']}: {measure.last_line(log)} ({log})"


def run_mapper(settings, sequence, method, database, model, log):
    """Runs `mgsfm mapper`; returns its costs."""
    command = settings.mgsfm(
        "mapper", "--database_path", database, "--output_path", model,
        *options_of(settings, sequence, method))
    record = measure.run_logged(command, log, settings.time_limit)
    record["command"] = shlex.join(map(str, command))
    if record["exit_code"] == 0:
        records.add_stages(record, read_json(model / "report.json"))
    return record


def run_peer(settings, sequence, method, database, model, log):
    """Runs a peer on a copy of the database, as it may write to it; returns its
    costs."""
    shutil.rmtree(model, ignore_errors=True)
    model.mkdir()
    copy = model / "database.db"
    shutil.copyfile(database, copy)
    images = pathlib.Path(sequence.image_path or model).resolve()
    command = settings.peers[method].command({
        "database": copy, "output": model, "images": images,
        "threads": settings.threads})
    record = measure.run_logged(command, log, settings.time_limit,
                                peers.environment())
    copy.unlink(missing_ok=True)
    record["command"] = shlex.join(command)
    if record["exit_code"] == 0:
        for kind in ("seconds", "processor_seconds"):
            record[f"{kind}_counted"] = record[kind]
    return record


def evaluate(settings, sequence, record, record_path):
    """The errors of the model of a record, as model_evaluator reports them."""
    path = record_path.with_suffix(".errors.json")
    measure.run_step(
        settings.mgsfm("model_evaluator", "--input_path",
                       settings.work / record["model"], "--json", path,
                       *sequence.truth),
        path.with_suffix(".log"))
    return read_json(path)
