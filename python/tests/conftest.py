# SPDX-License-Identifier: BSD-3-Clause
"""A small simulated drive, and the models of it by Python and by the program.

PYTHONPATH must name the folder with pymgsfm, MGSFM_EXECUTABLE the program.
"""

import os
import subprocess
from pathlib import Path

import pymgsfm
import pytest


def run_program(*arguments: object) -> str:
    """The output of the program, which must succeed."""
    command = [os.environ["MGSFM_EXECUTABLE"], *map(str, arguments)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, text=True)
    return done.stdout


@pytest.fixture(scope="session")
def drive(tmp_path_factory) -> Path:
    """A folder with database.db and truth/."""
    folder = tmp_path_factory.mktemp("drive")
    pymgsfm.simulate(folder, {"preset": "standard", "num_frames": 12,
                              "num_threads": 2})
    return folder


@pytest.fixture(scope="session")
def sparse(drive) -> Path:
    """The models by Python, in the folder `sparse` beside the database."""
    pymgsfm.global_mapping(drive / "database.db", None, drive / "sparse")
    return drive / "sparse"


@pytest.fixture(scope="session")
def model(sparse) -> pymgsfm.Reconstruction:
    return pymgsfm.Reconstruction(sparse / "0")
