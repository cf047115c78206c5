#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Fails if a document names a command, option or value that the program lacks.

Commands in blocks of code are compared with docs/reference/options.md, and so
are options in running text: `--name value`, and `Section.name value`. Pages of
results and the changelog tell of earlier versions and are not checked.
"""

import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OPTIONS = "docs/reference/options.md"
SKIPPED = ("CHANGELOG.md", OPTIONS, "docs/results/")
# Options of COLMAP 3.8 that documents name.
OF_COLMAP = {"SiftMatching.max_error"}
# Flags that are not options of a command.
FLAGS = {"help", "help_all", "config_path", "dump_config", "version", "h"}
ROW = re.compile(r"^\| `([\w.]+)` \| .*? \| (.*?(?<!\\)) \|", re.M)
BLOCK = re.compile(r"^```\w*\n(.*?)^```$", re.M | re.S)
INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
SECTION = re.compile(r"[A-Z][A-Za-z]+\.[a-z]\w*")


def read_options():
    """{command: {option: the texts that it takes, or None}}"""
    options, common = {}, {}
    text = (ROOT / OPTIONS).read_text(encoding="utf-8")
    for part in re.split(r"^## ", text, flags=re.M)[1:]:
        name, _, rows = part.partition("\n")
        of_command = {}
        for option, values in ROW.findall(rows):
            choices = values.replace("\\|", "|").split("|")
            of_command[option] = set(choices) if len(choices) > 1 else None
        if name == "All commands":
            common = of_command
        else:
            options[name] = of_command
    assert len(options) > 20 and common
    return {name: {**common, **found} for name, found in options.items()}


def words_of(line):
    try:
        return shlex.split(line, comments=True)
    except ValueError:
        return line.split()


def problems_of_call(words, options):
    command = words[0]
    if command.startswith("-") or command in ("help", "version"):
        return
    if command not in options:
        if command.islower() and any(w.startswith("--") for w in words):
            yield f"no command {command}"
        return
    for word, value in zip(words[1:], [*words[2:], ""]):
        if word in ("|", "&&", ";", ">", "2>&1"):
            return
        if not word.startswith("--"):
            continue
        name, _, given = word[2:].partition("=")
        if name in FLAGS:
            continue
        if name not in options[command]:
            yield f"{command} has no option --{name}"
            continue
        yield from problem_of_value(name, given or value,
                                    options[command][name])


def problem_of_value(name, value, choices):
    if choices and re.fullmatch(r"[a-z_]+", value) and value not in choices:
        if not choices <= {"true", "false"} or value not in ("yes", "no"):
            yield f"--{name} is none of {', '.join(sorted(choices))}: {value}"


def problems_of_block(code, options):
    for line in code.replace("\\\n", " ").split("\n"):
        words = words_of(line)
        for i, word in enumerate(words[:-1]):
            is_first = i == 0 or words[i - 1] in ("|", "&&", "time", "do")
            if is_first and re.fullmatch(r"(.*/)?mgsfm", word):
                yield from problems_of_call(words[i + 1:], options)


def problems_of_text(code, all_options, other_text):
    """Of code in running text."""
    words = words_of(code)
    if not words:
        return
    if words[0] == "mgsfm" or words[0].startswith("scripts/"):
        return
    word = words[0][2:] if words[0].startswith("--") else words[0]
    name = word.split("=")[0]
    is_option = words[0].startswith("--") or SECTION.fullmatch(name)
    if not is_option or name in FLAGS or not re.fullmatch(r"[\w.]+", name):
        return
    if name in all_options:
        if len(words) == 2:
            choices = [of.get(name) for of in all_options[name]]
            if not any(not list(problem_of_value(name, words[1], c))
                       for c in choices):
                yield f"--{name} does not take {words[1]}"
    elif name not in other_text and name not in OF_COLMAP:
        yield f"no command has the option {name}"


def main():
    options = read_options()
    all_options = {}
    for of_command in options.values():
        for name in of_command:
            all_options.setdefault(name, []).append(of_command)
    files = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split("\n")
    # Options of scripts, and those that the program names a replacement for.
    other_text = "".join(
        (ROOT / name).read_text(encoding="utf-8") for name in files
        if re.match(r"(scripts|experiments|workflow|tests|bench|packaging)/.*"
                    r"\.(py|sh|h|cc)$|apps/mgsfm/help\.cc$", name)
        and (ROOT / name).is_file())
    num_problems = 0
    for name in files:
        if not name.endswith(".md") or name.startswith(SKIPPED):
            continue
        text = (ROOT / name).read_text(encoding="utf-8")
        found = [p for code in BLOCK.findall(text)
                 for p in problems_of_block(code, options)]
        for code in INLINE.findall(BLOCK.sub("", text)):
            found += problems_of_text(code, all_options, other_text)
            words = words_of(code)
            if words[:1] == ["mgsfm"] and len(words) > 1:
                found += problems_of_call(words[1:], options)
        for problem in found:
            print(f"{name}: {problem}", file=sys.stderr)
        num_problems += len(found)
    if num_problems == 0:
        print("commands and options in documents exist")
    return 1 if num_problems else 0


if __name__ == "__main__":
    sys.exit(main())
