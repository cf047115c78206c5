# SPDX-License-Identifier: BSD-3-Clause
"""Tests of the report page in Chromium.

  python3 -m pytest tests/addons/report_page --program build/release/apps/mgsfm/mgsfm \\
      [--pictures FOLDER]
"""
import pathlib
import subprocess
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parent))

import browser as browser_module  # noqa: E402


def pytest_addoption(parser):
    parser.addoption("--program", type=pathlib.Path, required=True,
                     help="the program mgsfm")
    parser.addoption("--pictures", type=pathlib.Path,
                     help="keep pictures of pages in this folder")


@pytest.fixture(scope="session")
def running_browser():
    with browser_module.Browser() as running:
        yield running


@pytest.fixture
def browser(running_browser):
    """A browser whose pages are closed after the test."""
    yield running_browser
    running_browser.close_pages()


@pytest.fixture
def pictures(request):
    """The path of a picture to keep, None if they are not wanted."""
    folder = request.config.getoption("--pictures")

    def path(name):
        if folder is None:
            return None
        folder.mkdir(parents=True, exist_ok=True)
        return folder / name

    return path


@pytest.fixture(scope="session")
def program(request):
    return request.config.getoption("--program").resolve()


@pytest.fixture(scope="session")
def mgsfm(program):
    """Runs the program with options; it must succeed."""

    def run(command, **options):
        words = [program, command]
        for name, value in options.items():
            words += [f"--{name}", str(value)]
        return subprocess.run(words, check=True, capture_output=True,
                              text=True)

    return run


@pytest.fixture
def report(mgsfm, browser, tmp_path):
    """Writes and opens the page of a model; returns the page and its path."""

    def make(model, **options):
        path = tmp_path / "report.html"
        mgsfm("report", input_path=model, output_path=path, **options)
        return browser.open(path.as_uri()), path

    return make
