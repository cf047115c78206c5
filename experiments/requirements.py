# SPDX-License-Identifier: BSD-3-Clause
"""Checks for Python packages before runs start, not after hours of runs."""
import importlib.util
import sys

DEBIAN_PACKAGES = {"matplotlib": "python3-matplotlib", "numpy": "python3-numpy"}


def require(module, purpose):
    """Ends with one line that names the Debian package of a missing module."""
    if importlib.util.find_spec(module) is None:
        raise SystemExit(
            f"{purpose} need {module}, which {sys.executable} does not have; "
            f"install the Debian package {DEBIAN_PACKAGES[module]} and use "
            "/usr/bin/python3")
