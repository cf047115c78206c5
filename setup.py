# SPDX-License-Identifier: BSD-3-Clause
"""Builds the wheel of pymgsfm by CMake.

MGSFM_BUILD_DIR names a build folder to use, for example build/release.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = Path(__file__).resolve().parent


def version():
    text = (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    return re.search(r"project\(mgsfm VERSION ([\d.]+)", text)[1]


class CMakeBuild(build_ext):
    """Builds the target mgsfm_python and takes the files of its component."""

    def run(self):
        folder = Path(os.environ.get("MGSFM_BUILD_DIR",
                                     ROOT / "build" / "wheel")).resolve()
        subprocess.run(
            ["cmake", "-S", ROOT, "-B", folder, "-DCMAKE_BUILD_TYPE=Release",
             "-DMGSFM_BUILD_PYTHON=ON",
             f"-DPython3_EXECUTABLE={sys.executable}"], check=True)
        subprocess.run(["cmake", "--build", folder, "--target", "mgsfm_python",
                        "-j", str(os.cpu_count())], check=True)
        with tempfile.TemporaryDirectory() as prefix:
            subprocess.run(["cmake", "--install", folder, "--strip",
                            "--component", "python", "--prefix", prefix],
                           check=True)
            package, = Path(prefix).rglob("pymgsfm")
            shutil.copytree(package, Path(self.build_lib) / "pymgsfm",
                            dirs_exist_ok=True)


setup(version=version(), packages=[],
      ext_modules=[Extension("pymgsfm._core", [])],
      cmdclass={"build_ext": CMakeBuild})
