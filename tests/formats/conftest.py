# SPDX-License-Identifier: BSD-3-Clause
import pathlib
import subprocess

import colmap_files
import pytest


def pytest_addoption(parser):
    parser.addoption("--program", type=pathlib.Path, required=True,
                     help="the program mgsfm")


@pytest.fixture(scope="session")
def mgsfm(request):
    """Calls the program, which must succeed; returns what it prints."""
    path = request.config.getoption("--program").resolve()

    def call(*words):
        done = subprocess.run(list(map(str, [path, *words, "--quiet", 1])),
                              capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr
    return call


@pytest.fixture(scope="session")
def drive(mgsfm, tmp_path_factory):
    """A simulated stereo drive of twelve frames without noise."""
    folder = tmp_path_factory.mktemp("drive")
    mgsfm("simulate", "--rig", "stereo", "--num_frames", 12, "--output_path",
          folder)
    return folder


@pytest.fixture(scope="session")
def model(drive):
    """The true model, read from its definition."""
    return colmap_files.read_binary(drive / "truth")


@pytest.fixture
def convert(mgsfm, drive, tmp_path):
    """Converts the true model to a type."""
    def call(kind, *words):
        mgsfm("model_converter", "--input_path", drive / "truth",
              "--output_path", tmp_path / kind, "--output_type", kind, *words)
        return tmp_path / kind
    return call
