# SPDX-License-Identifier: BSD-3-Clause
"""The driver of KITTI odometry, from the call to the tables."""
import json
import shutil
import subprocess

import pytest

METHODS = ("mgsfm,mma,hybrid_bilinear,hybrid_non_bilinear,"
           "hybrid_bilinear_averaged")
# Copies a model to where a peer is to write its own.
PEER = """\
#!/bin/sh
# DATABASE OUTPUT MODEL
test -s "$1" || exit 1
mkdir "$2/0"
cp "$3"/*.bin "$2/0"
"""


@pytest.fixture
def call(try_experiments, program):
    """The driver with the options of all tests."""
    def run(tree, work, *options, cwd=None):
        return try_experiments(
            "kitti_odometry", tree, "--methods", METHODS, "--work", work,
            "--program", program, "--threads", 2, "--no_pictures", *options,
            cwd=cwd)
    return run


def succeeded(done):
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def record_times(work):
    return {p.name: p.stat().st_mtime_ns for p in work.glob("00/*.json")}


def test_tables_and_resuming(call, simulate, tmp_path):
    simulate(tmp_path / "tree/sequences/00")
    work = tmp_path / "work"
    nothing = call(tmp_path / "tree", work, "--only_done")
    assert "nothing is done" in nothing.stderr
    first = succeeded(call(tmp_path / "tree", work))
    assert "24 of 24" in first
    times = record_times(work)
    second = succeeded(call(tmp_path / "tree", work))
    assert "Position error" in second
    assert record_times(work) == times
    for suffix in ("txt", "md", "csv", "tex"):
        assert (work / f"tables.{suffix}").exists()
    tables = json.loads((work / "tables.json").read_text())
    # mgsfm is a member of the ablation, and does not run twice.
    assert [record["method"] for record in tables["records"]] == [
        "mgsfm", "mma", "hybrid_bilinear", "hybrid_bilinear_averaged"]
    rows = {table["name"]: dict(zip(table["header"], table["rows"][0]))
            for table in tables["tables"]}
    assert (rows["ablation"]["hybrid_non_bilinear"]
            == rows["position_error"]["mgsfm"])
    # Bundle adjustment improves a short drive.
    mean = {record["method"]: record["errors"]["position_m"]["mean"]
            for record in tables["records"]}
    assert mean["hybrid_bilinear"] < mean["hybrid_bilinear_averaged"]
    for record in tables["records"]:
        assert record["exit_code"] == 0
        assert record["errors"]["num_registered"] == 24
        assert record["errors"]["position_m"]["mean"] < 0.1
        assert record["seconds_counted"] > 0.0


def test_failed_runs_leave_no_record(call, simulate, tmp_path):
    sequences = tmp_path / "tree/sequences"
    simulate(sequences / "00")
    simulate(sequences / "01")
    # An interrupted simulation leaves this folder.
    (sequences / ".02.mgsfm-part").mkdir()
    (sequences / "00/truth").rename(tmp_path / "truth")

    def try_again(*options):
        return call(tmp_path / "tree", tmp_path / "work", "--methods", "mgsfm",
                    *options)
    wrong = try_again("--mapper_options=--Mapper.no_such_option 1")
    assert not list(tmp_path.glob("work/*/*.json"))
    assert "no_such_option" in wrong.stdout
    assert "2 of the runs failed" in wrong.stderr
    stopped = try_again("--sequences", "01", "--time_limit", "0.001")
    assert "time limit" in stopped.stdout
    without_truth = try_again()
    # 01 ran though 00 could not be evaluated.
    assert without_truth.returncode == 1
    assert without_truth.stdout.count("24 of 24") == 1
    assert "1 of the runs failed" in without_truth.stderr
    (tmp_path / "truth").rename(sequences / "00/truth")
    # Only the evaluation is missing.
    assert succeeded(try_again()).count("24 of 24") == 1
    other = try_again("--mapper_options=--random_seed 3")
    assert other.returncode == 1
    assert "other options" in other.stdout


def test_relative_paths_and_figures(try_experiments, program, simulate,
                                    tmp_path):
    pytest.importorskip("matplotlib")
    simulate(tmp_path / "tree/sequences/00")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin/mgsfm").symlink_to(program)

    def call_here(*options):
        return succeeded(try_experiments(
            "kitti_odometry", "tree", "--methods", "mgsfm", "--work", "work",
            "--program", "bin/mgsfm", "--threads", 2, *options, cwd=tmp_path))
    assert "24 of 24" in call_here()
    pictures = tmp_path / "work/pictures"
    names = {f"{stem}.{suffix}" for suffix in ("svg", "png")
             for stem in ("00_paths", "00_errors", "runtime")}
    assert {path.name for path in pictures.iterdir()} == names
    assert all(path.stat().st_size > 1000 for path in pictures.iterdir())
    # The folder of results may move, and the model may go.
    (tmp_path / "work").rename(tmp_path / "moved")
    shutil.rmtree(tmp_path / "moved/00/mgsfm")
    assert "Position error" in call_here("--work", "moved", "--only_done")


