# SPDX-License-Identifier: BSD-3-Clause
import os
import subprocess
import sys
from pathlib import Path

import pymgsfm
import pytest

pytest.importorskip("mypy")


def test_package_and_example_are_typed(tmp_path):
    package = Path(pymgsfm.__file__).parent
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir",
         str(tmp_path), str(package),
         str(Path(__file__).parent / "typed_example.py")],
        stdout=subprocess.PIPE, text=True,
        env={**os.environ, "MYPYPATH": str(package.parent)})
    assert done.returncode == 0, done.stdout


def test_all_public_names_are_documented():
    for name in pymgsfm.__all__:
        item = getattr(pymgsfm, name)
        if callable(item):
            assert item.__doc__, name
