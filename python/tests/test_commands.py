# SPDX-License-Identifier: BSD-3-Clause
"""Python and the program do the same, and report errors in their own way."""

import _thread
import gc
import json
import logging
import multiprocessing
import os
import resource
import tempfile
import threading
import time
from pathlib import Path

import pymgsfm
import pytest
from conftest import run_program

DATA = Path(__file__).resolve().parents[2] / "data"


def read_files(folder):
    """The bytes of all files of models; the report states times and paths."""
    return {path.relative_to(folder): path.read_bytes()
            for path in sorted(folder.rglob("*"))
            if path.is_file() and path.name not in ("report.json",
                                                    "report.html")}


def options_in(report):
    options = json.loads(report.read_text())["options"]
    return {name: value for name, value in options.items()
            if not name.endswith("_path")}


class TestSameBytesAsTheProgram:
    def test_simulate(self, drive, tmp_path):
        run_program("simulate", "--preset", "standard", "--num_frames", 12,
                    "--output_path", tmp_path)
        assert read_files(tmp_path / "truth") == read_files(drive / "truth")

    def test_global_mapping(self, drive, sparse, tmp_path):
        run_program("mapper", "--database_path", drive / "database.db",
                    "--output_path", tmp_path)
        assert len(read_files(sparse)) >= 7
        assert read_files(tmp_path) == read_files(sparse)
        assert (options_in(tmp_path / "report.json")
                == options_in(sparse / "report.json"))

    def test_incremental_mapping(self, drive, tmp_path):
        database = drive / "database.db"
        models = pymgsfm.incremental_mapping(database, None, tmp_path / "python")
        run_program("mapper", "--database_path", database, "--method",
                    "incremental", "--output_path", tmp_path / "program")
        assert len(models) == 1
        assert read_files(tmp_path / "program") == read_files(tmp_path / "python")

    def test_demo(self, tmp_path):
        database = DATA / "demo" / "database.db"
        models = pymgsfm.global_mapping(database, None, tmp_path / "python")
        run_program("mapper", "--database_path", database, "--output_path",
                    tmp_path / "program")
        assert models[0].num_reg_images() == 96
        assert read_files(tmp_path / "program") == read_files(tmp_path / "python")

    def test_bundle_adjustment(self, sparse, tmp_path):
        options = {"BundleAdjustment": {"max_num_iterations": 3}}
        by_python = pymgsfm.bundle_adjustment(sparse / "0", options,
                                              tmp_path / "python")
        run_program("bundle_adjuster", "--input_path", sparse / "0",
                    "--output_path", tmp_path / "program",
                    "--BundleAdjustment.max_num_iterations", 3)
        assert (read_files(tmp_path / "program")
                == read_files(tmp_path / "python"))
        in_memory = pymgsfm.bundle_adjustment(
            pymgsfm.Reconstruction(sparse / "0"), options)
        assert (in_memory.points3D.xyz == by_python.points3D.xyz).all()

    def test_triangulate_points(self, drive, sparse, tmp_path):
        model = pymgsfm.triangulate_points(
            drive / "database.db", None, sparse / "0", tmp_path / "python")
        run_program("point_triangulator", "--database_path",
                    drive / "database.db", "--input_path", sparse / "0",
                    "--output_path", tmp_path / "program")
        assert (read_files(tmp_path / "program")
                == read_files(tmp_path / "python"))
        assert model.num_points3D() > 100
        same = pymgsfm.triangulate_points(  # in pycolmap's order
            pymgsfm.Reconstruction(sparse / "0"), drive / "database.db", None,
            tmp_path / "in_memory")
        assert (same.points3D.xyz == model.points3D.xyz).all()
        with pytest.raises(TypeError, match="database_path"):
            pymgsfm.triangulate_points(drive / "database.db")

    def test_evaluate(self, drive, sparse, tmp_path):
        errors = pymgsfm.evaluate(sparse / "0", drive / "truth")
        run_program("model_evaluator", "--input_path", sparse / "0",
                    "--gt_path", drive / "truth", "--json",
                    tmp_path / "errors.json")
        assert errors == json.loads((tmp_path / "errors.json").read_text())

    def test_report(self, sparse, tmp_path):
        pymgsfm.report(sparse / "0", tmp_path / "report.html")
        assert (tmp_path / "report.html").read_bytes()[:9].lower() == b"<!doctype"


def test_extend_adds_frames(drive, tmp_path):
    names = [image.name for image in
             pymgsfm.Reconstruction(drive / "truth").images.values()]
    listed = tmp_path / "list.txt"
    frames = sorted({name.split("/")[-1] for name in names})[:8]
    listed.write_text("".join(f"{name}\n" for name in names
                              if name.split("/")[-1] in frames))
    part = pymgsfm.global_mapping(drive / "database.db", None,
                                  tmp_path / "part",
                                  {"image_list_path": listed})[0]
    assert part.num_frames() == 8
    whole = pymgsfm.extend(drive / "database.db", None, tmp_path / "part" / "0",
                           tmp_path / "whole")
    assert whole.num_frames() == 12


