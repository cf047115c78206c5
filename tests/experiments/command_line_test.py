# SPDX-License-Identifier: BSD-3-Clause
"""The subcommands, and errors before runs."""
import re

import pytest

from conftest import REPOSITORY
from experiments import command_line, requirements

SUBCOMMANDS = ("kitti_odometry", "kitti360", "eth3d_slam", "simulate_drives",
               "hardest_settings", "oracle_table", "robustness", "growth",
               "sub_maps", "bench", "compare_front_end", "use_cases")


def test_all_subcommands_are_listed(run_experiments):
    text = run_experiments("--help")
    for name in SUBCOMMANDS:
        assert f"    {name}" in text


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_help_has_an_example(name, capsys):
    with pytest.raises(SystemExit) as ended:
        command_line.parse([name, "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert f"python3 -m experiments {name} " in text
    # Each option says what it does.
    listed = text[text.index("\noptions:"):]
    for option in re.findall(r"^  (--\w+)", listed, re.MULTILINE):
        assert re.search(rf"^  {option}\b.*(  \w|\n {{20,}}\w)", listed,
                         re.MULTILINE), option


@pytest.mark.parametrize("name", SUBCOMMANDS)
def test_the_readme_has_an_example(name):
    readme = (REPOSITORY / "experiments/README.md").read_text()
    assert f"python3 -m experiments {name} " in readme


def test_words_behind_two_dashes_are_passed_on():
    arguments = command_line.parse(
        ["simulate_drives", "data", "tree", "--rig", "mono", "--",
         "--random_seed", "3"])
    assert arguments.passed_on == ["--random_seed", "3"]
    with pytest.raises(SystemExit):
        command_line.parse(["growth", "--", "--random_seed", "3"])


def test_numbers_must_be_positive():
    with pytest.raises(SystemExit):
        command_line.parse(["growth", "--threads", "0"])


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(requirements.importlib.util, "find_spec",
                        lambda name: None)
    with pytest.raises(SystemExit) as ended:
        requirements.require("matplotlib", "figures")
    assert "python3-matplotlib" in str(ended.value)
    assert "\n" not in str(ended.value)


@pytest.mark.parametrize("words", [
    ("kitti_odometry", "/no/data"), ("kitti360", "/no/data"),
    ("eth3d_slam", "/no/data"), ("robustness",),
    ("growth", "--figure", "a.svg")])
def test_matplotlib_is_checked_before_anything_else(words, monkeypatch):
    found = requirements.importlib.util.find_spec
    monkeypatch.setattr(requirements.importlib.util, "find_spec",
                        lambda name: None if name == "matplotlib"
                        else found(name))
    arguments = command_line.parse(list(words))
    with pytest.raises(SystemExit, match="Debian package python3-matplotlib"):
        arguments.run(arguments)


def test_figures_need_a_known_format(try_experiments):
    done = try_experiments("growth", "--figure", "a.jpg")
    assert done.returncode == 1
    assert "use .svg or .png" in done.stderr


def test_a_missing_program_is_named(try_experiments):
    done = try_experiments("growth", "--program", "/no/mgsfm")
    assert done.stderr.startswith("no program /no/mgsfm; build it with 'scripts")
    done = try_experiments("bench", "--program", "/bin/true",
                           "--solver_program", "/no/solver_benchmark")
    assert "MGSFM_BUILD_BENCHMARKS=ON" in done.stderr


def test_unknown_sweeps_and_cases_are_named(try_experiments):
    assert "unknown sweep 'a'" in try_experiments(
        "robustness", "--sweeps", "a").stderr
    assert "unknown case 'a'" in try_experiments("use_cases", "a").stderr
