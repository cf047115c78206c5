# SPDX-License-Identifier: BSD-3-Clause
"""Options and fixtures of the tests of experiments/.

Run them with scripts/test.sh, or by hand from the root of the repository:
  python3 -m pytest tests/experiments --program build/release/apps/mgsfm/mgsfm
Tests that need a program which is not given are skipped.
"""
import pathlib
import subprocess
import sys

import pytest

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY))


def pytest_addoption(parser):
    parser.addoption("--program", type=pathlib.Path,
                     help="the program mgsfm")
    parser.addoption("--oracle_benchmark", type=pathlib.Path,
                     help="the program mgsfm_oracle_benchmark")


def program_of(request, option):
    path = request.config.getoption(option)
    if path is None:
        pytest.skip(f"no {option}")
    return path.resolve()


@pytest.fixture
def program(request):
    """The absolute path of mgsfm."""
    return program_of(request, "--program")


@pytest.fixture
def oracle_benchmark(request):
    """The absolute path of mgsfm_oracle_benchmark."""
    return program_of(request, "--oracle_benchmark")


@pytest.fixture
def try_experiments():
    """Calls `python3 -m experiments WORDS...`, whatever comes of it."""
    def call(*words, cwd=None):
        return subprocess.run(
            [sys.executable, "-B", "-m", "experiments", *map(str, words)],
            env={"PYTHONPATH": str(REPOSITORY), "PATH": "/usr/bin:/bin"},
            capture_output=True, text=True, check=False, cwd=cwd)
    return call


@pytest.fixture
def run_experiments(try_experiments):
    """The same, but the call must succeed; returns the printed text."""
    def call(*words, cwd=None):
        done = try_experiments(*words, cwd=cwd)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout
    return call


@pytest.fixture
def simulate(program):
    """Simulates a short stereo drive in a folder."""
    def call(folder, *options):
        subprocess.run(
            list(map(str, [program, "simulate", "--log_level", "warning",
                           "--output_path", folder, "--num_frames", 12,
                           "--pixel_noise", 0.3, *options])), check=True)
        return folder
    return call
