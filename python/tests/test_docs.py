# SPDX-License-Identifier: BSD-3-Clause
"""The reference of the documentation is up to date."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_reference_is_up_to_date():
    script = ROOT / "scripts" / "python_reference.py"
    made = subprocess.run([sys.executable, str(script)], check=True,
                          stdout=subprocess.PIPE, text=True).stdout
    assert made == (ROOT / "docs" / "reference" / "python.md").read_text()
