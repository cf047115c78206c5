# SPDX-License-Identifier: BSD-3-Clause
"""Options and fixtures of the tests on recorded data.

  python3 -m pytest tests/recordings --program build/release/apps/mgsfm/mgsfm
"""
import json
import os
import pathlib
import subprocess

import pytest

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]


def pytest_addoption(parser):
    parser.addoption("--program", type=pathlib.Path, required=True,
                     help="the program mgsfm")


@pytest.fixture(scope="session")
def mgsfm(request):
    """Runs the program with options; it must succeed."""
    program = request.config.getoption("--program").resolve()

    def run(command, **options):
        words = [program, command, "--num_threads", "2"]
        for name, value in options.items():
            words += [f"--{name}", str(value)]
        done = subprocess.run(words, capture_output=True, text=True,
                              check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


@pytest.fixture(scope="session")
def recording():
    """The folder of a recording, as FindSharedData() of shared_data.h."""

    def find(name):
        folder = pathlib.Path(os.environ.get(
            "MGSFM_SHARED_DATA",
            REPOSITORY.parent / "shared" / "data")) / name
        if not folder.is_dir():
            pytest.skip(f"no {name}; see tests/support/shared_data.h")
        return folder

    return find


@pytest.fixture
def evaluate(mgsfm, tmp_path):
    """The errors of a model, as model_evaluator writes them."""

    def call(model, **options):
        path = tmp_path / "errors.json"
        mgsfm("model_evaluator", input_path=model, json=path, **options)
        return json.loads(path.read_text(encoding="utf-8"))

    return call


@pytest.fixture(scope="session")
def expect_whole():
    """One model has all images, and exactly these causes are warned of;
    returns the report."""

    def check(sparse, num_images, warnings=()):
        report = json.loads(
            (sparse / "report.json").read_text(encoding="utf-8"))
        assert report["summary"]["num_registered_images"] == num_images
        assert len(report["models"]) == 1
        assert {w["cause"] for w in report["warnings"]} == set(warnings)
        return report

    return check
