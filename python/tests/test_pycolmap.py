# SPDX-License-Identifier: BSD-3-Clause
"""The table of pycolmap's names is true, and a script in its dialect runs."""

import re
import subprocess
import sys
from pathlib import Path

import pymgsfm
import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "pycolmap.md"
ROWS = [(re.findall(r"`([\w.]+)`", row[1]), row[2].strip())
        for row in (line.split("|") for line in PAGE.read_text().splitlines())
        if len(row) == 5 and row[2].strip() in ("yes", "no")]


def names_of_table():
    """Whether each name works; `.name` belongs to the class before it, whose
    own row is the first."""
    works = {}
    for names, word in ROWS:
        for name in names:
            if name.startswith("."):
                name = kind + name
            else:
                kind = name
            works.setdefault(name, word == "yes")
    return works


NAMES = names_of_table()


def exists(name):
    first, _, attribute = name.partition(".")
    if not attribute:
        return first in pymgsfm.__all__
    kind = getattr(pymgsfm, first)
    if hasattr(kind, attribute):
        return True
    arguments = ([pymgsfm.Reconstruction()] if first == "ObservationManager"
                 else [])
    return first != "Database" and hasattr(kind(*arguments), attribute)


@pytest.mark.parametrize("name,works", NAMES.items())
def test_name(name, works):
    assert exists(name) == works


def test_names_are_counted():
    assert (f"{sum(NAMES.values())} of {len(NAMES)} work"
            in PAGE.read_text())


def test_script(drive, sparse, tmp_path):
    done = subprocess.run(
        [sys.executable, str(Path(__file__).parent / "pycolmap_script.py"),
         str(sparse / "0"), str(drive / "database.db"), str(tmp_path / "out")],
        stdout=subprocess.PIPE, text=True)
    assert done.returncode == 0, done.stdout
    values = dict(re.findall(r"(\w+): ([\d.]+)", done.stdout))
    assert float(values["error_before_px"]) < 2.0
    assert float(values["error_after_px"]) < float(values["error_before_px"])
    assert int(values["num_filtered"]) > 0
    assert int(values["num_new_points"]) > 0
    assert float(values["resection_deg"]) < 0.2
    assert float(values["max_difference"]) < 0.1
    assert pymgsfm.Reconstruction(tmp_path / "out").num_reg_frames() == 12