class TestErrors:
    def test_bad_file(self, tmp_path):
        with pytest.raises(pymgsfm.InputError, match="none.db"):
            pymgsfm.global_mapping(tmp_path / "none.db", None, tmp_path / "out")
        assert not (tmp_path / "out").exists()

    def test_is_a_value_error(self):
        with pytest.raises(ValueError):
            pymgsfm.Reconstruction("/nowhere")

    def test_output_that_replaces_an_input(self, sparse, tmp_path):
        poses = tmp_path / "poses.txt"
        poses.write_text("0 0 0 0 0 0 0 1\n")
        with pytest.raises(pymgsfm.InputError, match="is an input"):
            pymgsfm.evaluate(sparse / "0", poses,
                             {"json": poses, "gt_format": "tum"})

    def test_not_solvable(self, drive, tmp_path):
        with pytest.raises(pymgsfm.NotSolvableError, match="no model"):
            pymgsfm.global_mapping(drive / "database.db", None, tmp_path,
                                   {"min_num_frames": 1000})

    def test_refused_folder(self, drive, tmp_path):
        (tmp_path / "file").write_text("")
        with pytest.raises((OSError, pymgsfm.InputError), match="file"):
            pymgsfm.global_mapping(drive / "database.db", None,
                                   tmp_path / "file" / "out")


class TestCallbacks:
    def test_log_and_progress(self, drive, tmp_path):
        messages, stages = [], {}
        pymgsfm.global_mapping(
            drive / "database.db", None, tmp_path,
            log=lambda level, message: messages.append((level, message)),
            progress=lambda stage, done, total: stages.update({stage: done}))
        assert any(level == "info" and "images in 12 frames" in message
                   for level, message in messages)
        assert len(stages) >= 3

    def test_log_level(self, drive, tmp_path):
        messages = []
        pymgsfm.global_mapping(drive / "database.db", None, tmp_path,
                               {"log_level": "error"},
                               log=lambda *message: messages.append(message))
        assert messages == []

    def test_default_is_logging(self, drive, caplog):
        with caplog.at_level(logging.INFO, "pymgsfm"):
            pymgsfm.configure_rigs(drive / "database.db")
        assert "12 frames" in caplog.text

    def test_exception_ends_the_run(self, drive, tmp_path):
        class Stop(Exception):
            pass

        def stop(stage, done, total):
            raise Stop(stage)

        with pytest.raises(Stop):
            pymgsfm.global_mapping(drive / "database.db", None,
                                   tmp_path / "out", progress=stop)
        assert not (tmp_path / "out").exists()

    def test_interrupt(self, tmp_path):
        # Long enough not to end before the signal.
        timer = threading.Timer(0.5, _thread.interrupt_main)
        timer.start()
        start = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            pymgsfm.simulate(tmp_path / "out", {"preset": "standard",
                                                "num_frames": 4000})
        timer.join()
        assert time.monotonic() - start < 5.0
        assert not (tmp_path / "out" / "database.db").exists()


def map_drive(drive, output):
    pymgsfm.global_mapping(drive / "database.db", None, output)


def test_two_threads_map_at_once(drive, sparse, tmp_path):
    outputs = [tmp_path / "a", tmp_path / "b"]
    threads = [threading.Thread(target=map_drive, args=(drive, output))
               for output in outputs]
    num_loops = 0
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        num_loops += 1  # runs only while the others do not hold the GIL
        time.sleep(0.001)
    assert num_loops > 50
    for output in outputs:
        assert read_files(output) == read_files(sparse)


def test_fork_after_a_run(drive, sparse, tmp_path):
    context = multiprocessing.get_context("fork")
    child = context.Process(target=map_drive, args=(drive, tmp_path / "child"))
    child.start()
    child.join(60)
    assert child.exitcode == 0
    assert read_files(tmp_path / "child") == read_files(sparse)


@pytest.fixture
def memory_path():
    """A folder without a disk, where flushing files takes no time."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        yield Path(folder)


def test_no_leak(memory_path):
    tmp_path = memory_path
    pymgsfm.simulate(tmp_path / "drive", {"num_frames": 4})

    def run(num_runs):
        for _ in range(num_runs):
            model = pymgsfm.global_mapping(tmp_path / "drive" / "database.db",
                                           None, tmp_path / "out",
                                           {"write_report": False,
                                            "num_threads": 1})[0]
            errors = pymgsfm.evaluate(tmp_path / "out" / "0",
                                      tmp_path / "drive" / "truth")
            assert errors and model.num_frames() == 4
        gc.collect()
        with open("/proc/self/statm") as statm:
            return (int(statm.read().split()[1])
                    * resource.getpagesize() / 2**20)

    before_mib = run(10)
    after_mib = run(100)
    # 100 leaked runs would be more: a model has 0.1 MiB, a database more.
    assert after_mib - before_mib < 8.0
