# SPDX-License-Identifier: BSD-3-Clause
"""The code of the documentation runs, and its reference is up to date."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("page", ["guides/python.md", "tutorials/python.md"])
def test_code_blocks_run(page, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    text = (ROOT / "docs" / page).read_text()
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.M | re.S)
    assert len(blocks) >= 5
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    variables = {"__name__": page}
    for block in blocks:
        exec(compile(block, page, "exec"), variables)


def test_reference_is_up_to_date():
    script = ROOT / "scripts" / "python_reference.py"
    made = subprocess.run([sys.executable, str(script)], check=True,
                          stdout=subprocess.PIPE, text=True).stdout
    assert made == (ROOT / "docs" / "reference" / "python.md").read_text()