def test_external_methods(call, simulate, tmp_path):
    simulate(tmp_path / "tree/sequences/00")
    work = tmp_path / "work"
    succeeded(call(tmp_path / "tree", work, "--methods", "mma"))
    script = tmp_path / "peer.sh"
    script.write_text(PEER)
    script.chmod(0o755)
    own = f"copy={script} {{database}} {{output}} {work}/00/mma/0"
    failing = "failing=/bin/false {database} {output}"
    silent = "silent=/bin/true {database} {output}"

    def run_all():
        return call(tmp_path / "tree", work, "--methods", "mma", "--external",
                    own, "--external", failing, "--external", silent)
    done = run_all()
    assert done.returncode == 1
    assert "2 of the runs failed" in done.stderr
    assert "copy: given by --external" in done.stdout
    assert "failed: exit code 1" in done.stdout
    assert "failed: it wrote no images.bin" in done.stdout
    # Failed methods run again.
    assert run_all().stdout.count("failed: ") == 2
    tables = json.loads((work / "tables.json").read_text())
    mma, copy, failed, _ = tables["records"]
    assert (copy["method"], failed["method"]) == ("copy", "failing")
    assert copy["errors"] == mma["errors"]
    assert copy["seconds_counted"] == copy["seconds"]
    assert not (work / "00/copy/database.db").exists()
    assert failed["exit_code"] == 1 and "model" not in failed
    rows = {t["name"]: dict(zip(t["header"], t["rows"][0]))
            for t in tables["tables"]}
    assert rows["registered"]["copy"] == "24 / 24"
    assert rows["registered"]["failing"] == "0 / 24"
    assert rows["registered"]["silent"] == "0 / 24"
    other = call(tmp_path / "tree", work, "--methods", "mma", "--external",
                 own + " again")
    assert other.returncode == 1
    assert "other options" in other.stdout


def test_errors_before_the_first_run(call, simulate, tmp_path):
    simulate(tmp_path / "tree/sequences/00")

    def error_of(*options, tree=tmp_path / "tree"):
        done = call(tree, tmp_path / "work", *options)
        assert done.returncode != 0
        assert not (tmp_path / "work").exists()
        (line,) = done.stderr.splitlines()
        return line
    assert "mmb" in error_of("--methods", "mmb")
    assert "does not use {output}" in error_of("--external", "a=b {database}")
    assert "no program /nothing" in error_of(
        "--external", "a=/nothing {database} {output}")
    assert "no program /nothing" in error_of("--program", "/nothing")
    assert "No such file" in error_of(tree=tmp_path / "no_tree")


@pytest.fixture
def recorded(program, tmp_path):
    """A tree with sequence 00 of small stereo images, without poses."""
    rendered = tmp_path / "rendered"
    subprocess.run(
        list(map(str, [program, "simulate", "--log_level", "warning",
                       "--output_path", rendered, "--render", 1,
                       "--render_scale", 0.3, "--render_samples", 1,
                       "--rig", "stereo", "--num_frames", 6])), check=True)
    folder = tmp_path / "tree/sequences/00"
    folder.mkdir(parents=True)
    lines = []
    for k, line in enumerate(
            (rendered / "cameras.txt").read_text().splitlines()):
        name, model, _, _, fx, fy, cx, cy = line.split()
        assert model == "PINHOLE"
        shutil.copytree(rendered / "images" / name, folder / f"image_{k}")
        lines.append(f"P{k}: {fx} 0 {cx} 0 0 {fy} {cy} 0 0 0 1 0\n")
    (folder / "calib.txt").write_text("".join(lines))
    return folder


def test_drives_without_poses(call, recorded, tmp_path):
    work = tmp_path / "work"
    out = succeeded(call(tmp_path / "tree", work, "--methods", "mgsfm"))
    assert "00: features and matches" in out
    (record,) = json.loads((work / "tables.json").read_text())["records"]
    assert "model" in record and "errors" not in record
    # Another choice of images needs another folder of results.
    (recorded / "image_0").joinpath(
        sorted(p.name for p in (recorded / "image_0").iterdir())[-1]).unlink()
    other = call(tmp_path / "tree", work, "--methods", "mgsfm")
    assert other.returncode == 1
    assert "made of other images or cameras" in other.stdout


def test_no_figure_of_a_path_without_poses(call, try_experiments, recorded,
                                           program, tmp_path):
    pytest.importorskip("matplotlib")
    work = tmp_path / "work"
    succeeded(call(tmp_path / "tree", work, "--methods", "mgsfm"))
    succeeded(try_experiments("kitti_odometry", tmp_path / "tree", "--work",
                              work, "--methods", "mgsfm", "--only_done"))
    assert {path.stem for path in (work / "pictures").iterdir()} == {"runtime"}
